#include "core/topology/changed_sides.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <tuple>

#include <tbb/parallel_for.h>

#include "core/topology/columns.h"

namespace isoskin {
namespace {

constexpr int kCells = BrickLattice::kCells;
constexpr int kCorners = BrickLattice::kCorners;

/// A far corner that changes sides.
struct Moved {
  IVec3 column{0};
  int row = 0, z = 0;
  Index set = kNone;
  int by = 0;  // the winding number
  bool inside = false;
};

/// Whether it is far from the surface; `corner`.inside is set then.
bool is_far(const Field& field, const BrickLattice& lattice, const FarCorners& far, Moved& corner) {
  const int x = corner.row / kCorners, y = corner.row % kCorners;
  for (const int brick_z : {corner.z >> 3, (corner.z - 1) >> 3}) {
    const Index brick = lattice.find({corner.column.x, corner.column.y, brick_z});
    if (brick == kNone) continue;
    const float* value = &lattice.value[std::size_t{brick} * BrickLattice::kValues];
    const IVec3 local(x, y, corner.z - kCells * brick_z);
    corner.inside = value[BrickLattice::corner_index(local)] > 0.0f;
    return far(value, local.x, local.y, local.z);
  }
  const double value = field.value(lattice.point(kCells * corner.column + IVec3(x, y, corner.z)));
  corner.inside = value > 0.0;
  return !(std::abs(value) <= far.threshold());
}

/// In order of columns.
std::vector<Moved> far_corners(const Difference& difference, const Field& field, const BrickLattice& lattice,
                               const FarCorners& far) {
  MeshColumns columns = cross_columns(difference.mesh, lattice);
  const auto set = [&](const ColumnCrossing& c) { return difference.set[c.triangle]; };
  std::vector<std::vector<Moved>> found(columns.column.size());
  tbb::parallel_for(std::size_t{0}, columns.column.size(), [&](std::size_t c) {
    const auto begin = columns.crossing.begin() + columns.first[c],
               end = columns.crossing.begin() + columns.first[c + 1];
    std::sort(begin, end, [&](const ColumnCrossing& p, const ColumnCrossing& q) {
      return std::tuple(p.row, set(p), p.first, p.triangle) < std::tuple(q.row, set(q), q.first, q.triangle);
    });
    int winding = 0;
    for (auto at = begin; at != end; ++at) {
      winding += at->step;
      if (winding == 0) continue;  // else the same set goes on
      for (int z = at->first; z < (at + 1)->first; ++z) {
        Moved corner{columns.column[c], at->row, z, set(*at), winding};
        if (is_far(field, lattice, far, corner)) found[c].push_back(corner);
      }
    }
  });
  std::vector<Moved> all;
  for (const auto& f : found) all.insert(all.end(), f.begin(), f.end());
  return all;
}

}  // namespace

std::vector<std::uint8_t> sets_gone_wrong(const Difference& difference, const TriangleMesh& before, const Field& field,
                                          const BrickLattice& lattice, const FarCorners& far) {
  std::vector<std::uint8_t> wrong(difference.sets, 0);
  const std::vector<Moved> moved = far_corners(difference, field, lattice, far);
  if (moved.empty()) return wrong;
  const MeshColumns columns = cross_columns(before, lattice);
  std::map<std::pair<int, int>, std::size_t> number;
  for (std::size_t c = 0; c < columns.column.size(); ++c) number[{columns.column[c].x, columns.column[c].y}] = c;
  for (const Moved& corner : moved) {
    int winding = corner.by;
    if (const auto at = number.find({corner.column.x, corner.column.y}); at != number.end())
      for (Index i = columns.first[at->second]; i < columns.first[at->second + 1]; ++i)
        if (const ColumnCrossing& c = columns.crossing[i]; c.row == corner.row && c.first <= corner.z)
          winding += c.step;
    wrong[corner.set] |= winding != int(corner.inside);
  }
  return wrong;
}

}  // namespace isoskin
