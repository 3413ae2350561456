#include "core/refine/refine.h"

#include <cmath>
#include <cstdio>
#include <cstring>
#include <random>
#include <set>

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include "core/field/skeleton_field.h"
#include "core/mechanics/alter.h"
#include "core/mesh/validate.h"
#include "core/refine/refined_skin.h"
#include "core/refine/split_pattern.h"
#include "core/topology/triangle_pairs.h"
#include "core/tracker.h"
#include "tests/analytic_fields.h"
#include "tests/sanitized.h"
#include "tests/test_meshes.h"

using namespace isoskin;

namespace {

const ProjectOptions kProject{1e-6f, 0.25f, 32, 32};

std::shared_ptr<const Field> metaball() {
  SkeletonElement ball;
  ball.radius = 2.0;
  const double iso = std::pow(1.0 - 0.25, 3.0);  // the sphere of radius 1
  return std::make_shared<SkeletonField>(std::vector{ball}, iso);
}

struct Refined {
  GeometricMesh geometric;
  RefineReport report;
};

Refined refine_on(std::shared_ptr<const Field> field, const TriangleMesh& mechanical, const RefineOptions& options,
                  const ProjectOptions& project = kProject) {
  const std::unique_ptr<Backend> backend = make_reference_backend();
  backend->set_field(std::move(field));
  Refined r;
  r.geometric = refine(mechanical, *backend, options, project, &r.report);
  return r;
}

RefineOptions options(float angle, int passes = 4) {
  RefineOptions o;
  o.angle = angle;
  o.passes = passes;
  return o;
}

/// Largest | |p| - 1 | over vertices, edge middles and centroids.
double radial_error(const TriangleMesh& mesh) {
  double worst = 0.0;
  for (std::size_t t = 0; t < mesh.triangle_count(); ++t) {
    DVec3 p[3];
    for (int k = 0; k < 3; ++k) p[k] = DVec3(mesh.position(mesh.vertex[3 * t + k]));
    for (const DVec3& q : {p[0], p[1], p[2], 0.5 * (p[0] + p[1]), 0.5 * (p[1] + p[2]), 0.5 * (p[2] + p[0]),
                           (p[0] + p[1] + p[2]) / 3.0}) {
      worst = std::max(worst, std::abs(glm::length(q) - 1.0));
    }
  }
  return worst;
}

double vertex_error(const TriangleMesh& mesh) {
  double worst = 0.0;
  for (const Vec3& p : mesh.vertices.position) worst = std::max<double>(worst, std::abs(glm::length(DVec3(p)) - 1.0));
  return worst;
}

void expect_whole(const Refined& r, const TriangleMesh& mechanical) {
  const GeometricMesh& g = r.geometric;
  const ValidateReport valid = validate(g.mesh);
  ASSERT_TRUE(valid) << valid.reason;
  ASSERT_EQ(g.normal.size(), g.mesh.vertex_count());
  ASSERT_EQ(g.parent_edge.size(), g.mesh.vertex_count());
  ASSERT_EQ(g.parent_triangle.size(), g.mesh.triangle_count());
  EXPECT_EQ(r.report.triangles, g.mesh.triangle_count());
  EXPECT_EQ(r.report.new_vertices, g.mesh.vertex_count() - mechanical.vertex_count());
  for (const Vec3& n : g.normal) EXPECT_NEAR(glm::length(n), 1.0f, 1e-5f);
  const MeshPieces before = mesh_pieces(mechanical), after = mesh_pieces(g.mesh);
  EXPECT_EQ(before.euler, after.euler);
  for (std::size_t v = 0; v < mechanical.vertex_count(); ++v) {
    EXPECT_EQ(g.mesh.position(Index(v)), mechanical.position(Index(v)));
    EXPECT_EQ(g.mesh.vertices.id[v], mechanical.vertices.id[v]);
    EXPECT_EQ(g.parent_edge[v], (std::array<Index, 2>{Index(v), Index(v)}));
  }
  for (std::size_t v = mechanical.vertex_count(); v < g.mesh.vertex_count(); ++v) {
    const auto [a, b] = g.parent_edge[v];
    ASSERT_LT(a, v);
    ASSERT_LT(b, v);
    EXPECT_NE(a, b);
    const VertexTable& table = g.mesh.vertices;
    EXPECT_LT(glm::length(table.rest[v] - 0.5f * (table.rest[a] + table.rest[b])), 1e-6f);
    EXPECT_LT(glm::length(table.velocity[v] - 0.5f * (table.velocity[a] + table.velocity[b])), 1e-6f);
  }
  // The rest positions were interpolated linearly: each child lies in its parent's rest triangle, and all fill it.
  std::vector<double> area(mechanical.triangle_count(), 0.0);
  for (std::size_t t = 0; t < g.mesh.triangle_count(); ++t) {
    ASSERT_LT(g.parent_triangle[t], mechanical.triangle_count());
    const Index* m = &mechanical.vertex[3 * std::size_t(g.parent_triangle[t])];
    const Index* v = &g.mesh.vertex[3 * t];
    const auto rest = [&](Index i) { return DVec3(g.mesh.vertices.rest[i]); };
    const DVec3 parent = glm::cross(rest(m[1]) - rest(m[0]), rest(m[2]) - rest(m[0]));
    const DVec3 child = glm::cross(rest(v[1]) - rest(v[0]), rest(v[2]) - rest(v[0]));
    const double share = glm::dot(parent, child) / glm::dot(parent, parent);
    EXPECT_GT(share, 0.0);
    area[g.parent_triangle[t]] += share;
  }
  for (const double a : area) EXPECT_NEAR(a, 1.0, 1e-4);
}

}  // namespace

TEST(SplitPattern, EveryPatternFillsItsTriangleAndLinksItsChildren) {
  for (unsigned marked = 0; marked < 8; ++marked) {
    for (const bool second : {false, true}) {
      const SplitPattern& p = split_pattern(marked, second);
      EXPECT_EQ(p.count, 1 + __builtin_popcount(marked));
      const double x[6] = {0, 1, 0, 0.5, 0.5, 0}, y[6] = {0, 0, 1, 0, 0.5, 0.5};
      double area = 0.0;
      int borders = 0;
      for (int c = 0; c < p.count; ++c) {
        const std::int8_t* v = &p.corner[3 * c];
        const double twice = (x[v[1]] - x[v[0]]) * (y[v[2]] - y[v[0]]) - (x[v[2]] - x[v[0]]) * (y[v[1]] - y[v[0]]);
        EXPECT_GT(twice, 0.0);
        area += twice;
        for (int k = 0; k < 3; ++k) {
          EXPECT_TRUE(v[k] < 3 || (marked >> (v[k] - 3) & 1));
          const int h = 3 * c + k, twin = p.twin[h];
          borders += twin < 0;
          EXPECT_TRUE(twin < 0 || p.twin[twin] == h);
        }
      }
      EXPECT_DOUBLE_EQ(area, 1.0);
      EXPECT_EQ(borders, 3 + __builtin_popcount(marked));
      for (int k = 0; k < 3; ++k) {
        EXPECT_EQ(p.corner[p.part[2 * k]], k);
        EXPECT_EQ(p.corner[p.part[2 * k + 1]], (marked >> k & 1) ? 3 + k : k);
        EXPECT_EQ(p.twin[p.part[2 * k]], -1);
      }
    }
  }
  EXPECT_NE(split_pattern(3, false).corner, split_pattern(3, true).corner);
}

// Where no edge turns by more than `angle` degrees a triangle on the unit sphere is no farther from it than the middle
// of an equilateral one: 1 - cos(angle / sqrt 3). That is 2.0 % for 20 degrees, 1 % needs 14.
double bound_of_angle(float angle) {
  return 1.0 - std::cos(angle / std::sqrt(3.0) * 0.017453292519943295);
}

TEST(Refine, TetrahedronOnAMetaballBecomesASphere) {
  const TriangleMesh tetrahedron = test_meshes::tetrahedron();
  std::printf("angle passes triangles surface_error vertex_error\n");
  for (const float angle : {20.0f, 14.0f}) {
    for (int passes = 0; passes <= 6; ++passes) {
      const Refined r = refine_on(metaball(), tetrahedron, options(angle, passes));
      expect_whole(r, tetrahedron);
      const double error = radial_error(r.geometric.mesh);
      std::printf("%5.0f %6d %9zu %13.5f %12.2g\n", angle, passes, r.report.triangles, error,
                  vertex_error(r.geometric.mesh));
      EXPECT_EQ(r.report.quasi_critical, 0u);
      EXPECT_LT(vertex_error(r.geometric.mesh), 2e-6);
      if (passes >= (angle < 20.0f ? 5 : 4)) {  // 4 passes do for 20 degrees, 5 for 14
        EXPECT_LT(error, bound_of_angle(angle));
      }
    }
  }
}

// Bouthors and Nesme's figure 8: four triangles, 20 degrees. An edge of 20 degrees alone sags by 1.5 %; with the
// sagitta that a run asks for at this edge length (resolved(), core/tracker.h) it is another matter.
TEST(Refine, TetrahedronAtTwentyDegreesIsWithinAPercentOfItsSphere) {
  const TriangleMesh tetrahedron = test_meshes::tetrahedron();
  TrackOptions track;
  track.refine.angle = 20.0f;
  track.refine.passes = 5;
  track.edge_length = shape_statistics(tetrahedron).mean_edge;
  RefineOptions o = resolved(track, *metaball()).refine;
  ASSERT_EQ(o.angle, 20.0f);
  const Refined r = refine_on(metaball(), tetrahedron, o);
  expect_whole(r, tetrahedron);
  std::printf("triangles %zu, largest radial error %.5f\n", r.report.triangles, radial_error(r.geometric.mesh));
  EXPECT_LT(radial_error(r.geometric.mesh), 0.01);
}

TEST(Refine, WhatLiesBesideTheSurfaceIsSplit) {
  const TriangleMesh mesh = test_meshes::icosphere(1);
  const auto largest_sagitta = [](const TriangleMesh& m) {
    double worst = 0.0;
    for (Index h = 0; h < m.vertex.size(); ++h)
      worst = std::max(worst, 1.0 - glm::length(0.5 * (DVec3(m.position(m.from(h))) + DVec3(m.position(m.to(h))))));
    return worst;
  };
  RefineOptions o = options(18.0f, 6);
  std::size_t triangles = 0;
  for (const float sagitta : {0.01f, 0.003f, 0.001f}) {
    o.sagitta = sagitta;
    const Refined r = refine_on(metaball(), mesh, o);
    expect_whole(r, mesh);
    EXPECT_LT(largest_sagitta(r.geometric.mesh), 1.01 * sagitta);
    EXPECT_LT(radial_error(r.geometric.mesh), 1.4 * sagitta);
    EXPECT_GT(r.report.triangles, triangles);
    triangles = r.report.triangles;
  }
}

TEST(Refine, ATriangleThatCutsOffABumpIsSplitThoughItsCornersAgree) {
  class Bump final : public Field {  // the half space z < 0 with a hill between the corners, all of whose normals agree
  public:
    FieldSample sample(const DVec3& p) const override {
      const double hill = 0.2 * std::exp(-40.0 * (p.x * p.x + p.y * p.y));
      return {hill - p.z, {-80.0 * p.x * hill, -80.0 * p.y * hill, -1.0}};
    }
    Box bounds() const override { return {DVec3(-2.0), DVec3(2.0)}; }
    Interval range(const Box&) const override { return {-HUGE_VAL, HUGE_VAL}; }
  };
  const float s = std::sqrt(0.75f);
  const TriangleMesh mesh =
      make_mesh({{1, 0, 0}, {-0.5f, s, 0}, {-0.5f, -s, 0}, {0, 0, -1.5f}}, {0, 1, 2, 0, 3, 1, 1, 3, 2, 2, 3, 0});
  RefineOptions o = options(180.0f, 1);
  EXPECT_EQ(refine_on(std::make_shared<Bump>(), mesh, o).report.new_vertices, 0u);
  o.sagitta = 0.01f;
  EXPECT_GE(refine_on(std::make_shared<Bump>(), mesh, o).report.new_vertices, 3u);
}

TEST(Refine, SmallerAnglesGiveMoreTrianglesAndLessError) {
  std::size_t triangles = 0;
  double error = 1.0;
  const TriangleMesh coarse = test_meshes::icosphere(0);
  std::printf("angle triangles surface_error\n");
  for (const float angle : {37.0f, 26.0f, 18.0f, 8.0f}) {
    const Refined r = refine_on(metaball(), coarse, options(angle, 5));
    expect_whole(r, coarse);
    const double now = radial_error(r.geometric.mesh);
    std::printf("%5.0f %9zu %13.6f\n", angle, r.report.triangles, now);
    EXPECT_GT(r.report.triangles, triangles);
    EXPECT_LT(now, error);
    EXPECT_LT(now, bound_of_angle(angle));
    triangles = r.report.triangles;
    error = now;
  }
}

TEST(Refine, NothingToDoCopiesTheMechanicalMesh) {
  const TriangleMesh mesh = test_meshes::icosphere(2);
  for (const RefineOptions& o : {options(18.0f, 0), options(180.0f), options(60.0f)}) {
    const Refined r = refine_on(metaball(), mesh, o);
    expect_whole(r, mesh);
    EXPECT_EQ(r.report.passes, 0);
    EXPECT_EQ(r.geometric.mesh.vertex, mesh.vertex);
    EXPECT_EQ(r.geometric.mesh.twin, mesh.twin);
  }
  const Refined none = refine_on(metaball(), TriangleMesh{}, options(18.0f));
  EXPECT_TRUE(none.geometric.mesh.empty());
}

TEST(Refine, SplitsWhereItTurnsAndNotWhereItDoesNot) {
  // 36 degrees an edge round the small circle, 9 round the big one.
  const TriangleMesh mesh = test_meshes::torus(40, 10, 1.0f, 0.2f);
  const Refined r = refine_on(std::make_shared<analytic::TorusField>(1.0, 0.2), mesh, options(25.0f));
  expect_whole(r, mesh);
  EXPECT_EQ(r.report.passes, 1);
  EXPECT_EQ(r.report.triangles, 3 * mesh.triangle_count());
  const auto small_angle = [&](Index v) {
    const Vec3 p = r.geometric.mesh.position(v);
    return std::atan2(p.z, std::hypot(p.x, p.y) - 1.0f);
  };
  for (std::size_t v = mesh.vertex_count(); v < r.geometric.mesh.vertex_count(); ++v) {
    const auto [a, b] = r.geometric.parent_edge[v];
    EXPECT_GT(std::abs(std::sin(small_angle(a) - small_angle(b))), 0.5f);
  }
}

TEST(Refine, OneToThreeTakesTheDiagonalOfLowerCurvature) {
  // A cylinder-like field: along z nothing turns. Split the two steep edges of a triangle: the new diagonal must not be
  // the one whose end normals differ more.
  const TriangleMesh mesh = test_meshes::torus(24, 6, 3.0f, 0.3f);
  const Refined r = refine_on(std::make_shared<analytic::TorusField>(3.0, 0.3), mesh, options(40.0f, 1));
  expect_whole(r, mesh);
  std::vector<std::vector<Index>> children(mesh.triangle_count());
  for (std::size_t t = 0; t < r.geometric.parent_triangle.size(); ++t) {
    children[r.geometric.parent_triangle[t]].push_back(Index(t));
  }
  int seen = 0;
  const std::vector<Vec3>& n = r.geometric.normal;
  for (std::size_t t = 0; t < children.size(); ++t) {
    if (children[t].size() != 3) continue;
    ++seen;
    std::set<Index> corners(&mesh.vertex[3 * t], &mesh.vertex[3 * t] + 3), fresh;
    std::set<std::pair<Index, Index>> edges;
    for (const Index c : children[t]) {
      for (Index h = 3 * c; h < 3 * c + 3; ++h) {
        const Index a = r.geometric.mesh.from(h), b = r.geometric.mesh.to(h);
        edges.insert(std::minmax(a, b));
        for (const Index v : {a, b})
          if (!corners.count(v)) fresh.insert(v);
      }
    }
    ASSERT_EQ(fresh.size(), 2u);
    // Candidate diagonals join a new vertex to the corner that is no end of its edge.
    float chosen = -2.0f, refused = -2.0f;
    std::set<Index> shared;
    for (const Index m : fresh) {
      for (const Index c : corners) {
        const auto [a, b] = r.geometric.parent_edge[m];
        if (c == a || c == b) continue;
        (edges.count(std::minmax(m, c)) ? chosen : refused) = glm::dot(n[m], n[c]);
      }
    }
    EXPECT_GE(chosen, refused - 1e-6f);
  }
  EXPECT_GT(seen, 20);
}

TEST(Refine, CentroidNormalsSeeWhatVertexNormalsMiss) {
  // Figure 7b: vertices on a crease, with equal normals at both ends of every edge of a triangle, still get refined.
  class Roof final : public Field {  // F = 0.5 - |x| - z inside, bounded below by z = -1 and by |y| = 1
  public:
    FieldSample sample(const DVec3& p) const override {
      const double slant = 0.5 - std::abs(p.x) - p.z;
      return {slant, {p.x > 0.0 ? -1.0 : 1.0, 0, -1.0}};
    }
    Box bounds() const override { return {DVec3(-2.0), DVec3(2.0)}; }
    Interval range(const Box&) const override { return {-HUGE_VAL, HUGE_VAL}; }
  };
  // An octahedron-like body whose ridge vertices all sit at x = 0 minus a little: their normals agree.
  const TriangleMesh mesh = make_mesh({{-1e-3f, -1, 0.499f}, {-1e-3f, 1, 0.499f}, {1, 0, -0.5f}, {-1, 0, -0.5f}},
                                      {0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3});
  const Refined r = refine_on(std::make_shared<Roof>(), mesh, options(30.0f, 1));
  EXPECT_GT(r.report.new_vertices, 0u);
  const ValidateReport valid = validate(r.geometric.mesh);
  EXPECT_TRUE(valid) << valid.reason;
}

TEST(Refine, PointsThatCannotBeProjectedStayOnTheirEdge) {
  class NoSurface final : public Field {  // normals of a sphere, but no zero
  public:
    FieldSample sample(const DVec3& p) const override { return {-0.5 - glm::dot(p, p), -2.0 * p}; }
    Box bounds() const override { return {}; }
    Interval range(const Box&) const override { return {-HUGE_VAL, -0.5}; }
  };
  const TriangleMesh mesh = test_meshes::tetrahedron();
  const Refined r = refine_on(std::make_shared<NoSurface>(), mesh, options(20.0f, 2));
  expect_whole(r, mesh);
  EXPECT_GT(r.report.new_vertices, 0u);
  EXPECT_EQ(r.report.quasi_critical, r.report.new_vertices);
  for (std::size_t v = mesh.vertex_count(); v < r.geometric.mesh.vertex_count(); ++v) {
    const auto [a, b] = r.geometric.parent_edge[v];
    const Vec3 middle = 0.5f * (r.geometric.mesh.position(a) + r.geometric.mesh.position(b));
    EXPECT_EQ(r.geometric.mesh.position(Index(v)), middle);
  }
}

TEST(Refine, NoChildFoldsOverOnARoughField) {
  // A bumpy ball under a mesh much coarser than the bumps: projections land far away and cross each other.
  class Bumpy final : public Field {
  public:
    FieldSample sample(const DVec3& p) const override {
      constexpr double kA = 0.15, kW = 14.0;
      const double r = std::max(glm::length(p), 1e-9);
      const double sx = std::sin(kW * p.x), sy = std::sin(kW * p.y), sz = std::sin(kW * p.z);
      const double cx = std::cos(kW * p.x), cy = std::cos(kW * p.y), cz = std::cos(kW * p.z);
      return {1.0 - r + kA * sx * sy * sz, -p / r + kA * kW * DVec3(cx * sy * sz, sx * cy * sz, sx * sy * cz)};
    }
    Box bounds() const override { return {DVec3(-1.3), DVec3(1.3)}; }
    Interval range(const Box&) const override { return {-HUGE_VAL, HUGE_VAL}; }
  };
  const auto field = std::make_shared<Bumpy>();
  const std::unique_ptr<Backend> backend = make_reference_backend();
  backend->set_field(field);
  TriangleMesh mesh = test_meshes::icosphere(2);
  test_meshes::jitter(mesh, 0.15f, 1);  // some thin triangles
  backend->project(mesh.vertices.position, kProject, {});
  mesh = make_mesh(mesh.vertices.position, mesh.vertex);
  RefineReport report;
  const GeometricMesh g = refine(mesh, *backend, options(18.0f, 1), kProject, &report);
  const ValidateReport valid = validate(g.mesh);
  ASSERT_TRUE(valid) << valid.reason;
  EXPECT_GT(report.new_vertices, 300u);
  const auto folded = [&](const TriangleMesh& m, const std::vector<Vec3>& normal, std::size_t t) {
    const Index* v = &m.vertex[3 * t];
    const Vec3 n = glm::cross(m.position(v[1]) - m.position(v[0]), m.position(v[2]) - m.position(v[0]));
    return glm::dot(n, normal[v[0]]) < 0 && glm::dot(n, normal[v[1]]) < 0 && glm::dot(n, normal[v[2]]) < 0;
  };
  // Where even points on the edges have normals that point inside nothing helps; but no new point may have left its
  // edge to fold a child over.
  std::size_t left_its_edge = 0, folded_over = 0;
  for (std::size_t t = 0; t < g.mesh.triangle_count(); ++t) {
    for (int k = 0; k < 3; ++k) {
      const Index v = g.mesh.vertex[3 * t + k];
      const auto [a, b] = g.parent_edge[v];
      const bool left = g.mesh.position(v) != 0.5f * (g.mesh.position(a) + g.mesh.position(b));
      left_its_edge += left;
      folded_over += left && folded(g.mesh, g.normal, t);
    }
  }
  EXPECT_GT(left_its_edge, 500u);
  EXPECT_EQ(folded_over, 0u);
}

TEST(Refine, ShortEdgesAreLeftAlone) {
  const TriangleMesh mesh = test_meshes::icosphere(0);
  RefineOptions o = options(8.0f, 6);
  o.shortest = 0.3f;
  const Refined r = refine_on(metaball(), mesh, o);
  expect_whole(r, mesh);
  for (std::size_t v = mesh.vertex_count(); v < r.geometric.mesh.vertex_count(); ++v) {
    const auto [a, b] = r.geometric.parent_edge[v];
    EXPECT_GE(glm::length(r.geometric.mesh.position(b) - r.geometric.mesh.position(a)), 0.3f);
  }
  EXPECT_LT(r.report.triangles, refine_on(metaball(), mesh, options(8.0f, 6)).report.triangles);
}

TEST(Refine, SameBytesWhateverTheNumberOfThreads) {
  const auto field = std::make_shared<analytic::TorusField>(1.0, 0.4);
  TriangleMesh mesh = test_meshes::torus(60, 30);
  test_meshes::jitter(mesh, 0.03f, 3);
  const auto run = [&](std::size_t threads) {
    tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    return refine_on(field, mesh, options(8.0f)).geometric;
  };
  const GeometricMesh one = run(1), many = run(4);
  EXPECT_EQ(one.mesh.vertex, many.mesh.vertex);
  EXPECT_EQ(one.mesh.twin, many.mesh.twin);
  ASSERT_EQ(one.mesh.vertex_count(), many.mesh.vertex_count());
  const std::size_t bytes = one.mesh.vertex_count() * sizeof(Vec3);
  EXPECT_EQ(std::memcmp(one.mesh.vertices.position.data(), many.mesh.vertices.position.data(), bytes), 0);
  EXPECT_EQ(std::memcmp(one.normal.data(), many.normal.data(), bytes), 0);
}

namespace {

template <class T>
bool same_bytes(const std::vector<T>& a, const std::vector<T>& b) {
  return a.size() == b.size() && (a.empty() || std::memcmp(a.data(), b.data(), a.size() * sizeof(T)) == 0);
}

void expect_same_bytes(const GeometricMesh& a, const GeometricMesh& b) {
  const VertexTable &p = a.mesh.vertices, &q = b.mesh.vertices;
  EXPECT_TRUE(same_bytes(a.mesh.vertex, b.mesh.vertex));
  EXPECT_TRUE(same_bytes(a.mesh.twin, b.mesh.twin));
  EXPECT_TRUE(same_bytes(p.position, q.position));
  EXPECT_TRUE(same_bytes(p.rest, q.rest));
  EXPECT_TRUE(same_bytes(p.velocity, q.velocity));
  EXPECT_TRUE(same_bytes(p.id, q.id));
  EXPECT_TRUE(same_bytes(p.age, q.age));
  EXPECT_TRUE(same_bytes(a.normal, b.normal));
  EXPECT_TRUE(same_bytes(a.parent_triangle, b.parent_triangle));
  EXPECT_TRUE(same_bytes(a.parent_edge, b.parent_edge));
  EXPECT_EQ(a.mesh.next_id, b.mesh.next_id);
}

bool same_shape(const ShapeStatistics& a, const ShapeStatistics& b) {
  return std::memcmp(&a, &b, sizeof a) == 0;
}

/// Balls along a circle.
std::vector<SkeletonElement> necklace(int count, double circle = 1.0) {
  std::vector<SkeletonElement> balls(std::size_t(count), SkeletonElement{});
  for (int i = 0; i < count; ++i) {
    const double turn = 2.0 * 3.14159265358979 * i / count;
    balls[i].a = balls[i].b = circle * DVec3(std::cos(turn), std::sin(turn), 0.0);
    balls[i].radius = 0.5;
  }
  return balls;
}

}  // namespace

TEST(RefinedSkin, WhatChangesHereAndThereComesOutAsIfAllWereRefined) {
  constexpr int kBalls = 16, kFrames = test::repeats(9, 4);
  const std::unique_ptr<Backend> backend = make_reference_backend();
  std::vector<SkeletonElement> balls = necklace(kBalls);
  auto field = std::make_shared<const SkeletonField>(balls, 0.4);
  backend->set_field(field);
  TriangleMesh skin = test_meshes::torus(90, 16);
  test_meshes::jitter(skin, 0.01f, 3);
  backend->project(skin.vertices.position, kProject, {});
  RefinedSkinOptions how{options(10.0f), kProject, 0.0, 0.01};
  how.refine.sagitta = 0.004f;
  how.project.reach = 0.1f;
  RefinedSkin local, seldom_asked;
  std::mt19937 random(5);
  const auto any = [&](std::size_t count) { return std::uniform_int_distribution<std::size_t>(0, count - 1)(random); };
  const auto within = [&](float most) { return std::uniform_real_distribution<float>(-most, most)(random); };
  std::size_t refined = 0, all = 0, strays = 0, crossings = 0, altered = 0;
  for (int frame = 0; frame < kFrames; ++frame) {
    SCOPED_TRACE(frame);
    const std::shared_ptr<const SkeletonField> before = field;
    for (Index& age : skin.vertices.age) ++age;
    if (frame % 3 == 1) {  // the field
      SkeletonElement& ball = balls[any(kBalls)];
      ball.a = ball.b = ball.a + DVec3(within(0.03f), within(0.03f), within(0.03f));
      field = std::make_shared<const SkeletonField>(balls, 0.4);
      backend->set_field(field);
    }
    const Vec3 centre = skin.position(Index(any(skin.vertex_count())));
    std::vector<std::uint8_t> frozen(skin.vertex_count());
    for (Index v = 0; v < frozen.size(); ++v) {
      frozen[v] = glm::distance(skin.position(v), centre) > 0.2f;
      if (frozen[v] || frame % 3 != 2) continue;  // the skin, which folds over here and there
      skin.vertices.position[v] += Vec3(within(0.03f), within(0.03f), within(0.03f));
      skin.vertices.velocity[v] = Vec3(within(1.0f));
    }
    if (frame % 3 == 0) {  // how it hangs together
      AlterOptions alter_options;
      alter_options.edge_length = 0.05f + within(0.03f);
      alter_options.respect_locks = false;
      const AlterReport report = alter(skin, alter_options, {}, frozen);
      altered += report.splits + report.collapses + report.flips;
    }
    const FieldChanges changes = changes_between(*before, *field);
    local.update(skin, &changes, *backend, how);
    RefinedSkin whole;
    whole.update(skin, nullptr, *backend, how);
    expect_same_bytes(local.mesh(), whole.mesh());
    seldom_asked.update(skin, &changes, *backend, how);
    EXPECT_EQ(seldom_asked.triangle_count(), whole.triangle_count());
    EXPECT_TRUE(same_shape(seldom_asked.statistics(), whole.statistics()));
    if (frame % 4 == 3) expect_same_bytes(seldom_asked.mesh(), whole.mesh());
    if (frame == 0) expect_same_bytes(local.mesh(), refine(skin, *backend, how.refine, how.project));
    EXPECT_TRUE(same_bytes(local.strays(), whole.strays()));
    if (frame % 3 != 1) {  // else what has changed is kept in mind
      EXPECT_EQ(local.crossings(skin), whole.crossings(skin));
      crossings += whole.crossing_count();
    }
    if (frame == 2) {
      EXPECT_EQ(whole.crossing_count(), count_self_intersections(whole.mesh().mesh));
    }
    EXPECT_EQ(whole.refined_triangles(), skin.triangle_count());
    strays += whole.strays().size();
    refined += local.refined_triangles();
    all += skin.triangle_count();
    if (frame % 5 == 4) local.flatten({centre}, 0.3f);  // until the next frame
  }
  EXPECT_LT(refined, all / 2);
  EXPECT_GT(strays, 0u);
  EXPECT_GT(crossings, 0u);
  EXPECT_GT(altered, 10u);
}

TEST(RefinedSkin, StatisticsAreThoseOfItsMesh) {
  const std::unique_ptr<Backend> backend = make_reference_backend();
  backend->set_field(std::make_shared<const SkeletonField>(necklace(16), 0.4));
  TriangleMesh skin = test_meshes::torus(60, 12);
  backend->project(skin.vertices.position, kProject, {});
  RefinedSkin refined;
  refined.update(skin, nullptr, *backend, {options(10.0f), kProject, 0.0, 0.01, 0.02});
  for (const bool flattened : {false, true}) {
    if (flattened) refined.flatten({skin.position(0)}, 0.5f);
    const ShapeStatistics told = refined.statistics(), whole = shape_statistics(refined.mesh().mesh);
    EXPECT_LE(told.min_angle, whole.min_angle);
    EXPECT_GT(told.min_angle + ShapeTally::kStep, whole.min_angle);
    EXPECT_LE(told.p1_angle, whole.p1_angle);
    EXPECT_GT(told.p1_angle + ShapeTally::kStep, whole.p1_angle);
    EXPECT_NEAR(told.mean_angle, whole.mean_angle, 1e-9);
    EXPECT_EQ(told.below_10_degrees, whole.below_10_degrees);
    EXPECT_NEAR(told.mean_edge, whole.mean_edge, 1e-11);
    EXPECT_NEAR(told.area, whole.area, 1e-9);
  }
}

TEST(RefinedSkin, WhatIsRefinedWhenOneBallMovesDoesNotDependOnHowManyRest) {
  std::vector<std::size_t> refined;
  for (const int times : {2, 6}) {
    std::vector<SkeletonElement> balls = necklace(16 * times, times);
    const auto before = std::make_shared<const SkeletonField>(balls, 0.4);
    balls[0].a = balls[0].b = balls[0].a + DVec3(0.02, 0.0, 0.0);
    const auto after = std::make_shared<const SkeletonField>(balls, 0.4);
    const std::unique_ptr<Backend> backend = make_reference_backend();
    RefinedSkinOptions how{options(10.0f, 2), kProject, 0.0, 0.01};
    how.project.reach = 0.05f;
    TriangleMesh skin = test_meshes::torus(120 * times, 12, float(times), 0.3f);
    RefinedSkin local;
    for (const auto& field : {before, after}) {
      backend->set_field(field);
      backend->project(skin.vertices.position, kProject, {});
      const FieldChanges changes = changes_between(*before, *field);
      local.update(skin, &changes, *backend, how);
    }
    refined.push_back(local.refined_triangles());
    EXPECT_LT(refined.back(), skin.triangle_count());
  }
  EXPECT_LT(double(refined[1]), 1.1 * double(refined[0]));
}
