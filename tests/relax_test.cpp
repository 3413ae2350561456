#include "core/mechanics/relax.h"

#include <cmath>
#include <cstring>

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include "tests/analytic_fields.h"
#include "tests/test_meshes.h"

using namespace isoskin;

namespace {

struct Body {
  TriangleMesh mesh;
  SkinTopology topology;
  std::vector<ProjectStatus> status;

  explicit Body(TriangleMesh m)
      : mesh(std::move(m)), topology(skin_topology(mesh)), status(mesh.vertex_count(), ProjectStatus::converged) {}

  RelaxReport relax(const Field& field, const RelaxOptions& options) {
    const ProjectOptions project{1e-5f * options.edge_length, 0.5f * options.edge_length, 16, 24};
    return relax_skin(topology, field, options, project, mesh.vertices.position, status);
  }

  std::vector<DVec3> positions() const { return {mesh.vertices.position.begin(), mesh.vertices.position.end()}; }

  std::vector<DVec3> normals(const Field& field) const {
    const std::vector<DVec3> x = positions();
    std::vector<DVec3> n(x.size());
    field_normals(field, x, n);
    return n;
  }

  std::size_t inverted(const Field& field) const {
    std::vector<std::uint8_t> flags(mesh.triangle_count());
    mark_inverted(mesh.vertex, positions(), normals(field), flags);
    return std::count(flags.begin(), flags.end(), 1);
  }

  // Mean squared deviation of the edges from e: no force or energy of the code under test.
  double edge_error(double e) const {
    double sum = 0.0;
    for (Index h = 0; h < mesh.vertex.size(); ++h) {
      const double l = glm::length(DVec3(mesh.position(mesh.to(h))) - DVec3(mesh.position(mesh.from(h))));
      sum += (l / e - 1.0) * (l / e - 1.0);
    }
    return sum / double(mesh.vertex.size());
  }
};

Body jittered_sphere(int levels, float amplitude, unsigned seed) {
  TriangleMesh mesh = test_meshes::icosphere(levels);
  test_meshes::jitter(mesh, amplitude, seed);
  for (Vec3& p : mesh.vertices.position) p = glm::normalize(p);
  return Body(std::move(mesh));
}

RelaxOptions options_for(float e) {
  RelaxOptions o;
  o.edge_length = e;
  return o;
}

// Gaussian elimination with partial pivoting.
std::vector<double> solve(std::vector<std::vector<double>> a, std::vector<double> b) {
  const std::size_t n = b.size();
  for (std::size_t i = 0; i < n; ++i) {
    std::size_t pivot = i;
    for (std::size_t r = i; r < n; ++r)
      if (std::abs(a[r][i]) > std::abs(a[pivot][i])) pivot = r;
    std::swap(a[i], a[pivot]);
    std::swap(b[i], b[pivot]);
    for (std::size_t r = i + 1; r < n; ++r) {
      const double f = a[r][i] / a[i][i];
      for (std::size_t c = i; c < n; ++c) a[r][c] -= f * a[i][c];
      b[r] -= f * b[i];
    }
  }
  for (std::size_t i = n; i-- > 0;) {
    for (std::size_t c = i + 1; c < n; ++c) b[i] -= a[i][c] * b[c];
    b[i] /= a[i][i];
  }
  return b;
}

/// F = 1 - max |x_k|: the cube, with a gradient that jumps across its edges.
class CubeField final : public Field {
public:
  FieldSample sample(const DVec3& p) const override {
    const DVec3 a = glm::abs(p);
    const int k = a.x >= a.y && a.x >= a.z ? 0 : a.y >= a.z ? 1 : 2;
    FieldSample s{1.0 - a[k], DVec3(0.0)};
    s.gradient[k] = p[k] > 0.0 ? -1.0 : 1.0;
    return s;
  }
  Box bounds() const override { return {DVec3(-1.0), DVec3(1.0)}; }
  Interval range(const Box&) const override { return {-HUGE_VAL, HUGE_VAL}; }
};

/// No surface anywhere.
class NothingField final : public Field {
public:
  FieldSample sample(const DVec3& p) const override { return {-1.0 - glm::dot(p, p), -2.0 * p}; }
  Box bounds() const override { return {}; }
  Interval range(const Box&) const override { return {-HUGE_VAL, -1.0}; }
};

constexpr Mechanics kBoth[] = {Mechanics::fem, Mechanics::springs};

}  // namespace

TEST(Relax, ConjugateGradientsSolveTheConstrainedSystem) {
  const analytic::SphereField sphere;
  const Body body = jittered_sphere(1, 0.15f, 3);
  const std::vector<DVec3> x = body.positions(), normals = body.normals(sphere);
  std::vector<std::uint8_t> inverted(body.mesh.triangle_count());
  mark_inverted(body.mesh.vertex, x, normals, inverted);
  const std::size_t n = x.size();
  for (const Mechanics mechanics : kBoth) {
    RelaxOptions options = options_for(0.45f);
    options.mechanics = mechanics;
    options.cg_iterations = 400;
    options.cg_tolerance = 1e-9f;
    const Skin skin(body.topology, x, normals, inverted, options);
    const QuasiStaticMove solved = quasi_static_move(skin, options);
    EXPECT_LE(solved.residual, 1e-9);

    // The oracle assembles the dense matrix element by element and solves in a basis of the tangent planes.
    const ElementMaterial material{0.45f, options.young, options.poisson, options.spring};
    std::vector<std::vector<double>> a(3 * n, std::vector<double>(3 * n, 0.0));
    std::vector<double> f(3 * n, 0.0);
    for (std::size_t i = 0; i < 3 * n; ++i) a[i][i] = 1.0;
    for (std::size_t t = 0; t < body.mesh.triangle_count(); ++t) {
      const Index* v = &body.mesh.vertex[3 * t];
      const Corners p{x[v[0]], x[v[1]], x[v[2]]};
      const ElementFrame frame = element_frame(p, inverted[t], normals[v[0]] + normals[v[1]] + normals[v[2]]);
      const bool fem = mechanics == Mechanics::fem;
      const Corners force = fem ? element_forces(frame, p, material) : spring_forces(p, material);
      for (int k = 0; k < 9; ++k) {
        f[3 * v[k / 3] + k % 3] += force[k / 3][k % 3];
        Corners unit{DVec3(0.0), DVec3(0.0), DVec3(0.0)};
        unit[k / 3][k % 3] = 1.0;
        const Corners column =
            fem ? element_stiffness_times(frame, unit, material) : spring_stiffness_times(p, unit, material);
        for (int r = 0; r < 9; ++r) a[3 * v[r / 3] + r % 3][3 * v[k / 3] + k % 3] += options.dt * column[r / 3][r % 3];
      }
    }
    std::vector<DVec3> tangent(2 * n);
    for (std::size_t v = 0; v < n; ++v) {
      tangent[2 * v] = any_normal(normals[v]);
      tangent[2 * v + 1] = glm::cross(normals[v], tangent[2 * v]);
    }
    std::vector<std::vector<double>> reduced(2 * n, std::vector<double>(2 * n, 0.0));
    std::vector<double> rhs(2 * n, 0.0);
    for (std::size_t i = 0; i < 2 * n; ++i) {
      for (int r = 0; r < 3; ++r) {
        rhs[i] += options.dt * tangent[i][r] * f[3 * (i / 2) + r];
        for (std::size_t j = 0; j < 2 * n; ++j)
          for (int c = 0; c < 3; ++c)
            reduced[i][j] += tangent[i][r] * a[3 * (i / 2) + r][3 * (j / 2) + c] * tangent[j][c];
      }
    }
    const std::vector<double> y = solve(reduced, rhs);
    double largest = 0.0;
    for (std::size_t v = 0; v < n; ++v) {
      const DVec3 dx = y[2 * v] * tangent[2 * v] + y[2 * v + 1] * tangent[2 * v + 1];
      EXPECT_LT(glm::length(solved.move[v] - dx), 1e-7);
      largest = std::max(largest, glm::length(dx));
    }
    EXPECT_GT(largest, 0.01);
  }
}

TEST(Relax, MovesStayInTheTangentPlanesAfterAnyNumberOfIterations) {
  const analytic::SphereField sphere;
  const Body body = jittered_sphere(2, 0.1f, 4);
  const std::vector<DVec3> x = body.positions(), normals = body.normals(sphere);
  const std::vector<std::uint8_t> inverted(body.mesh.triangle_count(), 0);
  for (const int iterations : {0, 1, 2, 10}) {
    RelaxOptions options = options_for(0.3f);
    options.cg_iterations = iterations;
    options.cg_tolerance = 0.0f;
    const Skin skin(body.topology, x, normals, inverted, options);
    const QuasiStaticMove solved = quasi_static_move(skin, options);
    EXPECT_EQ(solved.iterations, iterations);
    for (std::size_t v = 0; v < x.size(); ++v) EXPECT_NEAR(glm::dot(solved.move[v], normals[v]), 0.0, 1e-12);
  }
}

TEST(Relax, StiffnessOfTheWholeSkinIsSymmetricAndPositive) {
  const analytic::SphereField sphere;
  const Body body = jittered_sphere(2, 0.2f, 5);
  const std::vector<DVec3> x = body.positions(), normals = body.normals(sphere);
  const std::vector<std::uint8_t> inverted(body.mesh.triangle_count(), 0);
  std::mt19937 rng(1);
  std::normal_distribution<double> g;
  for (const Mechanics mechanics : kBoth) {
    RelaxOptions options = options_for(0.3f);
    options.mechanics = mechanics;
    const Skin skin(body.topology, x, normals, inverted, options);
    std::vector<DVec3> a(x.size()), b(x.size()), ka(x.size()), kb(x.size());
    for (std::size_t i = 0; i < x.size(); ++i) a[i] = {g(rng), g(rng), g(rng)}, b[i] = {g(rng), g(rng), g(rng)};
    skin.stiffness_times(a, ka);
    skin.stiffness_times(b, kb);
    double ab = 0.0, ba = 0.0, aa = 0.0;
    DVec3 total(0.0);
    for (std::size_t i = 0; i < x.size(); ++i) {
      ab += glm::dot(a[i], kb[i]);
      ba += glm::dot(b[i], ka[i]);
      aa += glm::dot(a[i], ka[i]);
      total += ka[i];
    }
    EXPECT_NEAR(ab, ba, 1e-9 * aa);
    EXPECT_GT(aa, 0.0);
    EXPECT_LT(glm::length(total), 1e-9 * aa);  // a translation costs nothing
  }
}

TEST(Relax, BringsEdgesToTheirLengthAndStaysOnTheSurface) {
  const analytic::SphereField sphere;
  for (const Mechanics mechanics : kBoth) {
    Body body = jittered_sphere(3, 0.06f, 6);
    const float e = float(shape_statistics(body.mesh).mean_edge);
    RelaxOptions options = options_for(e);
    options.mechanics = mechanics;
    double error = body.edge_error(e);
    const double before = error;
    for (int round = 0; round < 5; ++round) {
      const RelaxReport report = body.relax(sphere, options);
      EXPECT_EQ(report.steps, 2);
      EXPECT_GT(report.cg_iterations, 0);
      EXPECT_LT(report.residual, 0.5);
      EXPECT_EQ(report.quasi_critical, 0u);
      EXPECT_LT(body.edge_error(e), error * 1.001);
      error = body.edge_error(e);
    }
    EXPECT_LT(error, 0.3 * before);
    for (const Vec3& p : body.mesh.vertices.position) EXPECT_NEAR(glm::length(p), 1.0f, 2e-5f * e + 3e-7f);
  }
}

TEST(Relax, RecoversFromForcedInversions) {
  const analytic::SphereField sphere;
  Body body(test_meshes::icosphere(3));
  const float e = float(shape_statistics(body.mesh).mean_edge);
  for (Index v = 0; v < body.mesh.vertex_count(); v += 37) {  // throw vertices across their rings
    const Vec3 p = body.mesh.position(v);
    body.mesh.vertices.position[v] = glm::normalize(p + 1.3f * e * Vec3(any_normal(DVec3(p))));
  }
  ASSERT_GT(body.inverted(sphere), 15u);
  const RelaxReport first = body.relax(sphere, [&] {
    RelaxOptions one = options_for(e);
    one.steps = 1;
    return one;
  }());
  EXPECT_GT(first.inverted, 15u);
  body.relax(sphere, options_for(e));  // "one or two time steps" (Bouthors-Nesme 4)
  EXPECT_EQ(body.inverted(sphere), 0u);
}

TEST(Relax, MovesAreClamped) {
  const analytic::SphereField sphere;
  Body body = jittered_sphere(2, 0.1f, 8);
  const std::vector<Vec3> before = body.mesh.vertices.position;
  RelaxOptions options = options_for(0.01f);  // edges of the mesh are thirty times longer
  options.steps = 1;
  body.relax(sphere, options);
  float longest = 0.0f;
  for (std::size_t v = 0; v < before.size(); ++v) {
    longest = std::max(longest, glm::length(body.mesh.vertices.position[v] - before[v]));
  }
  EXPECT_LE(longest, 0.5f * 0.01f * 1.001f);
  EXPECT_GT(longest, 0.5f * 0.01f * 0.9f);
}

TEST(Relax, SharpPullPutsVerticesOnEdgesAndCorners) {
  const CubeField cube;
  const auto farthest_corner = [&](bool sharp) {
    Body body(test_meshes::icosphere(3));
    RelaxOptions options = options_for(0.2f);
    options.sharp = sharp;
    const ProjectOptions project{1e-5f, 0.5f, 16, 24};
    project_points(cube, project, body.mesh.vertices.position, body.status);
    for (int round = 0; round < 10; ++round) body.relax(cube, options);
    double farthest = 0.0;
    for (int corner = 0; corner < 8; ++corner) {
      const Vec3 c(corner & 1 ? 1 : -1, corner & 2 ? 1 : -1, corner & 4 ? 1 : -1);
      float nearest = 10.0f;
      for (const Vec3& p : body.mesh.vertices.position) nearest = std::min(nearest, glm::length(p - c));
      farthest = std::max<double>(farthest, nearest);
    }
    for (const Vec3& p : body.mesh.vertices.position) EXPECT_NEAR(cube.value(DVec3(p)), 0.0, 1e-4);
    return std::pair(farthest, mesh_pieces(body.mesh).volume.at(0));
  };
  const auto [corner_off, volume_off] = farthest_corner(false);
  const auto [corner_on, volume_on] = farthest_corner(true);
  RecordProperty("volume_missing_without", std::to_string(8.0 - volume_off));
  RecordProperty("volume_missing_with", std::to_string(8.0 - volume_on));
  EXPECT_LT(corner_on, corner_off);
  EXPECT_LT(8.0 - volume_on, 0.5 * (8.0 - volume_off));
}

TEST(Relax, VerticesThatCannotBeProjectedAreCountedAndKeepTheirRelaxedPlace) {
  const NothingField nothing;
  Body body = jittered_sphere(1, 0.1f, 9);
  const RelaxReport report = body.relax(nothing, options_for(0.5f));
  EXPECT_EQ(report.quasi_critical, body.mesh.vertex_count());
  for (const ProjectStatus s : body.status) EXPECT_EQ(s, ProjectStatus::quasi_critical);
  for (const Vec3& p : body.mesh.vertices.position) EXPECT_TRUE(std::isfinite(p.x + p.y + p.z));
}

TEST(Relax, SameBytesWhateverTheNumberOfThreads) {
  const analytic::TorusField torus(1.0, 0.4);
  const auto run = [&](std::size_t threads) {
    tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    TriangleMesh mesh = test_meshes::torus(120, 60);
    test_meshes::jitter(mesh, 0.02f, 10);
    Body body(std::move(mesh));
    body.relax(torus, options_for(0.05f));
    return body.mesh.vertices.position;
  };
  const std::vector<Vec3> one = run(1), many = run(4);
  EXPECT_EQ(std::memcmp(one.data(), many.data(), one.size() * sizeof(Vec3)), 0);
}

TEST(Relax, DegenerateMeshesStayFinite) {
  const analytic::SphereField sphere;
  Body body(test_meshes::icosphere(2));
  std::vector<Vec3>& p = body.mesh.vertices.position;
  for (Index h = 0; h < 30; h += 3) p[body.mesh.to(h)] = p[body.mesh.from(h)];  // edges of length zero
  for (const Mechanics mechanics : kBoth) {
    RelaxOptions options = options_for(0.3f);
    options.mechanics = mechanics;
    body.relax(sphere, options);
    for (const Vec3& q : p) ASSERT_NEAR(glm::length(q), 1.0f, 1e-4f);
  }
  Body nothing{TriangleMesh{}};
  EXPECT_EQ(nothing.relax(sphere, options_for(1.0f)).inverted, 0u);
}

TEST(Relax, RefusesOptionsOutOfRange) {
  const analytic::SphereField sphere;
  Body body(test_meshes::icosphere(0));
  RelaxOptions bad = options_for(0.0f);
  EXPECT_THROW(body.relax(sphere, bad), std::invalid_argument);
  bad = options_for(1.0f);
  bad.poisson = 1.0f;
  EXPECT_THROW(body.relax(sphere, bad), std::invalid_argument);
  bad = options_for(1.0f);
  bad.dt = NAN;
  EXPECT_THROW(body.relax(sphere, bad), std::invalid_argument);
}
