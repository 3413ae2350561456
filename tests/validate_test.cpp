#include "core/mesh/validate.h"

#include <cmath>
#include <functional>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/test_meshes.h"

using namespace isoskin;
using namespace isoskin::test_meshes;
using testing::HasSubstr;

namespace {

std::string reason_after(const std::function<void(TriangleMesh&)>& damage, TriangleMesh mesh = icosphere(2)) {
  EXPECT_TRUE(validate(mesh)) << validate(mesh).reason;
  damage(mesh);
  const ValidateReport report = validate(mesh);
  EXPECT_EQ(report.ok, report.reason.empty());
  return report.reason;
}

/// Glues vertex b of a mesh onto vertex a.
void identify(TriangleMesh& mesh, Index a, Index b) {
  for (Index& v : mesh.vertex)
    if (v == b) v = a;
}

void drop_last_vertex(TriangleMesh& mesh, Index replaced) {
  const Index last = Index(mesh.vertex_count() - 1);
  for (Index& v : mesh.vertex)
    if (v == last) v = replaced;
  mesh.vertices.position[replaced] = mesh.vertices.position[last];
  mesh.vertices.id[replaced] = mesh.vertices.id[last];
  mesh.vertices.resize(last);
}

}  // namespace

TEST(Validate, AcceptsClosedMeshes) {
  EXPECT_TRUE(validate(TriangleMesh{}));
  EXPECT_TRUE(validate(tetrahedron()));
  EXPECT_TRUE(validate(torus(3, 3)));
  EXPECT_TRUE(validate(cube(1)));
}

TEST(Validate, ArraySizes) {
  EXPECT_THAT(reason_after([](TriangleMesh& m) { m.vertex.pop_back(); }), HasSubstr("three a triangle"));
  EXPECT_THAT(reason_after([](TriangleMesh& m) { m.twin.clear(); }), HasSubstr("0 twins"));
  EXPECT_THAT(reason_after([](TriangleMesh& m) { m.vertices.rest.pop_back(); }), HasSubstr("161 rest"));
  EXPECT_THAT(reason_after([](TriangleMesh& m) { m.vertices.velocity.clear(); }), HasSubstr("0 velocities"));
  EXPECT_THAT(reason_after([](TriangleMesh& m) { m.vertices.id.emplace_back(); }), HasSubstr("163 ids"));
  EXPECT_THAT(reason_after([](TriangleMesh& m) { m.vertices.age.pop_back(); }), HasSubstr("161 ages"));
}

TEST(Validate, IndexRange) {
  EXPECT_THAT(reason_after([](TriangleMesh& m) { m.vertex[31] = 162; }), HasSubstr("halfedge 31 of triangle 10"));
  EXPECT_THAT(reason_after([](TriangleMesh& m) { m.twin[5] = kNone; }), HasSubstr("halfedge 5 of triangle 1"));
}

TEST(Validate, RepeatedVertex) {
  EXPECT_THAT(reason_after([](TriangleMesh& m) { m.vertex[22] = m.vertex[21]; }), HasSubstr("triangle 7 repeats"));
}

TEST(Validate, Twins) {
  EXPECT_THAT(reason_after([](TriangleMesh& m) { m.twin[9] = m.twin[10]; }),
              HasSubstr("halfedge 4 (43 to 42) has twin 9"));
  EXPECT_THAT(reason_after([](TriangleMesh& m) { m.twin[0] = 0; }), HasSubstr("halfedge 0 "));
  // One triangle turned over: its edges now run the same way as its neighbours'.
  EXPECT_THAT(reason_after([](TriangleMesh& m) { std::swap(m.vertex[4], m.vertex[5]); }), HasSubstr("has twin"));
}

TEST(Validate, TwoEdgesWithTheSameEnds) {
  // An octahedron's opposite corners glued together: its four meridians become two pairs of parallel edges.
  const auto octahedron = [] {
    return make_mesh({{0, 0, 1}, {0, 0, -1}, {1, 0, 0}, {0, 1, 0}, {-1, 0, 0}, {0, -1, 0}},
                     {0, 2, 3, 0, 3, 4, 0, 4, 5, 0, 5, 2, 1, 3, 2, 1, 4, 3, 1, 5, 4, 1, 2, 5});
  };
  const std::string reason = reason_after([](TriangleMesh& m) { drop_last_vertex(m, 3); }, octahedron());
  EXPECT_THAT(reason, HasSubstr("two edges run from vertex 0 to vertex 3"));
}

TEST(Validate, TrianglesBackToBack) {
  TriangleMesh pillow = tetrahedron();
  pillow.vertex = {0, 1, 2, 0, 2, 1};
  pillow.twin = {5, 4, 3, 2, 1, 0};
  pillow.vertices.resize(3);
  EXPECT_THAT(validate(pillow).reason, HasSubstr("triangle 0 (0 1 2) has the same vertices"));
}

TEST(Validate, TwoFansAtAVertex) {
  const auto two_pieces = [] {
    TriangleMesh mesh = icosphere(1);
    append(mesh, icosphere(1, 1.0f, Vec3(3, 0, 0)));
    for (Index v = 0; v < mesh.vertex_count(); ++v) mesh.vertices.id[v] = v;
    mesh.next_id = Index(mesh.vertex_count());
    return mesh;
  };
  EXPECT_THAT(reason_after([](TriangleMesh& m) { drop_last_vertex(m, 0); }, two_pieces()),
              HasSubstr("vertex 0 has more than one fan"));
}

TEST(Validate, UnusedVertex) {
  EXPECT_THAT(reason_after([](TriangleMesh& m) {
                m.vertices.resize(163);
                m.vertices.id[162] = m.next_id++;
              }),
              HasSubstr("vertex 162 is unused"));
}

TEST(Validate, FiniteColumns) {
  EXPECT_THAT(reason_after([](TriangleMesh& m) { m.vertices.position[7].y = std::nanf(""); }),
              HasSubstr("position of vertex 7"));
  EXPECT_THAT(reason_after([](TriangleMesh& m) { m.vertices.rest[8].z = INFINITY; }), HasSubstr("rest of vertex 8"));
  EXPECT_THAT(reason_after([](TriangleMesh& m) { m.vertices.velocity[9].x = -INFINITY; }),
              HasSubstr("velocity of vertex 9"));
}

TEST(Validate, Ids) {
  EXPECT_THAT(reason_after([](TriangleMesh& m) { m.vertices.id[3] = m.next_id; }), HasSubstr("vertex 3 has id 162"));
  EXPECT_THAT(reason_after([](TriangleMesh& m) { m.vertices.id[20] = m.vertices.id[4]; }),
              HasSubstr("vertices 4 and 20 share id 4"));
}

TEST(Validate, NamesTheFirstFault) {
  EXPECT_THAT(reason_after([](TriangleMesh& m) { identify(m, 100, 101), m.vertex[900] = 500, m.vertex[30] = 400; }),
              HasSubstr("halfedge 30 "));
}
