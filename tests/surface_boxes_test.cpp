#include "render/surface_boxes.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "core/field/grid_field.h"
#include "core/field/skeleton_field.h"
#include "tests/analytic_fields.h"

using namespace isoskin;

namespace {

bool holds(const SurfaceBoxes& boxes, const DVec3& p) {
  for (const SurfaceBox& b : boxes.boxes) {
    if (glm::all(glm::greaterThanEqual(p, b.box.low - 1e-9)) && glm::all(glm::lessThanEqual(p, b.box.high + 1e-9))) {
      return true;
    }
  }
  return false;
}

}  // namespace

TEST(SurfaceBoxes, HoldTheWholeTorusAndLittleElse) {
  const analytic::TorusField torus(1.0, 0.4);
  const SurfaceBoxes boxes = surface_boxes(torus, {.size = 0.1});
  EXPECT_EQ(boxes.degree, 0);
  std::mt19937 random(3);
  std::uniform_real_distribution<double> angle(0.0, 6.283185307179586);
  for (int i = 0; i < 500; ++i) {
    const double u = angle(random), v = angle(random), r = 1.0 + 0.4 * std::cos(v);
    ASSERT_TRUE(holds(boxes, {r * std::cos(u), r * std::sin(u), 0.4 * std::sin(v)}));
  }
  for (const SurfaceBox& b : boxes.boxes) {
    ASSERT_LE(b.box.size().x, 0.1);
    // No point of a box is farther from the surface than the box's diagonal.
    ASSERT_LE(std::abs(torus.value(b.box.center())), 0.5 * b.box.diagonal() + 1e-9);
  }
  const Box around = bounding_box(boxes);
  EXPECT_LE(glm::length(around.size() - DVec3(2.8, 2.8, 0.8)), 0.4);
}

TEST(SurfaceBoxes, StayLargerRatherThanTooMany) {
  const SurfaceBoxes boxes = surface_boxes(analytic::SphereField(), {.size = 1e-4, .max_boxes = 5000});
  EXPECT_LE(boxes.boxes.size(), 5000u);
  EXPECT_TRUE(holds(boxes, {1.0, 0.0, 0.0}));
}

TEST(SurfaceBoxes, PartsOfASkeletonEqualTheWholeInTheirBoxes) {
  std::vector<SkeletonElement> elements;
  for (int i = 0; i < 20; ++i) {
    const DVec3 a(0.5 * i, std::sin(i), 0.0);
    elements.push_back({a, i % 4 ? a : a + DVec3(0.2), 0.9, 1.0, i % 5 ? 2.0 : 1.0, Potential::metaball});
  }
  const SkeletonField field(elements, 0.3);
  const SurfaceBoxes boxes = surface_boxes(field, {.size = 0.2});
  std::mt19937 random(4);
  std::uniform_real_distribution<double> share(0.0, 1.0);
  std::size_t smaller = 0;
  for (const SurfaceBox& b : boxes.boxes) {
    const DVec3 p = b.box.low + DVec3(share(random), share(random), share(random)) * b.box.size();
    ASSERT_NEAR(b.field->value(p), field.value(p), 1e-14);
    smaller += dynamic_cast<const SkeletonField&>(*b.field).elements().size() < 10;
  }
  EXPECT_EQ(smaller, boxes.boxes.size());
}

TEST(SurfaceBoxes, GridCellsAreThoseTheSplineMayCross) {
  auto grid = std::make_shared<BrickGrid>();
  grid->origin = {1.0, 2.0, 3.0};
  grid->h = 0.5;
  grid->interpolation = Interpolation::linear;
  grid->table_size = IVec3(1);
  grid->table = {0};
  grid->outside = -1.0f;
  grid->brick_coordinate = {IVec3(0)};
  grid->tap.assign(BrickGrid::kTapValues, -1.0f);
  grid->tap[(4 * BrickGrid::kTaps + 5) * BrickGrid::kTaps + 6] = 1.0f;  // voxel (3, 4, 5)
  const auto bounds_of = [&](Interpolation interpolation) {
    grid->interpolation = interpolation;
    return surface_boxes(GridField(grid));
  };
  const SurfaceBoxes linear = bounds_of(Interpolation::linear);
  EXPECT_EQ(linear.degree, 3);
  EXPECT_EQ(linear.boxes.size(), 8u);
  EXPECT_EQ(bounding_box(linear).low, DVec3(1.0, 2.0, 3.0) + 0.5 * DVec3(2, 3, 4));
  EXPECT_EQ(bounding_box(linear).high, DVec3(1.0, 2.0, 3.0) + 0.5 * DVec3(4, 5, 6));
  const SurfaceBoxes cubic = bounds_of(Interpolation::cubic);
  EXPECT_EQ(cubic.degree, 9);
  EXPECT_EQ(cubic.boxes.size(), 64u);
}
