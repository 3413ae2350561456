#include "render/ray_root.h"

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "tests/analytic_fields.h"

using namespace isoskin;

namespace {

// F = sign * product of (x - root): a polynomial along every ray. Counts how often range() is asked.
class ProductField final : public Field {
public:
  explicit ProductField(std::vector<double> roots, double sign = 1.0) : roots_(std::move(roots)), sign_(sign) {}

  FieldSample sample(const DVec3& p) const override {
    double value = sign_;
    for (const double r : roots_) value *= p.x - r;
    return {value, DVec3(0.0)};
  }
  Box bounds() const override { return {DVec3(0.0), DVec3(1.0)}; }
  Interval range(const Box& box) const override {
    Interval product{sign_, sign_};
    for (const double r : roots_) {
      const double a = box.low.x - r, b = box.high.x - r;
      const auto [low, high] = std::minmax({product.low * a, product.low * b, product.high * a, product.high * b});
      product = {low, high};
    }
    return product;
  }

private:
  std::vector<double> roots_;
  double sign_;
};

constexpr RayPiece kUnit{DVec3(0.0), DVec3(1.0, 0.0, 0.0), 0.0, 1.0};

// Nine distinct roots at random places from -0.5 to 1.5, at least 1e-3 apart, padded by far ones to the degree.
std::vector<double> random_roots(int degree) {
  std::vector<int> places;
  const int count = *rc::gen::inRange(0, degree + 1);
  while (static_cast<int>(places.size()) < count) {
    const int place = *rc::gen::inRange(-500, 1500);
    if (std::find(places.begin(), places.end(), place) == places.end()) places.push_back(place);
  }
  std::vector<double> roots;
  for (const int place : places) roots.push_back(1e-3 * place + 0.37e-3);
  return roots;
}

std::optional<double> smallest_in_unit(std::vector<double> roots) {
  std::sort(roots.begin(), roots.end());
  for (const double r : roots) {
    if (r > 0.0 && r < 1.0) return r;
  }
  return std::nullopt;
}

}  // namespace

RC_GTEST_PROP(RayRoot, TheFirstOfNineRootsIsFound, ()) {
  const auto roots = random_roots(9);
  const auto expected = smallest_in_unit(roots);
  const auto found = first_polynomial_root(ProductField(roots, *rc::gen::element(1.0, -1.0)), kUnit, 9);
  RC_ASSERT(found.has_value() == expected.has_value());
  // Nine roots make F as small as 1e-9 of its largest value between them; the rounding of 1e-15 moves roots by 1e-6.
  if (found) RC_ASSERT(std::abs(*found - *expected) < 1e-5);
}

RC_GTEST_PROP(RayRoot, TheFirstOfThreeRootsIsFound, ()) {
  const auto roots = random_roots(3);
  const auto expected = smallest_in_unit(roots);
  const auto found = first_polynomial_root(ProductField(roots, *rc::gen::element(1.0, -1.0)), kUnit, 3);
  RC_ASSERT(found.has_value() == expected.has_value());
  if (found) RC_ASSERT(std::abs(*found - *expected) < 1e-8);
}

RC_GTEST_PROP(RayRoot, BisectionBetweenBoundsFindsTheSame, ()) {
  const auto roots = random_roots(6);
  const auto expected = smallest_in_unit(roots);
  const auto found = first_root(ProductField(roots, *rc::gen::element(1.0, -1.0)), kUnit, 1e-4);
  RC_ASSERT(found.has_value() == expected.has_value());
  if (found) RC_ASSERT(std::abs(*found - *expected) < 1e-8);
}

TEST(RayRoot, AThinPairOfRootsIsNotSteppedOver) {
  for (const double gap : {1e-2, 1e-3, 1e-4, 1e-5}) {
    for (const double place : {0.1, 0.5, 0.77}) {
      const ProductField field({place, place + gap}, -1.0);  // positive between the two
      const auto cubic = first_polynomial_root(field, kUnit, 3), ninth = first_polynomial_root(field, kUnit, 9);
      const auto bounded = first_root(field, kUnit, 0.3 * gap);
      ASSERT_TRUE(cubic && ninth && bounded) << gap << " at " << place;
      EXPECT_NEAR(*cubic, place, 1e-3 * gap);
      EXPECT_NEAR(*ninth, place, 1e-3 * gap);
      EXPECT_NEAR(*bounded, place, 1e-6 * gap);
    }
  }
}

TEST(RayRoot, TouchingIsNotCrossing) {
  const ProductField touching({0.3, 0.3}, -1.0);  // at most 0
  EXPECT_FALSE(first_root(touching, kUnit, 1e-3));
  EXPECT_FALSE(first_polynomial_root(ProductField({}, 1.0), kUnit, 9));
  EXPECT_FALSE(first_polynomial_root(ProductField({}, -1.0), kUnit, 3));
  EXPECT_FALSE(first_polynomial_root(ProductField({2.0, 3.0, 4.0}), kUnit, 9));
}

TEST(RayRoot, PiecesAlongAnyRayWork) {
  const analytic::SphereField sphere(DVec3(1.0, 2.0, 3.0), 0.5);
  const DVec3 direction = glm::normalize(DVec3(1.0, 2.0, 3.0));
  const double center = glm::length(DVec3(1.0, 2.0, 3.0));
  const auto entry = first_root(sphere, {DVec3(0.0), direction, 0.0, 10.0}, 1e-3);
  ASSERT_TRUE(entry);
  EXPECT_NEAR(*entry, center - 0.5, 1e-9);
  const auto exit = first_root(sphere, {DVec3(0.0), direction, center, 10.0}, 1e-3);
  ASSERT_TRUE(exit);
  EXPECT_NEAR(*exit, center + 0.5, 1e-9);
}
