#include "core/topology/repair.h"

#include <cmath>
#include <random>
#include <set>

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include "core/io/sequence.h"
#include "core/mesh/validate.h"
#include "sanitized.h"
#include "solid_field.h"
#include "test_meshes.h"

using namespace isoskin;
using namespace isoskin::solid;

namespace {

const Box kBounds{DVec3(-1.6), DVec3(1.6)};

struct Shop {
  std::shared_ptr<const Field> field;
  std::unique_ptr<Backend> backend = make_reference_backend();
  double e;
  BrickLattice lattice;
  LatticeTopology topology;
  AlterOptions alter;
  RelaxOptions relax;
  ProjectOptions project;
  SettleOptions settle;
  CertifyOptions certify;

  Shop(std::shared_ptr<const Field> f, double edge, double spacing) : field(std::move(f)), e(edge) {
    backend->set_field(field);
    lattice = sample_lattice(*field, *backend, spacing);
    topology = lattice_topology(lattice);
    alter.edge_length = relax.edge_length = float(e);
    project.tolerance = float(1e-4 * e);
    project.max_step = float(0.5 * e);
    certify.tolerance = 2.0 * spacing;
  }
  explicit Shop(SolidField::Solid s, double edge = 0.12)
      : Shop(std::make_shared<SolidField>(std::move(s), kBounds), edge, edge / 3.0) {}

  Certificate judge(const TriangleMesh& mesh) const {
    return isoskin::certify(mesh, mesh_pieces(mesh), *field, lattice, topology, certify);
  }
  RepairReport repair(TriangleMesh& mesh) {
    const MeshPieces pieces = mesh_pieces(mesh);
    return reextract(mesh, pieces, judge(mesh), lattice, topology, *backend, alter, relax, project, settle);
  }
  void expect_right(const TriangleMesh& mesh) const {
    EXPECT_TRUE(validate(mesh)) << validate(mesh).reason;
    const Certificate c = judge(mesh);
    EXPECT_TRUE(c.passed) << c.summary();
  }
};

SolidField::Solid blobs(unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> place(-1.1, 1.1), radius(0.03, 0.4);
  SolidField::Solid s = ball(DVec3(0.0), 0.3);
  for (int i = 0; i < 14; ++i) s = both(s, ball(DVec3(place(random), place(random), place(random)), radius(random)));
  return s;
}

TriangleMesh moved(TriangleMesh mesh, const Vec3& by) {
  for (Vec3& p : mesh.vertices.position) p += by;
  return mesh;
}

}  // namespace

TEST(Reextract, FirstFrameGivesNearEquilateralSkins) {
  for (const auto& s : {ball(DVec3(0.0), 1.0), torus(DVec3(0.0), 1.0, 0.35)}) {
    Shop shop(s);
    TriangleMesh mesh;
    const RepairReport report = shop.repair(mesh);
    EXPECT_EQ(report.pieces_removed, 0u);
    EXPECT_EQ(report.pieces_extracted, 1u);
    shop.expect_right(mesh);
    const ShapeStatistics shape = shape_statistics(mesh);
    EXPECT_NEAR(report.area_reextracted, shape.area, 1e-6 * shape.area);
    EXPECT_GT(shape.mean_angle, 48.0);
    EXPECT_GT(shape.min_angle, 15.0);
    EXPECT_NEAR(shape.mean_edge, shop.e, 0.15 * shop.e);
    for (std::size_t v = 0; v < mesh.vertex_count(); ++v) {
      EXPECT_LT(std::abs(shop.field->value(DVec3(mesh.position(v)))), 1e-3 * shop.e);
      EXPECT_EQ(mesh.vertices.rest[v], mesh.position(v));
      EXPECT_EQ(mesh.vertices.velocity[v], Vec3(0.0f));
    }
  }
}

TEST(Reextract, ManyBlobsOfAllSizes) {
  for (unsigned seed = 0; seed < unsigned(test::repeats(6, 3)); ++seed) {
    SCOPED_TRACE(seed);
    Shop shop(blobs(seed));
    TriangleMesh mesh;
    EXPECT_EQ(shop.repair(mesh).pieces_extracted, shop.topology.piece_count());
    EXPECT_TRUE(validate(mesh)) << validate(mesh).reason;
    const MeshPieces pieces = mesh_pieces(mesh);
    EXPECT_EQ(pieces.count(), shop.topology.piece_count());
    const auto cavities = [](const std::vector<double>& volumes) {
      return std::count_if(volumes.begin(), volumes.end(), [](double v) { return v < 0.0; });
    };
    EXPECT_EQ(cavities(pieces.volume), cavities(shop.topology.volume));  // nothing is inverted
  }
}

TEST(Reextract, PiecesSmallerThanAnEdgeSurvive) {
  // From a single lattice corner inside up to an edge across.
  for (const double radius : {0.012, 0.03, 0.06, 0.1}) {
    SCOPED_TRACE(radius);
    Shop shop(both(ball({0.5, 0.0, 0.0}, 0.4), ball({-0.8, 0.0, 0.0}, radius)));
    TriangleMesh mesh;
    shop.repair(mesh);
    ASSERT_TRUE(validate(mesh)) << validate(mesh).reason;
    const MeshPieces pieces = mesh_pieces(mesh);
    ASSERT_EQ(pieces.count(), 2u);
    for (std::size_t p = 0; p < 2; ++p) {
      EXPECT_EQ(pieces.euler[p], 2);
      EXPECT_GT(pieces.volume[p], 0.0);
    }
  }
}

TEST(Reextract, OnlyFailedPiecesChange) {
  Shop shop(both(torus(DVec3(0.0), 1.2, 0.2), ball(DVec3(0.0), 0.5)));
  TriangleMesh mesh;
  shop.repair(mesh);
  shop.expect_right(mesh);
  TriangleMesh damaged = mesh;
  const MeshPieces pieces = mesh_pieces(mesh);
  ASSERT_EQ(pieces.count(), 2u);
  for (std::size_t v = 0; v < mesh.vertex_count(); ++v) {
    damaged.vertices.rest[v] += Vec3(5.0f, 0.0f, 0.0f);
    damaged.vertices.velocity[v] = Vec3(0.0f, 1.0f, 2.0f);
    if (pieces.euler[pieces.of_vertex[v]] == 2) damaged.vertices.position[v] *= 0.3f;
  }
  TriangleMesh repaired = damaged;
  const RepairReport report = shop.repair(repaired);
  EXPECT_EQ(report.pieces_removed, 1u);
  EXPECT_EQ(report.pieces_extracted, 1u);
  shop.expect_right(repaired);
  std::set<Index> old_ids(mesh.vertices.id.begin(), mesh.vertices.id.end());
  std::size_t survived = 0;
  for (std::size_t v = 0; v < repaired.vertex_count(); ++v) {
    EXPECT_LT(glm::distance(repaired.vertices.velocity[v], Vec3(0.0f, 1.0f, 2.0f)), 1e-5f);  // carried over
    if (!old_ids.count(repaired.vertices.id[v])) continue;
    ++survived;
    const auto at =
        std::size_t(std::find(damaged.vertices.id.begin(), damaged.vertices.id.end(), repaired.vertices.id[v]) -
                    damaged.vertices.id.begin());
    EXPECT_EQ(repaired.position(v), damaged.position(at));
    EXPECT_EQ(repaired.vertices.rest[v], damaged.vertices.rest[at]);
  }
  EXPECT_EQ(survived, std::size_t(std::count_if(pieces.of_vertex.begin(), pieces.of_vertex.end(),
                                                [&](Index p) { return pieces.euler[p] == 0; })));
}

TEST(Reextract, NothingSurvivesAndNothingToExtract) {
  Shop empty(ball(DVec3(0.0), -1.0));
  TriangleMesh mesh = test_meshes::icosphere(2);
  const Index next = mesh.next_id;
  const RepairReport report = empty.repair(mesh);
  EXPECT_EQ(report.pieces_removed, 1u);
  EXPECT_EQ(report.pieces_extracted, 0u);
  EXPECT_EQ(report.area_reextracted, 0.0);
  EXPECT_TRUE(mesh.empty());
  EXPECT_EQ(mesh.next_id, next);  // ids are never given twice
  EXPECT_TRUE(empty.judge(mesh).passed);
  empty.repair(mesh);
  EXPECT_TRUE(mesh.empty());

  Shop sphere(ball(DVec3(0.0), 1.0));
  TriangleMesh away = moved(test_meshes::icosphere(3), Vec3(5.0f, 0.0f, 0.0f));
  sphere.repair(away);
  sphere.expect_right(away);
  for (const Index id : away.vertices.id) EXPECT_GE(id, test_meshes::icosphere(3).next_id);
}

TEST(Reextract, WithoutCoarseningTheExtractedTrianglesStay) {
  Shop shop(torus(DVec3(0.0), 1.0, 0.3));
  shop.settle.coarsening = 0.0f;
  TriangleMesh mesh;
  shop.repair(mesh);
  shop.expect_right(mesh);
  EXPECT_EQ(mesh.vertex, marching_cubes(shop.lattice, shop.topology).vertex);
}

TEST(Reextract, SameBytesWhateverTheNumberOfThreads) {
  TriangleMesh many, single;
  Shop(blobs(3)).repair(many);
  const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
  Shop(blobs(3)).repair(single);
  EXPECT_EQ(many.vertex, single.vertex);
  EXPECT_EQ(many.vertices.position, single.vertices.position);
  EXPECT_EQ(many.vertices.id, single.vertices.id);
}

TEST(Reextract, ARealFluidIsCertifiedAfterwards) {
  const auto field = load_grid(ISOSKIN_TEST_DATA "/dam_break/dam_break.0034.vdb", {});
  const double h = field->resolution();
  Shop shop(field, 1.5 * h, 0.5 * h);
  shop.settle.rounds = 4;
  shop.certify = {h, 27.0 * h * h * h};
  TriangleMesh mesh;
  shop.repair(mesh);
  shop.expect_right(mesh);
  EXPECT_GT(shape_statistics(mesh).mean_angle, 47.0);
}
