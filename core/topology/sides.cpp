#include "core/topology/sides.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <bit>
#include <cmath>
#include <iterator>
#include <limits>

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_invoke.h>

#include "core/field/grid_field.h"
#include "core/parallel.h"
#include "core/sampling/brick_signs.h"
#include "core/topology/columns.h"

namespace isoskin {
namespace {

constexpr int kCells = BrickLattice::kCells;
constexpr int kCorners = BrickLattice::kCorners;
constexpr int kValues = BrickLattice::kValues;
constexpr std::size_t kSlopeBricks = 256;  // bricks the median slope is taken of, at least
constexpr int kSamples = 64;               // corners of a stretch without bricks that are evaluated
constexpr double kUntold = std::numeric_limits<double>::infinity();
constexpr double kLeastSlope = 0.5, kMostSlope = 2.0;  // of a grid of distances

void mark(std::uint8_t& flag) {
  std::atomic_ref<std::uint8_t>(flag).store(1, std::memory_order_relaxed);
}

/// The (n / 2)-th of n values that are not negative, in order of size.
double median_of(const std::vector<double>& values) {
  // By the first half of their bits as floats first: one bin of a few is left to be sorted.
  const auto bin = [](double value) { return std::bit_cast<std::uint32_t>(float(value)) >> 16; };
  std::vector<Index> count(1 << 16);
  for (const double value : values) ++count[bin(value)];
  std::size_t before = 0;
  std::uint32_t middle = 0;
  for (; before + count[middle] <= values.size() / 2; ++middle) before += count[middle];
  std::vector<double> some;
  std::copy_if(values.begin(), values.end(), std::back_inserter(some),
               [&](double value) { return bin(value) == middle; });
  const auto at = some.begin() + std::ptrdiff_t(values.size() / 2 - before);
  std::nth_element(some.begin(), at, some.end());
  return *at;
}

/// Median of the gradient's norm, by differences, over corners next to a crossing.
double median_slope(const BrickLattice& lattice) {
  constexpr std::array<int, 3> stride{kCorners * kCorners, kCorners, 1};
  const std::size_t every = 1 + lattice.brick_count() / kSlopeBricks;
  std::vector<std::vector<double>> of_brick((lattice.brick_count() + every - 1) / every);
  tbb::parallel_for(std::size_t{0}, of_brick.size(), [&](std::size_t i) {
    const float* const value = &lattice.value[i * every * kValues];
    const BrickSigns signs(value);
    if (!signs.mixed()) return;
    for (int x = 0; x < kCells; ++x)
      for (int y = 0; y < kCells; ++y) {
        const unsigned r = signs.at(x, y);
        unsigned crossing = ((r ^ signs.at(x + 1, y)) | (r ^ signs.at(x, y + 1)) | (r ^ r >> 1)) & 0xffu;
        for (; crossing; crossing &= crossing - 1) {
          const float* p = value + (x * kCorners + y) * kCorners + std::countr_zero(crossing);
          double squared = 0.0;
          for (const int s : stride) squared += (static_cast<double>(p[s]) - p[0]) * (static_cast<double>(p[s]) - p[0]);
          of_brick[i].push_back(squared);
        }
      }
  });
  std::vector<double> squares;
  for (const auto& of : of_brick) squares.insert(squares.end(), of.begin(), of.end());
  return squares.empty() ? 0.0 : std::sqrt(median_of(squares)) / lattice.spacing;
}

/// Everything a walk up the columns reads and reports to.
struct Walk {
  const TriangleMesh& mesh;
  const MeshPieces& pieces;
  const Field& field;
  const BrickLattice& lattice;
  const LatticeTopology& topology;
  const MeshColumns& columns;
  const FarCorners far;
  SideReport& report;
  std::atomic<std::size_t> wrong{0};
};

/// One lattice column, from below everything to above everything.
class Column {
public:
  Column(Walk& walk, std::size_t column, int row, Index next, Index end)
      : walk_(walk), column_(walk.columns.column[column]), row_(row), next_(next), end_(end) {}

  /// Corner z of a brick, with the crossing of the lattice edge below it.
  void corner(Index brick, int z) {
    const float* value = &walk_.lattice.value[std::size_t{brick} * kValues];
    const bool inside = value[row_ * kCorners + z] > 0;
    step(walk_.lattice.coordinate[brick].z * kCells + z, inside, brick, z);
    if (mismatch_ == 0) return;
    look_at(value[row_ * kCorners + z]);
    if (!walk_.far(value, x(), y(), z)) return;
    far_ = true;
    if (owned()) ++wrong;
  }

  /// Passes a brick that begins at corner `low`, from its corner `from` on, when nothing in it is to blame: mesh and
  /// field agree, but for corners near the surface in its midst. Else it stays before the brick.
  bool passes(Index brick, int low, int from, unsigned inside) {
    if (mismatch_ != 0) return false;
    Index next = next_;
    int winding = winding_;
    unsigned wound = winding_ != 0 ? kAll : 0;
    for (; next < end_ && crossing(next).first <= low + kCells; ++next) {
      winding += crossing(next).step;
      if (winding != 0 && winding != 1) return false;
      const unsigned above = kAll << std::max(0, crossing(next).first - low);
      wound = winding ? wound | above : wound & ~above;
    }
    unsigned differing = (wound ^ inside) & kAll & kAll << from;
    if (differing >> kCells) return false;
    const float* value = &walk_.lattice.value[std::size_t{brick} * kValues] + row_ * kCorners;
    for (; differing; differing &= differing - 1) {
      const double v = value[std::countr_zero(differing)];
      if (!(std::abs(v) <= walk_.far.threshold())) return false;
      look_at(v);
    }
    next_ = next;
    winding_ = winding;
    inside_ = inside >> kCells;
    return true;
  }

  /// Corners up to `last` that no brick covers: F keeps its sign.
  void gap(std::int32_t last) {
    while (next_ < end_ && crossing(next_).first <= last) {
      const std::int32_t from = crossing(next_).first;
      step(from, inside_, kNone, 0);
      if (mismatch_ == 0) continue;
      sample(from, next_ < end_ ? std::min(last, crossing(next_).first - 1) : last);
    }
  }
  /// Corners from..last of a gap, when something was wrong before it already.
  void gap_goes_on(std::int32_t from, std::int32_t last) {
    if (mismatch_ != 0) sample(from, next_ < end_ ? std::min(last, crossing(next_).first - 1) : last);
  }

  std::size_t wrong = 0;
  double worst = 0.0;  // see SideMemory

private:
  /// At a corner where mesh and field differ.
  void look_at(double value) {
    if (!(std::abs(value) <= worst)) worst = std::isnan(value) ? kUntold : std::abs(value);
  }

  static constexpr unsigned kAll = 0x1ff;  // of the corners of a row

  struct Causes {
    Index first = 0, last = 0;  // crossings
    Index piece = kNone;        // lattice piece whose crossing changed the sign
  };

  int x() const { return row_ / kCorners; }
  int y() const { return row_ % kCorners; }
  bool owned() const { return x() < kCells && y() < kCells; }
  const ColumnCrossing& crossing(Index i) const { return walk_.columns.crossing[i]; }

  void step(std::int32_t corner, bool inside, Index brick, int z) {
    Causes causes{next_, next_, kNone};
    for (; next_ < end_ && crossing(next_).first <= corner; ++next_) winding_ += crossing(next_).step;
    causes.last = next_;
    const bool turned = inside != inside_;
    inside_ = inside;
    const int mismatch = winding_ - inside;
    if (mismatch == mismatch_) return;
    if (turned && z > 0) causes.piece = walk_.topology.crossing_piece(brick, {x(), y(), z - 1}, 2);
    if (mismatch_ != 0 && far_) {
      blame(begun_);
      blame(causes);
    }
    begun_ = causes;
    far_ = false;
    mismatch_ = mismatch;
  }

  void sample(std::int32_t from, std::int32_t last) {
    worst = kUntold;
    const std::int32_t stride = std::max(1, (last - from) / kSamples);
    for (std::int32_t k = from; k <= last && !far_; k += stride) {
      const IVec3 corner(column_.x * kCells + x(), column_.y * kCells + y(), k);
      if (std::abs(walk_.field.value(walk_.lattice.point(corner))) <= walk_.far.threshold()) continue;
      far_ = true;
      if (owned()) ++wrong;
    }
  }

  void blame(const Causes& causes) {
    for (Index i = causes.first; i < causes.last; ++i)
      mark(walk_.report.mesh_piece[walk_.pieces.of_vertex[walk_.mesh.vertex[3 * crossing(i).triangle]]]);
    if (causes.piece != kNone) mark(walk_.report.lattice_piece[causes.piece]);
  }

  Walk& walk_;
  IVec3 column_;
  int row_;
  Index next_, end_;
  int winding_ = 0, mismatch_ = 0;
  bool inside_ = false, far_ = false;
  Causes begun_;
};

/// Returns the column's worst, see SideMemory.
double walk_column(Walk& walk, std::size_t c) {
  constexpr std::int32_t kTop = std::numeric_limits<std::int32_t>::max();
  const Index brick_end = walk.columns.first_brick[c + 1];
  Index next = walk.columns.first[c];
  std::size_t wrong = 0;
  double worst = 0.0;
  for (int row = 0; row < kCorners * kCorners; ++row) {
    Index end = next;
    while (end < walk.columns.first[c + 1] && walk.columns.crossing[end].row == row) ++end;
    Column column(walk, c, row, next, end);
    for (Index b = walk.columns.first_brick[c]; b < brick_end; ++b) {
      const int low = walk.lattice.coordinate[b].z * kCells;
      const bool adjoins =
          b > walk.columns.first_brick[c] && walk.lattice.coordinate[b - 1].z + 1 == walk.lattice.coordinate[b].z;
      if (!adjoins) {
        if (b > walk.columns.first_brick[c])
          column.gap_goes_on((walk.lattice.coordinate[b - 1].z + 1) * kCells + 1, low - 1);
        column.gap(low - 1);
      }
      if (column.passes(b, low, adjoins ? 1 : 0, walk.topology.signs[b].row[row])) continue;
      for (int z = adjoins ? 1 : 0; z < kCorners; ++z) column.corner(b, z);
    }
    column.gap(kTop);
    wrong += column.wrong;
    worst = std::max(worst, column.worst);
    next = end;
  }
  walk.wrong.fetch_add(wrong, std::memory_order_relaxed);
  return worst;
}

/// The first brick of each brick column, and their number.
std::vector<Index> first_bricks(const BrickLattice& lattice) {
  std::vector<Index> first;
  const auto& brick = lattice.coordinate;
  for (Index b = 0; b < brick.size(); ++b)
    if (b == 0 || brick[b].x != brick[b - 1].x || brick[b].y != brick[b - 1].y) first.push_back(b);
  first.push_back(static_cast<Index>(brick.size()));
  return first;
}

/// The bricks' x and y, of each brick column.
std::vector<glm::ivec2> columns_of(const BrickLattice& lattice, const std::vector<Index>& first_brick) {
  std::vector<glm::ivec2> column;
  for (std::size_t c = 0; c + 1 < first_brick.size(); ++c) column.emplace_back(lattice.coordinate[first_brick[c]]);
  return column;
}

/// The column of the lattice before that has the bricks first..end of this one and no others, else kNone.
Index column_before(const SideMemory& before, const BrickLattice& lattice, Index first, Index end) {
  const Index was = lattice.same_as[first];
  if (was == kNone) return kNone;
  for (Index b = first; b < end; ++b)
    if (lattice.same_as[b] != was + (b - first)) return kNone;
  const auto at = std::lower_bound(before.first_brick.begin(), before.first_brick.end(), was);
  const bool same = at != before.first_brick.end() && *at == was && *(at + 1) == was + (end - first);
  return same ? static_cast<Index>(at - before.first_brick.begin()) : kNone;
}

/// What prints go on from; nothing where all anew takes less.
std::optional<MeshChanges> changes_since(const SideMemory& before, const TriangleMesh& mesh,
                                         std::optional<MeshChanges> changes) {
  constexpr std::size_t kMostChanged = 2;  // one in so many triangles
  if (before.print.empty()) return std::nullopt;
  if (!changes) changes = mesh_changes(*before.mesh, mesh);
  return changes->fresh.size() * kMostChanged > mesh.triangle_count() ? std::nullopt : std::move(changes);
}

/// See column_prints().
std::vector<std::uint64_t> prints_now(const TriangleMesh& mesh, const BrickLattice& lattice, const SideMemory& before,
                                      const SideMemory& now) {
  if (!now.changes || before.column != now.column) return column_prints(mesh, lattice);
  std::vector<std::uint64_t> print = before.print;
  update_column_prints(*before.mesh, mesh, *now.changes, lattice, print);
  return print;
}

/// Fills `now`, but for what a walk has to find out.
void note_columns(const TriangleMesh& mesh, const BrickLattice& lattice, const SideMemory& before,
                  std::optional<MeshChanges> changes, SideMemory& now) {
  if (lattice.same_as.empty()) return;
  now.first_brick = first_bricks(lattice);
  now.column = columns_of(lattice, now.first_brick);
  now.changes = changes_since(before, mesh, std::move(changes));
  const bool same =
      now.changes && now.changes->gone.empty() && now.changes->fresh.empty() && before.mesh->id == mesh.vertices.id;
  tbb::parallel_invoke([&] { now.print = prints_now(mesh, lattice, before, now); },
                       [&] { now.mesh = same ? before.mesh : std::make_shared<const MeshCopy>(mesh); });
  now.worst.assign(now.print.size(), 0.0);
}

/// One byte a column: whether it has to be walked. Empty: all.
std::vector<std::uint8_t> columns_to_walk(const BrickLattice& lattice, double threshold, const SideMemory& before,
                                          SideMemory& now) {
  if (before.print.empty()) return {};
  std::vector<std::uint8_t> walk(now.print.size(), 1);
  for_each_index(walk.size(), [&](std::size_t c) {
    const Index old = column_before(before, lattice, now.first_brick[c], now.first_brick[c + 1]);
    if (old == kNone || before.print[old] != now.print[c] || !(before.worst[old] <= threshold)) return;
    now.worst[c] = before.worst[old];
    walk[c] = 0;
  });
  return walk;
}

}  // namespace

FarCorners::FarCorners(const Field& field, const BrickLattice& lattice, double tolerance)
    : tolerance_(tolerance), median_slope_(median_slope(lattice)), spacing_(lattice.spacing) {
  distances_ = dynamic_cast<const GridField*>(&field) && median_slope_ > kLeastSlope && median_slope_ < kMostSlope;
  if (distances_) median_slope_ = std::min(median_slope_, 1.0);
}

bool FarCorners::operator()(const float* value, int x, int y, int z) const {
  const double v = value[(x * kCorners + y) * kCorners + z];
  if (std::abs(v) <= threshold()) return false;
  if (distances_) return true;
  const int at[3] = {x, y, z}, stride[3] = {kCorners * kCorners, kCorners, 1};
  double squared = 0.0;
  for (int a = 0; a < 3; ++a) {
    const int low = at[a] > 0 ? -stride[a] : 0, high = at[a] < kCells ? stride[a] : 0;
    const float* p = value + (x * kCorners + y) * kCorners + z;
    const double slope = (p[high] - p[low]) / (spacing_ * (low && high ? 2 : 1));
    squared += slope * slope;
  }
  return v * v > tolerance_ * tolerance_ * squared;
}

bool FarCorners::is_far(double value, double slope, double share) const {
  return !(std::abs(value) <= share * tolerance_ * (distances_ ? median_slope_ : std::max(median_slope_, slope)));
}

SideReport check_sides(const TriangleMesh& mesh, const MeshPieces& pieces, const Field& field,
                       const BrickLattice& lattice, const LatticeTopology& topology, double tolerance,
                       SideMemory* memory, std::optional<MeshChanges> changes) {
  SideReport report;
  report.mesh_piece.assign(pieces.count(), 0);
  report.lattice_piece.assign(topology.piece_count(), 0);
  std::optional<FarCorners> far;
  SideMemory now;
  tbb::parallel_invoke([&] { far.emplace(field, lattice, tolerance); },
                       [&] {
                         if (memory) note_columns(mesh, lattice, *memory, std::move(changes), now);
                       });
  const std::vector<std::uint8_t> wanted =
      memory ? columns_to_walk(lattice, far->threshold(), *memory, now) : std::vector<std::uint8_t>{};
  const MeshColumns columns = cross_columns(mesh, lattice, wanted);
  Walk walk{mesh, pieces, field, lattice, topology, columns, *far, report};
  tbb::parallel_for(std::size_t{0}, columns.column.size(), [&](std::size_t c) {
    if (c < wanted.size() && !wanted[c]) return;
    const double worst = walk_column(walk, c);
    if (c < now.worst.size()) now.worst[c] = worst;
  });
  if (memory) *memory = std::move(now);
  report.checked = lattice.brick_count() * kCells * kCells * kCells;
  report.wrong = walk.wrong;
  return report;
}

}  // namespace isoskin
