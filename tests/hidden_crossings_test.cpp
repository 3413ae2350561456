// What a lattice's corners hide, against the same field on a lattice four times as fine.
#include "core/sampling/hidden_crossings.h"

#include <cstdio>
#include <random>

#include <gtest/gtest.h>

#include "core/io/sequence.h"
#include "core/sampling/marching_cubes.h"
#include "tests/analytic_fields.h"

using namespace isoskin;

namespace {

struct Topology {
  std::size_t pieces = 0;
  long long euler = 0;
  bool operator==(const Topology&) const = default;
};

Topology topology_at(const Field& field, double spacing) {
  const auto backend = make_reference_backend();
  const LatticeTopology topology = lattice_topology(sample_lattice(field, *backend, spacing));
  Topology sum{topology.piece_count(), 0};
  for (const int e : topology.euler) sum.euler += e;
  return sum;
}

/// Two balls of radius 1 and a rod of the given radius between their centres, rounded where they meet.
class Dumbbell final : public Field {
public:
  Dumbbell(const DVec3& a, const DVec3& b, double rod) : a_(a), b_(b), rod_(rod) {}

  FieldSample sample(const DVec3& p) const override {
    constexpr double kStep = 1e-5;
    DVec3 gradient;
    for (int i = 0; i < 3; ++i) {
      DVec3 d(0.0);
      d[i] = kStep;
      gradient[i] = (value(p + d) - value(p - d)) / (2.0 * kStep);
    }
    return {value(p), gradient};
  }
  double value(const DVec3& p) const override {
    const double t = std::clamp(glm::dot(p - a_, b_ - a_) / glm::dot(b_ - a_, b_ - a_), 0.0, 1.0);
    const std::array<double, 3> inside{1.0 - glm::distance(p, a_), 1.0 - glm::distance(p, b_),
                                       rod_ - glm::distance(p, a_ + t * (b_ - a_))};
    double sum = 0.0;
    for (const double d : inside) sum += std::exp(kSharp * d);
    return std::log(sum) / kSharp;
  }
  Box bounds() const override {
    Box box;
    for (const DVec3& c : {a_, b_}) {
      box.add(c - 1.5);
      box.add(c + 1.5);
    }
    return box;
  }
  Interval range(const Box&) const override { return {-1e9, 1e9}; }

private:
  static constexpr double kSharp = 60.0;
  DVec3 a_, b_;
  double rod_;
};

}  // namespace

TEST(HiddenCrossings, rods_thinner_than_the_spacing_hold) {
  std::mt19937 random(5);
  std::uniform_real_distribution<double> unit(-1.0, 1.0);
  constexpr double kSpacing = 0.25;
  int whole = 0, fine_whole = 0;
  constexpr int kTries = 60;
  for (int i = 0; i < kTries; ++i) {
    const DVec3 a = 0.5 * DVec3(unit(random), unit(random), unit(random));
    DVec3 way(unit(random), unit(random), unit(random));
    const Dumbbell dumbbell(a, a + 2.4 * glm::normalize(way), 0.3 * kSpacing);
    const Topology seen = topology_at(dumbbell, kSpacing);
    fine_whole += topology_at(dumbbell, kSpacing / 4.0) == Topology{1, 2};
    whole += seen == Topology{1, 2};
  }
  std::printf("%d of %d rods hold, %d on a lattice four times as fine\n", whole, kTries, fine_whole);
  EXPECT_EQ(fine_whole, kTries);
  EXPECT_GE(whole, kTries * 9 / 10);
}

TEST(HiddenCrossings, rough_fluids_have_the_topology_of_a_lattice_four_times_as_fine) {
  for (const int frame : {36, 45, 48}) {
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
  const auto backend = make_reference_backend();
  BrickLattice lattice = sample_lattice(torus, *backend, 0.07);
  EXPECT_EQ(reveal_hidden_crossings(lattice, torus), 0u);
}
