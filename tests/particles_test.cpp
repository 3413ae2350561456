// Figueiredo, Gomes, Terzopoulos and Velho 1992, section 3: what they state about particles, and what a mesh must be.
#include "core/particles/particle_mesh.h"

#include <algorithm>
#include <cmath>

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include "core/counter_random.h"
#include "core/field/skeleton_field.h"
#include "core/io/scene.h"
#include "core/mesh/validate.h"
#include "core/particles/delaunay.h"
#include "core/topology/certificate.h"
#include "tests/analytic_fields.h"

namespace isoskin {
namespace {

using namespace analytic;

double volume_of(const std::vector<DVec3>& p, const std::array<Index, 4>& t) {
  return std::abs(glm::dot(p[t[1]] - p[t[0]], glm::cross(p[t[2]] - p[t[0]], p[t[3]] - p[t[0]]))) / 6.0;
}

/// By definition, not by the paraboloid: all corners lie on the sphere about the circumcentre and nothing inside.
void expect_delaunay(const std::vector<DVec3>& points, double volume) {
  const Delaunay d = delaunay(points);
  double sum = 0.0;
  for (std::size_t t = 0; t < d.tetrahedron.size(); ++t) {
    const double radius = glm::distance(points[d.tetrahedron[t][0]], d.circumcenter[t]);
    for (const Index v : d.tetrahedron[t]) ASSERT_NEAR(glm::distance(points[v], d.circumcenter[t]), radius, 1e-8);
    for (const DVec3& p : points) ASSERT_GE(glm::distance(p, d.circumcenter[t]), radius - 1e-8);
    sum += volume_of(points, d.tetrahedron[t]);
  }
  EXPECT_NEAR(sum, volume, 1e-9 * volume);  // the cells fill the hull once
}

TEST(Delaunay, EmptySpheresFillTheHull) {
  std::vector<DVec3> points;
  for (int c = 0; c < 8; ++c) points.emplace_back(c & 1, c >> 1 & 1, c >> 2 & 1);
  for (std::uint64_t i = 0; i < 200; ++i) points.push_back(counter_point(3, i));
  expect_delaunay(points, 1.0);
}

TEST(Delaunay, PointsOnCommonSpheresShareOneCell) {
  std::vector<DVec3> points;
  constexpr int kSide = 4;
  for (int i = 0; i < kSide * kSide * kSide; ++i)
    points.emplace_back(100 + i % kSide, i / kSide % kSide, i / (kSide * kSide));
  expect_delaunay(points, std::pow(kSide - 1.0, 3.0));
  const Delaunay d = delaunay(points);
  for (const DVec3& c : d.circumcenter)
    EXPECT_LT(glm::distance(c, glm::floor(c) + 0.5), 1e-9) << "of a unit cube, the only cells there are";
}

TEST(Delaunay, SaysWhatItCannotDo) {
  EXPECT_THROW(delaunay(std::vector<DVec3>(4, DVec3(0.0))), std::invalid_argument);
  EXPECT_THROW(delaunay(std::vector<DVec3>(6, DVec3(NAN))), std::invalid_argument);
  std::vector<DVec3> flat;
  for (int i = 0; i < 9; ++i) flat.emplace_back(i % 3, i / 3, 0);
  EXPECT_THROW(delaunay(flat), std::runtime_error);
}

/// Their planar curve y^2 - x^3 + x = 0, as F = x^3 - x - y^2: an oval with x in [-1, 0], a branch from x = 1 on.
class CubicCurve final : public Field {
public:
  FieldSample sample(const DVec3& p) const override {
    return {p.x * p.x * p.x - p.x - p.y * p.y, DVec3(3.0 * p.x * p.x - 1.0, -2.0 * p.y, 0.0)};
  }
  Box bounds() const override { return {DVec3(-2.0, -2.0, 0.0), DVec3(2.0, 2.0, 0.0)}; }
  Interval range(const Box&) const override {
    return {-std::numeric_limits<double>::infinity(), std::numeric_limits<double>::infinity()};
  }
};

TEST(Particles, FallOnBothComponentsOfThePapersCurveInLessThanAHundredSteps) {
  const auto backend = make_reference_backend();
  backend->set_field(std::make_shared<CubicCurve>());
  std::vector<Vec3> points(400);
  for (std::size_t i = 0; i < points.size(); ++i) {
    const DVec3 u = counter_point(7, i);
    points[i] = Vec3(4.0 * u.x - 2.0, 4.0 * u.y - 2.0, 0.0);
  }
  std::vector<std::uint8_t> arrived(points.size());
  const ParticleReport report = fall_to_surface(points, arrived, *backend);
  EXPECT_LT(report.steps, 100);
  EXPECT_EQ(report.arrived, points.size());
  int oval = 0, branch = 0;
  const std::vector<Vec3> rest = points;
  ASSERT_EQ(backend->project(points, {}, {}).quasi_critical, 0u);
  for (std::size_t i = 0; i < points.size(); ++i) {
    EXPECT_EQ(rest[i].z, 0.0f);
    EXPECT_LT(glm::distance(rest[i], points[i]), 0.15f);
    points[i].x < 0.5f ? ++oval : ++branch;
  }
  EXPECT_GT(oval, 100);
  EXPECT_GT(branch, 100);
}

TEST(Particles, WithoutAGradientStayAndAreCounted) {
  const auto backend = make_reference_backend();
  backend->set_field(std::make_shared<SkeletonField>(std::vector<SkeletonElement>(1), 0.3));
  std::vector<Vec3> points{Vec3(0.9f, 0.0f, 0.0f), Vec3(0.7f, 0.0f, 0.0f), Vec3(5.0f, 0.0f, 0.0f)};
  std::vector<std::uint8_t> arrived(points.size());
  const ParticleReport report = fall_to_surface(points, arrived, *backend);
  EXPECT_EQ(report.stranded, 1u);
  EXPECT_EQ(points[2], Vec3(5.0f, 0.0f, 0.0f));
}

struct Made {
  TriangleMesh mesh;
  ParticleMeshReport report;
  Certificate certificate;
};

Made make(const std::shared_ptr<const Field>& field, double e, std::uint64_t seed = 1992) {
  const auto backend = make_reference_backend();
  backend->set_field(field);
  const BrickLattice lattice = sample_lattice(*field, *backend, 0.5 * e);
  const LatticeTopology topology = lattice_topology(lattice);
  ProjectOptions project;
  project.tolerance = float(1e-4 * e);
  project.max_step = float(0.5 * e);
  ParticleMeshOptions options;
  options.edge_length = e;
  options.seed = seed;
  Made made;
  made.mesh = particle_mesh(*field, *backend, lattice, topology, project, options, &made.report);
  CertifyOptions certify_options;
  certify_options.tolerance = 0.5 * e;
  made.certificate = certify(made.mesh, mesh_pieces(made.mesh), *field, lattice, topology, certify_options);
  return made;
}

/// The largest angle between a triangle and the tangent plane at one of its corners, degrees.
double farthest_from_tangent(const TriangleMesh& mesh, const Field& field) {
  double least = 1.0;
  for (std::size_t h = 0; h < mesh.vertex.size(); h += 3) {
    const DVec3 a(mesh.position(mesh.vertex[h])), b(mesh.position(mesh.vertex[h + 1])),
        c(mesh.position(mesh.vertex[h + 2]));
    const DVec3 normal = glm::normalize(glm::cross(b - a, c - a));
    for (const DVec3& p : {a, b, c})
      least = std::min(least, glm::dot(normal, outward_normal(field.sample(p).gradient)));
  }
  return glm::degrees(std::acos(least));
}

/// A closed manifold with the topology that the field has on the lattice, of quasi-regular triangles (the paper:
/// "almost equilateral and equiangular") near the tangent planes, about as long as was asked for.
void expect_quasi_regular(const std::shared_ptr<const Field>& field, double e, int euler, double tangent) {
  const Made made = make(field, e);
  const ValidateReport valid = validate(made.mesh);
  ASSERT_TRUE(valid) << valid.reason;
  EXPECT_TRUE(made.certificate.passed) << made.certificate.summary();
  EXPECT_GT(double(made.report.fall.arrived), 0.95 * double(made.report.starts));
  const MeshPieces pieces = mesh_pieces(made.mesh);
  ASSERT_EQ(pieces.count(), 1u);
  EXPECT_EQ(pieces.euler[0], euler);
  const ShapeStatistics shape = shape_statistics(made.mesh);
  EXPECT_GT(shape.mean_angle, 48.0);
  EXPECT_GT(shape.min_angle, 28.0);
  EXPECT_NEAR(shape.mean_edge, e, 0.1 * e);
  EXPECT_LT(farthest_from_tangent(made.mesh, *field), tangent);
}

TEST(ParticleMesh, OfThePapersSphere) {
  expect_quasi_regular(std::make_shared<SphereField>(), 0.2, 2, 20.0);
}

TEST(ParticleMesh, OfATorus) {
  expect_quasi_regular(std::make_shared<TorusField>(), 0.14, 0, 35.0);
}

TEST(ParticleMesh, OfGenusTwo) {
  const Scene scene = load_scene(ISOSKIN_TEST_DATA "/eight.toml");
  expect_quasi_regular(scene.source->load(1).field, 0.12, -2, 35.0);
}

TEST(ParticleMesh, DropsAndSheetsThinnerThanTheSpacingGetTheParticlesTheyNeed) {
  const auto drop = std::make_shared<SphereField>(DVec3(0.5, 0.2, 2.0), 0.16);
  const auto sheet = std::make_shared<BoxField>(Box{DVec3(-1.0, -1.0, -0.06), DVec3(1.0, 1.0, 0.06)});
  const Made made = make(std::make_shared<PairField>(PairField::Kind::both, drop, sheet), 0.15);
  ASSERT_TRUE(validate(made.mesh));
  EXPECT_TRUE(made.certificate.passed) << made.certificate.summary();
  EXPECT_EQ(mesh_pieces(made.mesh).count(), 2u);
  EXPECT_GT(made.report.inserted, 0u);
}

TEST(ParticleMesh, OfNothingIsEmpty) {
  EXPECT_TRUE(make(std::make_shared<SphereField>(DVec3(0.0), -1.0), 0.2).mesh.empty());
}

TEST(ParticleMesh, DependsOnTheSeedAndNotOnTheThreads) {
  const auto field = std::make_shared<SphereField>();
  const Made all = make(field, 0.3), other = make(field, 0.3, 1993);
  const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
  const Made single = make(field, 0.3);
  EXPECT_EQ(all.mesh.vertices.position, single.mesh.vertices.position);
  EXPECT_EQ(all.mesh.vertex, single.mesh.vertex);
  EXPECT_NE(all.mesh.vertices.position, other.mesh.vertices.position);
}

}  // namespace
}  // namespace isoskin
