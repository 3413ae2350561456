#include "core/topology/columns.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <bit>
#include <cmath>
#include <limits>
#include <numeric>
#include <span>
#include <stdexcept>
#include <tuple>

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include "core/mesh/independent_edits.h"
#include "core/parallel.h"

namespace isoskin {
namespace {

constexpr int kCells = BrickLattice::kCells;
constexpr int kCorners = BrickLattice::kCorners;
constexpr int kFraction = 20;  // bits after the point of a rounded coordinate
constexpr double kCorner = 1 << kFraction;
constexpr double kFarthest = 1 << 23;           // lattice corners
constexpr std::int64_t kShortSpan = 1ll << 30;  // products of spans below this fit 64 bits
constexpr std::size_t kChunk = 512;             // triangles
constexpr std::size_t kFewChunk = 256;          // where only some are looked at
constexpr int kHits = 16;                       // columns looked at at a time

/// A vertex in lattice coordinates.
struct Rounded {
  std::int64_t x, y;  // times 2^kFraction
  double z;
};

/// A crossing and the number of its brick column, kNone where that is not one of the lattice's.
struct Found {
  ColumnCrossing crossing;
  Index column;
};

/// In lattice coordinates, not rounded yet.
DVec3 in_lattice(const BrickLattice& lattice, const Vec3& position, std::size_t v) {
  const DVec3 q = (DVec3(position) - lattice.origin) / lattice.spacing;
  if (!(glm::all(glm::lessThan(glm::abs(q), DVec3(kFarthest)))))
    throw std::invalid_argument("mesh vertex " + std::to_string(v) + " is too far away for the lattice");
  return q;
}

/// std::llround(), which takes a call.
std::int64_t round_half_away(double x) {
  const std::int64_t towards_zero = static_cast<std::int64_t>(x);
  const double rest = x - static_cast<double>(towards_zero);
  return towards_zero + (rest >= 0.5) - (rest <= -0.5);
}

Rounded round_vertex(const BrickLattice& lattice, const Vec3& position, std::size_t v) {
  const DVec3 q = in_lattice(lattice, position, v);
  return {round_half_away(kCorner * q.x), round_half_away(kCorner * q.y), q.z};
}

std::vector<Rounded> round_vertices(const TriangleMesh& mesh, const BrickLattice& lattice) {
  std::vector<Rounded> out(mesh.vertex_count());
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, out.size(), kChunk), [&](const auto& range) {
    for (std::size_t v = range.begin(); v != range.end(); ++v)
      out[v] = round_vertex(lattice, mesh.vertices.position[v], v);
  });
  return out;
}

std::int64_t ceil_corner(std::int64_t v) {
  return (v + (std::int64_t{1} << kFraction) - 1) >> kFraction;
}
std::int64_t floor_corner(std::int64_t v) {
  return v >> kFraction;
}

/// Corner columns within a triangle's bounds.
struct Reach {
  glm::ivec2 low, high;

  Reach(const Rounded& a, const Rounded& b, const Rounded& c)
      : low(ceil_corner(std::min({a.x, b.x, c.x})), ceil_corner(std::min({a.y, b.y, c.y}))),
        high(floor_corner(std::max({a.x, b.x, c.x})), floor_corner(std::max({a.y, b.y, c.y}))) {}
  bool empty() const { return low.x > high.x || low.y > high.y; }

  /// Calls visit(brick column) until it returns true; whether it did.
  template <class Visit>
  bool any_brick_column(const Visit& visit) const {
    for (int x = (low.x - 1) >> 3; x <= high.x >> 3; ++x)
      for (int y = (low.y - 1) >> 3; y <= high.y >> 3; ++y)
        if (visit(IVec3(x, y, 0))) return true;
    return false;
  }
};

/// A bijection that leaves no trace of order (Steele, Lea and Flood 2014, SplitMix64).
std::uint64_t mixed(std::uint64_t v) {
  v += 0x9E3779B97F4A7C15ull;
  v = (v ^ v >> 30) * 0xBF58476D1CE4E5B9ull;
  v = (v ^ v >> 27) * 0x94D049BB133111EBull;
  return v ^ v >> 31;
}

std::uint64_t vertex_print(const Rounded& v) {
  return mixed(mixed(mixed(std::uint64_t(v.x)) + std::uint64_t(v.y)) + std::bit_cast<std::uint64_t>(v.z));
}
std::uint64_t triangle_print(std::uint64_t a, std::uint64_t b, std::uint64_t c) {
  return mixed(mixed(mixed(a) + b) + c);
}

/// Finds brick columns' numbers: in a table, or, where columns lie far apart, by hashing them.
class ColumnNumbers {
public:
  explicit ColumnNumbers(const std::vector<IVec3>& columns) {
    constexpr std::size_t kMostEntries = 64;  // of the table, a column
    if (columns.empty()) return;
    glm::ivec2 high(columns.front());
    low_ = high;
    for (const IVec3& c : columns) low_ = glm::min(low_, glm::ivec2(c)), high = glm::max(high, glm::ivec2(c));
    size_ = high - low_ + 1;
    if (std::size_t(size_.x) * std::size_t(size_.y) > kMostEntries * columns.size()) {
      hashed_.coordinate = columns;
      hashed_.build_index();
      return;
    }
    table_.assign(std::size_t(size_.x) * std::size_t(size_.y), kNone);
    for (Index c = 0; c < columns.size(); ++c) table_[place(glm::ivec2(columns[c]) - low_)] = c;
  }

  /// kNone where there is no such column.
  Index of(const IVec3& column) const {
    const glm::ivec2 at = glm::ivec2(column) - low_;
    if (at.x < 0 || at.y < 0 || at.x >= size_.x || at.y >= size_.y) return kNone;
    return table_.empty() ? hashed_.find(column) : table_[place(at)];
  }
  bool is_table() const { return !table_.empty(); }
  /// All lie within low() .. low() + size() - 1.
  const glm::ivec2& low() const { return low_; }
  const glm::ivec2& size() const { return size_; }

private:
  std::size_t place(const glm::ivec2& at) const { return std::size_t(at.x) * std::size_t(size_.y) + std::size_t(at.y); }

  glm::ivec2 low_{0}, size_{0};
  std::vector<Index> table_;
  BrickLattice hashed_;
};

/// Adds a triangle's print, or what undoes it, to the sums of the columns it may cross.
void add_print(const Reach& reach, std::uint64_t print, const ColumnNumbers& numbers, std::vector<std::uint64_t>& sum) {
  if (reach.empty()) return;
  reach.any_brick_column([&](const IVec3& column) {
    const Index number = numbers.of(column);
    if (number != kNone) std::atomic_ref(sum[number]).fetch_add(print, std::memory_order_relaxed);
    return false;
  });
}

/// An edge from p to q seen from the columns of one x after another, upwards in y.
template <class Wide>
class Side {
public:
  Side(const Rounded& p, const Rounded& q) : ux_(q.x - p.x), uy_(q.y - p.y), px_(p.x), py_(p.y) {
    const Wide decides = uy_ != 0 ? -uy_ : ux_;
    tie_ = decides > 0 ? 1 : decides < 0 ? -1 : 0;
  }
  void move_to(std::int64_t x, std::int64_t y) { value_ = ux_ * (y - py_) - uy_ * (x - px_); }
  void step() { value_ += ux_ * kOne; }

  /// Twice the signed area of p, q and the column.
  Wide value() const { return value_; }
  /// Its sign, never 0, once the column has moved by (eps, eps^2).
  Wide signed_value() const { return 2 * value_ + tie_; }
  /// An edge along z, which no column tells from a point.
  bool vanishes() const { return tie_ == 0; }

private:
  static constexpr Wide kOne = Wide{1} << kFraction;
  Wide ux_, uy_, value_ = 0;
  std::int64_t px_, py_;
  int tie_;
};

/// Collects crossings of a run of triangles.
class Finder {
public:
  /// `numbers`: of the lattice's brick columns. `wanted`: as cross_columns() has it.
  Finder(const ColumnNumbers& numbers, const std::vector<std::uint8_t>& wanted)
      : numbers_(&numbers), wanted_(&wanted) {}

  void triangle(const Rounded& a, const Rounded& b, const Rounded& c, Index triangle) {
    const Reach reach(a, b, c);
    if (reach.empty() || !is_wanted(reach)) return;
    const auto [x0, x1] = std::minmax({a.x, b.x, c.x});
    const auto [y0, y1] = std::minmax({a.y, b.y, c.y});
    if (x1 - x0 < kShortSpan && y1 - y0 < kShortSpan)
      cross<std::int64_t>(a, b, c, triangle, reach.low, reach.high);
    else
      cross<__int128>(a, b, c, triangle, reach.low, reach.high);
  }

  std::vector<Found> found;
  std::vector<std::pair<std::size_t, IVec3>> stray;  // positions in `found`: crossings in other columns, and these

private:
  bool is_wanted(const Reach& reach) {
    return wanted_->empty() || reach.any_brick_column([&](const IVec3& column) {
      const Index number = numbers_->of(column);
      return number == kNone || (*wanted_)[number];
    });
  }

  /// Columns low..high through the triangle.
  template <class Wide>
  void cross(const Rounded& a, const Rounded& b, const Rounded& c, Index triangle, const glm::ivec2& low,
             const glm::ivec2& high) {
    Side<Wide> bc(b, c), ca(c, a), ab(a, b);
    if (bc.vanishes() || ca.vanishes() || ab.vanishes()) return;
    const double lowest = std::min({a.z, b.z, c.z}), highest = std::max({a.z, b.z, c.z});
    struct Hit {
      Wide a, b, c;
      int y;
    };
    std::array<Hit, kHits> hit;
    for (int x = low.x; x <= high.x; ++x) {
      for (Side<Wide>* side : {&bc, &ca, &ab})
        side->move_to(std::int64_t{x} << kFraction, std::int64_t{low.y} << kFraction);
      for (int y = low.y; y <= high.y;) {
        int hits = 0;  // gathered without a branch: no processor foresees which columns meet the triangle
        for (const int end = std::min(high.y, y + kHits - 1); y <= end; ++y, bc.step(), ca.step(), ab.step()) {
          hit[hits] = {bc.value(), ca.value(), ab.value(), y};
          const Wide sign = bc.signed_value();
          hits += ((sign ^ ca.signed_value()) | (sign ^ ab.signed_value())) >= 0;
        }
        for (int i = 0; i < hits; ++i) {
          const double wa = static_cast<double>(hit[i].a), wb = static_cast<double>(hit[i].b),
                       wc = static_cast<double>(hit[i].c);
          const double z = std::clamp((wa * a.z + wb * b.z + wc * c.z) / (wa + wb + wc), lowest, highest);
          ColumnCrossing crossing;
          crossing.first = static_cast<std::int32_t>(std::ceil(z));
          crossing.step = wa + wb + wc > 0.0 ? -1 : 1;  // of the winding number
          crossing.triangle = triangle;
          add(x, hit[i].y, crossing);
        }
      }
    }
  }

  /// Adds a crossing at corner column (x, y) to the brick column that owns it and to those that share it.
  void add(int x, int y, const ColumnCrossing& crossing) {
    const int bx = x >> 3, by = y >> 3;
    for (int dx = 0; dx <= (x & 7 ? 0 : 1); ++dx)
      for (int dy = 0; dy <= (y & 7 ? 0 : 1); ++dy) {
        const IVec3 column(bx - dx, by - dy, 0);
        found.push_back({crossing, numbers_->of(column)});
        found.back().crossing.row =
            static_cast<std::uint8_t>(((x & 7) + kCells * dx) * kCorners + (y & 7) + kCells * dy);
        if (found.back().column == kNone) stray.emplace_back(found.size() - 1, column);
      }
  }

  const ColumnNumbers* numbers_;
  const std::vector<std::uint8_t>* wanted_;
};

/// Sorts by row, then by first; those alike in both stay in order.
void sort_column(std::span<ColumnCrossing> column) {
  const auto sooner = [](const ColumnCrossing& a, const ColumnCrossing& b) { return a.first < b.first; };
  std::array<Index, kCorners * kCorners + 1> slot{};
  for (const ColumnCrossing& c : column) ++slot[c.row + 1];
  std::partial_sum(slot.begin(), slot.end(), slot.begin());
  const std::vector<ColumnCrossing> unsorted(column.begin(), column.end());
  for (const ColumnCrossing& c : unsorted) column[slot[c.row]++] = c;
  for (std::size_t begin = 0; begin < column.size();) {
    const std::size_t end = slot[column[begin].row];  // which has moved to the row's end
    if (!std::is_sorted(column.begin() + begin, column.begin() + end, sooner))
      std::stable_sort(column.begin() + begin, column.begin() + end, sooner);
    begin = end;
  }
}

/// The lattice's brick columns, in order.
ColumnNumbers list_columns(const BrickLattice& lattice, MeshColumns& out) {
  for (std::size_t b = 0; b < lattice.brick_count(); ++b) {
    const IVec3 c(lattice.coordinate[b].x, lattice.coordinate[b].y, 0);
    if (!out.column.empty() && out.column.back() == c) continue;
    out.column.push_back(c);
    out.first_brick.push_back(static_cast<Index>(b));
  }
  return ColumnNumbers(out.column);
}

/// The first and last columns of a stretch, in x and y.
using ColumnStretch = std::array<glm::ivec2, 2>;

/// Counts wanted columns, and those that are not the lattice's, in stretches of columns at once.
class WantedColumns {
public:
  WantedColumns(const ColumnNumbers& numbers, const std::vector<std::uint8_t>& wanted)
      : low_(numbers.low()), size_(numbers.size()), numbers_(numbers), wanted_(wanted) {
    if (!numbers.is_table()) return;
    below_.assign(std::size_t(size_.x + 1) * std::size_t(size_.y + 1), 0);
    for (int x = 0; x < size_.x; ++x)
      for (int y = 0; y < size_.y; ++y)
        below_[place(x + 1, y + 1)] = Index(is_wanted({low_.x + x, low_.y + y, 0})) + below_[place(x, y + 1)] +
                                      below_[place(x + 1, y)] - below_[place(x, y)];
  }

  bool any(const ColumnStretch& columns) const {
    const glm::ivec2 from = columns[0] - low_, to = columns[1] - low_ + 1;
    if (from.x < 0 || from.y < 0 || to.x > size_.x || to.y > size_.y) return true;
    if (!below_.empty())
      return below_[place(to.x, to.y)] - below_[place(from.x, to.y)] - below_[place(to.x, from.y)] +
                 below_[place(from.x, from.y)] !=
             0;
    for (int x = columns[0].x; x <= columns[1].x; ++x)
      for (int y = columns[0].y; y <= columns[1].y; ++y)
        if (is_wanted({x, y, 0})) return true;
    return false;
  }

private:
  bool is_wanted(const IVec3& column) const {
    const Index number = numbers_.of(column);
    return number == kNone || wanted_[number];
  }
  std::size_t place(int x, int y) const { return std::size_t(x) * std::size_t(size_.y + 1) + std::size_t(y); }

  glm::ivec2 low_, size_;
  const ColumnNumbers& numbers_;
  const std::vector<std::uint8_t>& wanted_;
  std::vector<Index> below_;  // how many there are with smaller x and y
};

/// Triangles that may cross a wanted column, or one that is not the lattice's, and not many others. Blocks of them,
/// which lie near each other, are looked at first.
std::vector<Index> triangles_about(const TriangleMesh& mesh, const BrickLattice& lattice, const ColumnNumbers& numbers,
                                   const std::vector<std::uint8_t>& wanted) {
  constexpr double kSlack = 0.01;  // of a corner, for rounding
  constexpr std::size_t kBlock = 64, kFew = 8;
  const WantedColumns columns(numbers, wanted);
  const auto reaches = [&](std::size_t first, std::size_t end) {
    glm::vec2 low(std::numeric_limits<float>::infinity()), high = -low;
    for (std::size_t h = 3 * first; h < 3 * end; ++h) {
      const glm::vec2 p(mesh.position(mesh.vertex[h]));
      low = glm::min(low, p), high = glm::max(high, p);
    }
    const glm::dvec2 from(in_lattice(lattice, Vec3(low, 0.0f), mesh.vertex[3 * first]));
    const glm::dvec2 to(in_lattice(lattice, Vec3(high, 0.0f), mesh.vertex[3 * first]));
    return columns.any({glm::ivec2(glm::floor((from - (1.0 + kSlack)) / double(kCells))),
                        glm::ivec2(glm::floor((to + kSlack) / double(kCells)))});
  };
  const std::size_t count = mesh.triangle_count();
  const std::vector<Index> blocks = indices_where(
      (count + kBlock - 1) / kBlock, [&](Index b) { return reaches(b * kBlock, std::min(count, (b + 1) * kBlock)); });
  return collect(blocks.size(), kFew, [&](Index i, std::vector<Index>& list) {
    const std::size_t first = blocks[i] * kBlock;
    for (std::size_t t = first; t < std::min(count, first + kBlock); ++t)
      if (reaches(t, t + 1)) list.push_back(Index(t));
  });
}

/// Columns that only the mesh reaches come after the lattice's, in order.
void add_stray_columns(std::vector<Finder>& chunks, MeshColumns& out) {
  const auto sooner = [](const IVec3& a, const IVec3& b) { return std::tie(a.x, a.y) < std::tie(b.x, b.y); };
  std::vector<IVec3> more;
  for (const Finder& chunk : chunks)
    for (const auto& [at, column] : chunk.stray) more.push_back(column);
  std::sort(more.begin(), more.end(), sooner);
  more.erase(std::unique(more.begin(), more.end()), more.end());
  const Index first = static_cast<Index>(out.column.size());
  for (Finder& chunk : chunks)
    for (const auto& [at, column] : chunk.stray)
      chunk.found[at].column =
          first + static_cast<Index>(std::lower_bound(more.begin(), more.end(), column, sooner) - more.begin());
  out.column.insert(out.column.end(), more.begin(), more.end());
}

constexpr unsigned kAll = 0x1ff;  // of the corners of a row

/// A row of a brick, with the crossings from the last corner below it to its own last, and the winding number there.
struct CrossedRow {
  Index brick;
  int row, low, winding;
  std::span<const ColumnCrossing> crossing;

  void write_windings(std::int8_t* side) const {
    int now = winding;
    auto next = crossing.begin();
    for (int z = 0; z < kCorners; ++z) {
      for (; next != crossing.end() && next->first <= low + z; ++next) now += next->step;
      side[z] = static_cast<std::int8_t>(std::clamp(now, -128, 127));
    }
  }

  int lowest_winding() const {
    int now = winding;
    for (const ColumnCrossing& c : crossing)
      if (c.first <= low) now += c.step;
    return now;
  }

  /// Corners whose winding number is not 1 inside and 0 outside; `inside` and they as bits.
  unsigned differing(unsigned inside) const {
    int now = winding;
    // Of the corners from the last crossing on; those below have been seen to.
    unsigned once = now == 1 ? kAll : 0, never = now == 0 ? kAll : 0;
    for (const ColumnCrossing& c : crossing) {
      now += c.step;
      const unsigned above = kAll << std::max(0, c.first - low);
      once = now == 1 ? once | above : once & ~above;
      never = now == 0 ? never | above : never & ~above;
    }
    return kAll & ~((once & inside) | (never & ~inside));
  }
};

/// visit(row) for the rows of the column's bricks, row after row, upwards.
template <class Visit>
void for_each_row(const MeshColumns& columns, const BrickLattice& lattice, std::size_t c, const Visit& visit) {
  Index next = columns.first[c];
  const Index end = columns.first[c + 1];
  for (int row = 0; row < kCorners * kCorners; ++row) {
    const auto in_row = [&] { return next < end && columns.crossing[next].row == row; };
    int winding = 0;
    for (Index b = columns.first_brick[c]; b < columns.first_brick[c + 1]; ++b) {
      const int low = lattice.coordinate[b].z * kCells, before = winding;
      const Index first = next;
      for (; in_row() && columns.crossing[next].first <= low + kCells; ++next) winding += columns.crossing[next].step;
      visit(CrossedRow{b, row, low, before, std::span(columns.crossing).subspan(first, next - first)});
    }
    while (in_row()) ++next;
  }
}

}  // namespace

MeshColumns cross_columns(const TriangleMesh& mesh, const BrickLattice& lattice,
                          const std::vector<std::uint8_t>& wanted) {
  MeshColumns out;
  const ColumnNumbers numbers = list_columns(lattice, out);
  const bool all = wanted.empty(), none = !all && std::find(wanted.begin(), wanted.end(), 1) == wanted.end();
  const bool shared = all && mesh.vertex_count() < mesh.vertex.size();
  const std::vector<Rounded> vertex = shared ? round_vertices(mesh, lattice) : std::vector<Rounded>{};
  const std::vector<Index> some = all || none ? std::vector<Index>{} : triangles_about(mesh, lattice, numbers, wanted);
  const std::size_t triangles = all ? mesh.triangle_count() : some.size();
  const auto corner = [&](Index h) {
    const Index v = mesh.vertex[h];
    return shared ? vertex[v] : round_vertex(lattice, mesh.position(v), v);
  };
  const std::size_t of_chunk = triangles > kFewChunk * kFewChunk ? kChunk : kFewChunk;
  std::vector<Finder> chunks((triangles + of_chunk - 1) / of_chunk, Finder(numbers, wanted));
  tbb::parallel_for(std::size_t{0}, chunks.size(), [&](std::size_t k) {
    if (of_chunk == kChunk) chunks[k].found.reserve(2 * of_chunk);
    for (std::size_t i = k * of_chunk; i < std::min(triangles, (k + 1) * of_chunk); ++i) {
      const Index t = all ? static_cast<Index>(i) : some[i];
      chunks[k].triangle(corner(3 * t), corner(3 * t + 1), corner(3 * t + 2), t);
    }
  });
  add_stray_columns(chunks, out);
  out.first_brick.resize(out.column.size() + 1, static_cast<Index>(lattice.brick_count()));

  // A counting sort by column. Its chunks are scattered in order, so a column has its triangles in order.
  out.first.assign(out.column.size() + 1, 0);
  for (const Finder& chunk : chunks)
    for (const Found& f : chunk.found) ++out.first[f.column + 1];
  std::partial_sum(out.first.begin(), out.first.end(), out.first.begin());
  out.crossing.resize(out.first.back());
  std::vector<Index> slot(out.first.begin(), out.first.end() - 1);
  for (const Finder& chunk : chunks)
    for (const Found& f : chunk.found) out.crossing[slot[f.column]++] = f.crossing;
  tbb::parallel_for(std::size_t{0}, out.column.size(), [&](std::size_t c) {
    sort_column(std::span(out.crossing).subspan(out.first[c], out.first[c + 1] - out.first[c]));
  });
  return out;
}

std::vector<std::uint64_t> column_prints(const TriangleMesh& mesh, const BrickLattice& lattice) {
  MeshColumns columns;
  const ColumnNumbers numbers = list_columns(lattice, columns);
  const std::vector<Rounded> vertex = round_vertices(mesh, lattice);
  std::vector<std::uint64_t> print(mesh.vertex_count()), sum(columns.column.size(), 0);
  for_each_index(print.size(), [&](std::size_t v) { print[v] = vertex_print(vertex[v]); });
  const std::size_t triangles = mesh.triangle_count();
  tbb::parallel_for(std::size_t{0}, (triangles + kChunk - 1) / kChunk, [&](std::size_t k) {
    for (std::size_t t = k * kChunk; t < std::min(triangles, (k + 1) * kChunk); ++t) {
      const Index *const corner = &mesh.vertex[3 * t], a = corner[0], b = corner[1], c = corner[2];
      add_print(Reach(vertex[a], vertex[b], vertex[c]), triangle_print(print[a], print[b], print[c]), numbers, sum);
    }
  });
  return sum;
}

void update_column_prints(const MeshCopy& before, const TriangleMesh& mesh, const MeshChanges& changes,
                          const BrickLattice& lattice, std::vector<std::uint64_t>& print) {
  MeshColumns columns;
  const ColumnNumbers numbers = list_columns(lattice, columns);
  const auto add = [&](const std::vector<Index>& triangles, const std::vector<Index>& vertex,
                       const std::vector<Vec3>& position, bool gone) {
    tbb::parallel_for(std::size_t{0}, (triangles.size() + kFewChunk - 1) / kFewChunk, [&](std::size_t k) {
      for (std::size_t i = k * kFewChunk; i < std::min(triangles.size(), (k + 1) * kFewChunk); ++i) {
        const Index* const corner = &vertex[3 * std::size_t{triangles[i]}];
        const auto rounded = [&](int c) { return round_vertex(lattice, position[corner[c]], corner[c]); };
        const Rounded a = rounded(0), b = rounded(1), c = rounded(2);
        const std::uint64_t of_triangle = triangle_print(vertex_print(a), vertex_print(b), vertex_print(c));
        add_print(Reach(a, b, c), gone ? ~of_triangle + 1 : of_triangle, numbers, print);
      }
    });
  };
  add(changes.gone, before.vertex, before.position, true);
  add(changes.fresh, mesh.vertex, mesh.vertices.position, false);
}

std::vector<std::int8_t> winding_numbers(const TriangleMesh& mesh, const BrickLattice& lattice) {
  const MeshColumns columns = cross_columns(mesh, lattice);
  std::vector<std::int8_t> out(lattice.value.size());
  tbb::parallel_for(std::size_t{0}, columns.column.size(), [&](std::size_t c) {
    for_each_row(columns, lattice, c, [&](const CrossedRow& r) {
      r.write_windings(&out[std::size_t{r.brick} * BrickLattice::kValues + r.row * kCorners]);
    });
  });
  return out;
}

std::vector<DifferingRow> differing_rows(const TriangleMesh& mesh, const BrickLattice& lattice,
                                         const std::vector<BrickSigns>& signs,
                                         const std::vector<std::uint8_t>& anchored) {
  const MeshColumns columns = cross_columns(mesh, lattice);
  std::vector<std::vector<DifferingRow>> found(columns.column.size());
  tbb::parallel_for(std::size_t{0}, columns.column.size(), [&](std::size_t c) {
    int below = 0;  // what the mesh lacks there
    for_each_row(columns, lattice, c, [&](CrossedRow r) {
      const unsigned inside = signs[r.brick].row[r.row];
      if (r.brick == columns.first_brick[c]) {
        below = !anchored.empty() && anchored[r.brick] ? int(inside & 1) - r.lowest_winding() : 0;
      }
      r.winding += below;
      if (const unsigned corners = r.differing(inside))
        found[c].push_back({r.brick, static_cast<std::uint16_t>(corners), static_cast<std::uint8_t>(r.row)});
    });
    std::sort(found[c].begin(), found[c].end(), [](const DifferingRow& p, const DifferingRow& q) {
      return std::tie(p.brick, p.row) < std::tie(q.brick, q.row);
    });
  });
  std::vector<DifferingRow> out;
  for (const auto& f : found) out.insert(out.end(), f.begin(), f.end());
  return out;
}

DifferingBricks differing_bricks(const TriangleMesh& mesh, const BrickLattice& lattice,
                                 const std::vector<BrickSigns>& signs) {
  const MeshColumns columns = cross_columns(mesh, lattice);
  DifferingBricks out;
  out.number.assign(lattice.brick_count(), kNone);
  std::vector<std::uint8_t> differs(columns.column.size());
  tbb::parallel_for(std::size_t{0}, columns.column.size(), [&](std::size_t c) {
    for_each_row(columns, lattice, c, [&](const CrossedRow& r) {
      if (r.differing(signs[r.brick].row[r.row]) != 0) out.number[r.brick] = 0, differs[c] = 1;
    });
  });
  for (Index b = 0; b < out.number.size(); ++b) {
    if (out.number[b] == kNone) continue;
    out.number[b] = static_cast<Index>(out.brick.size());
    out.brick.push_back(b);
  }
  out.winding.resize(out.brick.size() * BrickLattice::kValues);
  tbb::parallel_for(std::size_t{0}, columns.column.size(), [&](std::size_t c) {
    if (!differs[c]) return;
    for_each_row(columns, lattice, c, [&](const CrossedRow& r) {
      const Index n = out.number[r.brick];
      if (n != kNone) r.write_windings(&out.winding[std::size_t{n} * BrickLattice::kValues + r.row * kCorners]);
    });
  });
  return out;
}

}  // namespace isoskin
