#include "tests/analytic_fields.h"

#include <gtest/gtest.h>
#include <rapidcheck.h>

#include <random>
#include <vector>

namespace isoskin::analytic {
namespace {

struct Case {
  const char* name;
  std::shared_ptr<const Field> field;
};

std::vector<Case> all_fields() {
  std::vector<Case> cases{{"sphere", std::make_shared<SphereField>(DVec3(0.2, 0.0, -0.1), 0.8)},
                          {"torus", std::make_shared<TorusField>(1.0, 0.3)},
                          {"plane", std::make_shared<PlaneField>(DVec3(1.0, 2.0, -0.5), 0.3)},
                          {"box", std::make_shared<BoxField>(Box{DVec3(-1.0, -0.5, -0.7), DVec3(0.3, 1.0, 0.2)})},
                          {"gyroid", boxed_gyroid(1.0, 0.9, 0.02)},
                          {"cap", capped_sphere(1.0, 0.4)},
                          {"sheets", two_sheets(1.0, 0.2, 0.1)}};
  for (int positive = 0; positive <= 3; ++positive) {
    for (const double c : {0.8, 1.1}) cases.push_back({"morse", std::make_shared<MorseField>(positive, c)});
  }
  return cases;
}

struct Random {
  std::mt19937_64 engine;
  double operator()(double low, double high) { return std::uniform_real_distribution<double>(low, high)(engine); }
  DVec3 vector(double size) { return {(*this)(-size, size), (*this)(-size, size), (*this)(-size, size)}; }
};

// Where differences of two step sizes disagree there is a kink.
bool smooth_at(const Field& field, const DVec3& p, double step) {
  const DVec3 g = field.sample(p).gradient;
  for (int corner = 0; corner < 8; ++corner) {
    const DVec3 q = p + step * DVec3(corner & 1 ? 1 : -1, corner & 2 ? 1 : -1, corner & 4 ? 1 : -1);
    if (glm::length(field.sample(q).gradient - g) > 1e-3) return false;
  }
  return true;
}

TEST(AnalyticFields, GradientsAndHessiansMatchDifferences) {
  for (const auto& [name, field] : all_fields()) {
    int checked = 0;
    Random random{std::mt19937_64(7)};
    for (int k = 0; k < 500; ++k) {
      const DVec3 p = random.vector(1.5);
      constexpr double kStep = 1e-5;
      if (!smooth_at(*field, p, 2 * kStep)) continue;
      ++checked;
      const FieldSample s = field->sample(p);
      const DMat3 h = field->hessian(p);
      for (int i = 0; i < 3; ++i) {
        DVec3 step(0.0);
        step[i] = kStep;
        EXPECT_NEAR(s.gradient[i], (field->value(p + step) - field->value(p - step)) / (2 * kStep), 1e-6) << name;
        if (!smooth_at(*field, p, 3e-4)) continue;  // the default Hessian reaches 1e-4 far
        const DVec3 column = (field->sample(p + step).gradient - field->sample(p - step).gradient) / (2 * kStep);
        EXPECT_LT(glm::length(h[i] - column), 1e-4) << name;
      }
    }
    EXPECT_GT(checked, 300) << name;
  }
}

TEST(AnalyticFields, RangesContainAndBoundsHoldTheSurface) {
  for (const auto& [name, shared] : all_fields()) {
    const Field& field = *shared;
    EXPECT_TRUE(rc::check([&](std::uint64_t seed) {
      Random random{std::mt19937_64(seed)};
      const DVec3 p = random.vector(1.5);
      Box box{p, p};
      box.add(p + random.vector(random(0.0, 1.0)));
      const Interval range = field.range(box);
      for (int k = 0; k < 20; ++k) {
        const DVec3 t(random(0.0, 1.0), random(0.0, 1.0), random(0.0, 1.0));
        RC_ASSERT(range.contains(field.value(glm::mix(box.low, box.high, t))));
      }
      // A sign change lies in the bounds (a plane has none of its own).
      const DVec3 q = random.vector(2.5);
      if ((field.value(p) > 0.0) == (field.value(q) > 0.0) || std::string(name) == "plane") return;
      DVec3 a = p, b = q;
      for (int k = 0; k < 60; ++k) {
        const DVec3 middle = 0.5 * (a + b);
        ((field.value(middle) > 0.0) == (field.value(a) > 0.0) ? a : b) = middle;
      }
      const Box bounds = field.bounds().grown(1e-9);
      RC_ASSERT(glm::all(glm::lessThanEqual(bounds.low, a)) && glm::all(glm::lessThanEqual(a, bounds.high)));
    })) << name;
  }
}

TEST(AnalyticFields, MorseFieldsHaveTheirCriticalPointAtTheOrigin) {
  for (int positive = 0; positive <= 3; ++positive) {
    const MorseField field(positive, 1.25);
    const FieldSample s = field.sample(DVec3(0.0));
    EXPECT_EQ(s.value, 0.25);
    EXPECT_EQ(s.gradient, DVec3(0.0));
    const DMat3 h = field.hessian(DVec3(0.0));
    int found = 0;
    for (int i = 0; i < 3; ++i) found += h[i][i] > 0.0;
    EXPECT_EQ(found, positive);
  }
}

}  // namespace
}  // namespace isoskin::analytic
