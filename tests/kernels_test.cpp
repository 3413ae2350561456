// Each kernel against the float64 definition, on random and adversarial input, at awkward sizes, with canaries behind
// the buffers. Tolerances are stated where they are used; `kEps` is the rounding unit of float32.
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <random>

#include "core/field/skeleton_field.h"
#include "core/mechanics/project.h"
#include "kernels/opencl_backend.h"

using namespace isoskin;

namespace {

constexpr double kEps = 6e-8;
constexpr float kCanary = -12345.678f;

Backend& device() {
  static const std::unique_ptr<Backend> backend = make_opencl_backend();
  return *backend;
}

std::vector<Vec3> random_points(std::size_t n, double extent, DVec3 center = DVec3(0), unsigned seed = 1) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> uniform(-extent, extent);
  std::vector<Vec3> points(n);
  for (Vec3& p : points) {
    const double x = uniform(random), y = uniform(random), z = uniform(random);
    p = Vec3(center + DVec3(x, y, z));
  }
  return points;
}

std::shared_ptr<const SkeletonField> random_skeleton(std::size_t n, const std::vector<Potential>& potentials,
                                                     const std::vector<double>& norms, double radius, bool segments,
                                                     DVec3 center = DVec3(0)) {
  std::mt19937 random(unsigned(n) * 7 + 1);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  std::vector<SkeletonElement> elements(n);
  for (std::size_t i = 0; i < n; ++i) {
    SkeletonElement& e = elements[i];
    e.a = center + DVec3(uniform(random), uniform(random), uniform(random));
    e.b = segments && i % 2 ? e.a + 0.5 * DVec3(uniform(random), uniform(random), uniform(random)) : e.a;
    e.radius = radius * (1.0 + 0.5 * uniform(random));
    e.weight = i % 5 == 4 ? -0.5 : 1.0;
    e.potential = potentials[i % potentials.size()];
    e.norm = norms[i % norms.size()];
  }
  return std::make_shared<SkeletonField>(std::move(elements), 0.3);
}

/// Values and gradients of the device at `points`, with canaries behind the ends of both.
struct Samples {
  std::vector<float> values;
  std::vector<Vec3> gradients;

  explicit Samples(const std::vector<Vec3>& points) {
    constexpr std::size_t kGuard = 64;
    const std::size_t n = points.size();
    values.assign(n + kGuard, kCanary);
    gradients.assign(n + kGuard, Vec3(kCanary));
    device().evaluate(points, std::span(values).first(n), std::span(gradients).first(n));
    for (std::size_t i = n; i < n + kGuard; ++i) {
      EXPECT_EQ(values[i], kCanary) << "value behind the end, at " << i - n;
      EXPECT_EQ(gradients[i], Vec3(kCanary)) << "gradient behind the end, at " << i - n;
    }
    values.resize(n);
    gradients.resize(n);
  }
};

void expect_near_field(const Field& field, const std::vector<Vec3>& points, double value_scale, double gradient_scale) {
  const Samples got(points);
  std::vector<float> only(points.size());
  device().evaluate(points, only, {});
  std::size_t wrong = 0;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const FieldSample want = field.sample(DVec3(points[i]));
    const double value_error = std::abs(got.values[i] - want.value);
    const double gradient_error = glm::length(DVec3(got.gradients[i]) - want.gradient);
    // Written so that NaN fails.
    const bool good = value_error <= value_scale * (1.0 + std::abs(want.value)) &&
                      gradient_error <= gradient_scale * (1.0 + glm::length(want.gradient)) &&
                      std::abs(only[i] - got.values[i]) <= value_scale * (1.0 + std::abs(want.value));
    if (!good && ++wrong <= 5)
      ADD_FAILURE() << "point " << i << " (" << points[i].x << ' ' << points[i].y << ' ' << points[i].z << ") value "
                    << got.values[i] << " instead of " << want.value << ", alone " << only[i] << ", gradient off by "
                    << gradient_error << " of " << glm::length(want.gradient);
  }
  EXPECT_EQ(wrong, 0u);
}

constexpr std::size_t kSizes[] = {0, 1, 7, 93, 4096, 100003};

}  // namespace

TEST(SkeletonKernel, MatchesTheDefinitionAtEverySize) {
  const auto field = random_skeleton(40, {Potential::metaball, Potential::wyvill}, {2.0}, 0.5, true);
  device().set_field(field);
  // About 40 terms below 1 each, distances of order 1: 1000 roundings are ample for values, slopes grow with 1/R.
  for (const std::size_t n : kSizes) expect_near_field(*field, random_points(n, 1.6), 1e3 * kEps, 4e3 * kEps);
}

TEST(SkeletonKernel, EveryPotentialAndNorm) {
  for (const Potential potential :
       {Potential::inverse_square, Potential::cauchy, Potential::metaball, Potential::blinn, Potential::wyvill})
    for (const double norm : {2.0, 1.0, 1.5, 3.0, 8.0, 0.7}) {
      SCOPED_TRACE(testing::Message() << "potential " << int(potential) << " norm " << norm);
      const auto field = random_skeleton(24, {potential}, {norm}, 0.6, true);
      device().set_field(field);
      // Near the coordinate planes of an element a norm below 2 bends without bound: rounding of |x_i| counts there.
      const double steep = norm < 2.0 ? 50.0 : 1.0;
      expect_near_field(*field, random_points(2000, 1.5), 4e3 * kEps, steep * 2e4 * kEps);
    }
}

TEST(SkeletonKernel, HessiansMatch) {
  for (const double norm : {2.0, 3.0}) {
    const auto field = random_skeleton(
        24, {Potential::inverse_square, Potential::cauchy, Potential::metaball, Potential::blinn, Potential::wyvill},
        {norm}, 0.6, true);
    device().set_field(field);
    const std::vector<Vec3> points = random_points(4099, 1.5);
    std::vector<float> got(6 * points.size() + 64, kCanary);
    device().evaluate_hessian(points, std::span(got).first(6 * points.size()));
    EXPECT_EQ(std::count(got.end() - 64, got.end(), kCanary), 64);
    for (std::size_t i = 0; i < points.size(); ++i) {
      const DMat3 want = field->hessian(DVec3(points[i]));
      const double packed[6] = {want[0][0], want[1][1], want[2][2], want[1][0], want[2][0], want[2][1]};
      double size = 1.0;
      for (const double w : packed) size = std::max(size, std::abs(w));
      // Second derivatives of inverse squares change by d^-1 of themselves over a rounding of the position.
      for (int k = 0; k < 6; ++k) ASSERT_NEAR(got[6 * i + k], packed[k], 1e5 * kEps * size) << i << ' ' << k;
    }
  }
}

TEST(SkeletonKernel, FarFromTheOriginLosesNothing) {
  const DVec3 center(3e4, -5e4, 1e5);
  const auto field = random_skeleton(40, {Potential::metaball}, {2.0}, 0.5, true, center);
  device().set_field(field);
  expect_near_field(*field, random_points(4096, 1.2, center), 1e3 * kEps, 4e3 * kEps);
}

TEST(SkeletonKernel, AdversarialPoints) {
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN(), kInf = std::numeric_limits<float>::infinity();
  std::vector<SkeletonElement> elements(3);
  elements[0].potential = Potential::inverse_square;
  elements[1] = {DVec3(2, 0, 0), DVec3(3, 0, 0), 0.5, 1.0, 3.0, Potential::metaball};
  elements[2] = {DVec3(0, 2, 0), DVec3(0, 2, 0), 0.5, 1.0, 2.0, Potential::blinn};
  const auto field = std::make_shared<SkeletonField>(elements, 0.5);
  device().set_field(field);
  const std::vector<Vec3> points = {{kNan, 0, 0},  {0, kInf, 0}, {0, 0, 0}, {1e-30f, 0, 0},    {1e18f, 0, 0},
                                    {3e38f, 0, 0}, {2.5f, 0, 0}, {0, 2, 0}, {-0.0f, 0, -0.0f}, {1e-5f, 1e-5f, 0}};
  const Samples got(points);
  for (const std::size_t bad : {0, 1}) {
    EXPECT_TRUE(std::isnan(got.values[bad]));
    EXPECT_EQ(got.gradients[bad], Vec3(0));
  }
  for (std::size_t i = 2; i < points.size(); ++i) {
    const FieldSample want = field->sample(DVec3(points[i]));
    // The last point lies 1e-5 from a singular element: positions are good to 1e-7 of the skeleton's size there.
    const double tolerance = i + 1 == points.size() ? 0.1 : 1e-5;
    EXPECT_NEAR(got.values[i], want.value, tolerance * (1 + std::abs(want.value))) << i;
    EXPECT_LE(glm::length(DVec3(got.gradients[i]) - want.gradient), tolerance * (1 + glm::length(want.gradient))) << i;
  }
}

TEST(SkeletonKernel, NoElementsIsMinusIso) {
  device().set_field(std::make_shared<SkeletonField>(std::vector<SkeletonElement>{}, 0.25));
  for (const float v : Samples(random_points(100, 10)).values) EXPECT_EQ(v, -0.25f);
}

TEST(SkeletonKernel, ManyElementsThroughCells) {
  const auto field =
      random_skeleton(3000, {Potential::metaball, Potential::wyvill, Potential::cauchy}, {2.0, 4.0}, 0.1, true);
  device().set_field(field);
  // A thousand Cauchy terms reach every point: their sum is of order 100.
  expect_near_field(*field, random_points(4096, 1.3), 1e3 * kEps, 1e4 * kEps);
}

TEST(ProjectKernel, ConvergedPointsAreOnTheSurfaceAndTheOthersKeepTheirBits) {
  const auto field = random_skeleton(40, {Potential::metaball, Potential::wyvill, Potential::blinn}, {2.0}, 0.5, true);
  device().set_field(field);
  ProjectOptions options;
  options.max_step = 0.1f;
  for (const std::size_t n : kSizes) {
    std::vector<Vec3> points = random_points(n, 1.4);
    if (n > 50) points[3] = Vec3(std::nanf("")), points[40] = Vec3(1e30f), points[41].y = INFINITY;
    const std::vector<Vec3> before = points;
    points.resize(n + 64, Vec3(kCanary));
    std::vector<ProjectStatus> status(n + 64, ProjectStatus(77));
    const ProjectReport report = device().project(std::span(points).first(n), options, std::span(status).first(n));
    EXPECT_EQ(report.points, n);
    EXPECT_EQ(std::count(points.end() - 64, points.end(), Vec3(kCanary)), 64);
    EXPECT_EQ(std::count(status.end() - 64, status.end(), ProjectStatus(77)), 64);
    std::size_t failed = 0, disagree = 0;
    for (std::size_t i = 0; i < n; ++i) {
      const Projection want = project_point(*field, DVec3(before[i]), options);
      disagree += want.status != status[i];
      failed += status[i] != ProjectStatus::converged;
      if (status[i] != ProjectStatus::converged) {
        EXPECT_EQ(std::memcmp(&points[i], &before[i], sizeof(Vec3)), 0) << i;
        continue;
      }
      ASSERT_TRUE(std::isfinite(points[i].x + points[i].y + points[i].z));
      const FieldSample f = field->sample(DVec3(points[i]));
      // The tolerance, or the rounding of values near 1 where that is more; where a bracket ended the gradient may
      // have turned: twice the tolerance.
      EXPECT_LE(std::abs(f.value), 2.0 * options.tolerance * glm::length(f.gradient) + 100 * kEps) << i;
    }
    EXPECT_EQ(report.quasi_critical, failed);
    // Paths that skirt a critical point may end differently for a rounding.
    EXPECT_LE(disagree, n / 200 + 1);
  }
}

TEST(ProjectKernel, NearTheSurfaceItFindsTheSamePoint) {
  const auto field = random_skeleton(40, {Potential::metaball, Potential::blinn}, {2.0}, 0.5, true);
  device().set_field(field);
  ProjectOptions options;
  options.max_step = 0.05f;
  std::vector<Vec3> start = random_points(20000, 1.2);
  device().project(start, options, {});
  for (std::size_t i = 0; i < start.size(); ++i) start[i] += Vec3(1e-2f * float(i % 3), -1e-2f * float(i % 2), 5e-3f);
  std::vector<Vec3> points = start;
  std::vector<ProjectStatus> status(points.size());
  device().project(points, options, status);
  std::size_t apart = 0, compared = 0;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Projection want = project_point(*field, DVec3(start[i]), options);
    if (want.status != ProjectStatus::converged || status[i] != ProjectStatus::converged) continue;
    ++compared;
    // Both stop within the tolerance of the surface, on the same path.
    apart += glm::length(DVec3(points[i]) - want.point) > 3.0 * options.tolerance;
  }
  EXPECT_GT(compared, points.size() / 2);
  EXPECT_LE(apart, compared / 500);
}
