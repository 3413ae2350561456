// A piece of surface appears about an extremum, or vanishes.
#include <algorithm>
#include <array>
#include <map>
#include <set>
#include <vector>

#include "core/mesh/small_pieces.h"
#include "core/topology/mesh_probe.h"
#include "core/topology/surgery_theatre.h"

namespace isoskin::surgery {
namespace {

/// Directions of an octahedron's corners, each triangle cut in four `levels` times.
struct Octahedron {
  std::vector<DVec3> direction{{1, 0, 0}, {-1, 0, 0}, {0, 1, 0}, {0, -1, 0}, {0, 0, 1}, {0, 0, -1}};
  std::vector<std::array<Index, 3>> triangle{{0, 2, 4}, {2, 1, 4}, {1, 3, 4}, {3, 0, 4},
                                             {2, 0, 5}, {1, 2, 5}, {3, 1, 5}, {0, 3, 5}};

  void subdivide() {
    std::map<std::pair<Index, Index>, Index> middles;
    const auto middle = [&](Index a, Index b) {
      const auto [it, fresh] = middles.try_emplace(std::minmax(a, b), Index(direction.size()));
      if (fresh) direction.push_back(glm::normalize(direction[a] + direction[b]));
      return it->second;
    };
    std::vector<std::array<Index, 3>> finer;
    for (const auto& [a, b, c] : triangle) {
      const Index ab = middle(a, b), bc = middle(b, c), ca = middle(c, a);
      finer.insert(finer.end(), {{a, ab, ca}, {b, bc, ab}, {c, ca, bc}, {ab, bc, ca}});
    }
    triangle = std::move(finer);
  }
};

/// Points of the surface in the octahedron's directions, turned to the Hessian's axes; nothing if one is out of reach.
std::optional<std::vector<DVec3>> shell_points(const Theatre& theatre, const Octahedron& shape) {
  std::vector<DVec3> points;
  for (const DVec3& d : shape.direction) {
    const DVec3 direction = theatre.site.after.hessian.vectors * d;
    const auto distance = theatre.surface_along(direction);
    if (!distance) return std::nullopt;
    points.push_back(theatre.site.after.position + *distance * direction);
  }
  return points;
}

double longest_edge_of(const Octahedron& shape, const std::vector<DVec3>& points) {
  double longest = 0.0;
  for (const auto& corner : shape.triangle)
    for (int k = 0; k < 3; ++k)
      longest = std::max(longest, glm::distance(points[corner[k]], points[corner[(k + 1) % 3]]));
  return longest;
}

/// The piece that encloses the critical point, told by two rays; kNone when none does. Returns one of its triangles.
Index enclosing_triangle(const TriangleMesh& mesh, const Theatre& theatre) {
  const bool leaving = theatre.matter == Matter::solid;
  for (int axis = 0; axis < 3; ++axis) {
    const auto hits =
        line_hits(mesh, theatre.site.before.position, theatre.site.before.hessian.vectors[axis], theatre.reach());
    const auto ahead = std::find_if(hits.begin(), hits.end(), [](const LineHit& hit) { return hit.distance > 0.0; });
    if (ahead == hits.begin() || ahead == hits.end()) continue;
    const LineHit &front = *ahead, &back = *(ahead - 1);
    if (front.along != leaving || back.along == leaving) continue;
    const std::vector<Index> piece = piece_of(mesh, front.triangle);
    if (std::binary_search(piece.begin(), piece.end(), back.triangle)) return front.triangle;
  }
  return kNone;
}

/// A triangle of the vertex nearest to the critical point: a piece a few triangles large may not enclose it.
Index nearest_triangle(const TriangleMesh& mesh, const Theatre& theatre) {
  const Vec3 at(theatre.site.before.position);
  Index nearest = kNone;
  float least = float(theatre.options.search * theatre.e());
  for (Index h = 0; h < mesh.vertex.size(); ++h) {
    const float distance = glm::distance(mesh.position(mesh.vertex[h]), at);
    if (distance < least) {
      least = distance;
      nearest = TriangleMesh::triangle(h);
    }
  }
  return nearest;
}

struct PieceShape {
  int euler = 0;
  double volume = 0.0;
  double diagonal = 0.0;
};

PieceShape shape_of(const TriangleMesh& mesh, const std::vector<Index>& piece) {
  PieceShape shape;
  std::set<Index> vertices;
  Box box;
  for (const Index t : piece) {
    DVec3 p[3];
    for (Index k = 0; k < 3; ++k) {
      const Index v = mesh.vertex[3 * t + k];
      vertices.insert(v);
      p[k] = DVec3(mesh.position(v));
      box.add(p[k]);
    }
    shape.volume += glm::dot(p[0], glm::cross(p[1], p[2])) / 6.0;
  }
  shape.euler = int(vertices.size()) - int(piece.size()) / 2;  // three halfedges a triangle, two an edge
  shape.diagonal = box.diagonal();
  return shape;
}

}  // namespace

SurgeryReport make_shell(TriangleMesh& mesh, const Theatre& theatre) {
  if (!(theatre.filled(theatre.site.after.position) > 0.0)) return refused("the new piece is gone again");
  constexpr int kLevels = 5;
  Octahedron shape;
  auto points = shell_points(theatre, shape);
  for (int level = 0; points && level < kLevels && longest_edge_of(shape, *points) > kSmallPieceEdge * theatre.e();
       ++level) {
    shape.subdivide();
    points = shell_points(theatre, shape);
  }
  if (!points) return refused("the new piece is larger than the reach");
  MeshPatch patch(mesh);
  std::vector<Index> vertex;
  for (const DVec3& p : *points) vertex.push_back(patch.add_vertex(p, {}));
  for (auto [a, b, c] : shape.triangle) {
    if (theatre.matter == Matter::hollow) std::swap(b, c);
    patch.add_triangle(vertex[a], vertex[b], vertex[c]);
  }
  return applied(mesh, patch);
}

SurgeryReport remove_shell(TriangleMesh& mesh, const Theatre& theatre) {
  Index triangle = enclosing_triangle(mesh, theatre);
  const bool enclosed = triangle != kNone;
  if (!enclosed) triangle = nearest_triangle(mesh, theatre);
  if (triangle == kNone) return refused("no piece encloses the critical point");
  const std::vector<Index> piece = piece_of(mesh, triangle);
  const PieceShape shape = shape_of(mesh, piece);
  if (shape.euler != 2) return refused("the piece about the critical point is not a sphere");
  if (sign(theatre.matter) * shape.volume < 0.0) return refused("the piece about the critical point is inside out");
  const double small = 2.0 * theatre.options.search * theatre.e();
  if (!enclosed && shape.diagonal > small) return refused("no piece encloses the critical point");
  MeshPatch patch(mesh);
  patch.remove(piece);
  return applied(mesh, patch);
}

}  // namespace isoskin::surgery
