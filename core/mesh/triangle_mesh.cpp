#include "core/mesh/triangle_mesh.h"

#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <numeric>

#include <fmt/format.h>

#include "core/disjoint_sets.h"
#include "core/mesh/independent_edits.h"
#include "core/mesh/piece_sums.h"
#include "core/parallel.h"

namespace isoskin {
namespace {

/// Lowers target to value if value is smaller.
void atomic_min(Index& target, Index value) {
  std::atomic_ref<Index> cell(target);
  Index seen = cell.load(std::memory_order_relaxed);
  while (value < seen && !cell.compare_exchange_weak(seen, value, std::memory_order_relaxed)) {
  }
}

/// Items sorted into buckets: those of bucket b are item[first[b] .. first[b+1]), ascending.
template <class Item>
struct Buckets {
  std::vector<Index> first;
  std::vector<Item> item;
};

/// As sort_into_buckets(), for so few that threads would only wait for each other.
template <class Item, class BucketOf, class ItemOf>
Buckets<Item> sort_few_into_buckets(std::size_t buckets, std::size_t n, const BucketOf& bucket, const ItemOf& item) {
  Buckets<Item> out;
  out.first.assign(buckets + 1, 0);
  for (Index h = 0; h < n; ++h) ++out.first[bucket(h) + 1];
  std::partial_sum(out.first.begin(), out.first.end(), out.first.begin());
  out.item.resize(n);
  std::vector<Index> slot(out.first.begin(), out.first.end() - 1);
  for (Index h = 0; h < n; ++h) out.item[slot[bucket(h)]++] = item(h);
  for (std::size_t b = 0; b < buckets; ++b) {
    const auto begin = out.item.begin() + out.first[b], end = out.item.begin() + out.first[b + 1];
    if (!std::is_sorted(begin, end)) std::sort(begin, end);
  }
  return out;
}

/// Counting sort of item(h), h < n, by bucket(h). Slots are taken in any order, then each small bucket is sorted, so
/// the result is the same whatever the number of threads.
template <class Item, class BucketOf, class ItemOf>
Buckets<Item> sort_into_buckets(std::size_t buckets, std::size_t n, const BucketOf& bucket, const ItemOf& item) {
  constexpr std::size_t kFew = 1 << 16;
  if (n <= kFew) return sort_few_into_buckets<Item>(buckets, n, bucket, item);
  Buckets<Item> out;
  out.first.assign(buckets + 1, 0);
  for_each_index(
      n, [&](Index h) { std::atomic_ref<Index>(out.first[bucket(h) + 1]).fetch_add(1, std::memory_order_relaxed); });
  std::partial_sum(out.first.begin(), out.first.end(), out.first.begin());
  out.item.resize(n);
  std::vector<Index> slot(out.first.begin(), out.first.end() - 1);
  for_each_index(n, [&](Index h) {
    out.item[std::atomic_ref<Index>(slot[bucket(h)]).fetch_add(1, std::memory_order_relaxed)] = item(h);
  });
  for_each_index(buckets,
                 [&](Index b) { std::sort(out.item.begin() + out.first[b], out.item.begin() + out.first[b + 1]); });
  return out;
}

std::size_t checked_halfedge_count(const TriangleMesh& mesh) {
  const std::size_t halfedges = mesh.vertex.size();
  if (halfedges % 3 != 0 || halfedges >= kNone)
    throw std::invalid_argument(fmt::format("mesh has {} triangle corners: not a multiple of 3 below 2^32", halfedges));
  Index bad = kNone;
  for_each_index(halfedges, [&](Index h) {
    if (mesh.vertex[h] >= mesh.vertex_count()) atomic_min(bad, h);
  });
  if (bad != kNone)
    throw std::invalid_argument(fmt::format("triangle {} uses vertex {}, but there are {} vertices", bad / 3,
                                            mesh.vertex[bad], mesh.vertex_count()));
  return halfedges;
}

std::string describe_bad_edge(const TriangleMesh& mesh, Index h) {
  const Index a = mesh.from(h), b = mesh.to(h);
  int same = 0, opposite = 0;
  for (Index k = 0; k < mesh.vertex.size(); ++k) {
    same += mesh.from(k) == a && mesh.to(k) == b;
    opposite += mesh.from(k) == b && mesh.to(k) == a;
  }
  return fmt::format(
      "edge {}-{} of triangle {} is used {} times in this direction and {} times in the other (expected 1 and 1)", a, b,
      h / 3, same, opposite);
}

/// Spreads the low 21 bits of x so that two zero bits follow each.
std::uint64_t spread_bits(std::uint64_t x) {
  x &= 0x1fffff;
  x = (x | x << 32) & 0x1f00000000ffffull;
  x = (x | x << 16) & 0x1f0000ff0000ffull;
  x = (x | x << 8) & 0x100f00f00f00f00full;
  x = (x | x << 4) & 0x10c30c30c30c30c3ull;
  return (x | x << 2) & 0x1249249249249249ull;
}

std::vector<Index> morton_order(const std::vector<Vec3>& points) {
  Box box;
  for (const Vec3& p : points) box.add(DVec3(p));
  const DVec3 size = box.empty() ? DVec3(1) : box.size();
  const double scale = double((1 << 21) - 1) / std::max({size.x, size.y, size.z, 1e-300});
  std::vector<std::pair<std::uint64_t, Index>> key(points.size());
  for_each_index(points.size(), [&](Index v) {
    const glm::u64vec3 q((DVec3(points[v]) - box.low) * scale);
    key[v] = {spread_bits(q.x) | spread_bits(q.y) << 1 | spread_bits(q.z) << 2, v};
  });
  tbb::parallel_sort(key.begin(), key.end());
  std::vector<Index> order(points.size());
  for_each_index(points.size(), [&](Index i) { order[i] = key[i].second; });
  return order;
}

std::vector<Index> inverse_permutation(const std::vector<Index>& order) {
  std::vector<Index> inverse(order.size());
  for_each_index(order.size(), [&](Index i) { inverse[order[i]] = i; });
  return inverse;
}

/// Sum of f(i) over i < n in blocks of fixed size: one order of additions whatever the number of threads.
template <class Function>
double ordered_sum(std::size_t n, const Function& f) {
  constexpr std::size_t kBlock = 4096;
  std::vector<double> block((n + kBlock - 1) / kBlock, 0.0);
  tbb::parallel_for(std::size_t(0), block.size(), [&](std::size_t b) {
    const std::size_t end = std::min(n, (b + 1) * kBlock);
    for (std::size_t i = b * kBlock; i < end; ++i) block[b] += f(Index(i));
  });
  return std::accumulate(block.begin(), block.end(), 0.0);
}

}  // namespace

void VertexTable::resize(std::size_t n) {
  position.resize(n, Vec3(0));
  rest.resize(n, Vec3(0));
  velocity.resize(n, Vec3(0));
  id.resize(n, kNone);
  age.resize(n, 0);
}

void VertexTable::reserve(std::size_t n) {
  position.reserve(n);
  rest.reserve(n);
  velocity.reserve(n);
  id.reserve(n);
  age.reserve(n);
}

VertexTable VertexTable::select(const std::vector<Index>& rows) const {
  VertexTable out;
  out.resize(rows.size());
  for_each_index(rows.size(), [&](Index i) {
    const Index v = rows[i];
    out.position[i] = position[v];
    out.rest[i] = rest[v];
    out.velocity[i] = velocity[v];
    out.id[i] = id[v];
    out.age[i] = age[v];
  });
  return out;
}

void VertexTable::blend(Index v, Index a, Index b, float t) {
  position[v] = glm::mix(position[a], position[b], t);
  rest[v] = glm::mix(rest[a], rest[b], t);
  velocity[v] = glm::mix(velocity[a], velocity[b], t);
  age[v] = 0;
}

void link_twins(TriangleMesh& mesh) {
  const std::size_t halfedges = checked_halfedge_count(mesh);
  const auto leaving = sort_into_buckets<std::uint64_t>(
      mesh.vertex_count(), halfedges, [&](Index h) { return mesh.from(h); },
      [&](Index h) { return std::uint64_t(mesh.to(h)) << 32 | h; });
  // The halfedges a -> b, which lie together in a's bucket.
  const auto edges = [&](Index a, Index b) {
    const auto begin = leaving.item.begin() + leaving.first[a], end = leaving.item.begin() + leaving.first[a + 1];
    const auto low = std::lower_bound(begin, end, std::uint64_t(b) << 32);
    auto high = low;
    while (high != end && *high >> 32 == b && high - low < 2) ++high;
    return std::pair(low, high);
  };
  mesh.twin.resize(halfedges);
  Index bad = kNone;
  for_each_index(halfedges, [&](Index h) {
    const Index a = mesh.from(h), b = mesh.to(h);
    const auto [same, same_end] = edges(a, b);
    const auto [opposite, opposite_end] = edges(b, a);
    if (a == b || same_end - same != 1 || opposite_end - opposite != 1) return atomic_min(bad, h);
    mesh.twin[h] = Index(*opposite);
  });
  if (bad == kNone) return;
  mesh.twin.clear();
  throw std::invalid_argument(describe_bad_edge(mesh, bad));
}

TriangleMesh make_mesh(std::vector<Vec3> positions, std::vector<Index> triangles) {
  TriangleMesh mesh;
  const std::size_t n = positions.size();
  mesh.vertex = std::move(triangles);
  mesh.vertices.rest = positions;
  mesh.vertices.position = std::move(positions);
  mesh.vertices.resize(n);
  std::iota(mesh.vertices.id.begin(), mesh.vertices.id.end(), Index(0));
  mesh.next_id = Index(n);
  link_twins(mesh);
  return mesh;
}

std::vector<Index> outgoing_halfedges(const TriangleMesh& mesh) {
  std::vector<Index> out(mesh.vertex_count(), kNone);
  for_each_index(mesh.vertex.size(), [&](Index h) { atomic_min(out[mesh.vertex[h]], h); });
  return out;
}

VertexCorners vertex_corners(const TriangleMesh& mesh) {
  auto buckets = sort_into_buckets<Index>(
      mesh.vertex_count(), mesh.vertex.size(), [&](Index h) { return mesh.from(h); }, [](Index h) { return h; });
  return {std::move(buckets.first), std::move(buckets.item)};
}

MeshPieces mesh_pieces(const TriangleMesh& mesh) {
  const std::size_t n = mesh.vertex_count(), triangles = mesh.triangle_count();
  DisjointSets sets(n);
  std::vector<std::uint8_t> used(n, 0);
  for_each_index(triangles, [&](Index t) {
    for (Index h = 3 * t; h < 3 * t + 3; ++h) {
      std::atomic_ref<std::uint8_t>(used[mesh.from(h)]).store(1, std::memory_order_relaxed);
      if (mesh.from(h) < mesh.to(h) || mesh.twin.empty()) sets.unite(mesh.from(h), mesh.to(h));
    }
  });

  MeshPieces pieces;
  pieces.first = indices_where(n, [&](Index v) { return used[v] && sets.root(v) == v; });
  std::vector<Index> number(n, kNone);  // of the piece that begins at a vertex
  for_each_index(pieces.first.size(), [&](std::size_t p) { number[pieces.first[p]] = Index(p); });
  pieces.of_vertex.assign(n, kNone);
  for_each_index(n, [&](std::size_t v) {
    if (used[v]) pieces.of_vertex[v] = number[sets.root(Index(v))];
  });
  pieces.euler.assign(pieces.first.size(), 0);
  pieces.triangles.assign(pieces.first.size(), 0);
  pieces.solid.resize(pieces.first.size());
  sum_by_piece<int>(
      n, [&](std::size_t v) { return pieces.of_vertex[v]; }, [](std::size_t, int& count) { ++count; },
      [&](Index piece, int count) { pieces.euler[piece] += count; });
  add_triangles(
      triangles, [](std::size_t t) { return Index(t); }, mesh.vertex, mesh.vertices.position, pieces.of_vertex, 1,
      pieces);
  for (std::size_t p = 0; p < pieces.count(); ++p) {
    pieces.euler[p] -= pieces.triangles[p] / 2;  // V - E + F with 2 E = 3 F
    pieces.volume.push_back(pieces.solid[p].volume());
  }
  return pieces;
}

void SolidSum::add(const Vec3& a, const Vec3& b, const Vec3& c, int times) {
  const double six = glm::dot(DVec3(a), glm::cross(DVec3(b) - DVec3(a), DVec3(c) - DVec3(a)));
  if (six == 0.0 || !std::isfinite(six)) return;
  int exponent = 0;
  const double mantissa = std::frexp(six, &exponent);
  const int bin = std::clamp((exponent - kLeast) / kBits, 0, kBins - 1);
  // Nothing comes near the last bin's end: that would be 10^60.
  bin_[bin] += times * static_cast<__int128>(std::ldexp(mantissa, std::min(exponent - unit(bin), 2 * kMantissa)));
}

void SolidSum::add(const SolidSum& other) {
  for (int bin = 0; bin < kBins; ++bin) bin_[bin] += other.bin_[bin];
}

double SolidSum::volume() const {
  double six = 0.0;
  for (int bin = 0; bin < kBins; ++bin) six += std::ldexp(static_cast<double>(bin_[bin]), unit(bin));
  return six / 6.0;
}

void copy_mesh(const TriangleMesh& from, TriangleMesh& to) {
  copy_column(from.vertex, to.vertex);
  copy_column(from.twin, to.twin);
  copy_column(from.vertices.position, to.vertices.position);
  copy_column(from.vertices.rest, to.vertices.rest);
  copy_column(from.vertices.velocity, to.vertices.velocity);
  copy_column(from.vertices.id, to.vertices.id);
  copy_column(from.vertices.age, to.vertices.age);
  to.next_id = from.next_id;
}

TriangleMesh submesh(const TriangleMesh& mesh, const std::vector<std::uint8_t>& keep) {
  if (keep.size() != mesh.triangle_count())
    throw std::invalid_argument(
        fmt::format("submesh: {} keep flags for {} triangles", keep.size(), mesh.triangle_count()));
  TriangleMesh out;
  std::vector<Index> renumbered(mesh.vertex_count(), kNone);
  for (Index t = 0; t < mesh.triangle_count(); ++t)
    if (keep[t])
      for (Index h = 3 * t; h < 3 * t + 3; ++h) renumbered[mesh.vertex[h]] = 0;
  std::vector<Index> kept;
  for (Index v = 0; v < mesh.vertex_count(); ++v) {
    if (renumbered[v] == kNone) continue;
    renumbered[v] = Index(kept.size());
    kept.push_back(v);
  }
  for (Index t = 0; t < mesh.triangle_count(); ++t)
    if (keep[t])
      for (Index h = 3 * t; h < 3 * t + 3; ++h) out.vertex.push_back(renumbered[mesh.vertex[h]]);
  out.vertices = mesh.vertices.select(kept);
  out.next_id = mesh.next_id;
  link_twins(out);
  return out;
}

void append(TriangleMesh& mesh, const TriangleMesh& other) {
  const Index first_vertex = Index(mesh.vertex_count()), first_halfedge = Index(mesh.vertex.size());
  const auto add = [](auto& to, const auto& from) { to.insert(to.end(), from.begin(), from.end()); };
  for (const Index v : other.vertex) mesh.vertex.push_back(first_vertex + v);
  for (const Index h : other.twin) mesh.twin.push_back(first_halfedge + h);
  add(mesh.vertices.position, other.vertices.position);
  add(mesh.vertices.rest, other.vertices.rest);
  add(mesh.vertices.velocity, other.vertices.velocity);
  add(mesh.vertices.id, other.vertices.id);
  add(mesh.vertices.age, other.vertices.age);
  mesh.next_id = std::max(mesh.next_id, other.next_id);
}

void reorder(TriangleMesh& mesh) {
  const std::vector<Index> vertex_order = morton_order(mesh.vertices.position);
  const std::vector<Index> new_vertex = inverse_permutation(vertex_order);
  const std::size_t triangles = mesh.triangle_count();
  std::vector<std::uint64_t> key(triangles);  // triangles follow their first vertex along the curve
  for_each_index(triangles, [&](Index t) {
    const Index* corner = &mesh.vertex[3 * t];
    const Index first = std::min({new_vertex[corner[0]], new_vertex[corner[1]], new_vertex[corner[2]]});
    key[t] = std::uint64_t(first) << 32 | t;
  });
  tbb::parallel_sort(key.begin(), key.end());
  std::vector<Index> new_triangle(triangles);
  for_each_index(triangles, [&](Index i) { new_triangle[Index(key[i])] = i; });

  std::vector<Index> vertex(mesh.vertex.size()), twin(mesh.twin.size());
  for_each_index(mesh.vertex.size(), [&](Index h) {
    const Index moved = 3 * new_triangle[h / 3] + h % 3;
    vertex[moved] = new_vertex[mesh.vertex[h]];
    if (!twin.empty()) twin[moved] = 3 * new_triangle[mesh.twin[h] / 3] + mesh.twin[h] % 3;
  });
  mesh.vertex = std::move(vertex);
  mesh.twin = std::move(twin);
  mesh.vertices = mesh.vertices.select(vertex_order);
}

double smallest_angle(const DVec3& a, const DVec3& b, const DVec3& c) {
  DVec3 u = b - a, v = c - a;
  const double ab = glm::dot(u, u), ca = glm::dot(v, v), bc = glm::dot(c - b, c - b);
  if (ab <= bc && ab <= ca) {
    u = a - c, v = b - c;
  } else if (ca <= bc) {
    u = a - b, v = c - b;
  }
  return glm::degrees(std::atan2(glm::length(glm::cross(u, v)), glm::dot(u, v)));
}

ShapeStatistics shape_statistics(const TriangleMesh& mesh) {
  ShapeStatistics out;
  const std::size_t triangles = mesh.triangle_count();
  if (triangles == 0) return out;
  std::vector<double> angle(triangles), edge(triangles), area(triangles);
  for_each_index(triangles, [&](Index t) {
    const DVec3 a(mesh.position(mesh.vertex[3 * t])), b(mesh.position(mesh.vertex[3 * t + 1])),
        c(mesh.position(mesh.vertex[3 * t + 2]));
    angle[t] = smallest_angle(a, b, c);
    edge[t] = glm::length(b - a) + glm::length(c - b) + glm::length(a - c);
    area[t] = 0.5 * glm::length(glm::cross(b - a, c - a));
  });
  out.mean_angle = ordered_sum(triangles, [&](Index t) { return angle[t]; }) / double(triangles);
  out.mean_edge = ordered_sum(triangles, [&](Index t) { return edge[t]; }) / (3.0 * double(triangles));
  out.area = ordered_sum(triangles, [&](Index t) { return area[t]; });
  out.below_10_degrees =
      double(std::count_if(angle.begin(), angle.end(), [](double x) { return x < 10.0; })) / double(triangles);
  const auto p1 = angle.begin() + std::ptrdiff_t(0.01 * double(triangles));
  std::nth_element(angle.begin(), p1, angle.end());
  out.p1_angle = *p1;
  out.min_angle = *std::min_element(angle.begin(), p1 + 1);
  return out;
}

}  // namespace isoskin
