// What a lattice's corners hide, against the same field on a lattice four times as fine.
#include "core/sampling/hidden_crossings.h"

#include <cstdio>
#include <random>

#include <gtest/gtest.h>

#include "core/io/sequence.h"
#include "core/sampling/marching_cubes.h"
#include "tests/analytic_fields.h"
#include "tests/sanitized.h"
#include "tests/solid_field.h"

using namespace isoskin;

namespace {

struct Topology {
  std::size_t pieces = 0;
  long long euler = 0;
  bool operator==(const Topology&) const = default;
};

std::unique_ptr<Backend> backend_with(const Field& field) {
  auto backend = make_reference_backend();
  backend->set_field({std::shared_ptr<const Field>(), &field});
  return backend;
}

Topology topology_at(const Field& field, double spacing) {
  const auto backend = backend_with(field);
  const LatticeTopology topology = lattice_topology(sample_lattice(field, *backend, spacing));
  Topology sum{topology.piece_count(), 0};
  for (const int e : topology.euler) sum.euler += e;
  return sum;
}

/// Two balls of radius 1 about a and b and a rod of the given radius between their centres.
SolidField dumbbell(const DVec3& a, const DVec3& b, double rod) {
  Box bounds;
  for (const DVec3& c : {a, b}) {
    bounds.add(c - 1.5);
    bounds.add(c + 1.5);
  }
  const auto inside = [=](const DVec3& p) {
    const double t = std::clamp(glm::dot(p - a, b - a) / glm::dot(b - a, b - a), 0.0, 1.0);
    return std::max({1.0 - glm::distance(p, a), 1.0 - glm::distance(p, b), rod - glm::distance(p, a + t * (b - a))});
  };
  return SolidField(inside, bounds);
}

}  // namespace

TEST(HiddenCrossings, rods_thinner_than_the_spacing_hold) {
  std::mt19937 random(5);
  std::uniform_real_distribution<double> unit(-1.0, 1.0);
  constexpr double kSpacing = 0.25;
  int whole = 0, fine_whole = 0;
  constexpr int kTries = 60;
  for (int i = 0; i < kTries; ++i) {
    const DVec3 a = 0.5 * DVec3(unit(random), unit(random), unit(random));
    const DVec3 way(unit(random), unit(random), unit(random));
    const SolidField field = dumbbell(a, a + 2.2 * glm::normalize(way), 0.3 * kSpacing);
    const Topology seen = topology_at(field, kSpacing);
    fine_whole += topology_at(field, kSpacing / 4.0) == Topology{1, 2};
    whole += seen == Topology{1, 2};
  }
  std::printf("%d of %d rods hold, %d on a lattice four times as fine\n", whole, kTries, fine_whole);
  EXPECT_EQ(fine_whole, kTries);
  EXPECT_GE(whole, kTries * 9 / 10);
}

TEST(HiddenCrossings, rough_fluids_have_the_topology_of_a_lattice_four_times_as_fine) {
  constexpr int kFrames[] = {48, 45, 36};
  for (int i = 0; i < test::repeats(3, 1); ++i) {
    const int frame = kFrames[i];
    const auto field =
        load_grid(std::string(ISOSKIN_TEST_DATA) + "/dam_break/dam_break.00" + std::to_string(frame) + ".vdb", {});
    const double h = field->resolution();
    const Topology seen = topology_at(*field, h / 2.0), fine = topology_at(*field, h / 8.0);
    EXPECT_EQ(seen.pieces, fine.pieces) << "frame " << frame;
    EXPECT_EQ(seen.euler, fine.euler) << "frame " << frame;
  }
}

TEST(HiddenCrossings, a_smooth_surface_has_none) {
  const analytic::TorusField torus(1.0, 0.4);
  const auto backend = backend_with(torus);
  BrickLattice lattice = sample_lattice(torus, *backend, 0.07);
  EXPECT_EQ(reveal_hidden_crossings(lattice, torus), 0u);
}
