// The closed, oriented triangle mesh: index-based halfedges in structure-of-arrays form (design 4).
#pragma once

#include <array>
#include <vector>

#include "core/types.h"

namespace isoskin {

/// Per-vertex columns, one entry a vertex. Edits carry all of them along: a collapse or split averages position, rest
/// and velocity; an id is never averaged: the surviving vertex keeps its own, a new one gets a fresh id.
struct VertexTable {
  std::vector<Vec3> position;
  std::vector<Vec3> rest;      // where the material point was when it was born: the tracked texture coordinate
  std::vector<Vec3> velocity;  // world units a second
  std::vector<Index> id;       // persistent, unique within a sequence
  std::vector<Index> age;      // frames since an edit last touched this vertex; 0 = touched in this frame ("locked")

  std::size_t size() const { return position.size(); }
  /// New rows: zero vectors, no id (kNone), age 0.
  void resize(std::size_t n);
  void reserve(std::size_t n);
  /// The rows rows[0], rows[1], ... as a new table.
  VertexTable select(const std::vector<Index>& rows) const;
  /// Row v becomes a + t (b - a) of rows a and b, touched now (age 0); its id stays. v may be a or b.
  void blend(Index v, Index a, Index b, float t);
};

/// Halfedges 3t, 3t+1, 3t+2 belong to triangle t, counter-clockwise seen from outside; halfedge h runs from vertex[h]
/// to vertex[next(h)]. twin[h] is the same edge in the neighbour. A whole mesh has no borders: every twin exists.
struct TriangleMesh {
  std::vector<Index> vertex;  // 3 a triangle
  std::vector<Index> twin;    // 3 a triangle
  VertexTable vertices;
  Index next_id = 0;  // the id the next new vertex gets

  std::size_t triangle_count() const { return vertex.size() / 3; }
  std::size_t vertex_count() const { return vertices.size(); }
  bool empty() const { return vertex.empty(); }

  static Index next(Index h) { return h % 3 == 2 ? h - 2 : h + 1; }
  static Index prev(Index h) { return h % 3 == 0 ? h + 2 : h - 1; }
  static Index triangle(Index h) { return h / 3; }
  Index from(Index h) const { return vertex[h]; }
  Index to(Index h) const { return vertex[next(h)]; }
  /// The next halfedge that leaves from(h), turning clockwise about it.
  Index turn(Index h) const { return next(twin[h]); }
  const Vec3& position(Index v) const { return vertices.position[v]; }
};

/// Fills mesh.twin from mesh.vertex. Throws std::invalid_argument naming the first edge that is not shared by exactly
/// two triangles of opposite direction. Parallel; the result does not depend on the number of threads.
void link_twins(TriangleMesh& mesh);

/// Builds a mesh from positions and triangles: rest = position, velocity zero, fresh ids in order, age 0, twins linked.
TriangleMesh make_mesh(std::vector<Vec3> positions, std::vector<Index> triangles);

/// One outgoing halfedge of every vertex (the smallest), kNone for an unused vertex.
std::vector<Index> outgoing_halfedges(const TriangleMesh& mesh);

/// Vertex-to-corner lists in CSR form: the halfedges that leave vertex v are corner[first[v] .. first[v+1]), ascending.
struct VertexCorners {
  std::vector<Index> first;   // vertex_count + 1
  std::vector<Index> corner;  // 3 * triangle_count
};
VertexCorners vertex_corners(const TriangleMesh& mesh);

/// Volume between triangles and the world's origin. Summed in whole numbers, of units that follow the size of what is
/// added, so that the sum depends neither on the order nor on what has been added and taken back since.
class SolidSum {
public:
  /// `times`: 1 or -1.
  void add(const Vec3& a, const Vec3& b, const Vec3& c, int times = 1);
  void add(const SolidSum& other);
  /// World units^3.
  double volume() const;

private:
  static constexpr int kBins = 10, kBits = 40;       // binary orders of magnitude a bin
  static constexpr int kLeast = -kBins / 2 * kBits;  // of the first bin
  static constexpr int kMantissa = 53;               // bits
  static int unit(int bin) { return kLeast + kBits * bin - kMantissa; }
  std::array<__int128, kBins> bin_{};
};

/// Connected pieces: label of every vertex (pieces numbered by their smallest vertex, unused vertices kNone) and their
/// Euler characteristics and enclosed volumes (negative for a cavity).
struct MeshPieces {
  std::vector<Index> of_vertex;
  std::vector<int> euler;
  std::vector<double> volume;
  // What they are told from, so that they may go on from those of the mesh before, with the same result.
  std::vector<Index> first;     // per piece: its smallest vertex
  std::vector<int> triangles;   // per piece
  std::vector<SolidSum> solid;  // per piece

  std::size_t count() const { return euler.size(); }
};
MeshPieces mesh_pieces(const TriangleMesh& mesh);

/// to = from in parallel, to where there is memory already.
void copy_mesh(const TriangleMesh& from, TriangleMesh& to);

/// Keeps the triangles t with keep[t] != 0, drops unused vertices, renumbers both in order and relinks. Every kept set
/// must be a union of whole pieces (else throws std::invalid_argument through link_twins).
TriangleMesh submesh(const TriangleMesh& mesh, const std::vector<std::uint8_t>& keep);

/// Appends all of `other` (vertices after vertices, triangles after triangles); ids are kept as they are and next_id
/// becomes the larger of the two.
void append(TriangleMesh& mesh, const TriangleMesh& other);

/// Renumbers vertices and triangles along a Morton curve of their positions, so gathers stay local (design 4).
void reorder(TriangleMesh& mesh);

/// The angle opposite the shortest edge, degrees; 0 for a degenerate triangle.
double smallest_angle(const DVec3& a, const DVec3& b, const DVec3& c);

/// Smallest angles and lengths of a mesh, degrees and world units.
struct ShapeStatistics {
  double min_angle = 0, p1_angle = 0, mean_angle = 0;  // over each triangle's smallest angle
  double below_10_degrees = 0;                         // share of triangles
  double mean_edge = 0, area = 0;
};
ShapeStatistics shape_statistics(const TriangleMesh& mesh);

}  // namespace isoskin
