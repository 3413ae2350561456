#include "core/refine/wrong_corners.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <iterator>
#include <limits>
#include <tuple>
#include <utility>

#include "core/mesh/independent_edits.h"
#include "core/parallel.h"
#include "core/topology/columns.h"

namespace isoskin {
namespace {

constexpr double kMostAnew = 0.5;  // of the bricks: with more to look at all of them is cheaper

bool sooner(const IVec3& p, const IVec3& q) {
  return std::tie(p.x, p.y, p.z) < std::tie(q.x, q.y, q.z);
}

/// A stretch of each of a lattice's columns of bricks.
class ColumnStretches {
public:
  explicit ColumnStretches(const BrickLattice& lattice) : lattice_(lattice) {
    low_ = high_ = lattice.coordinate.empty() ? IVec3(0) : lattice.coordinate.front();
    for (const IVec3& c : lattice.coordinate) low_ = glm::min(low_, c), high_ = glm::max(high_, c);
    stretch_.resize(std::size_t(high_.x - low_.x + 1) * std::size_t(high_.y - low_.y + 1));
  }

  void mark(const IVec3& brick) {
    stretch_[index(brick.x, brick.y)].add(brick.z - 1, brick.z + 1);
    reach_.add(lattice_.box(brick).grown(2.0 * kBrick * lattice_.spacing));
  }
  /// What a change in the box may reach of all columns: what it turns lies within it or between such boxes.
  void mark(const Box& box) {
    const auto [bottom, top] = bricks(box.low.z - lattice_.origin.z, box.high.z - lattice_.origin.z);
    for_each_column(box, [&](std::size_t at) { stretch_[at].add(bottom, top); });
    reach_.add(box.grown(2.0 * kBrick * lattice_.spacing));
  }
  /// From brick z on.
  void lower(const IVec3& brick, int z) {
    stretch_[index(brick.x, brick.y)].add(z, z);
    reach_.add(lattice_.box({brick.x, brick.y, z}).grown(2.0 * kBrick * lattice_.spacing));
  }

  bool marked(const IVec3& brick) const {
    if (brick.x < low_.x || brick.y < low_.y || brick.x > high_.x || brick.y > high_.y) return false;
    const Stretch& s = stretch_[index(brick.x, brick.y)];
    return s.bottom <= brick.z && brick.z <= s.top;
  }
  bool reaches(const Box& box) const {
    if (glm::any(glm::lessThan(box.high, reach_.low)) || glm::any(glm::lessThan(reach_.high, box.low))) return false;
    const auto [bottom, top] = bricks(box.low.z - lattice_.origin.z, box.high.z - lattice_.origin.z);
    bool any = false;
    for_each_column(box,
                    [&](std::size_t at) { any = any || (stretch_[at].bottom <= top && bottom <= stretch_[at].top); });
    return any;
  }

private:
  static constexpr double kBrick = BrickLattice::kCells;

  struct Stretch {
    int bottom = std::numeric_limits<int>::max(), top = std::numeric_limits<int>::min();
    void add(int from, int to) { bottom = std::min(bottom, from), top = std::max(top, to); }
  };

  std::size_t index(int x, int y) const {
    return std::size_t(x - low_.x) * std::size_t(high_.y - low_.y + 1) + std::size_t(y - low_.y);
  }
  /// Bricks have their sides in common, and coordinates are rounded: one corner more on each side.
  std::pair<int, int> bricks(double low, double high) const {
    const double over = 1.0 / lattice_.spacing;
    const auto brick = [&](double corner, double slack) {
      return int(std::floor(std::clamp(corner * over + slack, -1e9, 1e9) / BrickLattice::kCells));
    };
    return {brick(low, -1.0), brick(high, 1.0)};
  }
  template <class Visit>
  void for_each_column(const Box& box, const Visit& visit) const {
    const auto [x0, x1] = bricks(box.low.x - lattice_.origin.x, box.high.x - lattice_.origin.x);
    const auto [y0, y1] = bricks(box.low.y - lattice_.origin.y, box.high.y - lattice_.origin.y);
    for (int x = std::max(low_.x, x0); x <= std::min(high_.x, x1); ++x)
      for (int y = std::max(low_.y, y0); y <= std::min(high_.y, y1); ++y) visit(index(x, y));
  }

  const BrickLattice& lattice_;
  IVec3 low_{0}, high_{0};
  std::vector<Stretch> stretch_;
  Box reach_;  // at least what lies in any of them
};

/// The stretches' bricks, and the triangles that meet them.
struct Section {
  TriangleMesh mesh;
  BrickLattice lattice;
  std::vector<Index> brick;  // numbers in the whole lattice
  std::vector<BrickSigns> signs;
  std::vector<std::uint8_t> anchored;
};

Section section(const RefinedSkin& skin, const BrickLattice& lattice, const LatticeTopology& topology,
                const ColumnStretches& columns) {
  Section out;
  out.mesh = skin.triangles_where([&](const Box& box) { return columns.reaches(box); });
  out.lattice.origin = lattice.origin;
  out.lattice.spacing = lattice.spacing;
  out.brick = indices_where(lattice.brick_count(), [&](Index b) { return columns.marked(lattice.coordinate[b]); });
  for (const Index b : out.brick) {
    const IVec3& at = lattice.coordinate[b];
    const bool lowest = out.lattice.coordinate.empty() || out.lattice.coordinate.back().x != at.x ||
                        out.lattice.coordinate.back().y != at.y;
    const bool of_column = b == 0 || lattice.coordinate[b - 1].x != at.x || lattice.coordinate[b - 1].y != at.y;
    out.anchored.push_back(lowest && !of_column);  // below all of a column there is nothing that winds
    out.lattice.coordinate.push_back(at);
    out.signs.push_back(topology.signs[b]);
  }
  return out;
}

/// Of the rows, whose bricks are in order: those that differ at their lowest corner.
std::vector<IVec3> unsure_bricks(const std::vector<DifferingRow>& rows, const BrickLattice& lattice) {
  std::vector<IVec3> bricks;
  for (const DifferingRow& row : rows)
    if (row.corners & 1) bricks.push_back(lattice.coordinate[row.brick]);
  return bricks;
}

}  // namespace

void WrongCorners::look(const TriangleMesh& mesh, const Field& field, const BrickLattice& lattice,
                        const LatticeTopology& topology, double least) {
  const std::vector<DifferingRow> rows = differing_rows(mesh, lattice, topology.signs);
  corner_ = find(rows, field, lattice, least);
  unsure_ = unsure_bricks(rows, lattice);
  known_ = true;
}

bool WrongCorners::update_part(const RefinedSkin& skin, const Field& field, const FieldChanges* changes,
                               const BrickLattice& lattice, const LatticeTopology& topology, double least) {
  const auto& changed = skin.changed();
  const bool still = changes && changes->none();
  const bool goes_on = known_ && changed && changes && !changes->everywhere && !changes->rounded_anew &&
                       (still || lattice.same_as.size() == lattice.brick_count());
  if (!goes_on) return false;
  if (still && changed->empty()) return true;
  ColumnStretches columns(lattice);
  std::vector<std::uint8_t> other(lattice.brick_count(), 0);  // than it was
  for (const Box& box : *changed) columns.mark(box);
  const ChangeMask mask(*changes, 0.0);
  for (Index b = 0; b < lattice.brick_count() && !still; ++b) {
    other[b] = lattice.same_as[b] == kNone || mask.overlaps(lattice.box(lattice.coordinate[b]));
    if (other[b]) columns.mark(lattice.coordinate[b]);
  }
  // A stretch begins where mesh and field agree, as they did.
  for (Index b = Index(lattice.brick_count()); b-- > 1;) {
    const IVec3 &at = lattice.coordinate[b], &below = lattice.coordinate[b - 1];
    const bool lowest = columns.marked(at) && at.x == below.x && at.y == below.y && !columns.marked(below);
    if (lowest && (other[b] || std::binary_search(unsure_.begin(), unsure_.end(), at, sooner)))
      columns.lower(below, below.z);
  }
  const std::vector<Index> marked =
      indices_where(lattice.brick_count(), [&](Index b) { return columns.marked(lattice.coordinate[b]); });
  if (double(marked.size()) > kMostAnew * double(lattice.brick_count())) return false;
  const Section part = section(skin, lattice, topology, columns);
  std::vector<DifferingRow> rows = differing_rows(part.mesh, part.lattice, part.signs, part.anchored);
  for (DifferingRow& row : rows) row.brick = part.brick[row.brick];
  const auto looked_at = [&](const IVec3& brick) { return columns.marked(brick) || lattice.find(brick) == kNone; };
  std::erase_if(corner_, [&](const Corner& c) { return looked_at(c.brick); });
  std::erase_if(unsure_, looked_at);
  const std::vector<Corner> fresh = find(rows, field, lattice, least);
  std::vector<Corner> corners;
  std::merge(corner_.begin(), corner_.end(), fresh.begin(), fresh.end(), std::back_inserter(corners),
             [](const Corner& p, const Corner& q) { return sooner(p.brick, q.brick); });
  corner_ = std::move(corners);
  const std::vector<IVec3> fresh_unsure = unsure_bricks(rows, lattice);
  std::vector<IVec3> unsure;
  std::merge(unsure_.begin(), unsure_.end(), fresh_unsure.begin(), fresh_unsure.end(), std::back_inserter(unsure),
             sooner);
  unsure_ = std::move(unsure);
  return true;
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
  for_each_heavy(candidates.size(), [&](std::size_t i) {
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
