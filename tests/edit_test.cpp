#include "core/mesh/edit.h"

#include <algorithm>
#include <set>

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include "core/mesh/validate.h"
#include "tests/test_meshes.h"

using namespace isoskin;
using namespace isoskin::test_meshes;

namespace {

std::string fault(TriangleMesh mesh) {
  compact(mesh);
  return validate(mesh).reason;
}

std::set<Index> neighbours(const TriangleMesh& mesh, Index v) {
  std::set<Index> out;
  for (Index h = 0; h < mesh.vertex.size(); ++h) {
    if (mesh.vertex[h] == kNone) continue;
    if (mesh.from(h) == v) out.insert(mesh.to(h));
  }
  return out;
}

/// The link condition from its definition, by plain search.
bool link_condition_oracle(const TriangleMesh& mesh, Index h) {
  const auto a = neighbours(mesh, mesh.from(h)), b = neighbours(mesh, mesh.to(h));
  std::set<Index> common;
  for (const Index v : a)
    if (b.count(v)) common.insert(v);
  const std::set<Index> opposite = {mesh.from(mesh.prev(h)), mesh.from(mesh.prev(mesh.twin[h]))};
  return common == opposite && !(a.size() == 3 && b.size() == 3);
}

Index random_halfedge(const TriangleMesh& mesh, std::mt19937& random) {
  return Index(std::uniform_int_distribution<std::size_t>(0, mesh.vertex.size() - 1)(random));
}

int euler(const TriangleMesh& mesh) {
  return int(mesh.vertex_count()) - int(mesh.vertex.size() / 2) + int(mesh.triangle_count());
}

/// Random edits, each checked; the mesh is kept between 4 and about `target` vertices.
void edit_at_random(TriangleMesh mesh, int edits, unsigned seed, std::size_t target) {
  std::mt19937 random(seed);
  const int chi = euler(mesh);
  int done = 0, refused = 0;
  for (int i = 0; i < edits; ++i) {
    const Index h = random_halfedge(mesh, random);
    const float t = float(random() % 5) / 4.0f;
    const bool grow = mesh.vertex_count() < target && random() % 2;
    ASSERT_EQ(link_condition(mesh, h), link_condition_oracle(mesh, h));
    if (grow) {
      split_edge(mesh, h, t);
    } else if (random() % 2) {
      if (!can_flip(mesh, h)) {
        ++refused;
        continue;
      }
      flip_edge(mesh, h);
    } else {
      if (!link_condition(mesh, h)) {
        ++refused;
        continue;
      }
      collapse_edge(mesh, h, t);
      compact(mesh);
    }
    ++done;
    const ValidateReport report = validate(mesh);
    ASSERT_TRUE(report.ok) << "edit " << i << ": " << report.reason;
    ASSERT_EQ(euler(mesh), chi);
    ASSERT_EQ(mesh_pieces(mesh).count(), 1u);
  }
  // Sequences must not pass by refusing everything, nor by never meeting an edit that has to be refused.
  if (edits >= 1000) {
    EXPECT_GT(done, edits / 3);
    EXPECT_GT(refused, 0);
  }
}

}  // namespace

TEST(Edit, LongRandomSequencesOnSphere) {
  edit_at_random(icosphere(1), 4000, 1, 60);
}
TEST(Edit, LongRandomSequencesOnTorus) {
  edit_at_random(torus(6, 5), 4000, 2, 60);
}
TEST(Edit, LongRandomSequencesOnTetrahedron) {
  edit_at_random(tetrahedron(), 4000, 3, 8);
}

RC_GTEST_PROP(Edit, ShortRandomSequencesOnSmallMeshes, ()) {
  const int kind = *rc::gen::inRange(0, 3);
  const TriangleMesh start = kind == 0 ? tetrahedron() : kind == 1 ? torus(3, 3) : cube(1);
  edit_at_random(start, 60, *rc::gen::arbitrary<unsigned>(), *rc::gen::inRange(5, 20));
}

TEST(Edit, ATetrahedronHasNothingToFlipOrCollapse) {
  const TriangleMesh mesh = tetrahedron();
  for (Index h = 0; h < mesh.vertex.size(); ++h) {
    EXPECT_FALSE(can_flip(mesh, h));
    EXPECT_FALSE(link_condition(mesh, h));
  }
}

TEST(Edit, NeckOfATorusDoesNotCollapse) {
  const TriangleMesh mesh = torus(3, 8);  // three vertices around: every such edge closes a loop without a triangle
  for (Index h = 0; h < mesh.vertex.size(); ++h)
    if (mesh.to(h) == (mesh.from(h) + 8) % 24) {
      EXPECT_FALSE(link_condition(mesh, h));
    }
}

TEST(Edit, FlipTwiceTurnsBack) {
  TriangleMesh mesh = icosphere(1);
  const TriangleMesh before = mesh;
  flip_edge(mesh, 20);
  EXPECT_EQ(fault(mesh), "");
  EXPECT_NE(mesh.vertex, before.vertex);
  const std::set<Index> ends = {before.from(20), before.to(20)};
  EXPECT_FALSE(neighbours(mesh, *ends.begin()).count(*ends.rbegin()));
  flip_edge(mesh, 20);
  EXPECT_EQ((std::set<Index>{mesh.from(20), mesh.to(20)}), ends);
  EXPECT_EQ(fault(mesh), "");
}

TEST(Edit, SplitBlendsColumnsAndTakesAFreshId) {
  TriangleMesh mesh = icosphere(1);
  const Index h = 17, a = mesh.from(h), b = mesh.to(h);
  mesh.vertices.rest[a] = {1, 2, 3}, mesh.vertices.rest[b] = {5, 6, 7};
  mesh.vertices.velocity[a] = {0, 0, 4}, mesh.vertices.velocity[b] = {0, 4, 0};
  for (Index& age : mesh.vertices.age) age = 9;
  const Vec3 expected = 0.75f * mesh.position(a) + 0.25f * mesh.position(b);
  const Index fresh = mesh.next_id, m = split_edge(mesh, h, 0.25f);
  EXPECT_EQ(mesh.vertices.id[m], fresh);
  EXPECT_EQ(mesh.next_id, fresh + 1);
  EXPECT_LT(glm::length(mesh.position(m) - expected), 1e-6f);
  EXPECT_EQ(mesh.vertices.rest[m], Vec3(2, 3, 4));
  EXPECT_EQ(mesh.vertices.velocity[m], Vec3(0, 1, 3));
  EXPECT_EQ(mesh.vertices.age[m], 0u);
  EXPECT_EQ(mesh.vertices.age[a], 9u);
  EXPECT_EQ(neighbours(mesh, m).size(), 4u);
}

TEST(Edit, CollapseBlendsColumnsAndKeepsFromsId) {
  TriangleMesh mesh = icosphere(2);
  const Index h = 40, a = mesh.from(h), id = mesh.vertices.id[a], gone = mesh.vertices.id[mesh.to(h)];
  mesh.vertices.velocity[a] = {2, 0, 0}, mesh.vertices.velocity[mesh.to(h)] = {0, 2, 0};
  for (Index& age : mesh.vertices.age) age = 9;
  const Vec3 middle = 0.5f * (mesh.position(a) + mesh.position(mesh.to(h)));
  collapse_edge(mesh, h);
  compact(mesh);
  EXPECT_EQ(validate(mesh).reason, "");
  const auto& ids = mesh.vertices.id;
  const std::ptrdiff_t row = std::find(ids.begin(), ids.end(), id) - ids.begin();
  ASSERT_LT(row, std::ptrdiff_t(ids.size()));
  EXPECT_EQ(std::find(ids.begin(), ids.end(), gone), ids.end());
  EXPECT_LT(glm::length(mesh.position(Index(row)) - middle), 1e-6f);
  EXPECT_EQ(mesh.vertices.velocity[row], Vec3(1, 1, 0));
  EXPECT_EQ(mesh.vertices.age[row], 0u);
}

TEST(Edit, CompactKeepsOrderAndTwins) {
  TriangleMesh mesh = torus(8, 7);
  ASSERT_TRUE(link_condition(mesh, 30));
  collapse_edge(mesh, 30);
  compact(mesh);
  EXPECT_EQ(mesh.triangle_count(), 110u);
  EXPECT_TRUE(std::is_sorted(mesh.vertices.id.begin(), mesh.vertices.id.end()));
  TriangleMesh relinked = mesh;
  link_twins(relinked);
  EXPECT_EQ(relinked.twin, mesh.twin);
  const TriangleMesh again = mesh;
  compact(mesh);
  EXPECT_EQ(mesh.vertex, again.vertex);
}
