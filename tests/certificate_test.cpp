#include "core/topology/certificate.h"

#include <cmath>
#include <random>
#include <tuple>

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include "analytic_fields.h"
#include "core/mesh/edit.h"
#include "core/mesh/validate.h"
#include "core/refine/shape_sums.h"
#include "digital_topology.h"
#include "sanitized.h"
#include "solid_field.h"
#include "test_meshes.h"

using namespace isoskin;
using namespace isoskin::solid;

namespace {

constexpr double kSpacing = 0.05;
constexpr double kTolerance = 0.1;
const Box kBounds{DVec3(-1.6), DVec3(1.6)};

std::shared_ptr<const Field> make_field(SolidField::Solid s) {
  return std::make_shared<SolidField>(std::move(s), kBounds);
}

/// The lattice's view of a field, and certificates against it.
struct Judge {
  std::shared_ptr<const Field> field;
  std::unique_ptr<Backend> backend = make_reference_backend();
  BrickLattice lattice;
  LatticeTopology topology;

  explicit Judge(std::shared_ptr<const Field> f, double spacing = kSpacing) : field(std::move(f)) {
    backend->set_field(field);
    lattice = sample_lattice(*field, *backend, spacing);
    topology = lattice_topology(lattice);
  }
  explicit Judge(SolidField::Solid s, double spacing = kSpacing) : Judge(make_field(std::move(s)), spacing) {}

  TriangleMesh mesh() const { return marching_cubes(lattice, topology); }
  Certificate judge(const TriangleMesh& m, double least_piece = 0.0) const {
    EXPECT_TRUE(validate(m)) << validate(m).reason;
    return certify(m, mesh_pieces(m), *field, lattice, topology, {kTolerance, least_piece});
  }
};

TriangleMesh mesh_of(SolidField::Solid s, double spacing = kSpacing) {
  return Judge(std::move(s), spacing).mesh();
}

TriangleMesh together(const TriangleMesh& a, TriangleMesh b) {
  TriangleMesh sum = a;
  for (Index& id : b.vertices.id) id = sum.next_id++;
  b.next_id = sum.next_id;
  append(sum, b);
  return sum;
}

TriangleMesh moved(TriangleMesh mesh, const Vec3& by) {
  for (Vec3& p : mesh.vertices.position) p += by;
  return mesh;
}

TriangleMesh inside_out(const TriangleMesh& mesh) {
  std::vector<Index> triangles = mesh.vertex;
  for (std::size_t t = 0; t < mesh.triangle_count(); ++t) std::swap(triangles[3 * t], triangles[3 * t + 1]);
  return make_mesh(mesh.vertices.position, triangles);
}

/// Winding number of the mesh about p by solid angles (van Oosterom and Strackee 1983).
double winding_about(const TriangleMesh& mesh, const DVec3& p) {
  double sum = 0.0;
  for (std::size_t t = 0; t < mesh.triangle_count(); ++t) {
    DVec3 c[3];
    for (int i = 0; i < 3; ++i) c[i] = glm::normalize(DVec3(mesh.position(mesh.vertex[3 * t + i])) - p);
    const double triple = glm::dot(c[0], glm::cross(c[1], c[2]));
    sum += 2.0 * std::atan2(triple, 1.0 + glm::dot(c[0], c[1]) + glm::dot(c[1], c[2]) + glm::dot(c[2], c[0]));
  }
  return sum / (4.0 * M_PI);
}

/// Rows of differing corners, told by each corner's winding number and value.
void expect_differing_rows(const TriangleMesh& mesh, const BrickLattice& lattice,
                           const std::vector<std::int8_t>& winding) {
  const std::vector<DifferingRow> rows = differing_rows(mesh, lattice, lattice_topology(lattice).signs);
  std::size_t next = 0;
  for (std::size_t r = 0; r < lattice.value.size() / BrickLattice::kCorners; ++r) {
    unsigned corners = 0;
    for (int z = 0; z < BrickLattice::kCorners; ++z) {
      const std::size_t i = r * BrickLattice::kCorners + std::size_t(z);
      corners |= unsigned(winding[i] != (lattice.value[i] > 0.0f ? 1 : 0)) << z;
    }
    if (corners == 0) continue;
    ASSERT_LT(next, rows.size());
    EXPECT_EQ(rows[next].brick * 81 + rows[next].row, r);
    EXPECT_EQ(rows[next++].corners, corners);
  }
  EXPECT_EQ(next, rows.size());
}

void expect_differing_bricks(const TriangleMesh& mesh, const BrickLattice& lattice,
                             const std::vector<std::int8_t>& winding) {
  const DifferingBricks differing = differing_bricks(mesh, lattice, brick_signs(lattice));
  constexpr std::size_t kValues = BrickLattice::kValues;
  for (std::size_t b = 0; b < lattice.brick_count(); ++b) {
    const auto begin = winding.begin() + std::ptrdiff_t(b * kValues);
    bool differs = false;
    for (std::size_t i = 0; i < kValues; ++i) differs |= begin[i] != (lattice.value[b * kValues + i] > 0.0f ? 1 : 0);
    ASSERT_EQ(differing.number[b] != kNone, differs);
    if (!differs) continue;
    EXPECT_EQ(differing.brick[differing.number[b]], b);
    EXPECT_TRUE(std::equal(begin, begin + kValues, differing.winding.begin() + differing.number[b] * kValues));
  }
}

void expect_windings(const TriangleMesh& mesh, const BrickLattice& lattice, std::size_t every) {
  const std::vector<std::int8_t> winding = winding_numbers(mesh, lattice);
  expect_differing_rows(mesh, lattice, winding);
  expect_differing_bricks(mesh, lattice, winding);
  ASSERT_EQ(winding.size(), lattice.value.size());
  for (std::size_t i = 0; i < winding.size(); i += every) {
    const int local = int(i % BrickLattice::kValues);
    const IVec3 corner =
        lattice.coordinate[i / BrickLattice::kValues] * 8 + IVec3(local / 81, local / 9 % 9, local % 9);
    const DVec3 p = lattice.point(corner);
    const double expected = winding_about(mesh, p + DVec3(1e-5));
    bool on_mesh = false;  // then either side will do
    for (int k = 1; k < 8 && !on_mesh; ++k) {
      const DVec3 beside = p + 1e-5 * DVec3(k & 1 ? -1 : 1, k & 2 ? -1 : 1, k & 4 ? -1 : 1);
      on_mesh = std::abs(winding_about(mesh, beside) - expected) > 0.5;
    }
    if (on_mesh) continue;
    EXPECT_EQ(winding[i], int(std::round(expected))) << corner.x << ' ' << corner.y << ' ' << corner.z;
  }
}

}  // namespace

TEST(Winding, EqualsSolidAngles) {
  const Judge sphere(ball({0.01, 0.02, 0.03}, 0.5));
  const TriangleMesh two = together(test_meshes::icosphere(2, 0.5f), test_meshes::torus(14, 9, 0.4f, 0.17f));
  expect_windings(two, sphere.lattice, 31);
  expect_windings(inside_out(test_meshes::icosphere(2, 0.45f)), sphere.lattice, 31);
}

TEST(Winding, ColumnsThroughVerticesAndEdgesAreNoneTheWorse) {
  // Every vertex of the cube is a lattice corner, every edge lies in a lattice plane.
  Judge sphere(std::make_shared<analytic::SphereField>(DVec3(0.0), 1.0), 0.125);
  const TriangleMesh cube = test_meshes::cube(8, 1.0f);
  const std::vector<std::int8_t> winding = winding_numbers(cube, sphere.lattice);
  for (std::size_t i = 0; i < winding.size(); ++i) {
    const int local = int(i % BrickLattice::kValues);
    const IVec3 corner =
        sphere.lattice.coordinate[i / BrickLattice::kValues] * 8 + IVec3(local / 81, local / 9 % 9, local % 9);
    const double reach = std::max({std::abs(corner.x), std::abs(corner.y), std::abs(corner.z)}) * 0.125;
    if (reach != 1.0) {
      EXPECT_EQ(winding[i], reach < 1.0) << reach;
    }
  }
}

TEST(Winding, RandomSoupOfSheetsStaysConsistent) {
  // A closed mesh crumpled beyond recognition still has whole winding numbers that end at 0 above it.
  TriangleMesh mesh = test_meshes::icosphere(3, 0.7f);
  test_meshes::jitter(mesh, 0.4f, 3);
  for (Vec3& p : mesh.vertices.position)  // onto lattice columns
    p = Vec3(std::round(p.x * 20.0f) / 20.0f, std::round(p.y * 20.0f) / 20.0f, p.z);
  Judge sphere(ball(DVec3(0.0), 1.2));
  for (const std::int8_t w : winding_numbers(mesh, sphere.lattice)) EXPECT_LT(std::abs(w), 20);
  expect_windings(mesh, sphere.lattice, 401);
}

/// A split, a flip and a collapse, each where it may be.
void edit_somewhere(TriangleMesh& mesh, std::mt19937& random) {
  const auto anywhere = [&] { return Index(random() % mesh.vertex.size()); };
  split_edge(mesh, anywhere(), 0.5f);
  if (const Index h = anywhere(); can_flip(mesh, h)) flip_edge(mesh, h);
  if (const Index h = anywhere(); link_condition(mesh, h)) collapse_edge(mesh, h, 0.5f);
  compact(mesh);
}

TEST(Certificate, WhatIsRememberedChangesNoReport) {
  Judge sphere(both(ball({-0.7, 0.0, 0.0}, 0.5), ball({0.7, 0.0, 0.0}, 0.6)));
  sphere.lattice.same_as.resize(sphere.lattice.brick_count());
  std::iota(sphere.lattice.same_as.begin(), sphere.lattice.same_as.end(), Index{0});
  const TriangleMesh right = sphere.mesh();
  SideMemory memory;
  MeshPieces pieces_before;
  ShapeSums shape;
  std::mt19937 random(5);
  std::size_t wrong = 0;
  for (int frame = 0; frame < 24; ++frame) {
    TriangleMesh mesh = right;  // now and then dented here or there, within the tolerance or not
    const Vec3 centre = right.position(Index(random() % right.vertex_count()));
    const float depth = float(frame % 3) * 1.2f * float(kTolerance);
    for (Vec3& p : mesh.vertices.position)
      if (glm::distance(p, centre) < 0.25f) p += depth * glm::normalize(Vec3(p.x < 0 ? -0.7f : 0.7f, 0, 0) - p);
    edit_somewhere(mesh, random);
    const MeshPieces pieces = mesh_pieces(mesh);
    const std::shared_ptr<const MeshCopy> before = memory.mesh;
    if (before) {
      const MeshChanges changes = mesh_changes(*before, mesh);
      EXPECT_LT(changes.fresh.size(), mesh.triangle_count() / 2);
      const MeshPieces gone_on = mesh_pieces(mesh, *before, pieces_before, changes);
      EXPECT_EQ(gone_on.of_vertex, pieces.of_vertex);
      EXPECT_EQ(gone_on.euler, pieces.euler);
      EXPECT_EQ(gone_on.volume, pieces.volume);
      shape.update(*before, mesh, changes);
      const ShapeStatistics a = shape.statistics(), b = ShapeSums(mesh, 0.1).statistics();
      EXPECT_EQ(std::tie(a.min_angle, a.p1_angle, a.mean_angle, a.below_10_degrees, a.mean_edge, a.area),
                std::tie(b.min_angle, b.p1_angle, b.mean_angle, b.below_10_degrees, b.mean_edge, b.area));
    } else {
      shape = ShapeSums(mesh, 0.1);
    }
    pieces_before = pieces;
    BrickLattice lattice = sphere.lattice;
    if (frame % 4 == 1) lattice.same_as[random() % lattice.brick_count()] = kNone;
    const SideReport whole = check_sides(mesh, pieces, *sphere.field, lattice, sphere.topology, kTolerance);
    const SideReport again = check_sides(mesh, pieces, *sphere.field, lattice, sphere.topology, kTolerance, &memory);
    EXPECT_EQ(memory.print, column_prints(mesh, lattice));
    EXPECT_EQ(whole.wrong, again.wrong);
    EXPECT_EQ(whole.mesh_piece, again.mesh_piece);
    EXPECT_EQ(whole.lattice_piece, again.lattice_piece);
    wrong += whole.wrong > 0;
  }
  EXPECT_GT(wrong, 4u);
  EXPECT_LT(wrong, 20u);
}

TEST(Certificate, RightMeshesPass) {
  const std::vector<SolidField::Solid> scenes{
      ball({0.1, 0.0, 0.2}, 1.0),
      torus(DVec3(0.0), 1.0, 0.3),
      without(ball(DVec3(0.0), 1.2), ball({0.1, 0.1, 0.0}, 0.5)),
      both(ball({-0.7, 0.0, 0.0}, 0.5), ball({0.7, 0.0, 0.0}, 0.6)),
      both(torus(DVec3(0.0), 1.0, 0.2), ball(DVec3(0.0), 0.12)),
      without(plate(DVec3(0.0), 1.2, 0.08), rod({0, 0, -1}, {0, 0, 1}, 0.11)),
  };
  for (std::size_t i = 0; i < scenes.size(); ++i) {
    SCOPED_TRACE(i);
    const Judge judge(scenes[i]);
    for (const double spacing : {0.025, 0.05, 0.07}) {
      const Certificate c = judge.judge(mesh_of(scenes[i], spacing));
      EXPECT_TRUE(c.passed) << c.summary();
      EXPECT_GT(c.corners_checked, 1000u);
      EXPECT_EQ(c.wrong_side, 0u);
    }
  }
}

TEST(Certificate, ACoarseMeshMayCutCornersWithinTheTolerance) {
  const Judge judge(ball(DVec3(0.0), 1.0));
  EXPECT_TRUE(judge.judge(test_meshes::icosphere(2)).passed);
  EXPECT_FALSE(judge.judge(test_meshes::icosphere(0)).passed);  // an icosahedron: off by a fifth of the radius
}

TEST(Certificate, PiecesAgreeWithLabelledVoxels) {
  std::mt19937 random(11);
  std::uniform_real_distribution<double> place(-1.1, 1.1), radius(0.12, 0.4);
  int judged = 0;
  for (int scene = 0; scene < test::repeats(16, 3); ++scene) {
    SolidField::Solid s = ball(DVec3(0.0), 0.3);
    for (int i = 0; i < 14; ++i) {
      const DVec3 c(place(random), place(random), place(random));
      s = i % 4 == 3 ? without(s, ball(c, radius(random))) : both(s, ball(c, radius(random)));
    }
    const Judge judge(s, 0.04);
    const DigitalTopology expected = digital_topology(*judge.field, kBounds, 0.04);
    const digital::Lattice voxels = digital::sample(*judge.field, kBounds, 0.04);
    // Where voxels touch only at corners or edges, the answer depends on what one calls connected, and on their size.
    if (digital::pieces(voxels, true, false, false) != expected.components ||
        digital::pieces(voxels, false, true, true) != expected.cavities)
      continue;
    const DigitalTopology finer = digital_topology(*judge.field, kBounds, 0.025);
    if (finer.components != expected.components || finer.handles() != expected.handles()) continue;
    ++judged;
    int shells = 0, cavities = 0, handles = 0;
    for (std::size_t p = 0; p < judge.topology.piece_count(); ++p) {
      ++(judge.topology.volume[p] > 0 ? shells : cavities);
      handles += 1 - judge.topology.euler[p] / 2;
    }
    EXPECT_EQ(shells, expected.components);
    EXPECT_EQ(cavities, expected.cavities);
    EXPECT_EQ(handles, expected.handles());
    EXPECT_TRUE(judge.judge(judge.mesh()).passed);
  }
  EXPECT_GE(judged, test::repeats(5, 1));
}

TEST(Certificate, DeletedPieceIsMissing) {
  const auto left = ball({-0.7, 0.0, 0.0}, 0.5), right = ball({0.7, 0.0, 0.0}, 0.6);
  const Judge judge(both(left, right));
  const Certificate c = judge.judge(mesh_of(left));
  EXPECT_FALSE(c.passed);
  EXPECT_GT(c.wrong_side, 100u);
  EXPECT_EQ(c.mesh_piece, std::vector<Fault>{Fault::none});
  EXPECT_EQ(c.lattice_piece, (std::vector<Fault>{Fault::none, Fault::missing}));
  const Certificate nothing = judge.judge(TriangleMesh{});
  EXPECT_EQ(nothing.lattice_piece, (std::vector<Fault>{Fault::missing, Fault::missing}));
}

TEST(Certificate, SmallPiecesMayBeMissingUnlessACornerTellsSo) {
  const auto big = ball({-0.7, 0.0, 0.0}, 0.5);
  const Judge mist(both(big, ball({0.7, 0.0, 0.0}, 0.09)));  // nowhere deeper than the tolerance
  EXPECT_FALSE(mist.judge(mesh_of(big)).passed);
  EXPECT_TRUE(mist.judge(mesh_of(big), 0.01).passed);
  EXPECT_TRUE(mist.judge(mist.mesh(), 0.01).passed);
  const Judge drop(both(big, ball({0.7, 0.0, 0.0}, 0.2)));
  EXPECT_FALSE(drop.judge(mesh_of(big), 1.0).passed);
}

TEST(Certificate, DuplicatedSheetIsSplit) {
  const Judge judge(ball(DVec3(0.0), 1.0));
  const TriangleMesh sphere = test_meshes::icosphere(4);
  for (const float shift : {0.0f, 0.01f, 0.2f}) {
    const Certificate c = judge.judge(together(sphere, moved(sphere, Vec3(shift))));
    EXPECT_FALSE(c.passed);
    EXPECT_GT(c.wrong_side, 1000u);  // wound about twice
    EXPECT_EQ(c.mesh_piece, (std::vector<Fault>{Fault::split, Fault::split}));
    EXPECT_EQ(c.lattice_piece, std::vector<Fault>{Fault::split});
  }
}

TEST(Certificate, DropletsFarFromAnySurfaceAreSpurious) {
  const Judge judge(ball({-0.5, 0.0, 0.0}, 1.0));
  const TriangleMesh sphere = judge.mesh();
  const std::vector<Fault> expected{Fault::none, Fault::spurious};
  for (const float x : {3.0f, 40.0f, -0.5f})
    for (const bool flipped : {false, true}) {
      const TriangleMesh drop = test_meshes::icosphere(2, 0.3f, Vec3(x, 0.0f, 0.0f));
      const Certificate c = judge.judge(together(sphere, flipped ? inside_out(drop) : drop));
      EXPECT_FALSE(c.passed);
      EXPECT_EQ(c.mesh_piece, expected) << x;
      EXPECT_EQ(c.lattice_piece, std::vector<Fault>{Fault::none});
      EXPECT_GT(c.wrong_side, 10u);
    }
  // too small to hold a corner
  const Certificate dust = judge.judge(together(sphere, test_meshes::icosphere(0, 0.004f, Vec3(1.02f, 0.02f, 0.02f))));
  EXPECT_FALSE(dust.passed);
  EXPECT_EQ(dust.mesh_piece, expected);
}

TEST(Certificate, FlippedPieceIsOnTheWrongSide) {
  const Judge judge(torus(DVec3(0.0), 1.0, 0.3));
  const Certificate c = judge.judge(inside_out(judge.mesh()));
  EXPECT_FALSE(c.passed);
  EXPECT_EQ(c.mesh_piece, std::vector<Fault>{Fault::wrong_side});
}

TEST(Certificate, ShiftedPieceIsOnTheWrongSide) {
  const Judge judge(ball(DVec3(0.0), 1.0));
  EXPECT_TRUE(judge.judge(moved(judge.mesh(), Vec3(0.06f, 0.0f, 0.0f))).passed);
  const Certificate c = judge.judge(moved(judge.mesh(), Vec3(0.25f, 0.0f, 0.0f)));
  EXPECT_FALSE(c.passed);
  EXPECT_NE(c.mesh_piece[0], Fault::none);
  EXPECT_NE(c.lattice_piece[0], Fault::none);
}

TEST(Certificate, MergedAndSplitPieces) {
  const auto balls = both(ball({-0.58, 0.0, 0.0}, 0.5), ball({0.58, 0.0, 0.0}, 0.5));
  const auto dumbbell = both(balls, rod({-0.58, 0, 0}, {0.58, 0, 0}, 0.09));
  const Certificate merged = Judge(balls).judge(mesh_of(dumbbell));
  EXPECT_EQ(merged.mesh_piece, std::vector<Fault>{Fault::merged});
  EXPECT_EQ(merged.lattice_piece, (std::vector<Fault>{Fault::merged, Fault::merged}));
  EXPECT_EQ(merged.wrong_side, 0u);  // the bridge is too thin to tell by sides
  const Certificate split = Judge(dumbbell).judge(mesh_of(balls));
  EXPECT_EQ(split.mesh_piece, (std::vector<Fault>{Fault::split, Fault::split}));
  EXPECT_EQ(split.lattice_piece, std::vector<Fault>{Fault::split});
}

TEST(Certificate, HandlesTooSmallForSidesShowInTheEulerCharacteristic) {
  const auto sheet = plate(DVec3(0.0), 1.2, 0.08);
  const auto torn = without(sheet, rod({0, 0, -1}, {0, 0, 1}, 0.07));
  const Certificate filled = Judge(torn).judge(mesh_of(sheet));
  EXPECT_EQ(filled.wrong_side, 0u);
  EXPECT_EQ(filled.mesh_piece, std::vector<Fault>{Fault::euler});
  const Certificate pierced = Judge(sheet).judge(mesh_of(torn));
  EXPECT_EQ(pierced.wrong_side, 0u);
  EXPECT_EQ(pierced.lattice_piece, std::vector<Fault>{Fault::euler});
}

TEST(Certificate, FaultsOfOnePieceLeaveTheOthersAlone) {
  const auto rest = both(torus(DVec3(0.0), 1.2, 0.2), ball({0.0, 0.0, 1.2}, 0.25));
  const Judge judge(both(rest, ball(DVec3(0.0), 0.6)));
  const Certificate c = judge.judge(together(mesh_of(rest), test_meshes::torus(24, 12, 0.4f, 0.2f)));
  EXPECT_FALSE(c.passed);
  EXPECT_EQ(std::count(c.mesh_piece.begin(), c.mesh_piece.end(), Fault::none), 2);
  EXPECT_EQ(std::count(c.lattice_piece.begin(), c.lattice_piece.end(), Fault::none), 2);
}

TEST(Certificate, NothingIsRightAboutNothing) {
  const Judge judge(ball(DVec3(0.0), -1.0));
  EXPECT_TRUE(judge.judge(TriangleMesh{}).passed);
  EXPECT_FALSE(judge.judge(test_meshes::icosphere(2)).passed);
}

TEST(Certificate, SameWhateverTheNumberOfThreads) {
  const Judge judge(both(torus(DVec3(0.0), 1.0, 0.3), ball({0.0, 0.0, 1.2}, 0.25)));
  const TriangleMesh mesh = together(judge.mesh(), test_meshes::torus(24, 12, 0.4f, 0.2f));
  const Certificate many = judge.judge(mesh);
  const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
  const Certificate single = judge.judge(mesh);
  EXPECT_EQ(many.summary(), single.summary());
  EXPECT_EQ(many.mesh_piece, single.mesh_piece);
  EXPECT_EQ(many.lattice_piece, single.lattice_piece);
}
