#include "core/mesh/mesh_part.h"

#include <queue>

#include <gtest/gtest.h>

#include "core/mechanics/alter.h"
#include "core/mesh/edit.h"
#include "tests/test_meshes.h"

using namespace isoskin;
using namespace isoskin::test_meshes;

namespace {

/// Edges from each vertex to the nearest one with an id from `first_new` on, breadth first.
std::vector<int> rings_from_new(const TriangleMesh& mesh, Index first_new) {
  std::vector<std::vector<Index>> near(mesh.vertex_count());
  for (Index h = 0; h < mesh.vertex.size(); ++h) near[mesh.from(h)].push_back(mesh.to(h));
  std::vector<int> ring(mesh.vertex_count(), -1);
  std::queue<Index> open;
  for (Index v = 0; v < ring.size(); ++v)
    if (mesh.vertices.id[v] >= first_new) ring[v] = 0, open.push(v);
  for (; !open.empty(); open.pop())
    for (const Index w : near[open.front()])
      if (ring[w] < 0) ring[w] = ring[open.front()] + 1, open.push(w);
  return ring;
}

}  // namespace

TEST(MeshPart, HoldsNewVerticesAndTheirRings) {
  TriangleMesh mesh = icosphere(4);
  const Index first_new = mesh.next_id;
  for (const Index h : {0u, 900u, 2400u}) split_edge(mesh, h);
  for (int rings = 0; rings < 4; ++rings) {
    const std::vector<std::uint8_t> frozen = MeshPart(mesh, first_new, rings).frozen(mesh);
    const std::vector<int> ring = rings_from_new(mesh, first_new);
    for (Index v = 0; v < frozen.size(); ++v) EXPECT_EQ(frozen[v] != 0, ring[v] > rings) << v;
  }
}

TEST(MeshPart, GoesOnThroughEdits) {
  TriangleMesh mesh = icosphere(4);
  const Index first_new = mesh.next_id;
  split_edge(mesh, 0);
  const MeshPart part(mesh, first_new, 2);
  const std::vector<int> ring = rings_from_new(mesh, first_new);
  std::vector<Index> far;
  for (Index v = 0; v < ring.size(); ++v)
    if (ring[v] > 2) far.push_back(mesh.vertices.id[v]);
  AlterOptions options;
  options.edge_length = 0.02f;  // splits everything it may
  options.respect_locks = false;
  EXPECT_GT(alter(mesh, options, {}, part.frozen(mesh)).splits, 50u);
  const std::vector<std::uint8_t> frozen = part.frozen(mesh);
  std::vector<Index> frozen_ids;
  for (Index v = 0; v < frozen.size(); ++v)
    if (frozen[v]) frozen_ids.push_back(mesh.vertices.id[v]);
  EXPECT_EQ(frozen_ids, far);
}

TEST(MeshPart, AnOpenPartIsTheTrianglesAboutItsVertices) {
  const TriangleMesh mesh = torus(24, 12);
  std::vector<std::uint8_t> frozen(mesh.vertex_count(), 1);
  frozen[7] = frozen[100] = frozen[101] = 0;
  const OpenPart part = open_part(mesh, frozen);
  std::size_t expected = 0;
  for (Index t = 0; t < mesh.triangle_count(); ++t) {
    bool any = false;
    for (Index h = 3 * t; h < 3 * t + 3; ++h) any |= !frozen[mesh.vertex[h]];
    if (!any) continue;
    ASSERT_LT(expected, part.triangle.size());
    ASSERT_EQ(part.triangle[expected], t);
    for (Index k = 0; k < 3; ++k) {
      const Index local = part.mesh.vertex[3 * expected + k];
      ASSERT_EQ(part.vertex[local], mesh.vertex[3 * t + k]);
      EXPECT_EQ(part.mesh.position(local), mesh.position(mesh.vertex[3 * t + k]));
    }
    ++expected;
  }
  EXPECT_EQ(part.triangle.size(), expected);
  EXPECT_LT(expected, 20u);  // what is handed to the solver grows with the part, not with the mesh
  EXPECT_TRUE(open_part(mesh, std::vector<std::uint8_t>(mesh.vertex_count(), 1)).triangle.empty());
}
