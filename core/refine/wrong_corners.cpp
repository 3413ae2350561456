#include "core/refine/wrong_corners.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <iterator>
#include <tuple>

#include "core/mesh/independent_edits.h"
#include "core/parallel.h"
#include "core/topology/columns.h"

namespace isoskin {
namespace {

constexpr double kMostAnew = 0.5;  // of the columns: with more to look at all of them is cheaper

/// Some of a lattice's columns of bricks, as a raster.
class ColumnMask {
public:
  explicit ColumnMask(const BrickLattice& lattice) : lattice_(lattice) {
    low_ = high_ = lattice.coordinate.empty() ? IVec3(0) : lattice.coordinate.front();
    for (const IVec3& c : lattice.coordinate) low_ = glm::min(low_, c), high_ = glm::max(high_, c);
    marked_.assign(std::size_t(high_.x - low_.x + 1) * std::size_t(high_.y - low_.y + 1), 0);
  }

  void mark(const IVec3& brick) {
    marked_[index(brick.x, brick.y)] = 1;
    reach_.add(lattice_.box(brick).grown(lattice_.spacing));
  }
  /// All columns that this reaches.
  void mark(const Box& box) {
    for_each_column(box, [&](std::size_t at) { marked_[at] = 1; });
    // To the far sides of those columns.
    reach_.add(box.grown((BrickLattice::kCells + 2) * lattice_.spacing));
  }
  bool marked(const IVec3& brick) const { return within(brick) && marked_[index(brick.x, brick.y)]; }
  bool reaches(const Box& box) const {
    if (box.high.x < reach_.low.x || box.low.x > reach_.high.x || box.high.y < reach_.low.y ||
        box.low.y > reach_.high.y)
      return false;
    bool any = false;
    for_each_column(box, [&](std::size_t at) { any = any || marked_[at]; });
    return any;
  }
  double share() const {
    return double(std::count(marked_.begin(), marked_.end(), 1)) / std::max(1.0, double(marked_.size()));
  }

private:
  bool within(const IVec3& c) const { return c.x >= low_.x && c.y >= low_.y && c.x <= high_.x && c.y <= high_.y; }
  std::size_t index(int x, int y) const {
    return std::size_t(x - low_.x) * std::size_t(high_.y - low_.y + 1) + std::size_t(y - low_.y);
  }

  /// Columns have their sides in common, and coordinates are rounded: one corner more on each side.
  template <class Visit>
  void for_each_column(const Box& box, const Visit& visit) const {
    const double over = 1.0 / lattice_.spacing;
    const auto brick = [&](double corner, double slack) {
      return int(std::floor(std::clamp(corner * over + slack, -1e9, 1e9) / BrickLattice::kCells));
    };
    const int x0 = std::max(low_.x, brick(box.low.x - lattice_.origin.x, -1.0));
    const int x1 = std::min(high_.x, brick(box.high.x - lattice_.origin.x, 1.0));
    const int y0 = std::max(low_.y, brick(box.low.y - lattice_.origin.y, -1.0));
    const int y1 = std::min(high_.y, brick(box.high.y - lattice_.origin.y, 1.0));
    for (int x = x0; x <= x1; ++x)
      for (int y = y0; y <= y1; ++y) visit(index(x, y));
  }

  const BrickLattice& lattice_;
  IVec3 low_{0}, high_{0};
  std::vector<std::uint8_t> marked_;
  Box reach_;  // in x and y at least what the marked columns hold
};

/// The triangles that the columns meet, and the columns' bricks.
struct Section {
  TriangleMesh mesh;
  BrickLattice lattice;
  std::vector<Index> brick;  // numbers in the whole lattice
  std::vector<BrickSigns> signs;
};

Section section(const RefinedSkin& skin, const BrickLattice& lattice, const LatticeTopology& topology,
                const ColumnMask& columns) {
  Section out;
  out.mesh = skin.triangles_where([&](const Box& box) { return columns.reaches(box); });
  out.lattice.origin = lattice.origin;
  out.lattice.spacing = lattice.spacing;
  out.brick = indices_where(lattice.brick_count(), [&](Index b) { return columns.marked(lattice.coordinate[b]); });
  for (const Index b : out.brick) {
    out.lattice.coordinate.push_back(lattice.coordinate[b]);
    out.signs.push_back(topology.signs[b]);
  }
  return out;
}

}  // namespace

void WrongCorners::look(const TriangleMesh& mesh, const Field& field, const BrickLattice& lattice,
                        const LatticeTopology& topology, double least) {
  corner_ = find(differing_rows(mesh, lattice, topology.signs), field, lattice, least);
  known_ = true;
}

void WrongCorners::update(const RefinedSkin& skin, const Field& field, const FieldChanges* changes,
                          const BrickLattice& lattice, const LatticeTopology& topology, double least) {
  const auto& changed = skin.changed();
  const bool still = changes && !changes->everywhere && !changes->rounded_anew && changes->box.empty();
  const bool goes_on = known_ && changed && changes && !changes->everywhere && !changes->rounded_anew &&
                       (still || lattice.same_as.size() == lattice.brick_count());
  if (goes_on && still && changed->empty()) return;
  ColumnMask columns(lattice);
  if (goes_on) {
    for (const Box& box : *changed) columns.mark(box);
    const ChangeMask mask(*changes, 0.0);
    for (Index b = 0; b < lattice.brick_count() && !still; ++b)
      if (lattice.same_as[b] == kNone || mask.overlaps(lattice.box(lattice.coordinate[b])))
        columns.mark(lattice.coordinate[b]);
  }
  if (!goes_on || columns.share() > kMostAnew) return look(skin.mesh().mesh, field, lattice, topology, least);
  const Section part = section(skin, lattice, topology, columns);
  std::vector<DifferingRow> rows = differing_rows(part.mesh, part.lattice, part.signs);
  for (DifferingRow& row : rows) row.brick = part.brick[row.brick];
  const std::vector<Corner> fresh = find(rows, field, lattice, least);
  std::vector<Corner> all;
  std::erase_if(corner_, [&](const Corner& c) { return columns.marked(c.brick) || lattice.find(c.brick) == kNone; });
  const auto sooner = [](const Corner& p, const Corner& q) {
    return std::tie(p.brick.x, p.brick.y, p.brick.z, p.corner) < std::tie(q.brick.x, q.brick.y, q.brick.z, q.corner);
  };
  std::merge(corner_.begin(), corner_.end(), fresh.begin(), fresh.end(), std::back_inserter(all), sooner);
  corner_ = std::move(all);
}

std::vector<WrongCorners::Corner> WrongCorners::find(const std::vector<DifferingRow>& rows, const Field& field,
                                                     const BrickLattice& lattice, double least) {
  constexpr int kSide = BrickLattice::kCorners;
  struct Candidate {
    Index brick;
    int corner;
    DVec3 point;
    float value;
  };
  std::vector<Candidate> candidates;
  for (const DifferingRow& row : rows)
    for (unsigned bits = row.corners; bits; bits &= bits - 1) {
      const IVec3 local(row.row / kSide, row.row % kSide, std::countr_zero(bits));
      const int corner = BrickLattice::corner_index(local);
      const float value = lattice.value[std::size_t(row.brick) * BrickLattice::kValues + std::size_t(corner)];
      if (field.resolution() > 0.0 && std::abs(double(value)) <= least) continue;  // without asking for the slope
      const IVec3 at = BrickLattice::kCells * lattice.coordinate[row.brick] + local;
      candidates.push_back({row.brick, corner, lattice.point(at), value});
    }
  std::vector<double> distance(candidates.size());
  for_each_index(candidates.size(), [&](std::size_t i) {
    const double slope = glm::length(field.sample(candidates[i].point).gradient);
    distance[i] = distance_estimate(candidates[i].value, slope, field.resolution());
  });
  std::vector<Corner> wrong;
  for (std::size_t i = 0; i < candidates.size(); ++i)
    if (const Candidate& c = candidates[i]; distance[i] > least)
      wrong.push_back({lattice.coordinate[c.brick], c.corner, Vec3(c.point), distance[i]});
  return wrong;
}

std::vector<Vec3> WrongCorners::farther_than(double distance) const {
  std::vector<Vec3> points;
  for (const Corner& c : corner_)
    if (c.distance > distance) points.push_back(c.point);
  return points;
}

}  // namespace isoskin
