#include "core/topology/columns.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <span>
#include <stdexcept>
#include <tuple>

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

namespace isoskin {
namespace {

constexpr int kCells = BrickLattice::kCells;
constexpr int kCorners = BrickLattice::kCorners;
constexpr int kFraction = 20;                   // bits after the point of a rounded coordinate
constexpr double kFarthest = 1 << 23;           // lattice corners
constexpr std::int64_t kShortSpan = 1ll << 30;  // products of spans below this fit 64 bits
constexpr std::size_t kChunk = 2048;            // triangles

/// A vertex in lattice coordinates.
struct Rounded {
  std::int64_t x, y;  // times 2^kFraction
  double z;
};

struct Found {
  IVec3 column;
  ColumnCrossing crossing;
};

std::vector<Rounded> round_vertices(const TriangleMesh& mesh, const BrickLattice& lattice) {
  std::vector<Rounded> out(mesh.vertex_count());
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, out.size(), kChunk), [&](const auto& range) {
    for (std::size_t v = range.begin(); v != range.end(); ++v) {
      const DVec3 q = (DVec3(mesh.vertices.position[v]) - lattice.origin) / lattice.spacing;
      if (!(glm::all(glm::lessThan(glm::abs(q), DVec3(kFarthest)))))
        throw std::invalid_argument("mesh vertex " + std::to_string(v) + " is too far away for the lattice");
      out[v] = {std::llround(std::ldexp(q.x, kFraction)), std::llround(std::ldexp(q.y, kFraction)), q.z};
    }
  });
  return out;
}

/// An edge from p to q seen from the columns of one x after another.
template <class Wide>
class Side {
public:
  Side(const Rounded& p, const Rounded& q) : ux_(q.x - p.x), uy_(q.y - p.y), px_(p.x), py_(p.y) {
    const Wide decides = uy_ != 0 ? -uy_ : ux_;
    tie_ = decides > 0 ? 1 : decides < 0 ? -1 : 0;
  }
  void move_to(std::int64_t x) { across_ = uy_ * (x - px_); }

  /// Twice the signed area of p, q and the column.
  Wide value(std::int64_t y) const { return ux_ * (y - py_) - across_; }
  /// Of a value, once the column has moved by (eps, eps^2).
  int sign(Wide value) const { return value > 0 ? 1 : value < 0 ? -1 : tie_; }

private:
  Wide ux_, uy_, across_ = 0;
  std::int64_t px_, py_;
  int tie_;
};

std::int64_t ceil_corner(std::int64_t v) {
  return (v + (std::int64_t{1} << kFraction) - 1) >> kFraction;
}
std::int64_t floor_corner(std::int64_t v) {
  return v >> kFraction;
}

/// Adds a crossing at corner column (x, y) to the brick column that owns it and to those that share it.
void add(std::vector<Found>& out, int x, int y, const ColumnCrossing& crossing) {
  const int bx = x >> 3, by = y >> 3;
  for (int dx = 0; dx <= (x & 7 ? 0 : 1); ++dx)
    for (int dy = 0; dy <= (y & 7 ? 0 : 1); ++dy) {
      Found f{IVec3(bx - dx, by - dy, 0), crossing};
      f.crossing.row = static_cast<std::uint8_t>(((x & 7) + kCells * dx) * kCorners + (y & 7) + kCells * dy);
      out.push_back(f);
    }
}

/// Columns x0..x1, y0..y1 through the triangle.
template <class Wide>
void cross(const Rounded& a, const Rounded& b, const Rounded& c, Index triangle, const glm::ivec2& low,
           const glm::ivec2& high, std::vector<Found>& out) {
  Side<Wide> bc(b, c), ca(c, a), ab(a, b);
  const double lowest = std::min({a.z, b.z, c.z}), highest = std::max({a.z, b.z, c.z});
  for (int x = low.x; x <= high.x; ++x) {
    for (Side<Wide>* side : {&bc, &ca, &ab}) side->move_to(std::int64_t{x} << kFraction);
    for (int y = low.y; y <= high.y; ++y) {
      const std::int64_t py = std::int64_t{y} << kFraction;
      const Wide sa = bc.value(py), sb = ca.value(py), sc = ab.value(py);
      const int sign = bc.sign(sa);
      if (sign == 0 || sign != ca.sign(sb) || sign != ab.sign(sc)) continue;
      const double wa = static_cast<double>(sa), wb = static_cast<double>(sb), wc = static_cast<double>(sc);
      const double z = std::clamp((wa * a.z + wb * b.z + wc * c.z) / (wa + wb + wc), lowest, highest);
      ColumnCrossing crossing;
      crossing.first = static_cast<std::int32_t>(std::ceil(z));
      crossing.step = static_cast<std::int8_t>(-sign);  // of the winding number
      crossing.triangle = triangle;
      add(out, x, y, crossing);
    }
  }
}

void cross_triangle(const TriangleMesh& mesh, const std::vector<Rounded>& vertex, Index triangle,
                    std::vector<Found>& out) {
  const Rounded &a = vertex[mesh.vertex[3 * triangle]], &b = vertex[mesh.vertex[3 * triangle + 1]],
                &c = vertex[mesh.vertex[3 * triangle + 2]];
  const auto [x0, x1] = std::minmax({a.x, b.x, c.x});
  const auto [y0, y1] = std::minmax({a.y, b.y, c.y});
  const bool small = x1 - x0 < kShortSpan && y1 - y0 < kShortSpan;
  const glm::ivec2 low(ceil_corner(x0), ceil_corner(y0)), high(floor_corner(x1), floor_corner(y1));
  if (small)
    cross<std::int64_t>(a, b, c, triangle, low, high, out);
  else
    cross<__int128>(a, b, c, triangle, low, high, out);
}

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

/// Brick columns: those of the lattice, in order, then the others in which crossings were found.
BrickLattice list_columns(const BrickLattice& lattice, const std::vector<std::vector<Found>>& found, MeshColumns& out) {
  for (std::size_t b = 0; b < lattice.brick_count(); ++b) {
    const IVec3 c(lattice.coordinate[b].x, lattice.coordinate[b].y, 0);
    if (!out.column.empty() && out.column.back() == c) continue;
    out.column.push_back(c);
    out.first_brick.push_back(static_cast<Index>(b));
  }
  BrickLattice index;
  index.coordinate = out.column;
  index.build_index();
  std::vector<std::vector<IVec3>> others(found.size());
  tbb::parallel_for(std::size_t{0}, found.size(), [&](std::size_t k) {
    for (const Found& f : found[k])
      if (index.find(f.column) == kNone && (others[k].empty() || others[k].back() != f.column))
        others[k].push_back(f.column);
  });
  std::vector<IVec3> more;
  for (const auto& o : others) more.insert(more.end(), o.begin(), o.end());
  std::sort(more.begin(), more.end(),
            [](const IVec3& a, const IVec3& b) { return std::tie(a.x, a.y) < std::tie(b.x, b.y); });
  more.erase(std::unique(more.begin(), more.end()), more.end());
  out.column.insert(out.column.end(), more.begin(), more.end());
  out.first_brick.resize(out.column.size() + 1, static_cast<Index>(lattice.brick_count()));
  index.coordinate = out.column;
  index.build_index();
  return index;
}

}  // namespace

MeshColumns cross_columns(const TriangleMesh& mesh, const BrickLattice& lattice) {
  MeshColumns out;
  const std::vector<Rounded> vertex = round_vertices(mesh, lattice);
  const std::size_t triangles = mesh.triangle_count();
  std::vector<std::vector<Found>> found((triangles + kChunk - 1) / kChunk);
  tbb::parallel_for(std::size_t{0}, found.size(), [&](std::size_t k) {
    for (std::size_t t = k * kChunk; t < std::min(triangles, (k + 1) * kChunk); ++t)
      cross_triangle(mesh, vertex, static_cast<Index>(t), found[k]);
  });
  const BrickLattice index = list_columns(lattice, found, out);

  // A counting sort by column. Its chunks are scattered in order, so a column has its triangles in order.
  std::vector<std::vector<Index>> where(found.size());
  tbb::parallel_for(std::size_t{0}, found.size(), [&](std::size_t k) {
    where[k].resize(found[k].size());
    for (std::size_t i = 0; i < found[k].size(); ++i)
      where[k][i] =
          i > 0 && found[k][i].column == found[k][i - 1].column ? where[k][i - 1] : index.find(found[k][i].column);
  });
  out.first.assign(out.column.size() + 1, 0);
  for (const auto& w : where)
    for (const Index c : w) ++out.first[c + 1];
  for (std::size_t c = 0; c < out.column.size(); ++c) out.first[c + 1] += out.first[c];
  out.crossing.resize(out.first.back());
  std::vector<Index> slot(out.first.begin(), out.first.end() - 1);
  for (std::size_t k = 0; k < found.size(); ++k)
    for (std::size_t i = 0; i < found[k].size(); ++i) out.crossing[slot[where[k][i]]++] = found[k][i].crossing;
  tbb::parallel_for(std::size_t{0}, out.column.size(), [&](std::size_t c) {
    sort_column(std::span(out.crossing).subspan(out.first[c], out.first[c + 1] - out.first[c]));
  });
  return out;
}

std::vector<std::int8_t> winding_numbers(const TriangleMesh& mesh, const BrickLattice& lattice) {
  const MeshColumns columns = cross_columns(mesh, lattice);
  std::vector<std::int8_t> out(lattice.value.size());
  tbb::parallel_for(std::size_t{0}, columns.column.size(), [&](std::size_t c) {
    Index next = columns.first[c];
    for (int row = 0; row < kCorners * kCorners; ++row) {
      int winding = 0;
      for (Index b = columns.first_brick[c]; b < columns.first_brick[c + 1]; ++b) {
        std::int8_t* const side = &out[std::size_t{b} * BrickLattice::kValues + row * kCorners];
        const int low = lattice.coordinate[b].z * kCells;
        if (next == columns.first[c + 1] || columns.crossing[next].row != row ||
            columns.crossing[next].first > low + kCells) {
          std::fill_n(side, kCorners, static_cast<std::int8_t>(std::clamp(winding, -128, 127)));
          continue;
        }
        for (int z = 0; z < kCorners; ++z) {
          const int corner = low + z;
          for (; next < columns.first[c + 1] && columns.crossing[next].row == row &&
                 columns.crossing[next].first <= corner;
               ++next)
            winding += columns.crossing[next].step;
          side[z] = static_cast<std::int8_t>(std::clamp(winding, -128, 127));
        }
      }
      while (next < columns.first[c + 1] && columns.crossing[next].row == row) ++next;
    }
  });
  return out;
}

}  // namespace isoskin
