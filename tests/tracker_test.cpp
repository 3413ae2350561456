// Whole frames: equilibrium, jumps, long runs, topology changes, determinism and resumption.
#include "core/tracker.h"

#include <cstdio>
#include <cstring>
#include <map>

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include "core/counter_random.h"
#include "core/field/skeleton_field.h"
#include "core/io/ply.h"
#include "core/io/scene.h"
#include "core/mesh/validate.h"
#include "core/topology/triangle_pairs.h"
#include "kernels/opencl_backend.h"
#include "tests/analytic_fields.h"
#include "tests/digital_topology.h"
#include "tests/sanitized.h"
#include "tests/temporary_folder.h"

using namespace isoskin;
using namespace isoskin::analytic;

namespace {

FieldFrame frame_of(std::shared_ptr<const Field> field, int frame = 1, double dt = 0.04) {
  return {frame, frame * dt, std::move(field), nullptr};
}

Tracker reference_tracker(const Field& first, double edge_length = 0.0) {
  TrackOptions options;
  options.edge_length = edge_length;
  options.validate = true;
  return Tracker(make_reference_backend(), resolved(options, first));
}

std::unique_ptr<Tracker> opencl_tracker(const Field& first, double edge_length = 0.0,
                                        std::optional<double> sagitta = std::nullopt) {
  TrackOptions options;
  options.edge_length = edge_length;
  options.sagitta = sagitta;
  options.validate = true;
  return std::make_unique<Tracker>(make_opencl_backend(), resolved(options, first));
}

double farthest_in_edges(const Tracker& tracker, const Field& field) {
  double worst = 0.0;
  for (const Vec3& p : tracker.mechanical().vertices.position)
    worst = std::max(worst, field.distance_estimate(DVec3(p)));
  return worst / tracker.options().edge_length;
}

std::string data(const char* file) {
  return std::string(ISOSKIN_TEST_DATA) + "/" + file;
}

template <class T>
bool same_bytes(const std::vector<T>& a, const std::vector<T>& b) {
  return a.size() == b.size() && (a.empty() || std::memcmp(a.data(), b.data(), a.size() * sizeof(T)) == 0);
}

void expect_same_bytes(const TriangleMesh& a, const TriangleMesh& b) {
  EXPECT_TRUE(same_bytes(a.vertex, b.vertex));
  EXPECT_TRUE(same_bytes(a.twin, b.twin));
  EXPECT_TRUE(same_bytes(a.vertices.position, b.vertices.position));
  EXPECT_TRUE(same_bytes(a.vertices.rest, b.vertices.rest));
  EXPECT_TRUE(same_bytes(a.vertices.velocity, b.vertices.velocity));
  EXPECT_TRUE(same_bytes(a.vertices.id, b.vertices.id));
  EXPECT_TRUE(same_bytes(a.vertices.age, b.vertices.age));
  EXPECT_EQ(a.next_id, b.next_id);
}

/// Pieces, cavities and handles of a mesh, to compare with the digital oracle.
DigitalTopology mesh_topology(const TriangleMesh& mesh) {
  const MeshPieces pieces = mesh_pieces(mesh);
  DigitalTopology topology;
  int handles = 0;
  for (std::size_t p = 0; p < pieces.count(); ++p) {
    (pieces.volume[p] > 0.0 ? topology.components : topology.cavities) += 1;
    handles += 1 - pieces.euler[p] / 2;
  }
  topology.euler = topology.components + topology.cavities - handles;
  return topology;
}

struct NamedField {
  const char* name;
  std::shared_ptr<const Field> field;
};

std::vector<NamedField> equilibrium_fields() {
  std::vector<SkeletonElement> chain;
  for (int i = 0; i < 6; ++i) {
    SkeletonElement ball;
    ball.a = ball.b = DVec3(0.7 * i, 0.25 * std::sin(1.3 * i), 0.2 * std::cos(0.9 * i));
    chain.push_back(ball);
  }
  return {{"sphere", std::make_shared<SphereField>(DVec3(0.1, 0.2, 0.3), 1.0)},
          {"torus", std::make_shared<TorusField>(1.0, 0.4)},
          {"metaball chain", std::make_shared<SkeletonField>(chain, 0.3)}};
}

}  // namespace

TEST(Tracker, MarchingCubesReachesEquilibrium) {
  for (const auto& [name, field] : equilibrium_fields()) {
    Tracker tracker = reference_tracker(*field);
    FrameReport report;
    for (int frame = 1; frame <= 4; ++frame) report = tracker.advance(frame_of(field, frame));
    std::printf(
        "%-15s %6zu triangles, angles: mean %.1f, 1st percentile %.1f, least %.1f degrees; farthest vertex %.1e e\n",
        name, report.mechanical_triangles, report.mechanical.mean_angle, report.mechanical.p1_angle,
        report.mechanical.min_angle, farthest_in_edges(tracker, *field));
    EXPECT_TRUE(report.certified) << name << ": " << report.certificate;
    EXPECT_GE(report.mechanical.mean_angle, 52.0) << name;
    EXPECT_GE(report.mechanical.min_angle, 20.0) << name;
    EXPECT_LE(farthest_in_edges(tracker, *field), 1e-3) << name;
    EXPECT_NEAR(report.mechanical.mean_edge / tracker.options().edge_length, 1.0, 0.15) << name;
  }
}

TEST(Tracker, VerticesSurviveWhenTheFieldStands) {
  const auto field = std::make_shared<TorusField>(1.0, 0.4);
  Tracker tracker = reference_tracker(*field, 0.1);
  FrameReport report;
  for (int frame = 1; frame <= 6; ++frame) report = tracker.advance(frame_of(field, frame));
  EXPECT_GT(report.survived, 0.999);
  EXPECT_EQ(report.repairs, 0u);
}

TEST(Tracker, InvertedTrianglesAfterAJumpAreGoneWithinTwoFrames) {
  // A bumpy ball that jumps by most of an edge sideways: projection alone folds triangles over at the bumps.
  const auto bumpy = [](double shift) {
    std::vector<SkeletonElement> elements;
    for (int i = 0; i < 12; ++i) {
      SkeletonElement ball;
      const double a = 2.399963 * i, z = 1.0 - (2.0 * i + 1.0) / 12.0, r = std::sqrt(1.0 - z * z);
      ball.a = ball.b = DVec3(shift + 0.75 * r * std::cos(a), 0.75 * r * std::sin(a), 0.75 * z);
      ball.radius = 0.8;
      elements.push_back(ball);
    }
    return std::make_shared<SkeletonField>(elements, 0.35);
  };
  const double e = 0.06;
  Tracker tracker = reference_tracker(*bumpy(0.0), e);
  tracker.advance(frame_of(bumpy(0.0), 1));

  // How bad the jump is without mechanics: fold some triangles by hand as well, so that there is something to mend.
  TriangleMesh folded = tracker.mechanical();
  for (Index h = 0; h < folded.vertex.size(); h += 600) {
    const Index v = folded.vertex[h];
    const Vec3 across = folded.position(folded.to(h)) - folded.position(v);
    folded.vertices.position[v] += 1.6f * across;
  }
  auto probe = make_reference_backend();
  probe->set_field(bumpy(0.25 * e));
  probe->set_mesh(folded);
  probe->project_mesh(tracker.options().project);
  std::vector<std::uint8_t> inverted(folded.triangle_count());
  probe->inverted_triangles(inverted);
  const auto before = std::count(inverted.begin(), inverted.end(), 1);
  ASSERT_GT(before, 0);

  tracker.resume(folded, frame_of(bumpy(0.0), 1));
  FrameReport report = tracker.advance(frame_of(bumpy(0.25 * e), 2));
  std::printf("inverted: %td after the jump, %zu after one frame", before, report.inverted);
  report = tracker.advance(frame_of(bumpy(0.25 * e), 3));
  std::printf(", %zu after two\n", report.inverted);
  EXPECT_EQ(report.inverted, 0u);
  EXPECT_EQ(report.repairs, 0u);
}

TEST(Tracker, TwoHundredFramesOfSevenMetaballs) {
  const Scene scene = load_scene(data("metaballs7.toml"));
  std::unique_ptr<Tracker> tracker;
  double worst_p1 = 90.0;
  const int first = scene.source->first_frame(), last = scene.source->last_frame();
  for (int frame = first; frame <= std::min(last, first + test::repeats(last - first, 30)); ++frame) {
    const FieldFrame moment = scene.source->load(frame);
    // The geometric mesh is not looked at here.
    if (!tracker) tracker = opencl_tracker(*moment.field, 0.0, 0.0);
    const FrameReport report = tracker->advance(moment);
    const ValidateReport valid = validate(tracker->mechanical());
    ASSERT_TRUE(valid) << frame << ": " << valid.reason;
    ASSERT_TRUE(report.certified) << frame << ": " << report.certificate;
    if (frame > scene.source->first_frame()) {
      EXPECT_EQ(report.repairs, 0u) << frame << ": " << report.certificate;
    }
    EXPECT_GE(report.mechanical.p1_angle, 30.0) << frame;
    worst_p1 = std::min(worst_p1, report.mechanical.p1_angle);
  }
  EXPECT_GE(scene.source->last_frame() - scene.source->first_frame() + 1, 200);
  std::printf("worst 1st-percentile angle %.1f degrees\n", worst_p1);
}

void expect_two_points_as_the_oracle_says(Topology topology, const char* joined, const char* parted) {
  const Scene scene = load_scene(data("two_points.toml"));
  std::unique_ptr<Tracker> tracker;
  std::vector<int> components;
  std::vector<std::string> events;
  for (int frame = scene.source->first_frame(); frame <= scene.source->last_frame(); ++frame) {
    const FieldFrame moment = scene.source->load(frame);
    if (!tracker) {
      TrackOptions options;
      options.topology = topology;
      options.sagitta = 0.0;
      options.validate = true;
      tracker = std::make_unique<Tracker>(make_opencl_backend(), resolved(options, *moment.field));
    }
    const FrameReport report = tracker->advance(moment);
    EXPECT_TRUE(report.certified) << frame;
    const DigitalTopology mesh = mesh_topology(tracker->mechanical());
    if (frame % test::repeats(1, 20) == 0) {
      const Box box = moment.field->bounds();
      const DigitalTopology oracle = digital_topology(*moment.field, box, box.diagonal() / 100.0);
      EXPECT_EQ(mesh.components, oracle.components) << frame;
      EXPECT_EQ(mesh.cavities, oracle.cavities) << frame;
      EXPECT_EQ(mesh.handles(), oracle.handles()) << frame;
      EXPECT_EQ(mesh_topology(tracker->geometric().mesh).handles(), oracle.handles()) << frame;
    }
    if (components.empty() || components.back() != mesh.components) components.push_back(mesh.components);
    for (const LedgerEntry& entry : tracker->ledger()) {
      events.push_back(entry.kind);
      EXPECT_EQ(entry.tier, 1) << frame << ": " << entry.kind;
    }
    if (frame == scene.source->first_frame()) continue;
    EXPECT_EQ(report.repairs, 0u) << frame << ": " << report.certificate;
    EXPECT_EQ(report.reextracted[1] + report.reextracted[2], 0.0) << frame;
    EXPECT_EQ(report.reextracted[0] > 0.0, report.events > 0) << frame;
  }
  EXPECT_EQ(components, (std::vector<int>{2, 1, 2}));
  EXPECT_EQ(events, (std::vector<std::string>{joined, parted}));
}

TEST(Tracker, TwoPointsMeetAndPartByCriticalPoints) {
  expect_two_points_as_the_oracle_says(Topology::critical, "connect", "cut");
}

TEST(Tracker, TwoPointsMeetAndPartByCollision) {
  expect_two_points_as_the_oracle_says(Topology::collision, "blend", "split");
}

TEST(Tracker, EveryFrameOfARealFluidIsCertified) {
  const Scene scene = open_input(data("dam_break/dam_break.%04d.vdb"));
  std::unique_ptr<Tracker> tracker;
  const int first = scene.source->first_frame();
  for (int frame = first; frame < first + test::repeats(6, 3); ++frame) {
    const FieldFrame moment = scene.source->load(frame);
    if (!tracker) tracker = opencl_tracker(*moment.field);
    const FrameReport report = tracker->advance(moment);
    EXPECT_TRUE(report.certified) << frame << ": " << report.certificate;
  }
}

TEST(Tracker, SameBytesWhateverTheNumberOfThreads) {
  const Scene scene = load_scene(data("two_points.toml"));
  const auto run = [&](std::size_t threads) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    std::unique_ptr<Tracker> tracker;
    const Scene fresh = load_scene(data("two_points.toml"));
    const int first = fresh.source->first_frame(), last = fresh.source->last_frame();
    for (int frame = first; frame <= last; frame += std::max(1, (last - first) / test::repeats(8, 4))) {
      const FieldFrame moment = fresh.source->load(frame);
      if (!tracker) tracker = opencl_tracker(*moment.field);
      tracker->advance(moment);
    }
    return std::pair{tracker->mechanical(), tracker->geometric().mesh};
  };
  const auto one = run(1), many = run(4);
  expect_same_bytes(one.first, many.first);
  expect_same_bytes(one.second, many.second);
}

/// Sixteen balls in a box too small for them, thrown about: topology changes in nearly every frame, often several
/// times.
std::shared_ptr<const SkeletonField> crowd_at(double time) {
  std::vector<SkeletonElement> elements;
  for (int i = 0; i < 16; ++i) {
    SkeletonElement ball;
    const double a = 2.399963 * i;
    ball.a = ball.b = DVec3(1.4 * std::sin(a + (1.0 + 0.13 * i) * time), 1.2 * std::cos(1.7 * a + 1.3 * time),
                            1.2 * std::sin(2.3 * a - (0.7 + 0.11 * i) * time));
    ball.radius = 0.7 + 0.2 * std::sin(5.0 * a);
    elements.push_back(ball);
  }
  return std::make_shared<SkeletonField>(elements, 0.3);
}

TEST(Tracker, ResumingAfterAnyFrameChangesNothing) {
  const test::TemporaryFolder folder;
  constexpr int kFrames = test::repeats(8, 5);
  const double e = 0.16;
  std::vector<FieldFrame> frames;
  for (int k = 0; k < kFrames; ++k) frames.push_back(frame_of(crowd_at(0.06 * k), k));
  auto whole = opencl_tracker(*frames[0].field, e);
  whole->advance(frames[0]);
  std::size_t events = 0;
  for (int k = 1; k < kFrames; ++k) {
    SCOPED_TRACE(k);
    // As the program does: through a file. Every frame follows from the one before, so all follow from any.
    write_ply(folder / "skin.ply", whole->mechanical(), {}, {k - 1, frames[k - 1].time, whole->critical_points()});
    PlyMesh skin = read_ply(folder / "skin.ply");
    auto resumed = opencl_tracker(*frames[0].field, e);
    resumed->resume(std::move(skin.mesh), frames[k - 1], skin.header.critical_points);
    resumed->advance(frames[k]);
    whole->advance(frames[k]);
    for (const LedgerEntry& entry : whole->ledger()) events += entry.tier == 1;
    expect_same_bytes(whole->mechanical(), resumed->mechanical());
    expect_same_bytes(whole->geometric().mesh, resumed->geometric().mesh);
    EXPECT_TRUE(whole->critical_points() == resumed->critical_points());
  }
  EXPECT_GE(events, std::size_t(test::repeats(10, 5)));
}

/// A row of balls at rest, on one end of which another falls.
std::shared_ptr<const SkeletonField> row_at(int frame) {
  std::vector<SkeletonElement> elements(8);
  for (int i = 0; i < 7; ++i) elements[i].a = elements[i].b = DVec3(0.7 * i, 0.0, 0.0);
  elements[7].a = elements[7].b = DVec3(0.0, 0.0, std::max(0.5, 2.2 - 0.1 * frame));
  return std::make_shared<SkeletonField>(elements, 0.3);
}

TEST(Tracker, WhatIsAtRestSleepsAndWakesWhenTheFieldMoves) {
  const test::TemporaryFolder folder;
  constexpr int kFrames = 20, kSaved = 11;
  constexpr float kFarEnd = 2.0f, kNearEnd = -0.2f;  // out of reach of the falling ball, and within it at the end
  const double e = 0.12;
  std::vector<FieldFrame> frames;
  for (int k = 0; k < kFrames; ++k) frames.push_back(frame_of(row_at(k), k));
  auto tracker = opencl_tracker(*frames[0].field, e), resumed = opencl_tracker(*frames[0].field, e);
  const int settled = int(tracker->options().sleep.rest_frames) + 1;
  std::map<Index, Vec3> asleep;
  std::size_t slept = 0, woken = 0;
  for (int k = 0; k < kFrames; ++k) {
    SCOPED_TRACE(k);
    const FrameReport report = tracker->advance(frames[k]);
    EXPECT_TRUE(report.certified) << report.certificate;
    const TriangleMesh& mesh = tracker->mechanical();
    if (k % test::repeats(1, 5) == 0) {
      const Box box = frames[k].field->bounds();
      const DigitalTopology oracle = digital_topology(*frames[k].field, box, box.diagonal() / 60.0);
      EXPECT_EQ(mesh_topology(mesh).components, oracle.components);
      EXPECT_EQ(mesh_topology(mesh).handles(), oracle.handles());
    }
    for (Index v = 0; v < mesh.vertex_count(); ++v) {
      const Vec3 p = mesh.position(v);
      const auto before = asleep.find(mesh.vertices.id[v]);
      if (before != asleep.end() && p.x > kFarEnd) {
        EXPECT_EQ(p, before->second);
        ++slept;
      }
      woken += before != asleep.end() && before->second.x < kNearEnd && p != before->second;
      if (mesh.vertices.age[v] >= Index(settled) - 1) asleep[mesh.vertices.id[v]] = p;
    }
    if (k == kSaved) {
      write_ply(folder / "skin.ply", mesh, {}, {k, frames[k].time, tracker->critical_points()});
      PlyMesh skin = read_ply(folder / "skin.ply");
      resumed->resume(std::move(skin.mesh), frames[k], skin.header.critical_points);
    } else if (k > kSaved) {
      resumed->advance(frames[k]);
      expect_same_bytes(mesh, resumed->mechanical());
      expect_same_bytes(tracker->geometric().mesh, resumed->geometric().mesh);
    }
  }
  EXPECT_GT(slept, 1000u);
  EXPECT_GT(woken, 0u);
}

TEST(Tracker, SelfIntersectionsAreCountedInBothMeshes) {
  const Scene scene = load_scene(data("metaballs60.toml"));
  std::unique_ptr<Tracker> tracker;
  std::size_t seen = 0;
  for (int frame = 1; frame <= 4; ++frame) {
    const FieldFrame moment = scene.source->load(frame);
    if (!tracker) {
      TrackOptions options;
      options.edge_length = 0.5;  // too long for so many small balls: skins that belong apart overlap
      options.sagitta = 0.0;
      options.self_intersections = true;
      tracker = std::make_unique<Tracker>(make_opencl_backend(), resolved(options, *moment.field));
    }
    const FrameReport report = tracker->advance(moment);
    ASSERT_TRUE(report.mechanical_intersections);
    EXPECT_EQ(report.geometric_intersections, count_self_intersections(tracker->geometric().mesh));
    EXPECT_EQ(*report.mechanical_intersections, count_self_intersections(tracker->mechanical()));
    seen += *report.mechanical_intersections;
  }
  EXPECT_GT(seen, 0u);
}

TEST(Tracker, CuspsAreMendedWhereTheyAre) {
  const Scene scene = load_scene(data("norm_p06.toml"));
  const FieldFrame first = scene.source->load(6);
  const auto tracker = opencl_tracker(*first.field);
  const FrameReport extracted = tracker->advance(first);
  EXPECT_TRUE(extracted.certified);
  EXPECT_LT(extracted.reextracted[2], 1.5) << "once, and no finer";
  const FrameReport followed = tracker->advance(scene.source->load(7));
  EXPECT_TRUE(followed.certified);
  EXPECT_GT(followed.repairs, 0u) << "what is to be shown did not happen";
  EXPECT_EQ(followed.reextracted[2], 0.0);
  EXPECT_GT(followed.survived, 0.9);
}

TEST(Tracker, SurfacesMayVanishAndReturn) {
  const auto ball = std::make_shared<SphereField>(DVec3(0.0), 0.5);
  const auto nothing = std::make_shared<SphereField>(DVec3(0.0), -1.0);
  Tracker tracker = reference_tracker(*ball, 0.1);
  EXPECT_GT(tracker.advance(frame_of(ball, 1)).mechanical_triangles, 0u);
  EXPECT_EQ(tracker.advance(frame_of(nothing, 2)).mechanical_triangles, 0u);
  EXPECT_TRUE(tracker.geometric().mesh.empty());
  const FrameReport back = tracker.advance(frame_of(ball, 3));
  EXPECT_GT(back.mechanical_triangles, 0u);
  EXPECT_TRUE(back.certified);
}

double resolved_edge_length(double given, const Field& field) {
  TrackOptions options;
  options.edge_length = given;
  return resolved(options, field).edge_length;
}

/// Frames of balls that wander at random, repaired locally or extracted anew.
int repaired_frames(unsigned seed, std::vector<int> parts) {
  constexpr int kBalls = 14, kFrames = 16;
  const auto field_at = [&](int frame) {
    std::vector<SkeletonElement> balls(kBalls);
    for (unsigned i = 0; i < kBalls; ++i) {
      const DVec3 from = counter_point(seed, 2 * i), to = counter_point(seed, 2 * i + 1);
      balls[i].a = balls[i].b = DVec3(3.0, 2.0, 2.0) * glm::mix(from, to, double(frame) / kFrames);
      balls[i].radius = 0.7;
    }
    return std::make_shared<SkeletonField>(balls, 0.2);
  };
  TrackOptions options;
  options.parts = std::move(parts);
  options.refine.passes = 0;
  options.validate = true;
  Tracker tracker(make_opencl_backend(), resolved(options, *field_at(0)));
  int repaired = 0;
  for (int i = 0; i < kFrames; ++i) {
    const FrameReport report = tracker.advance(frame_of(field_at(i), i));
    EXPECT_TRUE(report.certified);
    repaired += i > 0 && report.repairs > 0;
  }
  return repaired;
}

TEST(Tracker, FramesThatFailAreFollowedInParts) {
  int without = 0, with = 0;
  for (const unsigned seed : {0u, 2u}) {
    without += repaired_frames(seed, {});
    with += repaired_frames(seed, {2, 4});
  }
  RecordProperty("without", without);
  RecordProperty("with", with);
  EXPECT_LT(with, without);
}

TEST(Tracker, AbsurdEdgeLengthsAreRefused) {
  const SphereField ball(DVec3(0.0), 1.0);
  const double diagonal = ball.bounds().diagonal();
  for (const double e : {-1.0, 1e-9, diagonal / 4100.0, 1.01 * diagonal, 100.0, std::nan(""), double(INFINITY)})
    EXPECT_THROW(resolved_edge_length(e, ball), InputError) << e;
  for (const double e : {diagonal / 4090.0, 0.1, diagonal}) EXPECT_EQ(resolved_edge_length(e, ball), e);
}

TEST(Tracker, AGridMayHaveItsDefaultEdgeLengthHoweverManyVoxelsItHas) {
  struct ManyVoxels final : Field {
    SphereField ball{DVec3(0.0), 1.0};
    FieldSample sample(const DVec3& p) const override { return ball.sample(p); }
    Box bounds() const override { return ball.bounds(); }
    Interval range(const Box& box) const override { return ball.range(box); }
    double resolution() const override { return bounds().diagonal() / 10'000.0; }
  };
  const ManyVoxels grid;
  const double usual = 1.5 * grid.resolution();
  EXPECT_EQ(resolved_edge_length(0.0, grid), usual);
  EXPECT_EQ(resolved_edge_length(usual, grid), usual);
  EXPECT_THROW(resolved_edge_length(0.99 * usual, grid), InputError);
}
