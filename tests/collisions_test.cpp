// Whole collisions: found, operated on and looked at again; several at once, three sheets in one place, films and
// tunnels, on fields without second derivatives.
#include "core/topology/collisions.h"

#include <map>
#include <random>

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>
#include <tbb/global_control.h>

#include "core/mechanics/motion.h"
#include "core/mesh/validate.h"
#include "core/sampling/marching_cubes.h"
#include "core/topology/triangle_pairs.h"
#include "tests/solid_field.h"

namespace isoskin {
namespace {

constexpr double kEdge = 0.1;

using Solid = SolidField::Solid;

std::shared_ptr<SolidField> field_of(Solid solid) {
  return std::make_shared<SolidField>(std::move(solid), Box{DVec3(-4.0), DVec3(4.0)});
}

TriangleMesh mesh_of(const std::shared_ptr<SolidField>& field) {
  auto backend = make_reference_backend();
  backend->set_field(field);
  const BrickLattice lattice = sample_lattice(*field, *backend, 0.7 * kEdge);
  return marching_cubes(lattice, lattice_topology(lattice));
}

int euler_of(const TriangleMesh& mesh) {
  return int(mesh.vertex_count()) - int(mesh.triangle_count()) / 2;
}

struct Outcome {
  TriangleMesh mesh;
  std::map<std::string, int> kinds;
  int rounds = 0;
};

/// A mesh on the surface of `before` follows `after`, as a frame does; every operation is validated.
Outcome follow(const Solid& before, const Solid& after) {
  Outcome outcome;
  outcome.mesh = mesh_of(field_of(before));
  const auto field = field_of(after);
  auto backend = make_reference_backend();
  backend->set_field(field);
  CollisionOptions options;
  options.edge_length = kEdge;
  ProjectOptions project;
  project.tolerance = float(1e-4 * kEdge);
  project.max_step = float(0.5 * kEdge);
  std::vector<Ball> split;
  for (;; ++outcome.rounds) {
    TriangleMesh moved = outcome.mesh;
    predict(moved, nullptr, 0.0, *field, *backend, project);  // in no time: straight onto the surface
    const int euler = euler_of(outcome.mesh);
    const CollisionReport report =
        handle_collisions(outcome.mesh, moved.vertices.position, *backend, *field, {}, split, options);
    if (report.events.empty()) {
      outcome.mesh = moved;
      return outcome;
    }
    split.insert(split.end(), report.split.begin(), report.split.end());
    int change = 0;
    for (const CollisionEvent& event : report.events) {
      ++outcome.kinds[event.kind];
      change += event.kind == "split" || event.kind == "spackle" ? 2 : -2;
    }
    const ValidateReport valid = validate(outcome.mesh);
    EXPECT_TRUE(valid) << valid.reason;
    EXPECT_EQ(euler_of(outcome.mesh), euler + change);
  }
}

Solid balls(const std::vector<DVec3>& centers, double radius) {
  Solid all = solid::ball(centers[0], radius);
  for (std::size_t i = 1; i < centers.size(); ++i) all = solid::both(all, solid::ball(centers[i], radius));
  return all;
}

using Kinds = std::map<std::string, int>;

}  // namespace

TEST(Collisions, NothingHappensWhereNothingMeets) {
  const Outcome outcome = follow(balls({{-1, 0, 0}, {1, 0, 0}}, 0.7), balls({{-0.95, 0, 0}, {1, 0.05, 0}}, 0.72));
  EXPECT_EQ(outcome.rounds, 0);
  EXPECT_EQ(mesh_pieces(outcome.mesh).count(), 2u);
}

TEST(Collisions, TwoBallsBlend) {
  for (const double overlap : {0.02, 0.05, 0.1, 0.15}) {
    const Outcome outcome = follow(balls({{-0.72, 0.1, 0}, {0.72, 0, 0}}, 0.7),
                                   balls({{-0.7 + overlap, 0.1, 0}, {0.7 - overlap, 0, 0}}, 0.7));
    EXPECT_EQ(outcome.kinds, (Kinds{{"blend", 1}})) << overlap;
    EXPECT_EQ(mesh_pieces(outcome.mesh).count(), 1u) << overlap;
  }
}

TEST(Collisions, ManyBlendAtOnce) {
  std::vector<DVec3> apart, near;
  for (int i = 0; i < 5; ++i) {
    apart.push_back({1.08 * (i - 2), 0.1 * (i % 2), 0.0});
    near.push_back({0.98 * (i - 2), 0.1 * (i % 2), 0.0});
  }
  const Outcome outcome = follow(balls(apart, 0.5), balls(near, 0.5));
  EXPECT_EQ(outcome.kinds, (Kinds{{"blend", 4}}));
  EXPECT_EQ(mesh_pieces(outcome.mesh).count(), 1u);
}

TEST(Collisions, ThreeSheetsMeetingAtOnePlaceAreBlendedTwoByTwo) {
  std::vector<DVec3> apart, near;
  for (int i = 0; i < 3; ++i) {
    const double a = 2.0943951 * i + 0.2;
    apart.push_back({0.85 * std::cos(a), 0.85 * std::sin(a), 0.02 * i});
    near.push_back({0.76 * std::cos(a), 0.76 * std::sin(a), 0.02 * i});
  }
  const auto filled = [](Solid three) { return solid::both(std::move(three), solid::ball(DVec3(0.0), 0.35)); };
  const Outcome outcome = follow(balls(apart, 0.7), filled(balls(near, 0.7)));
  EXPECT_EQ(mesh_pieces(outcome.mesh).count(), 1u);
  EXPECT_EQ(euler_of(outcome.mesh), 2);
  EXPECT_EQ(outcome.kinds, (Kinds{{"blend", 2}}));
}

TEST(Collisions, ManyNecksSplitAtOnce) {
  std::vector<DVec3> centers;
  for (int i = 0; i < 4; ++i) centers.push_back({1.5 * (i - 1.5), 0.2 * (i % 2), 0.1 * i});
  const Solid apart = balls(centers, 0.6);
  Solid string = apart;
  for (int i = 0; i + 1 < 4; ++i) string = solid::both(string, solid::rod(centers[i], centers[i + 1], 0.15));
  const Outcome outcome = follow(string, apart);
  EXPECT_EQ(outcome.kinds, (Kinds{{"split", 3}}));
  EXPECT_EQ(mesh_pieces(outcome.mesh).count(), 4u);
  EXPECT_EQ(euler_of(outcome.mesh), 8);
}

TEST(Collisions, AFilmIsPierced) {
  const Solid film = solid::plate(DVec3(0.0), 1.2, 0.1);
  const Outcome outcome = follow(film, solid::without(film, solid::ball(DVec3(0.0), 0.5)));
  EXPECT_EQ(outcome.kinds, (Kinds{{"pierce", 1}}));
  EXPECT_EQ(euler_of(outcome.mesh), 0);
}

TEST(Collisions, ABallThatIsGoneVanishes) {
  const Outcome outcome = follow(balls({{-1, 0, 0}, {1, 0, 0}}, 0.3), balls({{-1, 0, 0}}, 0.3));
  EXPECT_EQ(outcome.kinds, (Kinds{{"vanish", 1}}));
  EXPECT_EQ(mesh_pieces(outcome.mesh).count(), 1u);
}

TEST(Collisions, SameMeshWhateverTheNumberOfThreads) {
  const auto run = [](std::size_t threads) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    const Outcome outcome = follow(balls({{-1.08, 0, 0}, {0, 0, 0}, {1.08, 0, 0}}, 0.5),
                                   balls({{-0.97, 0, 0}, {0, 0, 0}, {0.97, 0, 0}}, 0.5));
    EXPECT_EQ(outcome.kinds, (Kinds{{"blend", 2}}));
    return outcome.mesh;
  };
  const TriangleMesh one = run(1), four = run(4);
  EXPECT_EQ(one.vertex, four.vertex);
  EXPECT_EQ(one.vertices.id, four.vertices.id);
  EXPECT_EQ(one.vertices.position, four.vertices.position);
}

RC_GTEST_PROP(Collisions, RandomBallsStayManifold, ()) {
  std::mt19937 random(*rc::gen::arbitrary<unsigned>());
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  std::vector<DVec3> before, after;
  for (int i = 0; i < 3; ++i) {
    const double x = uniform(random), y = uniform(random), z = uniform(random);
    before.push_back(DVec3(x, y, z));
    const double dx = uniform(random), dy = uniform(random), dz = uniform(random);
    after.push_back(before.back() + 0.12 * DVec3(dx, dy, dz));
  }
  for (DVec3& p : before) p *= 0.6;
  for (std::size_t i = 0; i < after.size(); ++i) after[i] -= 0.4 / 0.6 * before[i];
  const Outcome outcome = follow(balls(before, 0.3), balls(after, 0.3));
  RC_ASSERT(validate(outcome.mesh).reason == "");
  RC_ASSERT(outcome.rounds <= 20);
}

}  // namespace isoskin
