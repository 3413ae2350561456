// Local re-skin: whatever is done to a mesh, a frame on the same field mends it where it was hurt.
#include "core/topology/reskin.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <map>
#include <set>

#include <gtest/gtest.h>

#include "core/field/skeleton_field.h"
#include "core/io/scene.h"
#include "core/mesh/folds.h"
#include "core/mesh/validate.h"
#include "core/topology/crumples.h"
#include "core/topology/filling.h"
#include "core/topology/growing_filling.h"
#include "core/topology/holes.h"
#include "core/topology/inherit_ids.h"
#include "core/topology/match.h"
#include "core/topology/necks.h"
#include "core/topology/sound_skin.h"
#include "core/tracker.h"
#include "kernels/opencl_backend.h"
#include "tests/analytic_fields.h"
#include "tests/damage.h"
#include "tests/sanitized.h"
#include "tests/solid_field.h"

using namespace isoskin;

namespace {

/// How many damages to try: ISOSKIN_FUZZ=10000 for the long run.
int fuzz_count(int usual) {
  const char* wanted = std::getenv("ISOSKIN_FUZZ");
  return wanted ? std::atoi(wanted) : usual;
}

std::shared_ptr<const Field> random_metaballs(damage::Random& random) {
  std::vector<SkeletonElement> elements;
  for (int i = 0; i < 9; ++i) {
    SkeletonElement ball;
    ball.a = ball.b =
        DVec3(damage::uniform(random, -1, 1), damage::uniform(random, -1, 1), damage::uniform(random, -1, 1));
    ball.radius = damage::uniform(random, 0.4f, 0.8f);
    elements.push_back(ball);
  }
  return std::make_shared<SkeletonField>(elements, 0.3);
}

struct Tally {
  int tried = 0, certified = 0, without_tier3 = 0;
};

void try_damages(const std::shared_ptr<const Field>& field, double edge_length, int count, damage::Random& random,
                 std::vector<Tally>& tally) {
  TrackOptions options;
  options.edge_length = edge_length;
  options = resolved(options, *field);
  Tracker first(make_opencl_backend(), options);
  first.advance({1, 0.04, field, nullptr});
  const TriangleMesh good = first.mechanical();
  for (int i = 0; i < count; ++i) {
    const auto kind = Damage(i % int(Damage::count));
    const TriangleMesh bad = damaged(good, kind, random, float(options.edge_length));
    ASSERT_TRUE(validate(bad)) << name(kind) << ": " << validate(bad).reason;
    first.resume(bad, {1, 0.04, field, nullptr});
    const FrameReport report = first.advance({2, 0.08, field, nullptr});
    const ValidateReport valid = validate(first.mechanical());
    EXPECT_TRUE(valid) << name(kind) << ": " << valid.reason;
    EXPECT_TRUE(report.certified) << name(kind) << ": " << report.certificate;
    ++tally[int(kind)].tried;
    tally[int(kind)].certified += report.certified;
    tally[int(kind)].without_tier3 += report.reextracted[2] == 0.0;
  }
}

/// A good skin, by default about a ball, and all that a repair of it reads.
struct GoodSkin {
  std::shared_ptr<const Field> field;
  std::unique_ptr<Backend> backend = make_reference_backend();
  TrackOptions options;
  TriangleMesh mesh;
  BrickLattice lattice;
  LatticeTopology topology;

  explicit GoodSkin(std::shared_ptr<const Field> of = std::make_shared<analytic::SphereField>(DVec3(0.1, 0.2, 0.3),
                                                                                              1.0))
      : field(std::move(of)) {
    options.edge_length = 0.1;
    options = resolved(options, *field);
    Tracker tracker(make_reference_backend(), options);
    tracker.advance({1, 0.04, field, nullptr});
    mesh = tracker.mechanical();
    backend->set_field(field);
    lattice = sample_lattice(*field, *backend, options.lattice_spacing);
    topology = lattice_topology(lattice);
  }

  /// Repairs as if the one piece had failed.
  ReskinReport repair(TriangleMesh& of, const BadSites& sites, bool replace_all = false, bool suspects_only = false,
                      bool spare_sound = false, Fault fault = Fault::euler) {
    ReskinOptions reskin_options;
    reskin_options.suspects_only = suspects_only;
    reskin_options.spare_sound = spare_sound;
    reskin_options.edge_length = options.edge_length;
    reskin_options.replace_all = replace_all;
    reskin_options.alter = options.alter;
    reskin_options.alter.respect_locks = false;
    const MeshPieces pieces = mesh_pieces(of);
    Certificate failed;
    failed.mesh_piece.assign(pieces.count(), fault);
    failed.lattice_piece.assign(topology.piece_count(), fault);
    return reskin(of, pieces, failed, sites, lattice, topology, *backend, reskin_options);
  }
};

/// Positions by id.
std::map<Index, Vec3> places(const TriangleMesh& mesh) {
  std::map<Index, Vec3> out;
  for (Index v = 0; v < mesh.vertex_count(); ++v) out[mesh.vertices.id[v]] = mesh.position(v);
  return out;
}

/// Where a damaged skin is not the good one; nothing about it is sure.
BadSites suspects_of(const GoodSkin& skin, const TriangleMesh& mesh) {
  const std::map<Index, Vec3> old = places(skin.mesh);
  BadSites sites;
  for (Index v = 0; v < mesh.vertex_count(); ++v)
    if (!old.count(mesh.vertices.id[v]) || old.at(mesh.vertices.id[v]) != mesh.position(v))
      sites.add(mesh.position(v), false);
  std::map<std::pair<Index, Index>, int> edges;
  for (Index h = 0; h < skin.mesh.vertex.size(); ++h)
    ++edges[{skin.mesh.vertices.id[skin.mesh.from(h)], skin.mesh.vertices.id[skin.mesh.to(h)]}];
  for (Index h = 0; h < mesh.vertex.size(); ++h)
    if (!edges.count({mesh.vertices.id[mesh.from(h)], mesh.vertices.id[mesh.to(h)]}))
      sites.add(mesh.position(mesh.from(h)), false);
  return sites;
}

}  // namespace

TEST(Reskin, MendsRandomDamageWithoutReextraction) {
  damage::Random random(20261122);
  std::vector<Tally> tally(int(Damage::count));
  const int fields = 3, total = fuzz_count(test::repeats(120, 18));
  for (int f = 0; f < fields; ++f) try_damages(random_metaballs(random), 0.08, total / fields, random, tally);
  int tried = 0, local = 0;
  for (int k = 0; k < int(Damage::count); ++k) {
    std::printf("%-20s tried %5d  certified %5d  without tier 3 %5d\n", name(Damage(k)), tally[k].tried,
                tally[k].certified, tally[k].without_tier3);
    tried += tally[k].tried;
    local += tally[k].without_tier3;
  }
  EXPECT_GE(double(local), 0.99 * tried);
}

TEST(Reskin, WhereALostSpikeLeavesTheMeshIsSurelyBad) {
  const GoodSkin ball(std::make_shared<analytic::SphereField>(DVec3(0.0), 1.0));
  const SolidField::Solid thread = solid::rod({0.9, 0.01, 0.01}, {1.8, 0.01, 0.01}, 0.04);  // within the tolerance
  const SolidField::Solid drop = solid::ball({1.9, 0.01, 0.01}, 0.25);
  Box bounds;
  bounds.add(DVec3(-1.0));
  bounds.add(DVec3(2.2, 1.0, 1.0));
  GoodSkin spike(
      std::make_shared<SolidField>(solid::both(solid::ball(DVec3(0.0), 1.0), solid::both(thread, drop)), bounds));
  BadSiteOptions options;
  options.tolerance = spike.options.tolerance;
  const BadSites sites =
      find_bad_sites(ball.mesh, *spike.field, spike.lattice, spike.topology.signs, *spike.backend, options);
  int leaving = 0, thread_only = 0, dropped = 0;
  for (std::size_t i = 0; i < sites.point.size(); ++i) {
    const Vec3& p = sites.point[i];
    if (!sites.sure[i]) continue;
    leaving += p.x > 0.9f && p.x < 1.1f && std::abs(p.y) < 0.1f && std::abs(p.z) < 0.1f;
    thread_only += p.x > 1.2f && p.x < 1.5f;
    dropped += p.x > 1.7f;
  }
  EXPECT_GT(leaving, 0);
  EXPECT_EQ(thread_only, 0);
  EXPECT_GT(dropped, 10);
}

TEST(Reskin, APatchThatRunsIntoTheBackOfASeamLeaksThere) {
  GoodSkin skin;
  const TriangleMesh& mesh = skin.mesh;
  std::vector<std::uint8_t> hot(mesh.vertex_count());
  for (Index v = 0; v < hot.size(); ++v) hot[v] = std::abs(mesh.position(v).z - 0.7f) < 0.2f;  // a ring about z
  Holes holes = cut_holes(mesh, hot);
  ASSERT_EQ(holes.seams.size(), 2u);
  GrowingFilling filling(skin.lattice, skin.topology, *skin.backend);
  filling.extend(mesh.vertices.position, 0.1f, 0.1f);
  const std::vector<Vec3> normals = field_normals(mesh.vertices.position, *skin.backend);
  lay_seams(mesh, normals, holes, filling, skin.lattice.spacing);
  const PointGrid vertices(mesh.vertices.position, float(skin.options.edge_length));
  holes.seams[0].failed = true;
  const auto leaks = [&] { return follow_leaks(mesh, normals, vertices, holes, *filling); };
  EXPECT_TRUE(leaks().seams.empty());
  Seam& inside_out = holes.seams[1];
  for (std::vector<Index>& path : inside_out.path) std::reverse(path.begin(), path.end());
  std::set<Index> wanted;
  for (const Index h : inside_out.halfedge) wanted.insert(mesh.from(h));
  const Leaks found = leaks();
  EXPECT_EQ(std::set<Index>(found.seams.begin(), found.seams.end()), wanted);
  EXPECT_TRUE(found.ends.empty());
}

TEST(Reskin, LeavesAHoleAloneWhoseFillingHasTheSameTopology) {
  GoodSkin skin;
  BadSites sites;
  sites.add(skin.mesh.position(10), false);
  TriangleMesh mesh = skin.mesh;
  const ReskinReport report = skin.repair(mesh, sites);
  EXPECT_EQ(report.triangles_removed, 0u);
  EXPECT_EQ(report.triangles_added, 0u);
  EXPECT_EQ(mesh.vertex, skin.mesh.vertex);
  EXPECT_EQ(places(mesh), places(skin.mesh));
}

TEST(Reskin, ReplacesWhatIsSurelyBadAndTouchesNothingElse) {
  GoodSkin skin;
  const Vec3 bad = skin.mesh.position(10);
  for (const bool sure : {false, true}) {
    BadSites sites;
    sites.add(bad, sure);
    TriangleMesh mesh = skin.mesh;
    const ReskinReport report = skin.repair(mesh, sites, !sure);
    EXPECT_TRUE(validate(mesh)) << validate(mesh).reason;
    EXPECT_EQ(mesh_pieces(mesh).euler, std::vector<int>{2});
    EXPECT_GT(report.triangles_removed, 3u);
    EXPECT_LT(report.triangles_removed, 40u);  // two rings of triangles, whatever the size of the mesh
    EXPECT_EQ(report.seams, 1u);
    const auto before = places(skin.mesh), after = places(mesh);
    for (const auto& [id, position] : before) {
      if (glm::distance(position, bad) < 2.5f * float(skin.options.edge_length)) continue;
      ASSERT_TRUE(after.count(id)) << id;
      EXPECT_EQ(after.at(id), position);
    }
    for (Index v = report.first_new_vertex; v < mesh.vertex_count(); ++v)
      EXPECT_NEAR(glm::length(mesh.position(v) - Vec3(0.1f, 0.2f, 0.3f)), 1.0f, 0.02f);
  }
}

TEST(Reskin, ReplacesASuspectHandle) {
  // A tube joins two triangles; no vertex is off the surface.
  GoodSkin skin;
  damage::Random random(5);
  TriangleMesh mesh = damaged(skin.mesh, Damage::false_bridge, random, float(skin.options.edge_length));
  ASSERT_NE(mesh_pieces(mesh).euler, std::vector<int>{2});
  const BadSites sites = suspects_of(skin, mesh);
  ASSERT_FALSE(sites.point.empty());
  const ReskinReport report = skin.repair(mesh, sites);
  EXPECT_GT(report.triangles_removed, 0u);
  EXPECT_EQ(mesh_pieces(mesh).euler, std::vector<int>{2});
  EXPECT_TRUE(validate(mesh)) << validate(mesh).reason;
}

TEST(Reskin, OpensOnlyWhatIsSurelyBadWhereTheTopologyIsRight) {
  GoodSkin skin;
  damage::Random random(5);
  const TriangleMesh bad = damaged(skin.mesh, Damage::false_bridge, random, float(skin.options.edge_length));
  for (const Fault fault : {Fault::wrong_side, Fault::euler}) {
    TriangleMesh mesh = bad;
    BadSites sites = suspects_of(skin, mesh);
    sites.add(mesh.position(10), true);
    skin.repair(mesh, sites, false, false, false, fault);
    EXPECT_FALSE(places(mesh).count(bad.vertices.id[10]));
    EXPECT_EQ(mesh_pieces(mesh).euler, std::vector<int>{fault == Fault::euler ? 2 : 0});
    EXPECT_TRUE(validate(mesh)) << validate(mesh).reason;
  }
}

TEST(Reskin, FindsWhereSkinRunsFromPieceToPiece) {
  const auto left = std::make_shared<analytic::SphereField>(DVec3(-1.5, 0, 0), 1.0);
  const auto right = std::make_shared<analytic::SphereField>(DVec3(1.5, 0, 0), 1.0);
  const GoodSkin skin(std::make_shared<analytic::PairField>(analytic::PairField::Kind::both, left, right));
  const auto between = [&](const TriangleMesh& mesh) {
    return vertices_between_pieces(mesh, std::vector<std::uint8_t>(mesh.vertex_count(), 1), skin.lattice,
                                   skin.topology);
  };
  EXPECT_TRUE(between(skin.mesh).empty());
  damage::Random random(5);
  TriangleMesh mesh = skin.mesh;
  while (mesh_pieces(mesh).count() != 1) mesh = damaged(skin.mesh, Damage::false_bridge, random, 0.1f);
  EXPECT_EQ(between(mesh).size(), 3u);  // of the bridge's six edges, the ends on one ball
  EXPECT_TRUE(vertices_between_pieces(mesh, std::vector<std::uint8_t>(mesh.vertex_count()), skin.lattice, skin.topology)
                  .empty());
}

TEST(Reskin, NewSkinTakesOverTheIdsOfVerticesWhereItLies) {
  GoodSkin skin;
  BadSites sites;
  sites.add(skin.mesh.position(10), true);
  TriangleMesh mesh = skin.mesh;
  const Index first_new = mesh.next_id;
  skin.repair(mesh, sites);
  const auto before = places(skin.mesh), renewed = places(mesh);
  ASSERT_FALSE(renewed.count(skin.mesh.vertices.id[10]));
  const float reach = 0.5f * float(skin.options.edge_length);
  const std::vector<Index> taken = inherit_ids(mesh, first_new, skin.mesh.vertices, *skin.backend, reach);
  EXPECT_GT(taken.size(), 0u);
  EXPECT_TRUE(validate(mesh)) << validate(mesh).reason;
  const auto after = places(mesh);
  EXPECT_EQ(after.size(), renewed.size());
  for (const Index id : taken) {
    EXPECT_FALSE(renewed.count(id));
    EXPECT_LE(glm::distance(after.at(id), before.at(id)), reach);
  }
  for (const auto& [id, place] : after) EXPECT_TRUE(id >= first_new || before.count(id)) << id;
  EXPECT_TRUE(inherit_ids(mesh, mesh.next_id, skin.mesh.vertices, *skin.backend, reach).empty());
}

TEST(Reskin, FindsSkinThatLiesOnItselfInManyLayers) {
  GoodSkin skin;
  const auto crumpled_in = [&](const TriangleMesh& mesh) {
    const auto folded = folded_triangles(mesh, field_normals(mesh.vertices.position, *skin.backend));
    return crumpled_triangles(mesh, folded, float(skin.options.edge_length));
  };
  EXPECT_TRUE(crumpled_in(skin.mesh).empty());
  TriangleMesh mesh = skin.mesh;
  const std::set<Index> patch = damage::disc(mesh, 10, 3);
  const std::vector<Index> vertices(patch.begin(), patch.end());
  for (std::size_t i = 0; i < vertices.size(); ++i)  // on the surface still, but every which way
    mesh.vertices.position[vertices[i]] = skin.mesh.position(vertices[i * 7 % vertices.size()]);
  const std::vector<Index> crumpled = crumpled_in(mesh);
  EXPECT_GT(crumpled.size(), 20u);
  for (const Index t : crumpled) {
    int inside = 0;
    for (Index h = 3 * t; h < 3 * t + 3; ++h) inside += int(patch.count(mesh.vertex[h]));
    EXPECT_GT(inside, 0) << t;
  }
}

TEST(Reskin, FindsWhereAHandleIsOneTriangleAround) {
  GoodSkin skin;
  const auto necks = [](const TriangleMesh& mesh) {
    const std::vector<std::uint8_t> on = neck_vertices(mesh);
    return std::count(on.begin(), on.end(), 1);
  };
  EXPECT_EQ(necks(skin.mesh), 0);
  damage::Random random(5);
  EXPECT_EQ(necks(damaged(skin.mesh, Damage::false_bridge, random, float(skin.options.edge_length))), 6);
}

TEST(Reskin, LeavesOddPlacesAloneWhereNoSeamFails) {
  GoodSkin skin;
  BadSites sites;
  sites.add(skin.mesh.position(10), false);
  for (const Vec3& p : skin.mesh.vertices.position) sites.add(p, false, true);  // as rough as a surface can be
  for (const bool suspects_only : {false, true}) {
    TriangleMesh mesh = skin.mesh;
    const ReskinReport report = skin.repair(mesh, sites, true, suspects_only);
    EXPECT_EQ(mesh_pieces(mesh).euler, std::vector<int>{2});
    if (suspects_only)
      EXPECT_LT(report.triangles_removed, 40u);
    else
      EXPECT_EQ(report.triangles_removed, skin.mesh.triangle_count());
    EXPECT_GT(report.triangles_removed, 3u);
  }
}

TEST(Reskin, FindsAHandleThatNoSiteTellsTileByTile) {
  GoodSkin skin;
  damage::Random random(5);
  TriangleMesh mesh = damaged(skin.mesh, Damage::false_bridge, random, float(skin.options.edge_length));
  ASSERT_NE(mesh_pieces(mesh).euler, std::vector<int>{2});
  std::size_t removed = 0;
  for (const double shift : {0.0, 0.333, 0.667}) {
    BadSites sites;
    const std::vector<std::uint8_t> all(mesh.vertex_count(), 1);
    add_tiles(mesh, all, Tiles{.shift = shift}, skin.options.edge_length, sites);
    EXPECT_GT(sites.point.size(), mesh.vertex_count() / 10);
    removed += skin.repair(mesh, sites).triangles_removed;
    EXPECT_TRUE(validate(mesh)) << validate(mesh).reason;
  }
  EXPECT_EQ(mesh_pieces(mesh).euler, std::vector<int>{2});
  EXPECT_GT(removed, 3u);
  EXPECT_LT(removed, skin.mesh.triangle_count() / 2);
}

TEST(Reskin, SparesSkinThatIsAsItShouldBe) {
  GoodSkin skin;
  damage::Random random(5);
  const TriangleMesh bad = damaged(skin.mesh, Damage::false_bridge, random, float(skin.options.edge_length));
  BadSites sites;
  for (const Vec3& p : bad.vertices.position) sites.add(p, false);
  std::size_t removed[2];
  for (const bool spare : {false, true}) {
    TriangleMesh mesh = bad;
    removed[spare] = skin.repair(mesh, sites, false, false, spare).triangles_removed;
    EXPECT_TRUE(validate(mesh)) << validate(mesh).reason;
    EXPECT_EQ(mesh_pieces(mesh).euler, std::vector<int>{2});
  }
  EXPECT_EQ(removed[0], bad.triangle_count());
  EXPECT_GT(removed[1], 3u);
  EXPECT_LT(removed[1], bad.triangle_count() / 4);
}

TEST(Reskin, LaterTriesSpareSkinThatIsAsItShouldBeToo) {
  GoodSkin skin;
  damage::Random random(5);
  skin.mesh = damaged(skin.mesh, Damage::false_bridge, random, float(skin.options.edge_length));
  Tracker tracker(make_reference_backend(), skin.options);
  tracker.resume(skin.mesh, {1, 0.04, skin.field, nullptr});
  const FrameReport report = tracker.advance({2, 0.08, skin.field, nullptr});
  EXPECT_TRUE(report.certified);
  EXPECT_EQ(report.repairs, 1u);
  EXPECT_LT(report.reextracted[1], 0.01);  // taking out what lies about the bridge's ends made it 0.02
}

TEST(Reskin, AddsNoPieceAgainWhoseSkinIsSpared) {
  GoodSkin skin;
  BadSites sites;
  for (const Vec3& p : skin.mesh.vertices.position) sites.add(p, true);
  TriangleMesh mesh = skin.mesh;
  skin.repair(mesh, sites, false, false, true);
  EXPECT_EQ(mesh_pieces(mesh).euler, std::vector<int>{2});
}

TEST(Reskin, FindsTrianglesFromWhichThereIsNoSurface) {
  GoodSkin skin;
  damage::Random random(5);
  const TriangleMesh bridged = damaged(skin.mesh, Damage::false_bridge, random, float(skin.options.edge_length));
  const auto astray = [&](const TriangleMesh& mesh, bool wanted) {
    BadSites sites;
    add_astray(mesh, std::vector<std::uint8_t>(mesh.vertex_count(), wanted), *skin.backend, skin.options.project,
               0.5 * skin.options.edge_length, sites);
    return sites.point.size();
  };
  EXPECT_EQ(astray(skin.mesh, true), 0u);
  EXPECT_EQ(astray(bridged, true), 18u);
  EXPECT_EQ(astray(bridged, false), 0u);
}

/// A round film of voxels with a hole in it.
class FilmField final : public Field {
public:
  explicit FilmField(const DVec3& hole) : hole_(hole) {}

  FieldSample sample(const DVec3& p) const override {
    const DVec3 flat(p.x, p.y, 0.0), from_hole = flat - hole_;
    const FieldSample sheet{0.8 * resolution() - std::abs(p.z), DVec3(0.0, 0.0, p.z > 0.0 ? -1.0 : 1.0)};
    const FieldSample rim{1.0 - glm::length(flat), -flat / std::max(glm::length(flat), 1e-9)};
    const FieldSample hole{glm::length(from_hole) - 1.4 * resolution(),
                           from_hole / std::max(glm::length(from_hole), 1e-9)};
    const auto& least = rim.value < hole.value ? rim : hole;
    return sheet.value < least.value ? sheet : least;
  }
  Box bounds() const override { return {DVec3(-1.0, -1.0, -resolution()), DVec3(1.0, 1.0, resolution())}; }
  Interval range(const Box& box) const override {
    const double value = sample(box.center()).value, half = 0.5 * glm::length(box.high - box.low);
    return {value - half, value + half};
  }
  double resolution() const override { return 1.0 / 15.0; }
  bool is_c2() const override { return false; }

private:
  DVec3 hole_;
};

TEST(Reskin, DoubtsSkinThatStandsOffTheSurfaceThoughSumsAgree) {
  const auto before = std::make_shared<FilmField>(DVec3(-0.5, 0, 0)),
             now = std::make_shared<FilmField>(DVec3(0.5, 0, 0));
  TrackOptions options = resolved({}, *before);
  options.tolerance = 1.5 * before->resolution();  // no corner in a hole is farther
  Tracker tracker(make_reference_backend(), options);
  tracker.advance({1, 0.04, before, nullptr});
  const FrameReport report = tracker.advance({2, 0.08, now, nullptr});
  EXPECT_TRUE(report.certified);
  const TriangleMesh& mesh = tracker.mechanical();
  EXPECT_TRUE(validate(mesh)) << validate(mesh).reason;
  EXPECT_EQ(mesh_pieces(mesh).euler, std::vector<int>{0});
  const auto backend = make_reference_backend();
  backend->set_field(now);
  BadSites sites;
  add_astray(mesh, std::vector<std::uint8_t>(mesh.vertex_count(), 1), *backend, options.project,
             0.5 * options.edge_length, sites);
  EXPECT_TRUE(sites.point.empty());
}

TEST(Reskin, KnowsSkinThatIsAsItShouldBe) {
  GoodSkin skin;
  SoundOptions options;
  options.reach = 0.2f * float(skin.options.edge_length);
  options.layers = 2.0f * options.reach;
  options.longest = 2.0f * float(skin.options.edge_length);
  const auto sound = [&](const TriangleMesh& mesh) {
    return sound_triangles(mesh, std::vector<std::uint8_t>(mesh.vertex_count(), 1), *skin.backend, options);
  };
  const auto all = sound(skin.mesh);
  EXPECT_EQ(std::count(all.begin(), all.end(), 1), std::ptrdiff_t(skin.mesh.triangle_count()));
  EXPECT_EQ(sound_triangles(skin.mesh, std::vector<std::uint8_t>(skin.mesh.vertex_count()), *skin.backend, options),
            std::vector<std::uint8_t>(skin.mesh.triangle_count()));
  // The ball turned inside out, one off the surface, and two of which one lies over the other.
  TriangleMesh inside_out = skin.mesh, off = skin.mesh, twice = skin.mesh;
  for (Index h = 0; h < inside_out.vertex.size(); h += 3) std::swap(inside_out.vertex[h], inside_out.vertex[h + 1]);
  for (Vec3& p : off.vertices.position) p += 2.0f * options.reach * (p - Vec3(0.1f, 0.2f, 0.3f));
  const Index count = Index(skin.mesh.vertex_count());
  for (Index v = 0; v < count; ++v) twice.vertices.position.push_back(skin.mesh.position(v));
  for (const Index v : skin.mesh.vertex) twice.vertex.push_back(v + count);
  twice.vertices.resize(2 * count);
  for (const TriangleMesh* mesh : {&inside_out, &off, &twice}) {
    const auto none = sound(*mesh);
    EXPECT_EQ(std::count(none.begin(), none.end(), 1), 0);
  }
}

TEST(Reskin, OpensOtherSkinThatTheFillingRunsInto) {
  // Half a ring, closed by discs at both ends; only one end is said to be bad.
  const auto ring = std::make_shared<analytic::TorusField>(1.0, 0.3);
  const auto half = std::make_shared<analytic::PlaneField>(DVec3(1, 0, 0), 0.0, ring->bounds());
  const GoodSkin part(std::make_shared<analytic::PairField>(analytic::PairField::Kind::intersection, ring, half));
  ASSERT_EQ(mesh_pieces(part.mesh).euler, std::vector<int>{2});
  GoodSkin skin(ring);
  TriangleMesh mesh = part.mesh;
  BadSites sites;
  for (const Vec3& p : mesh.vertices.position)
    if (p.x > -0.01f && p.y > 0.0f) sites.add(p, true);
  ASSERT_FALSE(sites.point.empty());
  skin.repair(mesh, sites);
  EXPECT_TRUE(validate(mesh)) << validate(mesh).reason;
  EXPECT_EQ(mesh_pieces(mesh).euler, std::vector<int>{0});
  EXPECT_NEAR(mesh_pieces(mesh).volume.front(), mesh_pieces(skin.mesh).volume.front(),
              0.05 * mesh_pieces(skin.mesh).volume.front());
  const auto before = places(part.mesh), after = places(mesh);
  for (const auto& [id, position] : before)
    if (position.x < -0.3f) {
      ASSERT_TRUE(after.count(id)) << id;
      EXPECT_EQ(after.at(id), position);
    }
}
