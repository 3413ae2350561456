// One suite for every backend: what core/backend.h promises, at odd sizes and on adversarial points.
#include "core/backend.h"

#include <cmath>
#include <cstring>
#include <functional>
#include <limits>
#include <random>

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include "core/field/grid_field.h"
#include "core/field/skeleton_field.h"
#include "kernels/opencl_backend.h"
#include "tests/test_meshes.h"

using namespace isoskin;

namespace {

struct BackendCase {
  std::string name;
  std::function<std::unique_ptr<Backend>()> make;
};
void PrintTo(const BackendCase& c, std::ostream* out) {
  *out << c.name;
}

std::vector<BackendCase> backends() {
  return {{"reference", make_reference_backend}, {"opencl", [] { return make_opencl_backend(); }}};
}

constexpr double kEps = 1.0 / (1 << 24);  // half a unit in the last place of a float32 near 1
constexpr std::size_t kSizes[] = {0, 1, 7, 93, 4096, 100003};
constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
constexpr float kInf = std::numeric_limits<float>::infinity();

SkeletonElement element(DVec3 a, DVec3 b, double radius, double weight, double norm, Potential potential) {
  return {a, b, radius, weight, norm, potential};
}

std::shared_ptr<const Field> grid_ball(Interpolation interpolation) {
  auto grid = std::make_shared<BrickGrid>();
  grid->h = 0.2;
  grid->interpolation = interpolation;
  grid->table_low = IVec3(-1);
  grid->table_size = IVec3(2);
  grid->constant = {-5.0f};
  grid->outside = -5.0f;
  for (int b = 0; b < 8; ++b) {
    const IVec3 brick(b / 4 - 1, b / 2 % 2 - 1, b % 2 - 1);
    grid->table.push_back(b);
    grid->brick_coordinate.push_back(brick);
    for (int x = 0; x < BrickGrid::kTaps; ++x)
      for (int y = 0; y < BrickGrid::kTaps; ++y)
        for (int z = 0; z < BrickGrid::kTaps; ++z) {
          const DVec3 p = 0.2 * DVec3(8 * brick + IVec3(x, y, z) - 1);
          grid->tap.push_back(float(1.0 - glm::length(p) + 0.1 * std::sin(5.0 * p.x) * std::cos(4.0 * p.y)));
        }
  }
  return std::make_shared<GridField>(grid);
}

struct FieldCase {
  const char* name;
  std::shared_ptr<const Field> field;
  std::vector<DVec3> singular;  // where values may be anything finite
};

const std::vector<FieldCase>& fields() {
  using enum Potential;
  static const std::vector<FieldCase> cases = [] {
    const DVec3 a(-0.6, 0, 0), b(0.7, 0.1, 0.2), c(0, 0.8, -0.3);
    const auto skeleton = [](std::vector<SkeletonElement> e, double iso) {
      return std::make_shared<SkeletonField>(std::move(e), iso);
    };
    return std::vector<FieldCase>{
        {"metaballs",
         skeleton({element(a, a, 1.2, 1, 2, metaball), element(b, b, 1.1, 1, 2, metaball),
                   element(c, c, 0.9, -0.4, 2, metaball)},
                  0.3),
         {}},
        {"segments",
         skeleton({element(a, b, 1.0, 1, 2, wyvill), element(b, c, 0.8, 1, 2, cauchy), element(c, c, 0.5, 1, 2, blinn)},
                  0.9),
         {}},
        {"inverse squares",
         skeleton({element(a, a, 0.5, 1, 2, inverse_square), element(b, c, 0.4, 1, 2, inverse_square)}, 1.0),
         {a, b, c, 0.5 * (b + c)}},
        {"four norm", skeleton({element(a, b, 1.0, 1, 4, metaball)}, 0.4), {}},
        {"triangle and box",
         skeleton({{a, b, 1.1, 1, 2, metaball, Shape::triangle, c},
                   {DVec3(0, -0.5, 0), DVec3(0.4, -0.2, 0), 0.9, 1, 2, wyvill, Shape::box, DVec3(-0.3, -0.1, 0),
                    DVec3(0, -0.5, 0.4)}},
                  0.5),
         {}},
        {"cubic grid", grid_ball(Interpolation::cubic), {}},
        {"linear grid", grid_ball(Interpolation::linear), {}},
    };
  }();
  return cases;
}

std::vector<Vec3> random_points(std::size_t count, unsigned seed, float half = 1.8f) {
  std::mt19937 rng(seed);
  std::uniform_real_distribution<float> u(-half, half);
  std::vector<Vec3> points(count);
  for (Vec3& p : points) {
    const float x = u(rng), y = u(rng), z = u(rng);
    p = {x, y, z};
  }
  return points;
}

bool same_bits(const Vec3& a, const Vec3& b) {
  return std::memcmp(&a, &b, sizeof a) == 0;
}
bool is_finite(const Vec3& p) {
  return std::isfinite(p.x) && std::isfinite(p.y) && std::isfinite(p.z);
}

double distance_to_singular(const FieldCase& f, const DVec3& p) {
  double least = 1e30;
  for (const DVec3& s : f.singular) least = std::min(least, glm::length(p - s));
  if (f.singular.size() == 4) {  // the segment between the second and third
    const DVec3 ab = f.singular[2] - f.singular[1];
    const double t = std::clamp(glm::dot(p - f.singular[1], ab) / glm::dot(ab, ab), 0.0, 1.0);
    least = std::min(least, glm::length(p - f.singular[1] - t * ab));
  }
  return least;
}

/// How far a float32 evaluation may be off: rounding of the terms, plus what a rounded position does to the field.
struct Slack {
  double value = 0.0, gradient = 0.0;
};
Slack slack(const Field& field, const DVec3& p, const FieldSample& at) {
  Slack s{64 * kEps * (1.0 + std::abs(at.value)), 256 * kEps * (1.0 + glm::length(at.gradient))};
  const double step = 8 * kEps * (1.0 + glm::length(p));
  for (int k = 0; k < 6; ++k) {
    DVec3 q = p;
    q[k / 2] += k % 2 ? step : -step;
    const FieldSample near = field.sample(q);
    s.value = std::max(s.value, 2 * std::abs(near.value - at.value) + 64 * kEps * (1.0 + std::abs(at.value)));
    s.gradient = std::max(s.gradient,
                          2 * glm::length(near.gradient - at.gradient) + 256 * kEps * (1.0 + glm::length(at.gradient)));
  }
  return s;
}

/// F has a zero no farther than `d`: by its slope, or because its sign changes that near.
bool surface_within(const Field& field, const DVec3& p, double d) {
  const FieldSample s = field.sample(p);
  if (std::abs(s.value) <= d * glm::length(s.gradient)) return true;
  for (int k = 0; k < 6; ++k) {
    DVec3 q = p;
    q[k / 2] += k % 2 ? d : -d;
    if ((field.value(q) > 0.0) != (s.value > 0.0)) return true;
  }
  return false;
}

TriangleMesh skin_around(const Field& field, TriangleMesh mesh, const ProjectOptions& options, unsigned seed) {
  test_meshes::jitter(mesh, 0.03f, seed);
  for (Vec3& p : mesh.vertices.position) {
    const Projection r = project_point(field, DVec3(p), options);
    if (r.status == ProjectStatus::converged) p = Vec3(r.point);
  }
  return mesh;
}

class EveryBackend : public testing::TestWithParam<BackendCase> {
protected:
  std::unique_ptr<Backend> backend = GetParam().make();
  const ProjectOptions project{1e-4f, 0.1f, 32, 24};
};

}  // namespace

TEST_P(EveryBackend, EvaluatesValuesAndGradients) {
  EXPECT_FALSE(backend->name().empty());
  for (const FieldCase& f : fields()) {
    backend->set_field(f.field);
    for (const std::size_t count : kSizes) {
      const std::vector<Vec3> points = random_points(count, 11 + unsigned(count));
      std::vector<float> values(count, kNan), only(count, kNan);
      std::vector<Vec3> gradients(count, Vec3(kNan));
      backend->evaluate(points, values, gradients);
      backend->evaluate(points, only, {});
      const std::size_t stride = count > 5000 ? 29 : 1;
      for (std::size_t i = 0; i < count; i += stride) {
        const DVec3 p(points[i]);
        ASSERT_TRUE(std::isfinite(values[i]) && is_finite(gradients[i])) << f.name << " point " << i;
        if (distance_to_singular(f, p) < 0.02) continue;
        const FieldSample s = f.field->sample(p);
        const Slack allowed = slack(*f.field, p, s);
        ASSERT_NEAR(values[i], s.value, allowed.value) << f.name << " point " << i;
        ASSERT_NEAR(only[i], s.value, allowed.value) << f.name << " point " << i;
        ASSERT_LE(glm::length(DVec3(gradients[i]) - s.gradient), allowed.gradient) << f.name << " point " << i;
      }
    }
  }
}

TEST_P(EveryBackend, EvaluatesHessians) {
  for (const FieldCase& f : fields()) {
    if (!f.field->is_c2()) continue;
    backend->set_field(f.field);
    for (const std::size_t count : {std::size_t{0}, std::size_t{1}, std::size_t{93}, std::size_t{4096}}) {
      const std::vector<Vec3> points = random_points(count, 5, 1.5f);  // not where a grid ends
      std::vector<float> h(6 * count, kNan);
      backend->evaluate_hessian(points, h);
      for (std::size_t i = 0; i < count; ++i) {
        const DVec3 p(points[i]);
        if (distance_to_singular(f, p) < 0.05) continue;
        double step = 1e-4, scale = 1.0;
        DMat3 oracle(0.0);
        for (int axis = 0; axis < 3; ++axis) {  // central differences of the gradient
          DVec3 d(0.0);
          d[axis] = step;
          oracle[axis] = (f.field->sample(p + d).gradient - f.field->sample(p - d).gradient) / (2 * step);
          scale += glm::length(oracle[axis]);
        }
        const double packed[6] = {oracle[0][0], oracle[1][1], oracle[2][2], oracle[1][0], oracle[2][0], oracle[2][1]};
        for (int k = 0; k < 6; ++k) ASSERT_NEAR(h[6 * i + k], packed[k], 3e-3 * scale) << f.name << " point " << i;
      }
    }
  }
}

TEST_P(EveryBackend, AdversarialPointsHarmNobody) {
  for (const FieldCase& f : fields()) {
    backend->set_field(f.field);
    std::vector<Vec3> points = {
        {kNan, 0, 0},    {0, kNan, 0},         {0, 0, kNan},           {kInf, 0, 0},  {0, -kInf, 0},
        {kNan, kInf, 1}, {1e30f, 0, 0},        {-3e38f, 3e38f, 3e38f}, {0, 0, 0},     {0, 1e9f, -1e9f},
        {1e-40f, 0, 0},  {-1e-30f, 1e-38f, 0}, {2147483648.0f, 1, 1},  {-1e15f, 0, 1}};
    for (const DVec3& s : f.singular) points.push_back(Vec3(s));
    for (const DVec3& s : f.singular) points.push_back(Vec3(s) + Vec3(1e-7f, 0, 0));
    const std::vector<Vec3> good = random_points(93, 6);
    points.insert(points.end(), good.begin(), good.end());
    std::vector<float> values(points.size());
    std::vector<Vec3> gradients(points.size());
    backend->evaluate(points, values, gradients);
    for (std::size_t i = 0; i < points.size(); ++i) {
      EXPECT_EQ(std::isnan(values[i]), !is_finite(points[i])) << f.name << " point " << i;
      EXPECT_FALSE(std::isinf(values[i])) << f.name << " point " << i;
      EXPECT_TRUE(is_finite(gradients[i])) << f.name << " point " << i;
    }
    std::vector<Vec3> moved = points;
    std::vector<ProjectStatus> status(points.size());
    const ProjectReport report = backend->project(moved, project, status);
    EXPECT_EQ(report.points, points.size());
    std::size_t failed = 0;
    for (std::size_t i = 0; i < points.size(); ++i) {
      failed += status[i] == ProjectStatus::quasi_critical;
      if (i < 8) {
        EXPECT_EQ(status[i], ProjectStatus::quasi_critical) << f.name << " point " << i;
      }
      if (status[i] == ProjectStatus::quasi_critical) {
        EXPECT_TRUE(same_bits(moved[i], points[i])) << f.name << " point " << i;
      } else {
        EXPECT_TRUE(is_finite(moved[i])) << f.name << " point " << i;
      }
    }
    EXPECT_EQ(report.quasi_critical, failed);
    std::vector<float> h(6 * points.size(), kNan);
    backend->evaluate_hessian(points, h);
    for (std::size_t i = 0; i < 6 * points.size(); ++i)
      EXPECT_TRUE(std::isfinite(h[i])) << f.name << " point " << i / 6;
  }
}

TEST_P(EveryBackend, ProjectsOntoTheSurfaceOrLeavesAlone) {
  const std::unique_ptr<Backend> reference = make_reference_backend();
  for (const FieldCase& f : fields()) {
    backend->set_field(f.field);
    reference->set_field(f.field);
    for (const std::size_t count : kSizes) {
      if (count > 5000 && &f != &fields().front()) continue;
      const std::vector<Vec3> before = random_points(count, 7 + unsigned(count), 1.4f);
      std::vector<Vec3> points = before, oracle = before, unasked = before;
      std::vector<ProjectStatus> status(count), oracle_status(count);
      const ProjectReport report = backend->project(points, project, status);
      reference->project(oracle, project, oracle_status);
      backend->project(unasked, project, {});
      std::size_t failed = 0, disagree = 0;
      for (std::size_t i = 0; i < count; ++i) {
        ASSERT_TRUE(same_bits(unasked[i], points[i]));
        if (status[i] == ProjectStatus::quasi_critical) {
          ++failed;
          ASSERT_TRUE(same_bits(points[i], before[i])) << f.name << " point " << i;
        } else {
          const DVec3 p(points[i]);
          const double reached = 1.1 * project.tolerance + 16 * kEps * (1.0 + glm::length(p));
          ASSERT_TRUE(surface_within(*f.field, p, reached)) << f.name << " point " << i;
        }
        // A float32 path may part from the float64 one where it runs along a ridge; it may not do so often.
        disagree += status[i] != oracle_status[i] || glm::length(points[i] - oracle[i]) > 5 * project.tolerance;
      }
      EXPECT_EQ(report.points, count);
      EXPECT_EQ(report.quasi_critical, failed);
      EXPECT_LE(double(disagree), 0.01 * double(count) + 1.0) << f.name;
      if (count > 5000) {
        EXPECT_LT(double(failed), 0.9 * double(count)) << f.name;
      }
    }
  }
}

TEST_P(EveryBackend, KeepsTheMeshItWasGiven) {
  for (const TriangleMesh& mesh : {TriangleMesh{}, test_meshes::tetrahedron(), test_meshes::icosphere(3)}) {
    backend->set_mesh(mesh);
    const std::span<const Vec3> positions = backend->positions();
    ASSERT_EQ(positions.size(), mesh.vertex_count());
    for (std::size_t v = 0; v < mesh.vertex_count(); ++v) EXPECT_TRUE(same_bits(positions[v], mesh.position(Index(v))));
    const std::span<const ProjectStatus> status = backend->status();
    ASSERT_EQ(status.size(), mesh.vertex_count());
    for (const ProjectStatus s : status) EXPECT_EQ(s, ProjectStatus::converged);
  }
}

TEST_P(EveryBackend, NormalsAndInversionsOfTheResidentMesh) {
  for (const FieldCase& f : fields()) {
    TriangleMesh mesh = test_meshes::icosphere(3, 0.9f);
    test_meshes::jitter(mesh, 0.25f, 21);  // about twice an edge: many triangles turn over
    backend->set_field(f.field);
    backend->set_mesh(mesh);
    std::vector<Vec3> normals(mesh.vertex_count(), Vec3(kNan));
    backend->vertex_normals(normals);
    std::vector<DVec3> oracle(mesh.vertex_count());
    for (std::size_t v = 0; v < oracle.size(); ++v) {
      const DVec3 p(mesh.position(Index(v)));
      const FieldSample s = f.field->sample(p);
      const double slope = glm::length(s.gradient);
      oracle[v] = slope > 0.0 ? -s.gradient / slope : DVec3(0.0);
      if (distance_to_singular(f, p) < 0.02 || slope < 1e-3) continue;
      ASSERT_LE(glm::length(DVec3(normals[v]) - oracle[v]), 4 * kEps + 2 * slack(*f.field, p, s).gradient / slope)
          << f.name << " vertex " << v;
    }
    std::vector<std::uint8_t> inverted(mesh.triangle_count(), 7);
    backend->inverted_triangles(inverted);
    std::size_t expected = 0;
    for (std::size_t t = 0; t < mesh.triangle_count(); ++t) {
      DVec3 p[3];
      for (int k = 0; k < 3; ++k) p[k] = DVec3(mesh.position(mesh.vertex[3 * t + k]));
      const DVec3 normal = glm::normalize(glm::cross(p[1] - p[0], p[2] - p[0]));
      double highest = -1.0;
      for (int k = 0; k < 3; ++k) highest = std::max(highest, glm::dot(normal, oracle[mesh.vertex[3 * t + k]]));
      expected += highest < 0.0;
      if (std::abs(highest) > 1e-3) {
        ASSERT_EQ(inverted[t], highest < 0.0) << f.name << " triangle " << t;
      }
      ASSERT_LE(inverted[t], 1);
    }
    EXPECT_GT(expected, 20u) << f.name;
  }
}

TEST_P(EveryBackend, RelaxesAsTheReferenceDoes) {
  const std::unique_ptr<Backend> reference = make_reference_backend();
  const auto compare = [&](const FieldCase& f, const TriangleMesh& start, RelaxOptions options, const char* what,
                           const std::vector<std::uint8_t>& pinned = {}) {
    const TriangleMesh mesh = skin_around(*f.field, start, project, 31);
    options.edge_length = float(shape_statistics(mesh).mean_edge);
    options.cg_tolerance = 0.0f;
    for (Backend* b : {backend.get(), reference.get()}) {
      b->set_field(f.field);
      b->set_mesh(mesh, pinned);
    }
    const RelaxReport got = backend->relax(options, project), oracle = reference->relax(options, project);
    EXPECT_EQ(got.steps, options.steps) << f.name << what;
    EXPECT_EQ(got.cg_iterations, oracle.cg_iterations) << f.name << what;
    EXPECT_EQ(got.inverted, oracle.inverted) << f.name << what;
    EXPECT_NEAR(got.residual, oracle.residual, 1e-3) << f.name << what;
    EXPECT_NEAR(double(got.quasi_critical), double(oracle.quasi_critical), 1.0 + 0.01 * double(mesh.vertex_count()));
    const std::span<const Vec3> positions = backend->positions(), expected = reference->positions();
    const std::span<const ProjectStatus> status = backend->status();
    std::size_t far = 0;
    double moved = 0.0;
    for (std::size_t v = 0; v < positions.size(); ++v) {
      ASSERT_TRUE(is_finite(positions[v]));
      far += glm::length(positions[v] - expected[v]) > 0.02f * options.edge_length;
      const double by = glm::length(positions[v] - mesh.position(Index(v)));
      moved = std::max(moved, by);
      if (!pinned.empty() && pinned[v]) {
        EXPECT_LE(by, 2.0 * project.tolerance) << f.name << what << " vertex " << v;
      }
    }
    EXPECT_LE(double(far), 0.005 * double(positions.size())) << f.name << what;
    EXPECT_GT(moved, 0.05 * options.edge_length) << f.name << what;
    EXPECT_EQ(std::size_t(std::count(status.begin(), status.end(), ProjectStatus::quasi_critical)), got.quasi_critical);
  };
  for (const FieldCase& f : fields()) {
    RelaxOptions options;
    options.steps = 1;
    options.cg_iterations = 6;
    compare(f, test_meshes::icosphere(2), options, " fem");
    options.steps = 2;
    compare(f, test_meshes::icosphere(4), options, " fem, two steps");
    options.mechanics = Mechanics::springs;
    compare(f, test_meshes::icosphere(3), options, " springs");
    options.mechanics = Mechanics::fem;
    options.sharp = true;
    compare(f, test_meshes::icosphere(3), options, " sharp");
    options.sharp = false;
    std::vector<std::uint8_t> pinned(test_meshes::icosphere(3).vertex_count());
    for (std::size_t v = 0; v < pinned.size(); ++v) pinned[v] = v % 3 == 0;
    compare(f, test_meshes::icosphere(3), options, " pinned", pinned);
  }
}

TEST_P(EveryBackend, ProjectMeshIsProjectOfItsVertices) {
  const FieldCase& f = fields().front();
  backend->set_field(f.field);
  TriangleMesh mesh = test_meshes::icosphere(4, 1.1f);
  mesh.vertices.position[5] = Vec3(1e30f, 0, 0);  // cannot be projected
  std::vector<Vec3> points = mesh.vertices.position;
  std::vector<ProjectStatus> status(points.size());
  backend->set_mesh(mesh);
  const ProjectReport got = backend->project_mesh(project), expected = backend->project(points, project, status);
  EXPECT_EQ(got.quasi_critical, expected.quasi_critical);
  EXPECT_GE(got.quasi_critical, 1u);
  EXPECT_LT(got.quasi_critical, points.size());
  const std::vector<Vec3> positions(backend->positions().begin(), backend->positions().end());
  for (std::size_t v = 0; v < points.size(); ++v) EXPECT_TRUE(same_bits(positions[v], points[v])) << v;
  const std::span<const ProjectStatus> resident = backend->status();
  for (std::size_t v = 0; v < points.size(); ++v) EXPECT_EQ(resident[v], status[v]);
}

TEST_P(EveryBackend, FollowsTheFieldAndMeshItIsGivenLast) {
  const std::vector<Vec3> points = random_points(93, 8);
  for (int round = 0; round < 2; ++round) {
    for (const FieldCase& f : fields()) {
      backend->set_field(f.field);
      std::vector<float> values(points.size());
      backend->evaluate(points, values, {});
      const DVec3 p(points[4]);
      EXPECT_NEAR(values[4], f.field->value(p), slack(*f.field, p, f.field->sample(p)).value) << f.name;
    }
  }
  RelaxOptions options;
  for (const int levels : {3, 0, 2}) {
    backend->set_mesh(test_meshes::icosphere(levels));
    backend->relax(options, project);
    EXPECT_EQ(backend->positions().size(), std::size_t(10 * (1 << (2 * levels)) + 2));
  }
  backend->set_mesh(TriangleMesh{});
  EXPECT_EQ(backend->relax(options, project).quasi_critical, 0u);
}

TEST_P(EveryBackend, SameBytesEveryTimeWhateverTheNumberOfThreads) {
  const FieldCase& f = fields().front();
  const auto run = [&](std::size_t threads) {
    tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    const std::unique_ptr<Backend> fresh = GetParam().make();
    fresh->set_field(f.field);
    fresh->set_mesh(skin_around(*f.field, test_meshes::icosphere(4), project, 41));
    RelaxOptions options;
    options.edge_length = 0.08f;
    fresh->relax(options, project);
    return std::vector<Vec3>(fresh->positions().begin(), fresh->positions().end());
  };
  const std::vector<Vec3> one = run(1), many = run(4);
  ASSERT_EQ(one.size(), many.size());
  EXPECT_EQ(std::memcmp(one.data(), many.data(), one.size() * sizeof(Vec3)), 0);
}

TEST_P(EveryBackend, SaysWhatIsMissing) {
  std::vector<Vec3> points(3), gradients(2);
  std::vector<float> values(3), few(2);
  std::vector<ProjectStatus> status(2);
  EXPECT_THROW(backend->evaluate(points, values, {}), std::invalid_argument);  // no field
  EXPECT_THROW(backend->set_field(nullptr), std::invalid_argument);
  backend->set_field(fields().front().field);
  EXPECT_THROW(backend->evaluate(points, few, {}), std::invalid_argument);
  EXPECT_THROW(backend->evaluate(points, values, gradients), std::invalid_argument);
  EXPECT_THROW(backend->evaluate_hessian(points, values), std::invalid_argument);
  EXPECT_THROW(backend->project(points, project, status), std::invalid_argument);
  backend->set_mesh(test_meshes::tetrahedron());
  std::vector<std::uint8_t> inverted(3);
  EXPECT_THROW(backend->vertex_normals(gradients), std::invalid_argument);
  EXPECT_THROW(backend->inverted_triangles(inverted), std::invalid_argument);
  RelaxOptions bad;
  bad.edge_length = 0.0f;
  EXPECT_THROW(backend->relax(bad, project), std::invalid_argument);
}

INSTANTIATE_TEST_SUITE_P(Backends, EveryBackend, testing::ValuesIn(backends()),
                         [](const testing::TestParamInfo<BackendCase>& i) { return i.param.name; });
