#include "core/sampling/brick_lattice.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <random>
#include <tuple>

#include <gtest/gtest.h>

#include "analytic_fields.h"
#include "core/field/brick_builder.h"
#include "core/field/grid_field.h"
#include "core/field/skeleton_field.h"
#include "core/sampling/marching_cubes.h"
#include "core/sampling/plain_grid.h"
#include "core/topology/match.h"
#include "sanitized.h"

using namespace isoskin;

namespace {

struct LessCorner {
  bool operator()(const IVec3& a, const IVec3& b) const { return std::tie(a.x, a.y, a.z) < std::tie(b.x, b.y, b.z); }
};

IVec3 local_corner(int i) {
  return {i / 81, i / 9 % 9, i % 9};
}

/// Bricks are sorted and found; shared corners are equal bit for bit; every edge of mixed sign has its four cells; and
/// at the corners of space that no brick covers F keeps its sign.
void expect_sound(const BrickLattice& lattice, const Field& field, const Box& box) {
  std::map<IVec3, float, LessCorner> value;
  for (Index b = 0; b < lattice.brick_count(); ++b) {
    ASSERT_EQ(lattice.find(lattice.coordinate[b]), b);
    if (b > 0) {
      ASSERT_TRUE(LessCorner()(lattice.coordinate[b - 1], lattice.coordinate[b]));
    }
    for (int i = 0; i < BrickLattice::kValues; ++i) {
      const float v = lattice.value[std::size_t{b} * BrickLattice::kValues + i];
      const auto [at, fresh] = value.emplace(lattice.coordinate[b] * 8 + local_corner(i), v);
      ASSERT_EQ(at->second, v);
    }
  }
  ASSERT_EQ(lattice.find(IVec3(1 << 19)), kNone);
  const auto has_cell = [&](const IVec3& c) { return lattice.find({c.x >> 3, c.y >> 3, c.z >> 3}) != kNone; };
  for (const auto& [corner, v] : value)
    for (int axis = 0; axis < 3; ++axis) {
      IVec3 end = corner;
      ++end[axis];
      const auto other = value.find(end);
      if (other == value.end() || (other->second > 0) == (v > 0)) continue;
      for (int i = 0; i < 4; ++i) {
        IVec3 cell = corner;
        cell[(axis + 1) % 3] -= i & 1;
        cell[(axis + 2) % 3] -= i >> 1;
        EXPECT_TRUE(has_cell(cell));
      }
    }
  const IVec3 low(glm::floor((box.low - lattice.origin) / lattice.spacing)),
      high(glm::ceil((box.high - lattice.origin) / lattice.spacing));
  for (int x = low.x; x < high.x; ++x)
    for (int y = low.y; y < high.y; ++y)
      for (int z = low.z; z < high.z; ++z)
        if (!has_cell({x, y, z})) {
          const double here = field.value(lattice.point({x, y, z}));
          for (int axis = 0; axis < 3; ++axis) {
            IVec3 end(x, y, z);
            ++end[axis];
            EXPECT_EQ(here > 0, field.value(lattice.point(end)) > 0);
          }
        }
}

/// Values are those of the field. Beyond `plateau` a grid's constant blocks meet splines that ring a little: there both
/// sides of the seam will do.
void expect_values(const BrickLattice& lattice, const Field& field, double tolerance,
                   double plateau = std::numeric_limits<double>::infinity()) {
  for (std::size_t b = 0; b < lattice.brick_count(); ++b)
    for (int i = 0; i < BrickLattice::kValues; ++i) {
      const double expected = field.value(lattice.point(lattice.coordinate[b] * 8 + local_corner(i)));
      const double allowed = std::abs(expected) > plateau ? 1e-3 : tolerance;
      ASSERT_NEAR(lattice.value[b * BrickLattice::kValues + i], expected, allowed);
    }
}

/// Values of `f` by voxel in blocks^3 blocks, cut off at three, as level sets are; -3 outside.
std::shared_ptr<GridField> grid_of(Interpolation interpolation, int blocks, const auto& f) {
  BlockValues values;
  values.low = IVec3(-2, 1, 0);
  values.size = IVec3(blocks);
  values.outside = -3.0f;
  std::vector<std::vector<float>> storage;
  for (int b = 0; b < blocks * blocks * blocks; ++b) {
    const IVec3 block(b / (blocks * blocks), b / blocks % blocks, b % blocks);
    std::vector<float> v(512);
    for (int i = 0; i < 512; ++i) v[i] = float(std::min(f(DVec3(8 * block + IVec3(i / 64, i / 8 % 8, i % 8))), 3.0));
    storage.push_back(std::move(v));
  }
  for (const auto& v : storage) values.values.push_back(v.data());
  values.constant.assign(storage.size(), -3.0f);
  auto grid = std::make_shared<BrickGrid>(build_bricks(values, DVec3(0.3, -0.2, 0.1), 0.125, interpolation));
  return std::make_shared<GridField>(std::move(grid));
}

/// Blobs; one of them moved aside, and noise added to all values.
std::shared_ptr<GridField> make_grid(Interpolation interpolation, unsigned seed, int blocks = 4,
                                     const DVec3& moved = DVec3(0.0), double noise = 0.0) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> place(6.0, 8.0 * blocks - 6.0), radius(0.8, 5.0);
  std::vector<std::pair<DVec3, double>> balls;
  for (int i = 0; i < 12; ++i) balls.emplace_back(DVec3(place(random), place(random), place(random)), radius(random));
  balls.front().first += moved;
  return grid_of(interpolation, blocks, [&](const DVec3& p) {
    double best = -3.0;
    for (const auto& [c, r] : balls) best = std::max(best, r - glm::length(p - c));
    return best + noise * std::sin(7.1 * p.x + 12.3 * p.y * p.z);
  });
}

struct Host {
  std::unique_ptr<Backend> backend = make_reference_backend();
  BrickLattice sample(std::shared_ptr<const Field> field, double spacing, std::size_t most = 1u << 20) {
    backend->set_field(field);
    return sample_lattice(*field, *backend, spacing, most);
  }
};

}  // namespace

TEST(BrickLattice, ClosedFormFieldsAreSampledWhereTheirSurfaceIs) {
  Host host;
  for (const double spacing : {0.11, 0.05}) {
    const auto sphere = std::make_shared<analytic::SphereField>(DVec3(0.3, -4.2, 1.1), 0.7);
    const BrickLattice lattice = host.sample(sphere, spacing);
    expect_sound(lattice, *sphere, sphere->bounds().grown(10 * spacing));
    expect_values(lattice, *sphere, 1e-5);
    const auto torus = std::make_shared<analytic::TorusField>(1.0, 0.3);
    expect_sound(host.sample(torus, spacing), *torus, torus->bounds().grown(10 * spacing));
  }
}

TEST(BrickLattice, SkipsSpaceAwayFromTheSurface) {
  Host host;
  const auto sphere = std::make_shared<analytic::SphereField>(DVec3(0.0), 1.0);
  const BrickLattice lattice = host.sample(sphere, 0.01);
  const double area_in_bricks = 4.0 * M_PI / (0.08 * 0.08);
  EXPECT_LT(lattice.brick_count(), 4.0 * area_in_bricks);
}

TEST(BrickLattice, SkeletonFields) {
  Host host;
  const auto field = std::make_shared<SkeletonField>(
      std::vector<SkeletonElement>{{.a = DVec3(0), .b = DVec3(0)}, {.a = DVec3(1.1, 0, 0), .b = DVec3(1.1, 1, 0)}},
      0.2);
  const BrickLattice lattice = host.sample(field, 0.06);
  expect_sound(lattice, *field, field->bounds());
  expect_values(lattice, *field, 1e-5);
}

TEST(BrickLattice, GridsAtPartsOfAVoxelEqualTheirDefinition) {
  Host host;
  for (const Interpolation interpolation : {Interpolation::linear, Interpolation::cubic})
    for (int parts = 1; parts <= test::repeats(4, 2); parts *= 2) {
      const auto field = make_grid(interpolation, 5);
      const BrickLattice lattice = host.sample(field, field->grid()->h / parts);
      SCOPED_TRACE(parts);
      ASSERT_GT(lattice.brick_count(), 0u);
      EXPECT_EQ(lattice.origin, field->grid()->origin);
      expect_values(lattice, *field, 1e-6, 2.9);
      expect_sound(lattice, *field, field->bounds().grown(1.0));
    }
}

TEST(BrickLattice, GridsAtAnyOtherSpacingGoThroughTheBackend) {
  Host host;
  const auto field = make_grid(Interpolation::cubic, 6);
  for (const double spacing : {field->grid()->h / 3, 1.3 * field->grid()->h}) {
    const BrickLattice lattice = host.sample(field, spacing);
    expect_values(lattice, *field, 1e-5, 2.9);
    expect_sound(lattice, *field, field->bounds());
  }
}

void expect_same(const BrickLattice& a, const BrickLattice& b) {
  EXPECT_EQ(a.origin, b.origin);
  EXPECT_EQ(a.spacing, b.spacing);
  ASSERT_TRUE(a.coordinate == b.coordinate);
  EXPECT_TRUE(a.value == b.value);
  EXPECT_TRUE(a.tunnel == b.tunnel);
  EXPECT_TRUE(a.hidden == b.hidden);
  EXPECT_TRUE(a.revealed == b.revealed);
  ASSERT_EQ(a.face.size(), b.face.size());
  for (std::size_t i = 0; i < a.face.size(); ++i)
    EXPECT_TRUE(a.face[i].key == b.face[i].key && a.face[i].joined == b.face[i].joined);
}

void expect_same(const LatticeTopology& a, const LatticeTopology& b) {
  EXPECT_TRUE(a.cells == b.cells);
  EXPECT_TRUE(a.first_part == b.first_part);
  EXPECT_TRUE(a.part_piece == b.part_piece);
  EXPECT_TRUE(a.upper == b.upper);
  EXPECT_TRUE(a.euler == b.euler);
  EXPECT_TRUE(a.volume == b.volume);
}

/// Vertices in and about the lattice's bricks, and without triangles.
TriangleMesh scattered_about(const BrickLattice& lattice) {
  TriangleMesh mesh;
  for (const IVec3& brick : lattice.coordinate)
    for (int k = 0; k < 12; ++k) {
      const DVec3 off(std::sin(7.0 * k + brick.y), std::sin(11.0 * k + brick.z), std::sin(13.0 * k + brick.x));
      mesh.vertices.position.emplace_back(lattice.point(8 * brick) + lattice.spacing * (4.0 + 6.0 * off));
    }
  mesh.vertices.resize(mesh.vertices.position.size());
  return mesh;
}

/// Votes that go on from those of the lattice before are those of the new one. Some vertices move with it.
void expect_votes(const BrickLattice& lattice, const LatticeTopology& topology, TriangleMesh& mesh,
                  std::vector<Index>& votes) {
  MeshChanges changes;
  changes.moved.assign(mesh.vertex_count(), 0);
  changes.vertex_before.resize(mesh.vertex_count());
  std::iota(changes.vertex_before.begin(), changes.vertex_before.end(), Index{0});
  for (std::size_t v = 0; v < mesh.vertex_count(); v += 7) {
    mesh.vertices.position[v] += Vec3(float(3.0 * lattice.spacing));
    changes.moved[v] = 1;
  }
  votes = piece_votes(mesh, lattice, topology, votes, &changes);
  EXPECT_EQ(votes, piece_votes(mesh, lattice, topology));
}

/// Follows fields through resample_lattice() and lattice_topology(). Returns the share of bricks that were taken over.
double expect_resampled(const std::vector<std::shared_ptr<const Field>>& fields, double spacing) {
  Host host;
  BrickLattice lattice = host.sample(fields[0], spacing);
  LatticeTopology topology = lattice_topology(lattice);
  TriangleMesh mesh = scattered_about(lattice);
  std::vector<Index> votes = piece_votes(mesh, lattice, topology);
  std::size_t bricks = 0, kept = 0, details = 0;
  for (std::size_t k = 1; k < fields.size(); ++k) {
    SCOPED_TRACE(k);
    const BrickLattice before = lattice;
    host.backend->set_field(fields[k]);
    lattice = resample_lattice(std::move(lattice), changes_between(*fields[k - 1], *fields[k]), *fields[k],
                               *host.backend, 1u << 20);
    const BrickLattice whole = host.sample(fields[k], spacing);
    expect_same(lattice, whole);
    topology = lattice_topology(lattice, std::move(topology));
    expect_same(topology, lattice_topology(whole));
    expect_votes(lattice, topology, mesh, votes);
    details += lattice.face.size() + lattice.revealed.size();
    for (std::size_t b = 0; b < lattice.same_as.size(); ++b) {
      const Index from = lattice.same_as[b];
      if (from == kNone) continue;
      ++kept;
      EXPECT_EQ(before.coordinate[from], lattice.coordinate[b]);
      EXPECT_TRUE(std::equal(&lattice.value[b * BrickLattice::kValues], &lattice.value[b * BrickLattice::kValues] + 729,
                             &before.value[from * std::size_t(BrickLattice::kValues)]));
    }
    bricks += lattice.brick_count();
  }
  EXPECT_GT(details, 0u);
  return double(kept) / double(bricks);
}

TEST(BrickLattice, WhatHasNotChangedNeedNotBeSampledAgain) {
  constexpr int kFrames = test::repeats(6, 3);
  for (const Interpolation interpolation : {Interpolation::linear, Interpolation::cubic})
    for (const double parts : {1.0, 2.0, 0.8}) {
      SCOPED_TRACE(parts);
      std::vector<std::shared_ptr<const Field>> fields;
      for (int k = 0; k < kFrames; ++k) fields.push_back(make_grid(interpolation, 8, 6, DVec3(0.7 * k, 0, 0), 0.6));
      const double h = fields[0]->resolution();
      EXPECT_GT(expect_resampled(fields, h / parts), interpolation == Interpolation::linear ? 0.5 : 0.02);
    }
  std::vector<std::shared_ptr<const Field>> fields;
  for (int k = 0; k < kFrames; ++k) {
    std::vector<SkeletonElement> balls(40);
    for (int i = 0; i < 40; ++i) {
      balls[i].a = balls[i].b = DVec3(0.55 * (i % 10), 0.8 * (i / 10), 0.3 * std::sin(3.0 * i));
      balls[i].radius = 0.5;
    }
    balls[17].a = balls[17].b += DVec3(0.05 * k, 0.1 * k, 0.0);
    fields.push_back(std::make_shared<SkeletonField>(balls, 0.12));
  }
  EXPECT_GT(expect_resampled(fields, 0.12), 0.3);
}

TEST(BrickLattice, VoxelCentresAreLatticeCorners) {
  Host host;
  const auto field = make_grid(Interpolation::cubic, 7);
  const BrickLattice lattice = host.sample(field, field->grid()->h / 2);
  EXPECT_EQ(lattice.point(IVec3(2, -4, 6)), field->grid()->origin + field->grid()->h * DVec3(1, -2, 3));
}

TEST(BrickLattice, AFieldWithoutASurfaceHasNoBricks) {
  Host host;
  EXPECT_EQ(host.sample(std::make_shared<analytic::SphereField>(DVec3(0.0), -1.0), 0.1).brick_count(), 0u);
}

TEST(BrickLattice, AbsurdSpacingsAreRefused) {
  Host host;
  const auto sphere = std::make_shared<analytic::SphereField>();
  for (const double spacing : {0.0, -1.0, std::nan(""), std::numeric_limits<double>::infinity(), 1e-9})
    EXPECT_THROW(host.sample(sphere, spacing), InputError) << spacing;
  EXPECT_THROW(host.sample(sphere, 0.01, 100), InputError);
}

TEST(BrickLattice, AnOpenSurfaceIsRefused) {
  Host host;
  EXPECT_THROW(host.sample(std::make_shared<analytic::PlaneField>(DVec3(0, 0, 1)), 0.1), InputError);
}

TEST(PlainGrid, WholeVoxelsShowAllOfIt) {
  Host host;
  std::mt19937 random(3);
  std::uniform_real_distribution<double> radius(3.0, 7.0), unit(-1.0, 1.0);
  int plain = 0, rough = 0;
  for (int i = 0; i < test::repeats(40, 12); ++i) {
    const DVec3 way = glm::normalize(DVec3(unit(random), unit(random), unit(random)));
    const double r = radius(random), s = radius(random), gap = 3.0 * unit(random);  // they overlap, touch or do not
    const DVec3 a = DVec3(20.0) - 0.5 * (r + s + gap) * way, b = a + (r + s + gap) * way;
    const auto field = grid_of(Interpolation::cubic, 5, [&](const DVec3& p) {
      return std::max({r - glm::distance(p, a), s - glm::distance(p, b), -3.0});
    });
    if (!is_plain(*field->grid())) {
      ++rough;
      continue;
    }
    ++plain;
    const LatticeTopology whole = lattice_topology(host.sample(field, field->grid()->h)),
                          fine = lattice_topology(host.sample(field, field->grid()->h / 4.0));
    EXPECT_EQ(whole.euler, fine.euler) << "gap of " << gap << " voxels";
  }
  EXPECT_GE(plain, 1);
  EXPECT_GE(rough, 1);
}

TEST(PlainGrid, SheetsAndSlitsOfAVoxelAreNot) {
  std::mt19937 random(4);
  std::uniform_real_distribution<double> unit(-1.0, 1.0);
  for (int i = 0; i < test::repeats(20, 4); ++i) {
    const DVec3 normal = glm::normalize(DVec3(unit(random), unit(random), unit(random)));
    const auto sheet = [&](double half) {
      return [=](const DVec3& p) {
        const DVec3 q = p - DVec3(16.3, 15.8, 16.1);
        return std::max(std::min(half - std::abs(glm::dot(q, normal)), 9.0 - glm::length(q)), -3.0);
      };
    };
    EXPECT_FALSE(is_plain(*grid_of(Interpolation::cubic, 4, sheet(0.5))->grid()));
    const auto slit = [&](const DVec3& p) {
      return std::max(std::min(-sheet(0.5)(p), 12.0 - glm::distance(p, DVec3(16.0))), -3.0);
    };
    EXPECT_FALSE(is_plain(*grid_of(Interpolation::cubic, 4, slit)->grid()));
    const auto ball = [&](const DVec3& p) { return std::max(8.0 - glm::distance(p, DVec3(16.0) + normal), -3.0); };
    EXPECT_TRUE(is_plain(*grid_of(Interpolation::cubic, 4, ball)->grid()));
    EXPECT_FALSE(is_plain(*grid_of(Interpolation::linear, 4, ball)->grid()));
  }
}

TEST(BrickLattice, CrosswiseFacesAreJoinedWhereTheFieldIsInside) {
  Host host;
  const auto field = make_grid(Interpolation::cubic, 9);
  const BrickLattice lattice = host.sample(field, field->grid()->h);
  for (std::size_t i = 1; i < lattice.face.size(); ++i) EXPECT_LT(lattice.face[i - 1].key, lattice.face[i].key);
  EXPECT_GT(lattice.face.size(), 0u);
  // every crosswise face of every brick is listed, once
  std::map<IVec3, float, LessCorner> value;
  for (std::size_t b = 0; b < lattice.brick_count(); ++b)
    for (int i = 0; i < BrickLattice::kValues; ++i)
      value[lattice.coordinate[b] * 8 + local_corner(i)] = lattice.value[b * BrickLattice::kValues + i];
  std::size_t found = 0;
  for (const auto& [corner, v] : value)
    for (int axis = 0; axis < 3; ++axis) {
      IVec3 e(0), f(0);
      e[(axis + 1) % 3] = f[(axis + 2) % 3] = 1;
      const auto q = value.find(corner + e), r = value.find(corner + f), s = value.find(corner + e + f);
      if (q == value.end() || r == value.end() || s == value.end()) continue;
      const bool crosswise =
          (v > 0) == (s->second > 0) && (q->second > 0) == (r->second > 0) && (v > 0) != (q->second > 0);
      if (!crosswise) continue;
      ++found;
      const BrickLattice::Face* face = lattice.find_face(corner, axis);
      ASSERT_NE(face, nullptr);
      const double p = v, a = q->second, b = r->second, c = s->second, bend = p - a - b + c;
      const DVec3 at = DVec3(corner) + (p - b) / bend * DVec3(e) + (p - a) / bend * DVec3(f);
      EXPECT_EQ(face->joined, field->value(lattice.origin + lattice.spacing * at) > 0.0);
    }
  EXPECT_EQ(found, lattice.face.size());
}
