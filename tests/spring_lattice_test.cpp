// Figueiredo, Gomes, Terzopoulos and Velho 1992, section 4: what they state about the lattice of springs.
#include "core/lattice_springs/spring_lattice.h"

#include <algorithm>
#include <map>
#include <random>

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include "core/field/skeleton_field.h"
#include "core/mesh/validate.h"
#include "core/sampling/segment_roots.h"
#include "tests/analytic_fields.h"

namespace isoskin {
namespace {

using namespace analytic;

constexpr double kSpacing = 0.2;

/// The paper's cylinder x^2 + y^2 = 1 without ends.
class CylinderField final : public Field {
public:
  FieldSample sample(const DVec3& p) const override {
    return {1.0 - p.x * p.x - p.y * p.y, DVec3(-2.0 * p.x, -2.0 * p.y, 0.0)};
  }
  Box bounds() const override { return {DVec3(-1.0), DVec3(1.0)}; }
  Interval range(const Box&) const override {
    return {-std::numeric_limits<double>::infinity(), std::numeric_limits<double>::infinity()};
  }
};

struct Lattice {
  std::shared_ptr<const Field> field;
  std::unique_ptr<Backend> backend = make_reference_backend();
  FreudenthalComplex complex;

  explicit Lattice(std::shared_ptr<const Field> f) : field(std::move(f)) {
    backend->set_field(field);
    complex = intersecting_complex(sample_lattice(*field, *backend, kSpacing));
  }
  TriangleMesh mesh() const {
    SimplexSurface s = march_simplices(complex, *backend);
    return make_mesh(std::move(s.position), std::move(s.triangle));
  }
};

/// 1 for a regular tetrahedron, 0 for a flat one: 12 (3 V)^(2/3) over the sum of squared edges.
double mean_quality(const FreudenthalComplex& complex) {
  double sum = 0.0;
  const std::vector<double> volume = relative_volumes(complex);
  for (std::size_t t = 0; t < volume.size(); ++t) {
    double squares = 0.0;
    for (int i = 0; i < 4; ++i)
      for (int j = 0; j < i; ++j) {
        const DVec3 d(complex.node[complex.tetrahedron[t][i]] - complex.node[complex.tetrahedron[t][j]]);
        squares += glm::dot(d, d);
      }
    sum += 12.0 * std::pow(0.5 * volume[t] * std::pow(complex.spacing, 3.0), 2.0 / 3.0) / squares;
  }
  return sum / double(volume.size());
}

/// Mean angle between the surface's tangent plane at a tetrahedron and the nearest of its faces, degrees.
double mean_face_to_tangent(const FreudenthalComplex& complex, const Field& field) {
  double sum = 0.0;
  for (const auto& t : complex.tetrahedron) {
    std::array<DVec3, 4> p;
    for (int k = 0; k < 4; ++k) p[k] = DVec3(complex.node[t[k]]);
    const DVec3 normal = outward_normal(field.sample(0.25 * (p[0] + p[1] + p[2] + p[3])).gradient);
    double best = 0.0;
    for (int k = 0; k < 4; ++k) {
      const DVec3 &a = p[(k + 1) % 4], &b = p[(k + 2) % 4], &c = p[(k + 3) % 4];
      best = std::max(best, std::abs(glm::dot(glm::normalize(glm::cross(b - a, c - a)), normal)));
    }
    sum += glm::degrees(std::acos(std::min(1.0, best)));
  }
  return sum / double(complex.tetrahedron.size());
}

TEST(SegmentRoots, AreWhereTheFieldVanishes) {
  const auto backend = make_reference_backend();
  backend->set_field(std::make_shared<TorusField>());
  std::vector<SegmentRoot> segments(300);
  std::mt19937 random(4);
  std::uniform_real_distribution<float> uniform(-1.5f, 1.5f);
  for (SegmentRoot& s : segments)
    for (Vec3* p : {&s.from, &s.to})
      for (int a = 0; a < 3; ++a) (*p)[a] = uniform(random);
  find_roots(segments, *backend);
  const TorusField field;
  int crossed = 0;
  for (const SegmentRoot& s : segments) {
    EXPECT_EQ(s.found, (field.value(DVec3(s.from)) > 0.0) != (field.value(DVec3(s.to)) > 0.0));
    if (!s.found) continue;
    ++crossed;
    EXPECT_LT(std::abs(field.value(DVec3(s.point()))), 1e-5);
    EXPECT_TRUE(s.t >= 0.0f && s.t <= 1.0f);
  }
  EXPECT_GT(crossed, 40);
}

TEST(Freudenthal, ComplexIsEveryTetrahedronWithCornersOnBothSides) {
  const Lattice l(std::make_shared<TorusField>());
  for (const double v : relative_volumes(l.complex)) EXPECT_NEAR(v, 1.0, 1e-4);
  // Counted by hand: the simplices of a cube are the orders of its corner's coordinates.
  std::size_t expected = 0;
  const int n = 9;
  for (int x = -n; x < n; ++x)
    for (int y = -n; y < n; ++y)
      for (int z = -n; z < n; ++z) {
        std::array<int, 3> axes{0, 1, 2};
        do {
          DVec3 p = kSpacing * DVec3(x, y, z);
          int in = l.field->value(DVec3(Vec3(p))) > 0.0;
          for (const int a : axes) {
            p[a] += kSpacing;
            in += l.field->value(DVec3(Vec3(p))) > 0.0;
          }
          expected += in > 0 && in < 4;
        } while (std::next_permutation(axes.begin(), axes.end()));
      }
  EXPECT_EQ(l.complex.tetrahedron.size(), expected);
  for (std::size_t i = 0; i < l.complex.node.size(); ++i)
    EXPECT_EQ(l.complex.inside[i], l.field->value(DVec3(l.complex.node[i])) > 0.0);
}

TEST(Freudenthal, MarchingSimplicesAreClosedAndOfTheSurfacesTopology) {
  for (const auto& [field, euler] : {std::pair<std::shared_ptr<const Field>, int>{std::make_shared<SphereField>(), 2},
                                     {std::make_shared<TorusField>(), 0}}) {
    const TriangleMesh mesh = Lattice(field).mesh();
    const ValidateReport valid = validate(mesh);
    ASSERT_TRUE(valid) << valid.reason;
    EXPECT_EQ(mesh_pieces(mesh).euler, std::vector<int>{euler});
    EXPECT_GT(mesh_pieces(mesh).volume[0], 0.0);  // outward
    for (const Vec3& p : mesh.vertices.position) EXPECT_LT(std::abs(field->value(DVec3(p))), 2e-3 * kSpacing);
  }
}

TEST(SpringLattice, BecomesSubordinatedToTheSurface) {
  for (const std::shared_ptr<const Field>& field : {std::shared_ptr<const Field>(std::make_shared<SphereField>()),
                                                    std::shared_ptr<const Field>(std::make_shared<TorusField>())}) {
    Lattice l(field);
    const TriangleMesh before = l.mesh();
    const double quality = mean_quality(l.complex), tilt = mean_face_to_tangent(l.complex, *field);
    const SpringLatticeReport report = deform(l.complex, *l.backend);
    EXPECT_LE(report.steps, 100);  // the paper: usually less
    EXPECT_LT(report.last_move, 0.01);
    const TriangleMesh after = l.mesh();

    // transversal: no node on the surface, all on their sides, no tetrahedron turned
    for (std::size_t i = 0; i < l.complex.node.size(); ++i) {
      const double f = field->value(DVec3(l.complex.node[i]));
      EXPECT_EQ(f > 0.0, l.complex.inside[i] != 0);
      EXPECT_GT(std::abs(f), 0.1 * kSpacing);
    }
    for (const double v : relative_volumes(l.complex)) EXPECT_GT(v, 0.09);
    EXPECT_GT(mean_quality(l.complex), quality + 0.05);              // its simplices are quasi-regular
    EXPECT_LT(mean_face_to_tangent(l.complex, *field), 0.8 * tilt);  // and lie along the tangent planes
    // "transforming long, thin elements to nearly equilateral ones", without a change of structure
    EXPECT_EQ(after.vertex_count(), before.vertex_count());
    EXPECT_EQ(mesh_pieces(after).euler, mesh_pieces(before).euler);
    ASSERT_TRUE(validate(after));
    EXPECT_LT(shape_statistics(before).p1_angle, 2.0);
    EXPECT_GT(shape_statistics(after).p1_angle, 18.0);
    EXPECT_GT(shape_statistics(after).mean_angle, shape_statistics(before).mean_angle + 12.0);
  }
}

TEST(SpringLattice, ThePapersCylinderEndsAtItsBox) {
  const auto field = std::make_shared<CylinderField>();
  const auto backend = make_reference_backend();
  backend->set_field(field);
  const BrickLattice lattice = lattice_of_box({DVec3(-1.6, -1.6, -1.6), DVec3(1.6, 1.6, 1.6)}, kSpacing, *backend);
  FreudenthalComplex complex = intersecting_complex(lattice);
  hold_border(complex, lattice);
  deform(complex, *backend);
  const SimplexSurface surface = march_simplices(complex, *backend);
  std::map<std::pair<Index, Index>, int> sides;
  for (std::size_t h = 0; h < surface.triangle.size(); ++h) {
    const Index a = surface.triangle[h], b = surface.triangle[TriangleMesh::next(Index(h))];
    ++sides[std::minmax(a, b)];
  }
  int border = 0;
  for (const auto& [edge, count] : sides) {
    EXPECT_TRUE(count == 1 || count == 2);
    if (count == 2) continue;
    ++border;
    for (const Index v : {edge.first, edge.second}) EXPECT_NEAR(std::abs(surface.position[v].z), 1.6f, 1e-5f);
  }
  EXPECT_GT(border, 60);
  const int euler = int(surface.position.size()) - int(sides.size()) + int(surface.triangle.size() / 3);
  EXPECT_EQ(euler, 0);  // a tube
}

TEST(SpringLattice, NodesWithoutAGradientOnlyFeelTheirSprings) {
  Lattice l(std::make_shared<SkeletonField>(std::vector<SkeletonElement>(1), 0.01));  // support ends near the surface
  deform(l.complex, *l.backend);
  EXPECT_TRUE(validate(l.mesh()));
  for (const Vec3& p : l.complex.node) EXPECT_TRUE(std::isfinite(p.x + p.y + p.z));
}

TEST(SpringLattice, DoesNotDependOnThreads) {
  const auto nodes = [] {
    Lattice l(std::make_shared<SphereField>());
    deform(l.complex, *l.backend);
    return l.complex.node;
  };
  const std::vector<Vec3> all = nodes();
  const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
  EXPECT_EQ(all, nodes());
}

}  // namespace
}  // namespace isoskin
