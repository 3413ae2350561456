// Each kernel against the float64 definition, on random and adversarial input, at awkward sizes, with canaries behind
// the buffers. Tolerances are stated where they are used; `kEps` is the rounding unit of float32.
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <random>

#include "core/field/grid_field.h"
#include "core/field/skeleton_field.h"
#include "core/mechanics/element.h"
#include "core/mechanics/project.h"
#include "kernels/element.h"
#include "kernels/opencl_backend.h"
#include "tests/test_meshes.h"

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
                                                     DVec3 center = DVec3(0), bool solids = false) {
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
    if (!solids || i % 3 == 0) continue;
    const DVec3 u(uniform(random), uniform(random), uniform(random)),
        v(uniform(random), uniform(random), uniform(random));
    e.shape = i % 3 == 1 ? Shape::triangle : Shape::box;
    e.b = e.a + 0.4 * u;
    e.c = e.a + 0.4 * (i % 3 == 1 ? v : glm::cross(u, v));
    e.d = e.a + 0.2 * glm::cross(u, glm::cross(u, v));
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

TEST(SkeletonKernel, TrianglesAndBoxes) {
  for (const double norm : {4.0, 1.0}) {
    SCOPED_TRACE(norm);
    const auto field = random_skeleton(
        30, {Potential::inverse_square, Potential::cauchy, Potential::metaball, Potential::blinn, Potential::wyvill},
        {2.0, norm}, 0.5, true, DVec3(0), true);
    device().set_field(field);
    const double steep = norm < 2.0 ? 50.0 : 1.0;
    for (const std::size_t n : {7, 93, 4099})
      expect_near_field(*field, random_points(n, 1.6), 4e3 * kEps, steep * 2e4 * kEps);
  }
  const auto many = random_skeleton(1000, {Potential::metaball}, {2.0, 3.0}, 0.1, true, DVec3(0), true);
  device().set_field(many);  // through lists of cells
  expect_near_field(*many, random_points(4096, 1.3), 1e3 * kEps, 1e4 * kEps);
}

TEST(SkeletonKernel, HessiansMatch) {
  for (const auto& [norm, solids] : {std::pair(2.0, false), {3.0, false}, {3.0, true}}) {
    const auto field = random_skeleton(
        24, {Potential::inverse_square, Potential::cauchy, Potential::metaball, Potential::blinn, Potential::wyvill},
        solids ? std::vector{norm, 2.0} : std::vector{norm}, 0.6, true, DVec3(0), solids);
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

namespace {

/// A table of 3 x 4 x 2 blocks, some constant, the others with random taps: no relation between bricks, so a tap taken
/// from the wrong one shows.
std::shared_ptr<const GridField> random_grid(Interpolation interpolation, DVec3 origin, double h) {
  auto grid = std::make_shared<BrickGrid>();
  grid->origin = origin;
  grid->h = h;
  grid->interpolation = interpolation;
  grid->table_low = IVec3(-1, -2, 0);
  grid->table_size = IVec3(3, 4, 2);
  grid->outside = -0.75f;
  grid->constant = {-0.75f, 0.5f};
  std::mt19937 random(3);
  std::uniform_real_distribution<float> uniform(-1.0f, 1.0f);
  for (int i = 0; i < 24; ++i) {
    if (i % 5 == 3) {
      grid->table.push_back(i % 2 ? -1 : -2);
      continue;
    }
    grid->table.push_back(std::int32_t(grid->brick_coordinate.size()));
    grid->brick_coordinate.push_back(grid->table_low + IVec3(i / 8, i / 2 % 4, i % 2));
    for (int k = 0; k < BrickGrid::kTapValues; ++k) grid->tap.push_back(uniform(random));
  }
  return std::make_shared<GridField>(grid);
}

/// Points about the grid, none within `margin` voxels of a voxel plane: there float32 may land in the next cell, and
/// random taps (unlike a real grid's) jump between bricks.
std::vector<Vec3> points_in_cells(const BrickGrid& grid, std::size_t n, double margin) {
  std::mt19937 random(unsigned(n) + 5);
  std::uniform_real_distribution<double> uniform(0.0, 1.0);
  std::vector<Vec3> points(n);
  for (Vec3& p : points) {
    DVec3 u;
    for (int k = 0; k < 3; ++k) {
      const double cell = std::floor((grid.table_low[k] - 0.5 + uniform(random) * (grid.table_size[k] + 1)) * 8);
      u[k] = cell + margin + (1.0 - 2.0 * margin) * uniform(random);
    }
    p = Vec3(grid.origin + grid.h * u);
  }
  return points;
}

}  // namespace

TEST(GridKernel, MatchesTheDefinitionAtEverySize) {
  for (const Interpolation interpolation : {Interpolation::linear, Interpolation::cubic}) {
    const auto field = random_grid(interpolation, DVec3(0.3, -0.2, 0.1), 0.125);
    device().set_field(field);
    // Positions in voxels are good to 30 voxels * 2 roundings, values change by up to 2 a voxel, slopes by 8 / h.
    for (const std::size_t n : kSizes)
      expect_near_field(*field, points_in_cells(*field->grid(), n, 1e-3), 300 * kEps, 3000 * kEps / 0.125);
  }
}

TEST(GridKernel, HessiansMatch) {
  for (const Interpolation interpolation : {Interpolation::linear, Interpolation::cubic}) {
    const auto field = random_grid(interpolation, DVec3(0), 0.5);
    device().set_field(field);
    const std::vector<Vec3> points = points_in_cells(*field->grid(), 4099, 1e-3);
    std::vector<float> got(6 * points.size());
    device().evaluate_hessian(points, got);
    for (std::size_t i = 0; i < points.size(); ++i) {
      const DMat3 want = field->hessian(DVec3(points[i]));
      const double packed[6] = {want[0][0], want[1][1], want[2][2], want[1][0], want[2][0], want[2][1]};
      for (int k = 0; k < 6; ++k) ASSERT_NEAR(got[6 * i + k], packed[k], 1e4 * kEps) << i << ' ' << k;
    }
  }
}

TEST(GridKernel, FarFromTheOriginLosesNothing) {
  const auto field = random_grid(Interpolation::cubic, DVec3(3e3, -5e3, 1e4), 0.5);
  device().set_field(field);
  // Points are float32 at 1e4, an ulp is 2e-3 voxels: the margin keeps them in their cells.
  expect_near_field(*field, points_in_cells(*field->grid(), 4096, 1e-2), 300 * kEps, 6000 * kEps);
}

TEST(GridKernel, EdgesOfTheTableAndPointsThatAreNone) {
  const auto field = random_grid(Interpolation::cubic, DVec3(0), 1.0);
  device().set_field(field);
  // The table covers -8..16, -16..16, 0..16.
  const std::vector<Vec3> points = {{-8, -16, 0},         {16, 0, 8},     {-8.0001f, 0, 8}, {0, 0, 15.9999f},
                                    {1e30f, 0, 0},        {-1e30f, 1, 1}, {INFINITY, 0, 0}, {NAN, NAN, NAN},
                                    {2147483648.f, 1, 1}, {1, -3e9f, 1}};
  const Samples got(points);
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (!std::isfinite(points[i].x)) {
      EXPECT_TRUE(std::isnan(got.values[i]));
      EXPECT_EQ(got.gradients[i], Vec3(0));
      continue;
    }
    const FieldSample want = field->sample(DVec3(points[i]));
    EXPECT_NEAR(got.values[i], want.value, 1e-4) << i;
    EXPECT_LE(glm::length(DVec3(got.gradients[i]) - want.gradient), 1e-3) << i;
  }
}

namespace {

struct Soup {  // unconnected triangles as a resident mesh
  opencl::Device device{OpenClOptions{}};
  opencl::ResidentMesh mesh{device};
  opencl::Array<Vec3> normals{device};
  opencl::Array<std::uint8_t> inverted{device};
  std::vector<Vec3> points, outward;
  std::vector<std::uint8_t> flipped;
  std::vector<Index> vertex;

  explicit Soup(std::vector<Vec3> corners) : points(std::move(corners)) {
    std::mt19937 random(9);
    std::uniform_real_distribution<float> uniform(-1.0f, 1.0f);
    for (std::size_t i = 0; i < points.size(); ++i) {
      const float x = uniform(random), y = uniform(random), z = uniform(random);
      outward.push_back(glm::normalize(Vec3(x, y, z)));
      vertex.push_back(Index(i));
    }
    for (std::size_t t = 0; t < points.size() / 3; ++t) flipped.push_back(t % 4 == 1);
    mesh.positions.assign(points);
    mesh.vertex.assign(vertex);
    normals.assign(outward);
    inverted.assign(flipped);
  }

  Corners corners(std::size_t t, const std::vector<Vec3>& of) const {
    return {DVec3(of[3 * t]), DVec3(of[3 * t + 1]), DVec3(of[3 * t + 2])};
  }
  ElementFrame frame(std::size_t t) const {
    return element_frame(corners(t, points), flipped[t] != 0,
                         DVec3(outward[3 * t]) + DVec3(outward[3 * t + 1]) + DVec3(outward[3 * t + 2]));
  }
  std::vector<Vec3> slots(const opencl::Elements& elements) const {
    std::vector<float> raw(elements.slots().size());
    const_cast<opencl::Array<float>&>(elements.slots()).read(raw);
    std::vector<Vec3> result;
    for (std::size_t i = 0; i + 2 < raw.size(); i += 3) result.emplace_back(raw[i], raw[i + 1], raw[i + 2]);
    return result;
  }
};

void compare_elements(std::vector<Vec3> corners, Mechanics mechanics, std::size_t most_wrong) {
  Soup soup(std::move(corners));
  const std::size_t triangles = soup.flipped.size();
  RelaxOptions options;
  options.mechanics = mechanics;
  options.edge_length = 0.8f;
  const ElementMaterial material{options.edge_length, options.young, options.poisson, options.spring};
  const std::vector<Vec3> d = random_points(3 * triangles, 0.5, DVec3(0), 77);
  opencl::Array<Vec3> displacement(soup.device);
  displacement.assign(d);
  opencl::Array<int> done(soup.device);
  done.assign(std::vector<int>{0});

  opencl::Elements elements(soup.device);
  elements.forces(soup.mesh, soup.normals, soup.inverted, options);
  const std::vector<Vec3> forces = soup.slots(elements);
  elements.product(soup.mesh, displacement, done, options);
  const std::vector<Vec3> products = soup.slots(elements);

  std::size_t wrong = 0;
  for (std::size_t t = 0; t < triangles; ++t) {
    const Corners p = soup.corners(t, soup.points), dx = soup.corners(t, d);
    const bool fem = mechanics == Mechanics::fem;
    const Corners f = fem ? element_forces(soup.frame(t), p, material) : spring_forces(p, material);
    const Corners k =
        fem ? element_stiffness_times(soup.frame(t), dx, material) : spring_stiffness_times(p, dx, material);
    bool good = true;
    for (int c = 0; c < 3; ++c) {
      // Forces are of order E times the deformation, in edges of order 1; a frame is good to 1e3 roundings.
      good = good && glm::length(DVec3(forces[3 * t + c]) + f[c]) <= 1e3 * kEps * (1000.0 + glm::length(f[c]));
      good = good && glm::length(DVec3(products[3 * t + c]) - k[c]) <= 1e3 * kEps * (1000.0 + glm::length(k[c]));
    }
    if (!good && ++wrong <= 3)
      ADD_FAILURE_AT(__FILE__, __LINE__) << "triangle " << t << " of " << triangles << ": force off by "
                                         << glm::length(DVec3(forces[3 * t]) + f[0]) << ", product by "
                                         << glm::length(DVec3(products[3 * t]) - k[0]);
  }
  EXPECT_LE(wrong, most_wrong);
}

}  // namespace

TEST(ElementKernel, RandomTrianglesMatchAtEverySize) {
  for (const Mechanics mechanics : {Mechanics::fem, Mechanics::springs})
    for (const std::size_t n : kSizes) compare_elements(random_points(3 * n, 1.0), mechanics, 0);
}

TEST(ElementKernel, DegenerateTriangles) {
  const std::vector<Vec3> corners = {
      {1, 2, 3}, {1, 2, 3},      {1, 2, 3},         // a point
      {0, 0, 0}, {1, 0, 0},      {1, 0, 0},         // an edge of no length
      {0, 0, 0}, {1, 0, 0},      {2, 0, 0},         // a line
      {0, 0, 0}, {4, 4, 4},      {1, 1, 1},         // the same, corners in another order
      {0, 0, 0}, {1, 0, 0},      {0.5f, 1e-9f, 0},  // flatter than float32 tells
      {0, 0, 0}, {1e-12f, 0, 0}, {0, 1e-12f, 0},    // tiny
      {0, 0, 0}, {1e3f, 0, 0},   {0, 1e3f, 0},      // huge
      {0, 0, 0}, {2, 0, 0},      {1, 0.25f, 0},     // flat, and one seen from behind (every fourth)
      {0, 0, 0}, {2, 0, 0},      {1, 0.25f, 0},    {0, 0, 0}, {2, 0, 0}, {1, 0.25f, 0}};
  for (const Mechanics mechanics : {Mechanics::fem, Mechanics::springs}) compare_elements(corners, mechanics, 0);
}

TEST(ElementKernel, DoneStopsTheProduct) {
  Soup soup(random_points(300, 1.0));
  opencl::Elements elements(soup.device);
  const RelaxOptions options;
  elements.forces(soup.mesh, soup.normals, soup.inverted, options);
  const std::vector<Vec3> before = soup.slots(elements);
  opencl::Array<int> done(soup.device);
  done.assign(std::vector<int>{1});
  elements.product(soup.mesh, soup.normals, done, options);
  EXPECT_EQ(soup.slots(elements), before);
}

// Small enough for oclgrind, which interprets: every kernel once, at a size that leaves a tail (tests/CMakeLists.txt).
TEST(SmallForOclgrind, EveryKernel) {
  const auto backend = make_opencl_backend();
  TriangleMesh mesh = test_meshes::icosphere(1);
  const std::shared_ptr<const Field> fields[] = {
      random_skeleton(12, {Potential::metaball, Potential::cauchy, Potential::wyvill}, {2.0, 3.0}, 1.0, true),
      random_grid(Interpolation::cubic, DVec3(0.1), 0.1), random_grid(Interpolation::linear, DVec3(0.1), 0.1)};
  for (const auto& field : fields) {
    backend->set_field(field);
    std::vector<Vec3> points = random_points(21, 1.0), gradients(21);
    std::vector<float> values(21), hessians(6 * 21);
    backend->evaluate(points, values, gradients);
    backend->evaluate(points, values, {});
    backend->evaluate_hessian(points, hessians);
    backend->project(points, {}, {});
    backend->set_mesh(mesh);
    RelaxOptions relax;
    relax.edge_length = 0.6f;
    relax.cg_iterations = 2;
    relax.steps = 1;
    relax.sharp = true;
    relax.sharp_pulls = 1;
    for (const Mechanics mechanics : {Mechanics::fem, Mechanics::springs}) {
      relax.mechanics = mechanics;
      EXPECT_EQ(backend->relax(relax, {}).steps, 1);
    }
    std::vector<Vec3> normals(mesh.vertex_count());
    std::vector<std::uint8_t> inverted(mesh.triangle_count());
    backend->vertex_normals(normals);
    backend->inverted_triangles(inverted);
    for (const Vec3& p : backend->positions()) EXPECT_TRUE(std::isfinite(p.x + p.y + p.z));
  }
}

namespace {

/// A linear grid of a signed square root of the distance to a sphere: no slope is right for long.
std::shared_ptr<const GridField> steep_grid() {
  auto grid = std::make_shared<BrickGrid>();
  grid->origin = DVec3(-2.0);
  grid->h = 0.125;
  grid->interpolation = Interpolation::linear;
  grid->table_size = IVec3(4);
  grid->outside = -1.0f;
  for (int i = 0; i < 64; ++i) {
    const IVec3 brick(i / 16, i / 4 % 4, i % 4);
    grid->table.push_back(i);
    grid->brick_coordinate.push_back(brick);
    for (int k = 0; k < BrickGrid::kTapValues; ++k) {
      const IVec3 voxel = 8 * brick + IVec3(k / 121, k / 11 % 11, k % 11) - 1;
      const double d = 0.83 - glm::length(grid->origin + grid->h * DVec3(voxel));
      grid->tap.push_back(float(std::copysign(std::sqrt(std::abs(d)), d)));
    }
  }
  return std::make_shared<GridField>(grid);
}

}  // namespace

TEST(ProjectKernel, BracketsOfBentFieldsCloseAsOftenAsTheDefinitionSays) {
  // Steep near the skeleton, flat far away: false position alone keeps one end of the bracket. With 10 evaluations the
  // halvings decide who converges.
  const auto steep = random_skeleton(6, {Potential::inverse_square}, {2.0}, 0.3, false);
  const auto kinked = steep_grid();
  for (const std::shared_ptr<const Field>& field :
       {std::shared_ptr<const Field>(steep), std::shared_ptr<const Field>(kinked)}) {
    device().set_field(field);
    ProjectOptions options;
    options.tolerance = 1e-5f;
    options.max_step = 2.0f;
    options.max_bisection = 10;
    const std::vector<Vec3> start = random_points(20000, 1.5);
    std::vector<Vec3> points = start;
    std::vector<ProjectStatus> status(points.size());
    device().project(points, options, status);
    std::size_t want = 0, got = 0, disagree = 0;
    for (std::size_t i = 0; i < start.size(); ++i) {
      const ProjectStatus oracle = project_point(*field, DVec3(start[i]), options).status;
      want += oracle == ProjectStatus::converged;
      got += status[i] == ProjectStatus::converged;
      disagree += oracle != status[i];
    }
    EXPECT_GT(want, start.size() / 20);
    EXPECT_NEAR(double(got), double(want), 0.02 * double(start.size()));
    // Where the last evaluation lands on the tolerance, rounding decides.
    EXPECT_LE(disagree, start.size() / 25) << want << " of " << start.size();
  }
}
