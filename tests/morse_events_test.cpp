// The eight canonical Morse events, forward and backward in time, in 20 rotations and at 5 speeds, through the whole
// tracker: the topology is the oracle's in every frame, and tier 1 made it so.
#include <array>
#include <map>
#include <numeric>
#include <random>
#include <sstream>

#include <gtest/gtest.h>
#include <tbb/parallel_for.h>

#include "core/field/skeleton_field.h"
#include "core/tracker.h"
#include "tests/digital_topology.h"
#include "tests/morse_scenes.h"
#include "tests/random_rotation.h"
#include "tests/sanitized.h"

namespace isoskin {
namespace {

using test::kMorseScenes;
using test::MorseScene;

DMat3 rotation(int number) {
  std::mt19937 random{unsigned(number)};
  return number == 0 ? DMat3(1.0) : test::random_rotation(random);
}

/// Two frames before the event and two after it; `speed` is the change of q a frame.
double q_at(int frame, double speed, bool rising) {
  return (rising ? 1.0 : -1.0) * (frame - 1.5) * speed;
}

std::shared_ptr<const SkeletonField> field_of(const MorseScene& scene, double q, const DMat3& turn,
                                              const DVec3& shift) {
  std::vector<SkeletonElement> elements = scene.elements(q);
  for (SkeletonElement& e : elements) e.a = e.b = turn * e.a + shift;
  return std::make_shared<SkeletonField>(elements, scene.iso);
}

/// Topology of the unturned scene by labelling; the same for every rotation.
const DigitalTopology& oracle(const MorseScene& scene, double q) {
  static std::map<std::pair<const MorseScene*, double>, DigitalTopology> known;
  const auto [it, fresh] = known.try_emplace({&scene, q});
  if (fresh) {
    const auto field = field_of(scene, q, DMat3(1.0), DVec3(0.013, 0.007, -0.011));
    const Box bounds = field->bounds();
    if (!bounds.empty()) it->second = digital_topology(*field, bounds, 0.04);
  }
  return it->second;
}

/// Faces that look inside: the skin is folded there.
std::size_t misplaced(const TriangleMesh& mesh, const Field& field) {
  std::size_t count = 0;
  for (Index t = 0; t < mesh.triangle_count(); ++t) {
    const DVec3 a(mesh.position(mesh.vertex[3 * t])), b(mesh.position(mesh.vertex[3 * t + 1])),
        c(mesh.position(mesh.vertex[3 * t + 2]));
    const DVec3 normal = glm::cross(b - a, c - a);
    bool inverted = true;
    for (const DVec3& p : {a, b, c}) inverted = inverted && glm::dot(normal, field.sample(p).gradient) > 0.0;
    count += inverted;
  }
  return count;
}

constexpr std::array<double, 5> kSpeeds = {0.1, 0.2, 0.35, 0.6, 0.8};
constexpr int kTurns = test::repeats(20, 1), kFrames = 4;

/// What one run of four frames came to; the event is between the second and the third.
struct Outcome {
  std::string faults;
  std::size_t inverted = 0, triangles = 0;
};

TrackOptions track_options(const MorseScene& scene, const Field& field) {
  TrackOptions options;
  options.edge_length = scene.edge;
  options.validate = true;
  options.refine.passes = 0;
  return resolved(options, field);
}

/// The skin of the unturned scene, as a tracker settles it: every rotation begins with it.
TriangleMesh first_skin(const MorseScene& scene, const std::shared_ptr<const SkeletonField>& field) {
  Tracker tracker(make_reference_backend(), track_options(scene, *field));
  tracker.advance({0, 0.0, field, nullptr});
  return tracker.mechanical();
}

Outcome follow(const MorseScene& scene, bool rising, double speed, int turn, TriangleMesh skin,
               const std::array<DigitalTopology, kFrames>& truth) {
  const DMat3 axes = rotation(turn);
  const DVec3 origin(0.013, 0.007, -0.011);
  const auto field_at = [&](int frame) {
    const DVec3 drift = speed * scene.edge * frame * axes * DVec3(0.5, 0.3, -0.4);
    return field_of(scene, q_at(frame, speed, rising), axes, origin + drift);
  };
  for (Vec3& p : skin.vertices.position) p = Vec3(axes * DVec3(p) + origin);
  Tracker tracker(make_reference_backend(), track_options(scene, *field_at(0)));
  tracker.resume(std::move(skin), {0, 0.0, field_at(0), nullptr});
  Outcome outcome;
  std::ostringstream faults;
  for (int frame = 1; frame < kFrames; ++frame) {
    const auto field = field_at(frame);
    const FrameReport report = tracker.advance({frame, 0.04 * frame, field, nullptr});
    const TriangleMesh& mesh = tracker.mechanical();
    const MeshPieces pieces = mesh_pieces(mesh);
    const int euler = std::accumulate(pieces.euler.begin(), pieces.euler.end(), 0);
    const auto fault = [&]() -> std::ostream& {
      return faults << "speed " << speed << " turn " << turn << " frame " << frame << ": ";
    };
    if (euler != 2 * truth[frame].euler) fault() << "Euler characteristic " << euler << "\n";
    if (int(pieces.count()) != truth[frame].components + truth[frame].cavities)
      fault() << pieces.count() << " pieces\n";
    if (!report.certified) fault() << "not certified\n";
    if (report.repairs || report.reextracted[1] + report.reextracted[2] > 0.0) fault() << report.certificate << "\n";
    const std::string wanted = frame == 2 ? (rising ? scene.rising : scene.falling) : "";
    std::string seen;
    for (const LedgerEntry& entry : tracker.ledger()) seen += entry.kind + (entry.tier == 1 ? "" : " again");
    if (seen != wanted) fault() << "the ledger says \"" << seen << "\"\n";
    outcome.inverted += misplaced(mesh, *field);
    outcome.triangles += mesh.triangle_count();
  }
  outcome.faults = faults.str();
  return outcome;
}

class MorseEvents : public testing::TestWithParam<int> {};

TEST_P(MorseEvents, are_operated_on_in_every_rotation_at_every_speed) {
  const MorseScene& scene = kMorseScenes[GetParam() / 2];
  const bool rising = GetParam() % 2 == 0;
  std::array<std::array<DigitalTopology, kFrames>, kSpeeds.size()> truth;
  std::array<TriangleMesh, kSpeeds.size()> skin;
  for (std::size_t s = 0; s < kSpeeds.size(); ++s) {
    skin[s] = first_skin(scene, field_of(scene, q_at(0, kSpeeds[s], rising), DMat3(1.0), DVec3(0.0)));
    for (int frame = 0; frame < kFrames; ++frame) truth[s][frame] = oracle(scene, q_at(frame, kSpeeds[s], rising));
  }
  std::vector<Outcome> runs(kSpeeds.size() * kTurns);
  tbb::parallel_for(std::size_t(0), runs.size(), [&](std::size_t i) {
    const std::size_t s = i / kTurns;
    runs[i] = follow(scene, rising, kSpeeds[s], int(i % kTurns), skin[s], truth[s]);
  });
  Outcome all;
  for (const Outcome& run : runs) {
    all.faults += run.faults;
    all.inverted += run.inverted;
    all.triangles += run.triangles;
  }
  EXPECT_EQ(all.faults, "");
  EXPECT_LE(1000 * all.inverted, all.triangles);  // necks thinner than an edge fold a little
}

INSTANTIATE_TEST_SUITE_P(Tier1, MorseEvents, testing::Range(0, 8), [](const auto& which) {
  const MorseScene& scene = kMorseScenes[which.param / 2];
  return std::string(which.param % 2 == 0 ? scene.rising : scene.falling);
});

}  // namespace
}  // namespace isoskin
