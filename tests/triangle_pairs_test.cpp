// The broad phase against all pairs, the exact test against a rational one, and what touches or lies in one plane.
#include "core/topology/triangle_pairs.h"

#include <random>

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>
#include <tbb/global_control.h>
#include <boost/multiprecision/cpp_int.hpp>

#include "core/topology/exact_sign.h"
#include "tests/test_meshes.h"

namespace isoskin {
namespace {

using Corners = std::array<Vec3, 3>;
using Rational = boost::multiprecision::cpp_rational;
using Exact = std::array<Rational, 3>;

Exact exact(const Vec3& p) {
  return {Rational(p.x), Rational(p.y), Rational(p.z)};
}
Exact minus(const Exact& a, const Exact& b) {
  return {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
}
Exact cross(const Exact& a, const Exact& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}
Rational dot(const Exact& a, const Exact& b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/// By separating axes, in rationals: another algorithm, another arithmetic.
bool overlap_oracle(const Corners& a, const Corners& b) {
  std::array<Exact, 3> p, q;
  for (int k = 0; k < 3; ++k) p[k] = exact(a[k]), q[k] = exact(b[k]);
  std::vector<Exact> axes;
  const Exact n = cross(minus(p[1], p[0]), minus(p[2], p[0])), m = cross(minus(q[1], q[0]), minus(q[2], q[0]));
  axes.push_back(n);
  axes.push_back(m);
  for (int i = 0; i < 3; ++i) {
    const Exact u = minus(p[(i + 1) % 3], p[i]), v = minus(q[(i + 1) % 3], q[i]);
    axes.push_back(cross(n, u));
    axes.push_back(cross(m, v));
    for (int j = 0; j < 3; ++j) axes.push_back(cross(u, minus(q[(j + 1) % 3], q[j])));
  }
  for (const Exact& axis : axes) {
    const auto range = [&](const std::array<Exact, 3>& t) {
      const Rational x = dot(t[0], axis), y = dot(t[1], axis), z = dot(t[2], axis);
      return std::pair{std::min({x, y, z}), std::max({x, y, z})};
    };
    const auto [low_a, high_a] = range(p);
    const auto [low_b, high_b] = range(q);
    if (high_a < low_b || high_b < low_a) return false;
  }
  return true;
}

bool has_area(const Corners& t) {
  const Exact n = cross(minus(exact(t[1]), exact(t[0])), minus(exact(t[2]), exact(t[0])));
  return n[0] != 0 || n[1] != 0 || n[2] != 0;
}

std::vector<TrianglePair> all_pairs(const TriangleMesh& mesh) {
  std::vector<TrianglePair> pairs;
  for (Index a = 0; a < mesh.triangle_count(); ++a)
    for (Index b = a + 1; b < mesh.triangle_count(); ++b) {
      bool shared = false;
      for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) shared |= mesh.vertex[3 * a + i] == mesh.vertex[3 * b + j];
      if (!shared && triangles_overlap(corners_of(mesh, a), corners_of(mesh, b))) pairs.push_back({a, b});
    }
  return pairs;
}

const Corners kTriangle{Vec3(0, 0, 0), Vec3(1, 0, 0), Vec3(0, 1, 0)};

}  // namespace

TEST(TrianglePairs, WhatTouchesOverlapsAndWhatIsAnUlpAwayDoesNot) {
  const auto moved = [](const Vec3& by) { return Corners{kTriangle[0] + by, kTriangle[1] + by, kTriangle[2] + by}; };
  EXPECT_TRUE(triangles_overlap(kTriangle, kTriangle));
  EXPECT_TRUE(triangles_overlap(kTriangle, moved({1, 0, 0})));                               // a corner on a corner
  EXPECT_TRUE(triangles_overlap(kTriangle, moved({0.5f, 0.5f, 0})));                         // a corner on an edge
  EXPECT_TRUE(triangles_overlap(kTriangle, moved({0, 0.25f, 0})));                           // coplanar, overlapping
  EXPECT_FALSE(triangles_overlap(kTriangle, moved({0.5f, std::nextafter(0.5f, 1.0f), 0})));  // coplanar, an ulp apart
  EXPECT_FALSE(triangles_overlap(kTriangle, moved({0, 0, 1e-30f})));
  EXPECT_TRUE(triangles_overlap(kTriangle, {Vec3(0.25f, 0.25f, 0), Vec3(0, 0, 1), Vec3(1, 0, 1)}));
  EXPECT_FALSE(triangles_overlap(kTriangle, {Vec3(0.25f, 0.25f, 1e-38f), Vec3(0, 0, 1), Vec3(1, 0, 1)}));
  const Corners inside{Vec3(0.2f, 0.2f, 0), Vec3(0.3f, 0.2f, 0), Vec3(0.2f, 0.3f, 0)};
  EXPECT_TRUE(triangles_overlap(kTriangle, inside));
  EXPECT_TRUE(triangles_overlap(inside, kTriangle));
  const Corners needle{Vec3(0.25f, 0.25f, -1), Vec3(0.25f, 0.25f, 1), Vec3(0.25f, 0.25f, 0.5f)};
  EXPECT_TRUE(triangles_overlap(kTriangle, needle));
  EXPECT_TRUE(triangles_overlap(needle, kTriangle));
  EXPECT_FALSE(triangles_overlap(needle, needle));  // two without area: never
}

RC_GTEST_PROP(TrianglePairs, AgreesWithSeparatingAxesInRationals, ()) {
  // Few coordinates, so that touching, coplanar and flat cases come up often; or any, or scaled to lose all bits.
  const int kind = *rc::gen::inRange(0, 3);
  std::mt19937 random(*rc::gen::arbitrary<unsigned>());
  const auto coordinate = [&]() -> float {
    if (kind == 0) return float(random() % 4);
    const float x = std::uniform_real_distribution<float>(-1.0f, 1.0f)(random);
    return kind == 1 ? x : 1000.0f + 1e-3f * float(random() % 5);
  };
  for (int i = 0; i < 20; ++i) {
    Corners a, b;
    for (int k = 0; k < 3; ++k) {
      a[k] = {coordinate(), coordinate(), coordinate()};
      b[k] = {coordinate(), coordinate(), coordinate()};
    }
    if (!has_area(a) || !has_area(b)) continue;
    RC_ASSERT(triangles_overlap(a, b) == overlap_oracle(a, b));
    RC_ASSERT(triangles_overlap(b, a) == triangles_overlap(a, b));
  }
}

RC_GTEST_PROP(TrianglePairs, GridFindsWhatAllPairsFind, ()) {
  const unsigned seed = *rc::gen::arbitrary<unsigned>();
  std::mt19937 random(seed);
  std::uniform_real_distribution<float> uniform(-1.0f, 1.0f);
  TriangleMesh mesh;
  for (int i = 0; i < 4; ++i) {
    const Vec3 center(uniform(random), uniform(random), uniform(random));
    append(mesh, test_meshes::icosphere(1, 0.5f + 0.3f * uniform(random), center));
  }
  test_meshes::jitter(mesh, 0.1f, seed);
  RC_ASSERT(overlapping_pairs(mesh) == all_pairs(mesh));
}

TEST(TrianglePairs, CountsSelfIntersections) {
  EXPECT_EQ(count_self_intersections({}), 0u);
  TriangleMesh mesh = test_meshes::icosphere(3);
  EXPECT_EQ(count_self_intersections(mesh), 0u);
  append(mesh, test_meshes::icosphere(3, 1.0f, Vec3(2.5f, 0, 0)));
  EXPECT_EQ(count_self_intersections(mesh), 0u);
  append(mesh, test_meshes::icosphere(3, 1.0f, Vec3(1.25f, 0, 0)));
  EXPECT_GT(count_self_intersections(mesh), 50u);
  const auto run = [&](std::size_t threads) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    return overlapping_pairs(mesh);
  };
  EXPECT_EQ(run(1), run(4));
}

TEST(TrianglePairs, NearPairsLieWithinTheMargin) {
  TriangleMesh mesh = test_meshes::icosphere(2);
  append(mesh, test_meshes::icosphere(2, 1.0f, Vec3(2.1f, 0, 0)));
  const std::size_t half = mesh.triangle_count() / 2;
  const auto of_both = [&](const TrianglePair& pair) { return pair.a < half && pair.b >= half; };
  EXPECT_TRUE(near_pairs(mesh, 0.05, of_both).empty());
  EXPECT_FALSE(near_pairs(mesh, 0.2, of_both).empty());
}

TEST(TrianglePairs, CandidatesGrowWithTheTriangles) {
  double per_triangle[2];
  for (const int level : {4, 6}) {
    PairStatistics statistics;
    const TriangleMesh mesh = test_meshes::icosphere(level);
    overlapping_pairs(mesh, &statistics);
    per_triangle[level == 6] = double(statistics.candidates + statistics.entries) / double(mesh.triangle_count());
  }
  EXPECT_NEAR(per_triangle[1] / per_triangle[0], 1.0, 0.1);
}

}  // namespace isoskin
