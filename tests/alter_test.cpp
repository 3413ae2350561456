#include "core/mechanics/alter.h"

#include <tbb/global_control.h>

#include <algorithm>
#include <cstring>
#include <map>
#include <numbers>
#include <set>

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include "core/mesh/validate.h"
#include "tests/test_meshes.h"

using namespace isoskin;
using namespace isoskin::test_meshes;

namespace {

std::string fault(const TriangleMesh& mesh) {
  return validate(mesh).reason;
}

int euler(const TriangleMesh& mesh) {
  return int(mesh.vertex_count()) - int(mesh.vertex.size() / 2) + int(mesh.triangle_count());
}

double length(const TriangleMesh& mesh, Index h) {
  return glm::length(DVec3(mesh.position(mesh.to(h))) - DVec3(mesh.position(mesh.from(h))));
}

DVec3 normal(const TriangleMesh& mesh, Index t) {
  const DVec3 a(mesh.position(mesh.vertex[3 * t])), b(mesh.position(mesh.vertex[3 * t + 1])),
      c(mesh.position(mesh.vertex[3 * t + 2]));
  return glm::cross(b - a, c - a);
}

AlterOptions free_options(float edge) {
  AlterOptions options;
  options.edge_length = edge;
  options.respect_locks = false;
  return options;
}

void grow_old(TriangleMesh& mesh) {
  std::fill(mesh.vertices.age.begin(), mesh.vertices.age.end(), 5);
}

/// Each vertex goes to the middle of its neighbours, then back onto the surface: a stand-in for relaxation.
template <class Project>
void smooth(TriangleMesh& mesh, const Project& project) {
  std::vector<Vec3> sum(mesh.vertex_count(), Vec3(0));
  std::vector<float> count(mesh.vertex_count(), 0);
  for (Index h = 0; h < mesh.vertex.size(); ++h) sum[mesh.from(h)] += mesh.position(mesh.to(h)), ++count[mesh.from(h)];
  for (Index v = 0; v < mesh.vertex_count(); ++v)
    mesh.vertices.position[v] = project(0.5f * mesh.position(v) + 0.5f * sum[v] / count[v]);
}

Vec3 onto_sphere(const Vec3& p) {
  return glm::normalize(p);
}

Vec3 onto_torus(const Vec3& p) {
  const Vec3 ring = glm::normalize(Vec3(p.x, p.y, 0));
  return ring + 0.4f * glm::normalize(p - ring);
}

/// What alter.h says flips lower: cotangents over sqrt 3, plus 0.3 times squared valence defects.
double flip_potential(const TriangleMesh& mesh) {
  double cotangents = 0, defects = 0;
  std::vector<int> valence(mesh.vertex_count(), 0);
  for (Index h = 0; h < mesh.vertex.size(); ++h) {
    const DVec3 p(mesh.position(mesh.from(h)));
    const DVec3 u = DVec3(mesh.position(mesh.to(h))) - p, v = DVec3(mesh.position(mesh.from(mesh.prev(h)))) - p;
    cotangents += glm::dot(u, v) / glm::length(glm::cross(u, v));
    ++valence[mesh.from(h)];
  }
  for (const int v : valence) defects += (v - 6) * (v - 6);
  return cotangents / std::sqrt(3.0) + 0.3 * defects;
}

template <class T>
bool same_bytes(const std::vector<T>& a, const std::vector<T>& b) {
  return a.size() == b.size() && (a.empty() || std::memcmp(a.data(), b.data(), a.size() * sizeof(T)) == 0);
}

bool same_bytes(const TriangleMesh& a, const TriangleMesh& b) {
  return same_bytes(a.vertex, b.vertex) && same_bytes(a.twin, b.twin) && a.next_id == b.next_id &&
         same_bytes(a.vertices.position, b.vertices.position) && same_bytes(a.vertices.rest, b.vertices.rest) &&
         same_bytes(a.vertices.velocity, b.vertices.velocity) && same_bytes(a.vertices.id, b.vertices.id) &&
         same_bytes(a.vertices.age, b.vertices.age);
}

std::map<Index, Vec3> position_by_id(const TriangleMesh& mesh) {
  std::map<Index, Vec3> out;
  for (Index v = 0; v < mesh.vertex_count(); ++v) out[mesh.vertices.id[v]] = mesh.position(v);
  return out;
}

}  // namespace

TEST(Alter, LeavesAGoodMeshAlone) {
  TriangleMesh mesh = icosphere(4);
  const TriangleMesh before = mesh;
  const AlterReport report = alter(mesh, free_options(float(shape_statistics(mesh).mean_edge)));
  EXPECT_EQ(report.splits + report.collapses + report.flips, 0u);
  EXPECT_TRUE(same_bytes(mesh, before));
  TriangleMesh none;
  EXPECT_EQ(alter(none, free_options(1)).splits, 0u);
}

TEST(Alter, RefinesAndCoarsensToTheWantedLength) {
  for (const float edge : {0.05f, 0.12f, 0.3f}) {
    TriangleMesh mesh = icosphere(4);  // edges of about 0.075
    AlterReport last;
    for (int round = 0; round < 10; ++round) {
      last = alter(mesh, free_options(edge));
      ASSERT_EQ(fault(mesh), "");
      for (int i = 0; i < 5; ++i) smooth(mesh, onto_sphere);
    }
    const ShapeStatistics shape = shape_statistics(mesh);
    EXPECT_NEAR(shape.mean_edge / edge, 1.0, 0.2) << edge;
    EXPECT_GE(shape.mean_angle, 52.0) << edge;
    EXPECT_GE(shape.p1_angle, 35.0) << edge;
    EXPECT_LE(last.splits + last.collapses, mesh.vertex_count() / 100) << edge;
  }
}

TEST(Alter, NoEdgeStaysTooLong) {
  TriangleMesh mesh = torus(12, 6);
  const AlterOptions options = free_options(0.1f);
  for (int round = 0; round < 8; ++round) alter(mesh, options);
  EXPECT_EQ(fault(mesh), "");
  for (Index h = 0; h < mesh.vertex.size(); ++h) EXPECT_LE(length(mesh, h), options.longest * 0.1 * (1 + 1e-6));
}

RC_GTEST_PROP(Alter, RandomMeshesStayValidWithTheirTopology, ()) {
  const bool ball = *rc::gen::arbitrary<bool>();
  TriangleMesh mesh =
      ball ? icosphere(*rc::gen::inRange(1, 4)) : torus(*rc::gen::inRange(4, 30), *rc::gen::inRange(3, 20));
  const double mean = shape_statistics(mesh).mean_edge;
  jitter(mesh, float(mean * *rc::gen::inRange(0, 12) / 10.0), *rc::gen::arbitrary<unsigned>());
  TriangleMesh motion = mesh;
  jitter(motion, float(mean), *rc::gen::arbitrary<unsigned>());
  for (Index v = 0; v < mesh.vertex_count(); ++v)
    mesh.vertices.velocity[v] = 20.0f * (motion.position(v) - mesh.position(v));
  if (*rc::gen::arbitrary<bool>()) append(mesh, tetrahedron(float(mean)));
  for (Index v = 0; v < mesh.vertex_count(); ++v) mesh.vertices.id[v] = v;
  mesh.next_id = Index(mesh.vertex_count());
  const int chi = euler(mesh);
  const auto pieces = mesh_pieces(mesh);

  AlterOptions options = free_options(float(mean * *rc::gen::element(0.2, 0.5, 1.0, 2.0, 5.0, 100.0)));
  options.respect_locks = *rc::gen::arbitrary<bool>();
  for (int round = 0; round < 4; ++round) {
    std::vector<std::uint8_t> inverted(mesh.triangle_count(), 0);
    for (std::size_t t = 0; t < inverted.size(); t += 7) inverted[t] = 1;
    const std::size_t vertices = mesh.vertex_count();
    const Index next_id = mesh.next_id;
    for (Index& age : mesh.vertices.age) ++age;
    const AlterReport report = alter(mesh, options, inverted);
    const ValidateReport valid = validate(mesh);
    if (!valid) RC_FAIL(valid.reason);
    RC_ASSERT(mesh.vertex_count() == vertices + report.splits - report.collapses);
    RC_ASSERT(mesh.next_id == next_id + report.splits);
    RC_ASSERT(euler(mesh) == chi);
    RC_ASSERT(mesh_pieces(mesh).count() == pieces.count());
    auto sorted = mesh_pieces(mesh).euler, expected = pieces.euler;
    std::sort(sorted.begin(), sorted.end());
    std::sort(expected.begin(), expected.end());
    RC_ASSERT(sorted == expected);
  }
}

TEST(Alter, BytesDoNotDependOnThreads) {
  TriangleMesh mesh = icosphere(5);
  append(mesh, torus(100, 50));
  for (Index v = 0; v < mesh.vertex_count(); ++v) mesh.vertices.id[v] = v;
  mesh.next_id = Index(mesh.vertex_count());
  jitter(mesh, 0.01f, 5);
  for (const float edge : {0.025f, 0.05f, 0.15f}) {
    const auto run = [&](std::size_t threads) {
      tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
      TriangleMesh out = mesh;
      for (int round = 0; round < 2; ++round) alter(out, free_options(edge));
      return out;
    };
    const TriangleMesh one = run(1);
    EXPECT_TRUE(same_bytes(one, run(4))) << edge;
    EXPECT_FALSE(same_bytes(one, mesh));
  }
}

TEST(Alter, LockedVerticesAreLeftAlone) {
  for (const float edge : {0.05f, 0.3f}) {
    TriangleMesh mesh = icosphere(4);
    jitter(mesh, 0.03f, 1);
    for (Index v = 0; v < mesh.vertex_count(); ++v) mesh.vertices.age[v] = mesh.position(v).x > 0 ? 0 : 3;
    std::map<Index, Vec3> locked;
    std::set<std::set<Index>> locked_edges;
    for (Index v = 0; v < mesh.vertex_count(); ++v)
      if (mesh.vertices.age[v] == 0) locked[mesh.vertices.id[v]] = mesh.position(v);
    for (Index h = 0; h < mesh.vertex.size(); ++h)
      if (mesh.vertices.age[mesh.from(h)] == 0 && mesh.vertices.age[mesh.to(h)] == 0)
        locked_edges.insert({mesh.vertices.id[mesh.from(h)], mesh.vertices.id[mesh.to(h)]});
    AlterOptions options = free_options(edge);
    options.respect_locks = true;
    const AlterReport report = alter(mesh, options);
    EXPECT_GT(report.splits + report.collapses, 100u);
    ASSERT_EQ(fault(mesh), "");
    const auto after = position_by_id(mesh);
    for (const auto& [id, p] : locked) {
      ASSERT_TRUE(after.count(id));
      EXPECT_EQ(after.at(id), p);
    }
    for (Index h = 0; h < mesh.vertex.size(); ++h)
      locked_edges.erase({mesh.vertices.id[mesh.from(h)], mesh.vertices.id[mesh.to(h)]});
    EXPECT_TRUE(locked_edges.empty()) << locked_edges.size();
    // A second call in the same frame leaves what the first one touched.
    const auto first = position_by_id(mesh);
    std::set<Index> touched;
    for (Index v = 0; v < mesh.vertex_count(); ++v)
      if (mesh.vertices.age[v] == 0) touched.insert(mesh.vertices.id[v]);
    EXPECT_GT(touched.size(), locked.size());
    alter(mesh, options);
    const auto second = position_by_id(mesh);
    for (const Index id : touched) {
      ASSERT_TRUE(second.count(id));
      EXPECT_EQ(second.at(id), first.at(id));
    }
  }
}

TEST(Alter, OldVerticesGoOnWhereNewOnesAreCollapsed) {
  TriangleMesh mesh = icosphere(4);
  jitter(mesh, 0.02f, 3);
  grow_old(mesh);
  const Index count = Index(mesh.vertex_count());
  for (Index v = 0; v < count; ++v) mesh.vertices.id[v] = count - 1 - v;  // edges' first ends are the newer ones
  mesh.next_id = count;
  std::vector<std::uint8_t> frozen(count);
  for (Index v = 0; v < count; ++v) frozen[v] = mesh.position(v).z < -0.8f;
  const auto before = position_by_id(mesh);
  AlterOptions options = free_options(0.15f);
  const auto summary = [&](bool keep_older) {
    TriangleMesh altered = mesh;
    options.keep_older = keep_older;
    EXPECT_GT(alter(altered, options, {}, frozen).collapses, 400u);
    EXPECT_EQ(fault(altered), "");
    const auto after = position_by_id(altered);
    std::set<Index> still;
    for (Index v = 0; v < count; ++v) {
      if (!frozen[v]) continue;
      const Index id = mesh.vertices.id[v];
      EXPECT_TRUE(after.count(id) && after.at(id) == before.at(id));
      still.insert(id);
    }
    double sum = 0.0;  // of the ids that are left
    for (const auto& [id, p] : after) sum += id;
    std::size_t short_edges = 0;  // that have one frozen end
    for (Index h = 0; h < altered.vertex.size(); ++h)
      short_edges += still.count(altered.vertices.id[altered.from(h)]) > 0 &&
                     still.count(altered.vertices.id[altered.to(h)]) == 0 &&
                     length(altered, h) < 0.75 * options.shortest * options.edge_length;
    return std::pair(sum / double(after.size()), short_edges);
  };
  const auto [mean, left] = summary(true);
  const auto [mean_before, left_before] = summary(false);
  EXPECT_LT(mean, 0.8 * mean_before);
  EXPECT_LT(left, left_before / 4);
}

TEST(Alter, FrozenVerticesKeepTheirBytesAndTheirEdges) {
  for (const float edge : {0.03f, 0.5f}) {  // everything wants to be split, or collapsed
    TriangleMesh mesh = icosphere(4);
    jitter(mesh, 0.02f, 3);
    grow_old(mesh);
    const TriangleMesh before = mesh;
    std::vector<std::uint8_t> frozen(mesh.vertex_count());
    for (Index v = 0; v < frozen.size(); ++v) frozen[v] = mesh.position(v).z < 0.0f;
    const AlterReport report = alter(mesh, free_options(edge), {}, frozen);
    EXPECT_EQ(fault(mesh), "");
    EXPECT_GT(report.splits + report.collapses, 500u);
    std::map<Index, Index> row;
    for (Index v = 0; v < mesh.vertex_count(); ++v) row[mesh.vertices.id[v]] = v;
    std::set<std::pair<Index, Index>> edges;  // by ids
    for (Index h = 0; h < mesh.vertex.size(); ++h)
      edges.emplace(mesh.vertices.id[mesh.from(h)], mesh.vertices.id[mesh.to(h)]);
    for (Index v = 0; v < frozen.size(); ++v) {
      if (!frozen[v]) continue;
      ASSERT_TRUE(row.count(before.vertices.id[v]));
      const Index now = row[before.vertices.id[v]];
      EXPECT_EQ(mesh.position(now), before.position(v));
      EXPECT_EQ(mesh.vertices.age[now], before.vertices.age[v]);
    }
    for (Index h = 0; h < before.vertex.size(); ++h) {
      if (!frozen[before.from(h)] || !frozen[before.to(h)]) continue;
      EXPECT_TRUE(edges.count({before.vertices.id[before.from(h)], before.vertices.id[before.to(h)]}));
    }
  }
}

TEST(Alter, TouchedVerticesAreYoungAndOthersKeepTheirAge) {
  TriangleMesh mesh = icosphere(3);
  grow_old(mesh);
  const auto before = position_by_id(mesh);
  AlterOptions options = free_options(0.2f);
  options.respect_locks = true;
  const AlterReport report = alter(mesh, options);
  EXPECT_GT(report.collapses, 10u);
  for (Index v = 0; v < mesh.vertex_count(); ++v) {
    const auto old = before.find(mesh.vertices.id[v]);
    if (old == before.end() || old->second != mesh.position(v))
      EXPECT_EQ(mesh.vertices.age[v], 0u);
    else
      EXPECT_TRUE(mesh.vertices.age[v] == 0 || mesh.vertices.age[v] == 5);
  }
}

TEST(Alter, FreshIdsAreUniqueAndSurvivorsKeepTheirs) {
  TriangleMesh mesh = icosphere(3);
  const Index next_id = mesh.next_id;
  std::set<Index> old(mesh.vertices.id.begin(), mesh.vertices.id.end());
  const AlterReport report = alter(mesh, free_options(0.08f));
  ASSERT_GT(report.splits, 100u);
  std::set<Index> ids(mesh.vertices.id.begin(), mesh.vertices.id.end());
  EXPECT_EQ(ids.size(), mesh.vertex_count());
  EXPECT_EQ(mesh.next_id, next_id + report.splits);
  for (const Index id : ids) EXPECT_TRUE(old.count(id) || (id >= next_id && id < mesh.next_id));
}

TEST(Alter, CompressedEdgesAreNotSplitNorStretchedOnesCollapsed) {
  const double mean = shape_statistics(icosphere(3)).mean_edge;
  const auto moving = [](float speed) {
    TriangleMesh mesh = icosphere(3);
    for (Index v = 0; v < mesh.vertex_count(); ++v) mesh.vertices.velocity[v] = speed * mesh.position(v);
    return mesh;
  };
  const auto report = [&](float speed, double edge) {
    TriangleMesh mesh = moving(speed);
    AlterOptions options = free_options(float(edge));
    options.flip = false;
    const AlterReport out = alter(mesh, options);
    EXPECT_EQ(fault(mesh), "");
    return out;
  };
  // Too long by a factor of 2; one frame at this speed changes a length by 4 %, 8 % of e: not yet a change.
  EXPECT_GT(report(-1.0f, mean / 2).splits, 0u);
  EXPECT_EQ(report(-2.0f, mean / 2).splits, 0u);
  EXPECT_GT(report(2.0f, mean / 2).splits, 0u);
  EXPECT_GT(report(2.0f, mean * 2).collapses, 0u);
  EXPECT_EQ(report(8.0f, mean * 2).collapses, 0u);
  EXPECT_GT(report(-8.0f, mean * 2).collapses, 0u);
}

TEST(Alter, InvertedTrianglesAreNotSplit) {
  TriangleMesh mesh = icosphere(2);
  std::vector<std::uint8_t> inverted(mesh.triangle_count(), 1);
  EXPECT_EQ(alter(mesh, free_options(0.1f), inverted).splits, 0u);
  std::fill(inverted.begin(), inverted.end(), 0);
  inverted[11] = 1;
  std::set<Index> ids;
  for (int k = 0; k < 3; ++k) ids.insert(mesh.vertices.id[mesh.vertex[33 + k]]);
  AlterOptions options = free_options(0.1f);
  options.flip = false;
  EXPECT_GT(alter(mesh, options, inverted).splits, 0u);
  bool whole = false;
  for (Index t = 0; t < mesh.triangle_count(); ++t) {
    std::set<Index> now;
    for (int k = 0; k < 3; ++k) now.insert(mesh.vertices.id[mesh.vertex[3 * t + k]]);
    whole |= now == ids;
  }
  EXPECT_TRUE(whole);
}

TEST(Alter, TetrahedraAreNotCollapsedAway) {
  TriangleMesh mesh = tetrahedron(0.01f);
  append(mesh, icosphere(1, 0.01f, Vec3(1, 0, 0)));
  for (Index v = 0; v < mesh.vertex_count(); ++v) mesh.vertices.id[v] = v;
  mesh.next_id = Index(mesh.vertex_count());
  for (int round = 0; round < 5; ++round) alter(mesh, free_options(1.0f));
  EXPECT_EQ(fault(mesh), "");
  const MeshPieces pieces = mesh_pieces(mesh);
  ASSERT_EQ(pieces.count(), 2u);
  EXPECT_GT(pieces.volume[0], 0.0);
  EXPECT_GT(pieces.volume[1], 0.0);
}

TEST(Alter, CollapsesNeverTurnATriangleOver) {
  TriangleMesh mesh = icosphere(5);
  jitter(mesh, 0.005f, 9);
  for (int round = 0; round < 3; ++round) {
    alter(mesh, free_options(0.2f));
    for (Index t = 0; t < mesh.triangle_count(); ++t)
      EXPECT_GT(glm::dot(normal(mesh, t), DVec3(mesh.position(mesh.vertex[3 * t]))), 0.0);
  }
}

TEST(Alter, CreasesAreNotFlippedAcross) {
  TriangleMesh mesh = cube(6);
  for (Vec3& p : mesh.vertices.position) p.x *= 0.3f;  // right triangles with legs 1 to 0.3 on four of the sides
  const auto on_side = [](const DVec3& n) {
    const DVec3 a = glm::abs(glm::normalize(n));
    return std::max({a.x, a.y, a.z}) > 0.999;
  };
  AlterOptions options = free_options(1.0f);
  options.shortest = 0.0f, options.longest = 100.0f;
  alter(mesh, options);
  EXPECT_EQ(fault(mesh), "");
  for (Index t = 0; t < mesh.triangle_count(); ++t) EXPECT_TRUE(on_side(normal(mesh, t)));
}

TEST(Alter, FlipsComeToRest) {
  for (const bool ball : {true, false}) {
    TriangleMesh mesh = ball ? icosphere(4) : torus(60, 24);
    AlterOptions options = free_options(0.15f);
    options.flip = false;
    jitter(mesh, 0.02f, 4);
    alter(mesh, options);  // collapses leave valences in disorder
    for (Vec3& p : mesh.vertices.position) p = ball ? onto_sphere(p) : onto_torus(p);
    options = free_options(1.0f);
    options.shortest = 0.0f, options.longest = 100.0f;
    double potential = flip_potential(mesh);
    std::size_t total = 0, flips = 0;
    int calls = 0;
    do {
      flips = alter(mesh, options).flips;
      total += flips;
      ASSERT_EQ(fault(mesh), "");
      const double now = flip_potential(mesh);
      EXPECT_LE(now, potential - 0.04 * double(flips));
      potential = now;
    } while (flips > 0 && ++calls < 20);
    EXPECT_EQ(flips, 0u);
    EXPECT_GT(total, 50u);
  }
}

TEST(Alter, FlipsCanBeSwitchedOff) {
  TriangleMesh mesh = icosphere(3);
  jitter(mesh, 0.08f, 4);
  AlterOptions options = free_options(0.15f);
  options.flip = false;
  EXPECT_EQ(alter(mesh, options).flips, 0u);
}

TEST(Alter, AVeryDenseMeshIsNearlyDoneInOneCall) {
  TriangleMesh mesh = icosphere(6);  // 81920 triangles, edges of about 0.019
  jitter(mesh, 0.004f, 2);
  for (Vec3& p : mesh.vertices.position) p = onto_sphere(p);
  const double edge = 3 * shape_statistics(mesh).mean_edge;
  alter(mesh, free_options(float(edge)));
  EXPECT_EQ(fault(mesh), "");
  EXPECT_LT(mesh.triangle_count(), 81920u / 6);
  EXPECT_NEAR(shape_statistics(mesh).mean_edge / edge, 1.0, 0.2);
}
