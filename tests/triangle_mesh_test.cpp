#include "core/mesh/triangle_mesh.h"

#include <tbb/global_control.h>

#include <algorithm>
#include <limits>
#include <numbers>
#include <set>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include "core/mesh/validate.h"
#include "tests/test_meshes.h"

using namespace isoskin;
using namespace isoskin::test_meshes;

namespace {

void expect_valid(const TriangleMesh& mesh) {
  const ValidateReport report = validate(mesh);
  EXPECT_TRUE(report.ok) << report.reason;
}

std::string link_error(std::vector<Index> triangles, std::size_t vertices) {
  try {
    make_mesh(std::vector<Vec3>(vertices), std::move(triangles));
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return {};
}

/// Triangles as sorted sets of their corners' ids, rotated to start at the smallest: equal up to renumbering.
std::multiset<std::array<Index, 3>> triangles_by_id(const TriangleMesh& mesh) {
  std::multiset<std::array<Index, 3>> out;
  for (Index t = 0; t < mesh.triangle_count(); ++t) {
    std::array<Index, 3> ids;
    for (int k = 0; k < 3; ++k) ids[k] = mesh.vertices.id[mesh.vertex[3 * t + k]];
    std::rotate(ids.begin(), std::min_element(ids.begin(), ids.end()), ids.end());
    out.insert(ids);
  }
  return out;
}

}  // namespace

TEST(TriangleMesh, MakersAreClosedAndEnclosePositiveVolume) {
  struct Case {
    TriangleMesh mesh;
    int euler;
    double volume, slack;
  };
  const double pi = std::numbers::pi;
  const Case cases[] = {
      {tetrahedron(), 2, 8.0 / (9.0 * std::sqrt(3.0)), 1e-6},
      {icosphere(4), 2, 4.0 / 3.0 * pi, 0.02},
      {torus(64, 32, 2.0f, 0.5f), 0, 2.0 * pi * pi * 2.0 * 0.25, 0.1},
      {cube(3), 2, 8.0, 1e-5},
  };
  for (const Case& c : cases) {
    expect_valid(c.mesh);
    const MeshPieces pieces = mesh_pieces(c.mesh);
    ASSERT_EQ(pieces.count(), 1u);
    EXPECT_EQ(pieces.euler[0], c.euler);
    EXPECT_NEAR(pieces.volume[0], c.volume, c.slack);
  }
}

TEST(TriangleMesh, MakeMeshFillsDefaults) {
  const TriangleMesh mesh = icosphere(1);
  EXPECT_EQ(mesh.next_id, mesh.vertex_count());
  for (Index v = 0; v < mesh.vertex_count(); ++v) {
    EXPECT_EQ(mesh.vertices.id[v], v);
    EXPECT_EQ(mesh.vertices.age[v], 0u);
    EXPECT_EQ(mesh.vertices.rest[v], mesh.vertices.position[v]);
    EXPECT_EQ(mesh.vertices.velocity[v], Vec3(0));
  }
}

TEST(TriangleMesh, LinkTwinsNamesTheFirstBadEdge) {
  EXPECT_THAT(link_error({0, 1, 2}, 3), testing::HasSubstr("edge 0-1 of triangle 0 is used 1 times"));
  EXPECT_THAT(link_error({0, 1, 2, 0, 2, 3, 0, 3, 1, 1, 2, 3}, 4), testing::HasSubstr("edge 1-2"));
  EXPECT_THAT(link_error({0, 1, 2, 0, 2, 1, 0, 1, 2, 0, 2, 1}, 3), testing::HasSubstr("used 2 times"));
  EXPECT_THAT(link_error({0, 0, 1}, 2), testing::HasSubstr("edge 0-0"));
  EXPECT_THAT(link_error({0, 1, 7}, 3), testing::HasSubstr("vertex 7, but there are 3"));
  EXPECT_THAT(link_error({0, 1}, 3), testing::HasSubstr("2 triangle corners"));
  EXPECT_EQ(link_error({}, 0), "");
}

TEST(TriangleMesh, LinkTwinsCopesWithOneVertexInEveryTriangle) {
  const Index n = 20000;  // a double cone: quadratic work at the apex would take minutes
  std::vector<Index> triangles;
  for (Index i = 0; i < n; ++i) {
    const Index a = 2 + i, b = 2 + (i + 1) % n;
    triangles.insert(triangles.end(), {0, a, b, 1, b, a});
  }
  expect_valid(make_mesh(std::vector<Vec3>(n + 2), triangles));
}

TEST(TriangleMesh, CornersAndOutgoingAgreeWithAPlainSearch) {
  const TriangleMesh mesh = torus(7, 5);
  const VertexCorners corners = vertex_corners(mesh);
  const std::vector<Index> outgoing = outgoing_halfedges(mesh);
  for (Index v = 0; v < mesh.vertex_count(); ++v) {
    std::vector<Index> expected;
    for (Index h = 0; h < mesh.vertex.size(); ++h)
      if (mesh.vertex[h] == v) expected.push_back(h);
    EXPECT_EQ(
        std::vector<Index>(corners.corner.begin() + corners.first[v], corners.corner.begin() + corners.first[v + 1]),
        expected);
    EXPECT_EQ(outgoing[v], expected.front());
  }
}

TEST(TriangleMesh, PiecesAreNumberedByTheirSmallestVertex) {
  TriangleMesh mesh = torus(12, 8, 1.0f, 0.3f, Vec3(10, 0, 0));
  TriangleMesh bubble = icosphere(2, 0.5f);
  for (std::size_t t = 0; t < bubble.triangle_count(); ++t) std::swap(bubble.vertex[3 * t], bubble.vertex[3 * t + 1]);
  link_twins(bubble);
  append(mesh, bubble);
  append(mesh, tetrahedron());
  const MeshPieces pieces = mesh_pieces(mesh);
  EXPECT_THAT(pieces.euler, testing::ElementsAre(0, 2, 2));
  EXPECT_GT(pieces.volume[0], 0);
  EXPECT_LT(pieces.volume[1], 0);
  EXPECT_GT(pieces.volume[2], 0);
  EXPECT_EQ(pieces.of_vertex.front(), 0u);
  EXPECT_EQ(pieces.of_vertex.back(), 2u);
}

TEST(TriangleMesh, SubmeshUndoesAppend) {
  const TriangleMesh first = icosphere(2), second = torus(9, 6);
  TriangleMesh both = first;
  append(both, second);
  EXPECT_EQ(both.next_id, std::max(first.next_id, second.next_id));
  std::vector<std::uint8_t> keep(both.triangle_count(), 0);
  std::fill(keep.begin() + std::ptrdiff_t(first.triangle_count()), keep.end(), 1);
  const TriangleMesh back = submesh(both, keep);
  EXPECT_EQ(back.vertex, second.vertex);
  EXPECT_EQ(back.twin, second.twin);
  EXPECT_EQ(back.vertices.position, second.vertices.position);
  EXPECT_EQ(back.vertices.id, second.vertices.id);
  keep.back() = 0;
  EXPECT_THROW(submesh(both, keep), std::invalid_argument);
  EXPECT_THROW(submesh(both, {1}), std::invalid_argument);
}

RC_GTEST_PROP(TriangleMesh, ReorderKeepsTheMeshAndBringsNeighboursTogether, ()) {
  TriangleMesh mesh = torus(*rc::gen::inRange(20, 40), *rc::gen::inRange(20, 30));
  std::vector<Index> shuffled(mesh.vertex_count());
  for (Index v = 0; v < shuffled.size(); ++v) shuffled[v] = v;
  std::mt19937 random(*rc::gen::arbitrary<unsigned>());
  std::shuffle(shuffled.begin(), shuffled.end(), random);
  TriangleMesh mixed = mesh;
  for (Index v = 0; v < shuffled.size(); ++v) {
    mixed.vertices.position[shuffled[v]] = mesh.vertices.position[v];
    mixed.vertices.rest[shuffled[v]] = mesh.vertices.rest[v];
    mixed.vertices.id[shuffled[v]] = mesh.vertices.id[v];
  }
  for (Index& v : mixed.vertex) v = shuffled[v];
  const auto spread = [](const TriangleMesh& m) {
    double sum = 0;
    for (Index h = 0; h < m.vertex.size(); ++h) sum += std::abs(double(m.from(h)) - double(m.to(h)));
    return sum;
  };
  const auto before = triangles_by_id(mixed);
  const double spread_before = spread(mixed);
  reorder(mixed);
  RC_ASSERT(validate(mixed).ok);
  RC_ASSERT(triangles_by_id(mixed) == before);
  RC_ASSERT(spread(mixed) < 0.5 * spread_before);
  for (Index v = 0; v < mixed.vertex_count(); ++v) RC_ASSERT(mixed.vertices.rest[v] == mixed.vertices.position[v]);
}

TEST(TriangleMesh, ReorderTakesOneAndNoPoints) {
  TriangleMesh none;
  reorder(none);
  EXPECT_TRUE(none.empty());
  TriangleMesh flat = make_mesh(std::vector<Vec3>(4, Vec3(2)), tetrahedron().vertex);
  reorder(flat);
  expect_valid(flat);
}

TEST(TriangleMesh, ShapeStatisticsOfKnownShapes) {
  const ShapeStatistics regular = shape_statistics(tetrahedron());
  EXPECT_NEAR(regular.min_angle, 60, 1e-4);
  EXPECT_NEAR(regular.mean_angle, 60, 1e-4);
  const double edge = std::sqrt(8.0) / std::sqrt(3.0);
  EXPECT_NEAR(regular.mean_edge, edge, 1e-6);
  EXPECT_NEAR(regular.area, std::sqrt(3.0) * edge * edge, 1e-5);

  const ShapeStatistics right = shape_statistics(cube(4));
  EXPECT_NEAR(right.min_angle, 45, 1e-4);
  EXPECT_NEAR(right.p1_angle, 45, 1e-4);
  EXPECT_NEAR(right.area, 24, 1e-4);
  EXPECT_EQ(right.below_10_degrees, 0);

  TriangleMesh needles = cube(4);
  for (Vec3& p : needles.vertices.position) p.x *= 100.0f;
  const ShapeStatistics sharp = shape_statistics(needles);
  EXPECT_NEAR(sharp.min_angle, std::atan(0.01) * 180 / std::numbers::pi, 1e-4);
  EXPECT_NEAR(sharp.below_10_degrees, 2.0 / 3.0, 1e-9);

  EXPECT_EQ(shape_statistics(TriangleMesh{}).area, 0);
  EXPECT_EQ(shape_statistics(make_mesh(std::vector<Vec3>(4), tetrahedron().vertex)).min_angle, 0);
}

TEST(TriangleMesh, ResultsDoNotDependOnThreads) {
  TriangleMesh mesh = icosphere(5);
  append(mesh, torus(90, 40));
  jitter(mesh, 0.01f, 3);
  const auto run = [&](std::size_t threads) {
    tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    TriangleMesh out = mesh;
    reorder(out);
    link_twins(out);
    return std::tuple(out, shape_statistics(out), mesh_pieces(out), vertex_corners(out));
  };
  const auto [a, shape_a, pieces_a, corners_a] = run(1);
  const auto [b, shape_b, pieces_b, corners_b] = run(4);
  EXPECT_EQ(a.vertex, b.vertex);
  EXPECT_EQ(a.twin, b.twin);
  EXPECT_EQ(a.vertices.position, b.vertices.position);
  EXPECT_EQ(shape_a.mean_angle, shape_b.mean_angle);
  EXPECT_EQ(shape_a.area, shape_b.area);
  EXPECT_EQ(pieces_a.of_vertex, pieces_b.of_vertex);
  EXPECT_EQ(pieces_a.volume, pieces_b.volume);
  EXPECT_EQ(corners_a.corner, corners_b.corner);
}
