#include "core/sampling/marching_cubes.h"

#include <cmath>
#include <numeric>
#include <random>
#include <utility>

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include "core/mesh/validate.h"
#include "core/sampling/cell_shapes.h"
#include "dense_lattice.h"

using namespace isoskin;
using dense::to_lattice;
using dense::Values;

namespace {

/// Volumes of the lattice's pieces as they are defined, by the vertices of marching cubes, whose places on lattice
/// edges tell where the surface crosses them.
std::vector<double> volumes_by_lines(const TriangleMesh& mesh, const std::vector<Index>& piece, const Values& values,
                                     std::size_t pieces, double spacing, const DVec3& origin) {
  std::vector<double> volumes(pieces, 0.0);
  for (Index v = 0; v < mesh.vertex_count(); ++v) {
    const DVec3 q = (DVec3(mesh.position(v)) - origin) / spacing;
    const DVec3 off = glm::abs(q - glm::round(q));
    const int axis = off.x > off.y && off.x > off.z ? 0 : off.y > off.z ? 1 : 2;
    if (std::max(off[(axis + 1) % 3], off[(axis + 2) % 3]) > 1e-3) continue;  // the centre of a loop
    IVec3 low(glm::round(q));
    low[axis] = int(std::floor(q[axis]));
    volumes[piece[v]] += (values.at(low) > 0 ? q[axis] : -q[axis]) / 3.0 * std::pow(spacing, 3);
  }
  return volumes;
}

/// Everything that must hold whatever the values: a closed oriented manifold that agrees with the topology, whose
/// pieces are the interfaces between the labelled sets.
void expect_consistent(const Values& values, bool separated) {
  const BrickLattice lattice = to_lattice(values, 0.25, DVec3(-1.0, 2.0, 0.5), IVec3(-1));
  const LatticeTopology topology = lattice_topology(lattice);
  std::vector<Index> piece_of_vertex;
  const TriangleMesh mesh = marching_cubes(lattice, topology, {}, 7, &piece_of_vertex);
  const ValidateReport report = validate(mesh);
  ASSERT_TRUE(report) << report.reason;

  const dense::Labelling sets = dense::label(values);
  ASSERT_EQ(topology.piece_count(), std::size_t(sets.inside + sets.outside - 1));
  const MeshPieces pieces = mesh_pieces(mesh);
  ASSERT_EQ(pieces.count(), topology.piece_count());
  const std::vector<double> volumes =
      volumes_by_lines(mesh, piece_of_vertex, values, topology.piece_count(), 0.25, DVec3(-1.0, 2.0, 0.5) - 2.0);
  long long euler = 0;
  std::vector<std::uint8_t> seen(pieces.count());
  for (Index v = 0; v < mesh.vertex_count(); ++v) {
    const Index m = pieces.of_vertex[v], l = piece_of_vertex[v];
    if (std::exchange(seen[m], 1)) continue;
    EXPECT_EQ(pieces.euler[m], topology.euler[l]);
    EXPECT_NEAR(volumes[l], topology.volume[l], 1e-5);
    EXPECT_EQ(pieces.volume[m] > 0, topology.volume[l] > 0);
    euler += topology.euler[l];
  }
  for (Index v = 0; v < mesh.vertex_count(); ++v) {
    // all vertices of a mesh piece belong to one lattice piece
    EXPECT_EQ(pieces.euler[pieces.of_vertex[v]], topology.euler[piece_of_vertex[v]]);
    const Box box = topology.box[piece_of_vertex[v]].grown(1e-6);
    const DVec3 p(mesh.position(v));
    EXPECT_TRUE(glm::all(glm::greaterThanEqual(p, box.low)) && glm::all(glm::lessThanEqual(p, box.high)));
    EXPECT_EQ(mesh.vertices.id[v], 7 + v);
  }
  if (separated) {
    EXPECT_EQ(euler, 2 * dense::euler_of_separated_inside(values));
  }
}

}  // namespace

TEST(MarchingCubes, EverySignPatternOfACellIsAClosedManifoldOfTheRightTopology) {
  for (int signs = 1; signs < 256; ++signs) {
    Values values(1, [&](const IVec3& c) {
      const IVec3 d = c - 3;
      const bool in_cell = glm::all(glm::greaterThanEqual(d, IVec3(0))) && glm::all(glm::lessThan(d, IVec3(2)));
      return in_cell && (signs >> (d.x | d.y << 1 | d.z << 2) & 1) ? 1.0f : -1.0f;
    });
    SCOPED_TRACE(signs);
    expect_consistent(values, true);
  }
}

TEST(MarchingCubes, RandomSignsGiveAClosedManifoldOfTheRightTopology) {
  std::mt19937 random(1);
  for (const double density : {0.02, 0.2, 0.5, 0.8, 0.98}) {
    std::bernoulli_distribution inside(density);
    Values values(3);
    for (std::size_t i = 0; i < values.value.size(); ++i)
      if (!values.on_border(values.corner(i))) values.value[i] = inside(random) ? 1.0f : -1.0f;
    SCOPED_TRACE(density);
    expect_consistent(values, true);
  }
}

TEST(MarchingCubes, RandomValuesResolveAmbiguousFacesBySaddles) {
  std::mt19937 random(2);
  for (const float shift : {-0.8f, -0.3f, 0.0f, 0.3f, 0.8f}) {
    std::uniform_real_distribution<float> value(-1.0f, 1.0f);
    Values values(3);
    for (std::size_t i = 0; i < values.value.size(); ++i)
      if (!values.on_border(values.corner(i))) values.value[i] = value(random) + shift;
    SCOPED_TRACE(shift);
    expect_consistent(values, false);
  }
}

TEST(MarchingCubes, SmoothSheetsThroughManyBricks) {
  std::mt19937 random(11);
  std::uniform_real_distribution<double> wave(-0.7, 0.7), phase(0.0, 6.0);
  for (const double slower : {1.0, 2.0, 4.0}) {  // from several parts a brick to one
    std::array<glm::dvec4, 6> waves;
    for (glm::dvec4& w : waves) w = glm::dvec4(DVec3(wave(random), wave(random), wave(random)) / slower, phase(random));
    Values values(3);
    for (std::size_t i = 0; i < values.value.size(); ++i) {
      const glm::dvec4 at(DVec3(values.corner(i)), 1.0);
      if (values.on_border(values.corner(i))) continue;
      values.value[i] = 0.0f;
      for (const glm::dvec4& w : waves) values.value[i] += float(std::sin(glm::dot(w, at)));
    }
    SCOPED_TRACE(slower);
    expect_consistent(values, false);
  }
}

TEST(MarchingCubes, TunnelsThroughCellsOfTwoLoops) {
  std::mt19937 random(7);
  std::normal_distribution<float> value;
  for (int scene = 0; scene < 4; ++scene) {
    Values values(2);
    for (std::size_t i = 0; i < values.value.size(); ++i)
      if (!values.on_border(values.corner(i))) values.value[i] = value(random) + 0.5f * float(scene) - 0.75f;
    BrickLattice lattice = to_lattice(values, 0.25, DVec3(-1.0), IVec3(-2));
    const LatticeTopology discs = lattice_topology(lattice);
    std::size_t tunnels = 0;
    for (Index b = 0; b < lattice.brick_count(); ++b)
      for (const SurfaceCell& cell : discs.cells[b]) {
        if (shape(cell.shape).loops != 2) continue;
        const int c = cell.cell;
        lattice.tunnel.push_back(
            BrickLattice::face_key(lattice.coordinate[b] * 8 + IVec3(c / 64, c / 8 % 8, c % 8), 3));
        ++tunnels;
      }
    std::sort(lattice.tunnel.begin(), lattice.tunnel.end());
    ASSERT_GT(tunnels, 20u);
    const LatticeTopology topology = lattice_topology(lattice);
    const TriangleMesh mesh = marching_cubes(lattice, topology);
    const ValidateReport report = validate(mesh);
    ASSERT_TRUE(report) << report.reason;
    const MeshPieces pieces = mesh_pieces(mesh);
    ASSERT_EQ(pieces.count(), topology.piece_count());
    const auto sum = [](const std::vector<int>& euler) { return std::accumulate(euler.begin(), euler.end(), 0LL); };
    EXPECT_EQ(sum(topology.euler), sum(discs.euler) - 2 * static_cast<long long>(tunnels));
    std::vector<int> of_mesh = pieces.euler, of_lattice = topology.euler;
    std::sort(of_mesh.begin(), of_mesh.end());
    std::sort(of_lattice.begin(), of_lattice.end());
    EXPECT_EQ(of_mesh, of_lattice);
    EXPECT_NEAR(std::accumulate(discs.volume.begin(), discs.volume.end(), 0.0),
                std::accumulate(topology.volume.begin(), topology.volume.end(), 0.0), 1e-9);  // no crossing has moved
  }
}

TEST(MarchingCubes, ZeroAndDenormalValuesAreHarmless) {
  std::mt19937 random(3);
  const float choice[] = {0.0f, -0.0f, 1e-42f, -1e-42f, 1.0f, -1.0f, 1e30f};
  std::uniform_int_distribution<int> pick(0, 6);
  Values values(2);
  for (std::size_t i = 0; i < values.value.size(); ++i)
    if (!values.on_border(values.corner(i))) values.value[i] = choice[pick(random)];
  const BrickLattice lattice = to_lattice(values);
  const ValidateReport report = validate(marching_cubes(lattice, lattice_topology(lattice)));
  EXPECT_TRUE(report) << report.reason;
}

TEST(MarchingCubes, SphereHasItsVolumeAndPointsOutwards) {
  const double radius = 9.3;
  const Values values(3,
                      [&](const IVec3& c) { return float(radius - glm::length(DVec3(c) - DVec3(12.1, 11.8, 12.3))); });
  const BrickLattice lattice = to_lattice(values);
  const LatticeTopology topology = lattice_topology(lattice);
  ASSERT_EQ(topology.piece_count(), 1u);
  EXPECT_EQ(topology.euler[0], 2);
  EXPECT_NEAR(topology.volume[0], 4.0 / 3.0 * M_PI * std::pow(radius, 3), 0.01 * topology.volume[0]);
  const TriangleMesh mesh = marching_cubes(lattice, topology);
  for (std::size_t t = 0; t < mesh.triangle_count(); ++t) {
    const DVec3 a(mesh.position(mesh.vertex[3 * t])), b(mesh.position(mesh.vertex[3 * t + 1])),
        c(mesh.position(mesh.vertex[3 * t + 2]));
    EXPECT_GT(glm::dot(glm::cross(b - a, c - a), (a + b + c) / 3.0 - DVec3(12.1, 11.8, 12.3)), 0.0);
  }
}

TEST(MarchingCubes, TorusCavityAndDropletAreCountedApart) {
  const Values values(4, [&](const IVec3& c) {
    const DVec3 p = DVec3(c) - DVec3(16.03, 15.97, 12.01);
    const double torus = 3.0 - std::hypot(std::hypot(p.x, p.y) - 9.0, p.z);
    const double bubble = std::hypot(std::hypot(p.x - 9.0, p.y), p.z) - 1.6;
    const double drop = 2.0 - glm::length(p - DVec3(0, 0, 10));
    return float(std::max(std::min(torus, bubble), drop));
  });
  const LatticeTopology topology = lattice_topology(to_lattice(values));
  ASSERT_EQ(topology.piece_count(), 3u);
  std::vector<std::pair<int, bool>> kinds;
  for (std::size_t p = 0; p < 3; ++p) kinds.emplace_back(topology.euler[p], topology.volume[p] > 0);
  std::sort(kinds.begin(), kinds.end());
  EXPECT_EQ(kinds, (std::vector<std::pair<int, bool>>{{0, true}, {2, false}, {2, true}}));
}

TEST(MarchingCubes, ExtractsOnlyTheWantedPieces) {
  const Values values(2, [&](const IVec3& c) {
    return float(std::max(2.2 - glm::length(DVec3(c) - DVec3(4)), 3.1 - glm::length(DVec3(c) - DVec3(11.2))));
  });
  const BrickLattice lattice = to_lattice(values);
  const LatticeTopology topology = lattice_topology(lattice);
  ASSERT_EQ(topology.piece_count(), 2u);
  for (std::size_t p = 0; p < 2; ++p) {
    std::vector<std::uint8_t> wanted(2, 0);
    wanted[p] = 1;
    const TriangleMesh mesh = marching_cubes(lattice, topology, wanted);
    EXPECT_TRUE(validate(mesh)) << validate(mesh).reason;
    const MeshPieces pieces = mesh_pieces(mesh);
    ASSERT_EQ(pieces.count(), 1u);
    EXPECT_NEAR(pieces.volume[0], topology.volume[p], 0.1 * topology.volume[p]);
  }
}

TEST(MarchingCubes, FindsPatchesAndCrossingsByCellAndEdge) {
  const Values values(2, [&](const IVec3& c) { return float(5.3 - glm::length(DVec3(c) - DVec3(8.2, 7.9, 8.1))); });
  const BrickLattice lattice = to_lattice(values);
  const LatticeTopology topology = lattice_topology(lattice);
  std::size_t crossings = 0;
  for (Index b = 0; b < lattice.brick_count(); ++b) {
    for (int i = 0; i < 512; ++i) {
      const IVec3 low = lattice.coordinate[b] * 8 + IVec3(i / 64, i / 8 % 8, i % 8);
      int inside = 0, patches = 0;
      for (int c = 0; c < 8; ++c) inside += values.at(low + IVec3(c & 1, c >> 1 & 1, c >> 2)) > 0;
      topology.for_pieces_in_cell(b, i, [&](Index piece) {
        EXPECT_EQ(piece, 0u);
        ++patches;
      });
      EXPECT_EQ(patches, inside % 8 != 0);
    }
    for (int i = 0; i < 729; ++i)
      for (int axis = 0; axis < 3; ++axis) {
        const IVec3 corner(i / 81, i / 9 % 9, i % 9);
        IVec3 end = lattice.coordinate[b] * 8 + corner;
        const bool p = values.at(end) > 0;
        ++end[axis];
        if (corner[axis] == 8 || end[axis] >= values.corners) continue;
        const Index c = topology.crossing(b, corner, axis);
        EXPECT_EQ(c != kNone, p != (values.at(end) > 0));
        if (c != kNone && glm::all(glm::lessThan(corner, IVec3(8)))) ++crossings;
      }
  }
  EXPECT_EQ(crossings, topology.crossing_count);
}

TEST(MarchingCubes, SurfaceThatLeavesTheLatticeIsAnError) {
  const Values values(1, [](const IVec3& c) { return c.x < 4 ? 1.0f : -1.0f; });
  EXPECT_THROW(lattice_topology(to_lattice(values)), std::invalid_argument);
}

TEST(MarchingCubes, SameBytesWhateverTheNumberOfThreads) {
  std::mt19937 random(5);
  std::normal_distribution<float> value;
  Values values(4);
  for (std::size_t i = 0; i < values.value.size(); ++i)
    if (!values.on_border(values.corner(i))) values.value[i] = value(random);
  const BrickLattice lattice = to_lattice(values);
  const LatticeTopology many = lattice_topology(lattice);
  const TriangleMesh mesh = marching_cubes(lattice, many);
  const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
  const LatticeTopology single = lattice_topology(lattice);
  EXPECT_EQ(many.part_piece, single.part_piece);
  EXPECT_EQ(many.volume, single.volume);
  const TriangleMesh again = marching_cubes(lattice, single);
  EXPECT_EQ(mesh.vertex, again.vertex);
  EXPECT_EQ(mesh.vertices.position, again.vertices.position);
}

TEST(MarchingCubes, EmptyLatticeGivesAnEmptyMesh) {
  const BrickLattice lattice;
  const LatticeTopology topology = lattice_topology(lattice);
  EXPECT_EQ(topology.piece_count(), 0u);
  EXPECT_TRUE(marching_cubes(lattice, topology).empty());
}
