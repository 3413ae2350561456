#include "core/mesh/validate.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_reduce.h>
#include <tbb/parallel_sort.h>

#include <algorithm>
#include <cmath>
#include <functional>

#include <fmt/format.h>

#include "core/parallel.h"

namespace isoskin {
namespace {

/// The smallest i < n with bad(i), kNone if there is none.
template <class Predicate>
Index first_bad(std::size_t n, const Predicate& bad) {
  return tbb::parallel_reduce(
      tbb::blocked_range<std::size_t>(0, n, 4096), kNone,
      [&](const auto& range, Index found) {
        for (std::size_t i = range.begin(); i != range.end() && i < found; ++i)
          if (bad(Index(i))) return Index(i);
        return found;
      },
      [](Index a, Index b) { return std::min(a, b); });
}

bool finite(const Vec3& p) {
  return std::isfinite(p.x) && std::isfinite(p.y) && std::isfinite(p.z);
}

std::string check_sizes(const TriangleMesh& mesh) {
  const VertexTable& table = mesh.vertices;
  const std::size_t n = table.position.size();
  if (mesh.vertex.size() % 3 != 0) return fmt::format("{} halfedges: not three a triangle", mesh.vertex.size());
  if (mesh.twin.size() != mesh.vertex.size())
    return fmt::format("{} twins for {} halfedges", mesh.twin.size(), mesh.vertex.size());
  if (table.rest.size() != n) return fmt::format("{} rest positions for {} vertices", table.rest.size(), n);
  if (table.velocity.size() != n) return fmt::format("{} velocities for {} vertices", table.velocity.size(), n);
  if (table.id.size() != n) return fmt::format("{} ids for {} vertices", table.id.size(), n);
  if (table.age.size() != n) return fmt::format("{} ages for {} vertices", table.age.size(), n);
  if (mesh.vertex.size() >= kNone || n >= kNone) return "more than 2^32 - 1 halfedges or vertices";
  return {};
}

std::string check_indices(const TriangleMesh& mesh) {
  const Index h = first_bad(mesh.vertex.size(), [&](Index i) {
    return mesh.vertex[i] >= mesh.vertex_count() || mesh.twin[i] >= mesh.vertex.size();
  });
  if (h == kNone) return {};
  return fmt::format("halfedge {} of triangle {} has vertex {} of {} and twin {} of {}: out of range", h, h / 3,
                     mesh.vertex[h], mesh.vertex_count(), mesh.twin[h], mesh.vertex.size());
}

std::string check_triangles(const TriangleMesh& mesh) {
  const Index t = first_bad(mesh.triangle_count(), [&](Index i) {
    const Index a = mesh.vertex[3 * i], b = mesh.vertex[3 * i + 1], c = mesh.vertex[3 * i + 2];
    return a == b || b == c || c == a;
  });
  if (t == kNone) return {};
  return fmt::format("triangle {} repeats a vertex: {} {} {}", t, mesh.vertex[3 * t], mesh.vertex[3 * t + 1],
                     mesh.vertex[3 * t + 2]);
}

std::string check_twins(const TriangleMesh& mesh) {
  const Index h = first_bad(mesh.vertex.size(), [&](Index i) {
    const Index j = mesh.twin[i];
    return i == j || mesh.twin[j] != i || mesh.from(i) != mesh.to(j) || mesh.to(i) != mesh.from(j);
  });
  if (h == kNone) return {};
  const Index twin = mesh.twin[h];
  return fmt::format("halfedge {} ({} to {}) has twin {} ({} to {}), whose twin is {}", h, mesh.from(h), mesh.to(h),
                     twin, mesh.from(twin), mesh.to(twin), mesh.twin[twin]);
}

/// The end of two edges that leave v for the same vertex, kNone if there are none.
Index doubled_end(const TriangleMesh& mesh, const VertexCorners& corners, Index v) {
  thread_local std::vector<Index> ends;
  ends.clear();
  for (Index k = corners.first[v]; k < corners.first[v + 1]; ++k) ends.push_back(mesh.to(corners.corner[k]));
  std::sort(ends.begin(), ends.end());
  const auto twice = std::adjacent_find(ends.begin(), ends.end());
  return twice == ends.end() ? kNone : *twice;
}

std::string check_edges(const TriangleMesh& mesh, const VertexCorners& corners) {
  const Index v = first_bad(mesh.vertex_count(), [&](Index i) { return doubled_end(mesh, corners, i) != kNone; });
  if (v == kNone) return {};
  return fmt::format("two edges run from vertex {} to vertex {}", v, doubled_end(mesh, corners, v));
}

/// With every directed edge unique, triangles with the same corners can only be two glued back to back.
std::string check_duplicates(const TriangleMesh& mesh) {
  const Index t = first_bad(mesh.triangle_count(), [&](Index i) {
    const Index a = mesh.twin[3 * i] / 3, b = mesh.twin[3 * i + 1] / 3, c = mesh.twin[3 * i + 2] / 3;
    return a == b || b == c || c == a;
  });
  if (t == kNone) return {};
  return fmt::format("triangle {} ({} {} {}) has the same vertices as a neighbour", t, mesh.vertex[3 * t],
                     mesh.vertex[3 * t + 1], mesh.vertex[3 * t + 2]);
}

Index fan_size(const TriangleMesh& mesh, Index start) {
  Index size = 0, h = start;
  do {
    ++size;
    h = mesh.turn(h);
  } while (h != start);
  return size;
}

std::string check_fans(const TriangleMesh& mesh, const VertexCorners& corners) {
  const auto used = [&](Index v) { return corners.first[v + 1] - corners.first[v]; };
  const Index v = first_bad(mesh.vertex_count(), [&](Index i) {
    return used(i) == 0 || fan_size(mesh, corners.corner[corners.first[i]]) != used(i);
  });
  if (v == kNone) return {};
  if (used(v) == 0) return fmt::format("vertex {} is unused", v);
  return fmt::format("vertex {} has more than one fan of triangles: {} triangles, {} in the fan of halfedge {}", v,
                     used(v), fan_size(mesh, corners.corner[corners.first[v]]), corners.corner[corners.first[v]]);
}

std::string check_finite(const TriangleMesh& mesh) {
  const VertexTable& table = mesh.vertices;
  const Index v = first_bad(table.size(), [&](Index i) {
    return !finite(table.position[i]) || !finite(table.rest[i]) || !finite(table.velocity[i]);
  });
  if (v == kNone) return {};
  const char* column = !finite(table.position[v]) ? "position" : !finite(table.rest[v]) ? "rest" : "velocity";
  return fmt::format("the {} of vertex {} is not finite", column, v);
}

std::string check_ids(const TriangleMesh& mesh) {
  const std::vector<Index>& id = mesh.vertices.id;
  const Index v = first_bad(id.size(), [&](Index i) { return id[i] >= mesh.next_id; });
  if (v != kNone) return fmt::format("vertex {} has id {}, not below next_id {}", v, id[v], mesh.next_id);
  std::vector<std::uint64_t> sorted(id.size());
  for_each_index(id.size(), [&](Index i) { sorted[i] = std::uint64_t(id[i]) << 32 | i; });
  tbb::parallel_sort(sorted.begin(), sorted.end());
  const Index k = first_bad(sorted.size(), [&](Index i) { return i > 0 && sorted[i] >> 32 == sorted[i - 1] >> 32; });
  if (k == kNone) return {};
  return fmt::format("vertices {} and {} share id {}", Index(sorted[k - 1]), Index(sorted[k]), sorted[k] >> 32);
}

}  // namespace

ValidateReport validate(const TriangleMesh& mesh) {
  VertexCorners corners;
  // Later checks rely on earlier ones: fans can only be walked once twins are an involution.
  const std::function<std::string()> checks[] = {
      [&] { return check_sizes(mesh); },
      [&] { return check_indices(mesh); },
      [&] { return check_triangles(mesh); },
      [&] { return check_twins(mesh); },
      [&] { return corners = vertex_corners(mesh), check_edges(mesh, corners); },
      [&] { return check_duplicates(mesh); },
      [&] { return check_fans(mesh, corners); },
      [&] { return check_finite(mesh); },
      [&] { return check_ids(mesh); },
  };
  for (const auto& check : checks)
    if (std::string reason = check(); !reason.empty()) return {false, std::move(reason)};
  return {};
}

}  // namespace isoskin
