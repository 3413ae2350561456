// Ways to ruin a mesh that stays a closed, oriented 2-manifold: what a repair must be able to mend.
#pragma once

#include <algorithm>
#include <random>
#include <set>
#include <vector>

#include "core/mesh/triangle_mesh.h"

namespace isoskin {

enum class Damage {
  cut_off_patch,
  fold,
  push_through,
  duplicate_piece,
  droplet_inside,
  droplet_outside,
  lose_piece,
  false_bridge,
  count
};

inline const char* name(Damage damage) {
  constexpr const char* kNames[] = {"cut off a patch",   "fold",           "push a cap through",
                                    "duplicate a piece", "droplet inside", "droplet outside",
                                    "lose a piece",      "false bridge"};
  return kNames[int(damage)];
}

namespace damage {

using Random = std::mt19937_64;

inline Index pick(Random& random, std::size_t n) {
  return Index(random() % n);
}

inline float uniform(Random& random, float low, float high) {
  return low + (high - low) * float(double(random() >> 11) * 0x1p-53);
}

inline Vec3 normal_of(const TriangleMesh& mesh, Index t) {
  const Vec3 a = mesh.position(mesh.vertex[3 * t]), b = mesh.position(mesh.vertex[3 * t + 1]),
             c = mesh.position(mesh.vertex[3 * t + 2]);
  return glm::normalize(glm::cross(b - a, c - a));
}

/// Vertices within `rings` edges of v.
inline std::set<Index> disc(const TriangleMesh& mesh, Index v, int rings) {
  const std::vector<Index> outgoing = outgoing_halfedges(mesh);
  std::set<Index> inside{v}, rim{v};
  for (int ring = 0; ring < rings; ++ring) {
    std::set<Index> next;
    for (const Index r : rim) {
      Index h = outgoing[r];
      do {
        if (inside.insert(mesh.to(h)).second) next.insert(mesh.to(h));
        h = mesh.turn(h);
      } while (h != outgoing[r]);
    }
    rim = std::move(next);
  }
  return inside;
}

inline TriangleMesh rebuilt(const TriangleMesh& mesh, std::vector<Index> triangles, std::vector<Vec3> extra = {}) {
  std::vector<Vec3> positions = mesh.vertices.position;
  positions.insert(positions.end(), extra.begin(), extra.end());
  std::vector<Index> used(positions.size(), kNone);
  std::vector<Vec3> kept;
  for (Index& v : triangles) {
    if (used[v] == kNone) {
      used[v] = Index(kept.size());
      kept.push_back(positions[v]);
    }
    v = used[v];
  }
  return make_mesh(std::move(kept), std::move(triangles));
}

inline TriangleMesh cut_off_patch(const TriangleMesh& mesh, Random& random) {
  const auto inside = disc(mesh, pick(random, mesh.vertex_count()), 1 + int(random() % 3));
  std::vector<Index> triangles;
  std::vector<std::pair<Index, Index>> border;
  const auto removed = [&](Index t) {
    return inside.count(mesh.vertex[3 * t]) && inside.count(mesh.vertex[3 * t + 1]) &&
           inside.count(mesh.vertex[3 * t + 2]);
  };
  std::set<Index> starts;
  Vec3 sum(0.0f);
  for (Index h = 0; h < mesh.vertex.size(); ++h) {
    if (!removed(h / 3)) {
      triangles.push_back(mesh.vertex[h]);
    } else if (!removed(mesh.twin[h] / 3)) {
      border.emplace_back(mesh.from(h), mesh.to(h));
      if (!starts.insert(mesh.from(h)).second) return mesh;  // pinched: leave it
      sum += mesh.position(mesh.from(h));
    }
  }
  if (border.empty() || triangles.empty()) return mesh;
  // One closed border only, or the fan would not be a disc.
  Index at = border.front().second;
  for (std::size_t steps = 1; at != border.front().first; ++steps) {
    const auto next = std::find_if(border.begin(), border.end(), [&](const auto& e) { return e.first == at; });
    if (next == border.end() || steps > border.size()) return mesh;
    at = next->second;
    if (at == border.front().first && steps + 1 != border.size()) return mesh;
  }
  const Index center = Index(mesh.vertex_count());
  for (const auto& [a, b] : border) triangles.insert(triangles.end(), {a, b, center});
  return rebuilt(mesh, std::move(triangles), {sum / float(border.size())});
}

inline TriangleMesh fold(TriangleMesh mesh, Random& random, float e) {
  const auto inside = disc(mesh, pick(random, mesh.vertex_count()), 1);
  for (const Index v : inside)
    mesh.vertices.position[v] += Vec3(uniform(random, -2, 2), uniform(random, -2, 2), uniform(random, -2, 2)) * e;
  return mesh;
}

inline TriangleMesh push_through(TriangleMesh mesh, Random& random, float e) {
  const Index t = pick(random, mesh.triangle_count());
  const Vec3 inward = -normal_of(mesh, t) * e * uniform(random, 3, 10);
  for (const Index v : disc(mesh, mesh.vertex[3 * t], 1 + int(random() % 2))) mesh.vertices.position[v] += inward;
  return mesh;
}

inline TriangleMesh one_piece(const TriangleMesh& mesh, Index v, bool keep) {
  const MeshPieces pieces = mesh_pieces(mesh);
  std::vector<std::uint8_t> kept(mesh.triangle_count());
  for (Index t = 0; t < kept.size(); ++t)
    kept[t] = (pieces.of_vertex[mesh.vertex[3 * t]] == pieces.of_vertex[v]) == keep;
  return submesh(mesh, kept);
}

inline TriangleMesh with_appended(const TriangleMesh& mesh, TriangleMesh other) {
  TriangleMesh sum = mesh;
  for (Index& id : other.vertices.id) id = sum.next_id++;
  other.next_id = sum.next_id;
  append(sum, other);
  return sum;
}

inline TriangleMesh duplicate_piece(const TriangleMesh& mesh, Random& random, float e) {
  TriangleMesh copy = one_piece(mesh, pick(random, mesh.vertex_count()), true);
  const Vec3 shift = Vec3(uniform(random, -1, 1), uniform(random, -1, 1), uniform(random, -1, 1)) * e * 0.5f;
  for (Vec3& p : copy.vertices.position) p += shift;
  return with_appended(mesh, std::move(copy));
}

inline TriangleMesh droplet(const TriangleMesh& mesh, Random& random, float e, bool inside) {
  const Index t = pick(random, mesh.triangle_count());
  const float radius = e * uniform(random, 0.4f, 1.5f);
  const Vec3 center = mesh.position(mesh.vertex[3 * t]) +
                      normal_of(mesh, t) * (inside ? -1.0f : 1.0f) * (radius + e * uniform(random, 0.3f, 3.0f));
  std::vector<Vec3> corners;
  for (int axis = 0; axis < 3; ++axis)
    for (const float sign : {1.0f, -1.0f}) {
      Vec3 p = center;
      p[axis] += sign * radius;
      corners.push_back(p);
    }
  std::vector<Index> triangles;
  for (Index x = 0; x < 2; ++x)
    for (Index y = 2; y < 4; ++y)
      for (Index z = 4; z < 6; ++z) {
        const bool even = ((x + y + z) % 2 == 0) != inside;
        triangles.insert(triangles.end(), {x, even ? y : z, even ? z : y});
      }
  return with_appended(mesh, make_mesh(std::move(corners), std::move(triangles)));
}

/// A tube of six triangles between two far triangles.
inline TriangleMesh false_bridge(const TriangleMesh& mesh, Random& random) {
  const Index a = pick(random, mesh.triangle_count()), b = pick(random, mesh.triangle_count());
  std::set<Index> corners;
  for (Index k = 0; k < 3; ++k) corners.insert({mesh.vertex[3 * a + k], mesh.vertex[3 * b + k]});
  if (corners.size() != 6) return mesh;
  for (Index h = 0; h < mesh.vertex.size(); ++h) {
    const bool from_a =
        std::find(&mesh.vertex[3 * a], &mesh.vertex[3 * a] + 3, mesh.from(h)) != &mesh.vertex[3 * a] + 3;
    const bool to_b = std::find(&mesh.vertex[3 * b], &mesh.vertex[3 * b] + 3, mesh.to(h)) != &mesh.vertex[3 * b] + 3;
    if (from_a && to_b) return mesh;  // neighbours: the tube would double an edge
  }
  std::vector<Index> triangles;
  for (Index h = 0; h < mesh.vertex.size(); ++h)
    if (h / 3 != a && h / 3 != b) triangles.push_back(mesh.vertex[h]);
  for (Index k = 0; k < 3; ++k) {
    const Index a0 = mesh.vertex[3 * a + k], a1 = mesh.vertex[3 * a + (k + 1) % 3];
    const Index b0 = mesh.vertex[3 * b + (3 - k) % 3], b1 = mesh.vertex[3 * b + (5 - k) % 3];
    triangles.insert(triangles.end(), {a0, a1, b0, a1, b1, b0});
  }
  return rebuilt(mesh, std::move(triangles));
}

}  // namespace damage

/// Applies one damage; may return the mesh unchanged where the place drawn does not allow it. `e`: edge length.
inline TriangleMesh damaged(const TriangleMesh& mesh, Damage kind, damage::Random& random, float e) {
  switch (kind) {
    case Damage::cut_off_patch:
      return damage::cut_off_patch(mesh, random);
    case Damage::fold:
      return damage::fold(mesh, random, e);
    case Damage::push_through:
      return damage::push_through(mesh, random, e);
    case Damage::duplicate_piece:
      return damage::duplicate_piece(mesh, random, e);
    case Damage::droplet_inside:
      return damage::droplet(mesh, random, e, true);
    case Damage::droplet_outside:
      return damage::droplet(mesh, random, e, false);
    case Damage::lose_piece:
      return damage::one_piece(mesh, damage::pick(random, mesh.vertex_count()), false);
    case Damage::false_bridge:
      return damage::false_bridge(mesh, random);
    case Damage::count:
      break;
  }
  return mesh;
}

}  // namespace isoskin
