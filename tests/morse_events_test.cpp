// The eight canonical Morse events, forward and backward in time, in 20 rotations and at 5 speeds.
#include <array>
#include <cmath>
#include <map>
#include <random>

#include <gtest/gtest.h>

#include "core/field/skeleton_field.h"
#include "core/mechanics/alter.h"
#include "core/mesh/small_pieces.h"
#include "core/mesh/validate.h"
#include "core/sampling/marching_cubes.h"
#include "core/topology/events.h"
#include "tests/digital_topology.h"

namespace isoskin {
namespace {

constexpr double kEdge = 0.18;
constexpr double kSpacing = 0.08;  // of the lattice the first skin comes from: it must see the narrowest feature

SkeletonElement ball(const DVec3& center, double radius, double weight = 1.0) {
  SkeletonElement e;
  e.a = e.b = center;
  e.radius = radius;
  e.weight = weight;
  return e;
}

/// A scene whose one critical point near the origin crosses zero at q = 0, rising with q.
struct Scene {
  const char* rising;
  const char* falling;
  std::vector<SkeletonElement> (*elements)(double q);
  double iso;
};

const Scene kScenes[4] = {
    {"create", "destroy",
     [](double q) {
       const double w = (1.0 + 0.3 * q) * 0.3;
       return std::vector<SkeletonElement>{ball({0, 0, 0}, 1.0, w), ball({0.3, 0.1, 0}, 0.8, 0.7 * w)};
     },
     0.46437},
    {"connect", "cut",
     [](double q) {
       const double d = 0.7 - 0.06 * q;
       return std::vector<SkeletonElement>{ball({-d, 0, 0}, 1.0), ball({d, 0, 0}, 1.0)};
     },
     0.265302},
    {"spackle", "pierce",
     [](double q) {
       const double w = 0.7 - 0.3 * q;
       return std::vector<SkeletonElement>{ball({0, 0, 0}, 4.0), ball({0, 0, 0.7}, 1.0, -w),
                                           ball({0, 0, -0.7}, 1.0, -w)};
     },
     0.8142886},
    {"burst_bubble", "open_bubble",
     [](double q) {
       return std::vector<SkeletonElement>{ball({0, 0, 0}, 2.0), ball({0, 0, 0}, 1.0, -0.6 + 0.15 * q)};
     },
     0.4},
};

DMat3 rotation(int number) {
  if (number == 0) return DMat3(1.0);
  std::mt19937 random{unsigned(number)};
  std::normal_distribution<double> normal;
  const auto vector = [&] {
    const double x = normal(random), y = normal(random), z = normal(random);
    return DVec3(x, y, z);
  };
  const DVec3 x = glm::normalize(vector());
  DVec3 y = vector();
  y = glm::normalize(y - glm::dot(x, y) * x);
  return DMat3(x, y, glm::cross(x, y));
}

std::shared_ptr<const SkeletonField> field_of(const Scene& scene, double q, const DMat3& turn, const DVec3& shift) {
  std::vector<SkeletonElement> elements = scene.elements(q);
  for (SkeletonElement& e : elements) e.a = e.b = turn * e.a + shift;
  return std::make_shared<SkeletonField>(elements, scene.iso);
}

/// Topology of the unturned scene by labelling; the same for every rotation.
const DigitalTopology& oracle(const Scene& scene, double q) {
  static std::map<std::pair<const Scene*, double>, DigitalTopology> known;
  const auto [it, fresh] = known.try_emplace({&scene, q});
  if (fresh) {
    const auto field = field_of(scene, q, DMat3(1.0), DVec3(0.013, 0.007, -0.011));
    const Box bounds = field->bounds();
    if (!bounds.empty()) it->second = digital_topology(*field, bounds, 0.04);
  }
  return it->second;
}

/// A skin kept on the field as the tracker does it, without certificate or repair: what tier 1 misses stays wrong.
class Skin {
public:
  explicit Skin(std::shared_ptr<const SkeletonField> field) : backend_(make_reference_backend()) {
    alter_.edge_length = relax_.edge_length = float(kEdge);
    project_.tolerance = float(1e-4 * kEdge);
    project_.max_step = float(0.5 * kEdge);
    options_.complete_elements = 0;  // concentric balls have whole spheres of critical points, which take long
    backend_->set_field(field);
    const BrickLattice lattice = sample_lattice(*field, *backend_, kSpacing);
    mesh_ = marching_cubes(lattice, lattice_topology(lattice));
    alter_.respect_locks = false;
    for (int round = 0; round < 6; ++round) settle();
    alter_.respect_locks = true;
  }

  /// The same skin turned and moved, about to be followed from `field`.
  Skin(const Skin& other, const DMat3& turn, const DVec3& shift, std::shared_ptr<const SkeletonField> field)
      : backend_(make_reference_backend()),
        options_(other.options_),
        alter_(other.alter_),
        relax_(other.relax_),
        project_(other.project_),
        mesh_(other.mesh_) {
    for (Vec3& p : mesh_.vertices.position) p = Vec3(turn * DVec3(p) + shift);
    backend_->set_field(field);
    state_ = start_critical_points(mesh_, field, *backend_, options_);
  }

  EventReport advance(std::shared_ptr<const SkeletonField> field) {
    backend_->set_field(field);
    const EventReport report = handle_critical_events(mesh_, state_, field, *backend_, options_);
    for (Index& age : mesh_.vertices.age) ++age;
    backend_->project(mesh_.vertices.position, project_, {});
    for (int round = 0; round < 2; ++round) settle();
    return report;
  }

  const TriangleMesh& mesh() const { return mesh_; }

private:
  void settle() {
    if (mesh_.empty()) return;
    alter(mesh_, alter_);
    backend_->set_mesh(mesh_);
    backend_->relax(relax_, project_);
    const auto positions = backend_->positions();
    const std::vector<Vec3> before = mesh_.vertices.position;
    mesh_.vertices.position.assign(positions.begin(), positions.end());
    for (const Index v : small_piece_vertices(mesh_)) {
      mesh_.vertices.position[v] = before[v];
      backend_->project(std::span(&mesh_.vertices.position[v], 1), project_, {});
    }
  }

  std::unique_ptr<Backend> backend_;
  EventOptions options_ = event_options(kEdge);
  AlterOptions alter_;
  RelaxOptions relax_;
  ProjectOptions project_;
  TriangleMesh mesh_;
  CriticalState state_;
};

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

class MorseEvents : public testing::TestWithParam<int> {};

TEST_P(MorseEvents, are_followed_in_every_rotation_at_every_speed) {
  const Scene& scene = kScenes[GetParam() / 2];
  const bool rising = GetParam() % 2 == 0;
  const DVec3 origin(0.013, 0.007, -0.011);
  int inverted = 0, far = 0, vertices = 0;
  for (const double speed : {0.1, 0.2, 0.35, 0.6, 0.8}) {
    const auto q_at = [&](int frame) { return (rising ? 1.0 : -1.0) * (frame - 1.5) * speed; };
    const Skin first(field_of(scene, q_at(0), DMat3(1.0), DVec3(0.0)));
    for (int turn = 0; turn < 20; ++turn) {
      SCOPED_TRACE(testing::Message() << "speed " << speed << " turn " << turn);
      const DMat3 axes = rotation(turn);
      const auto field_at = [&](int frame) {
        const DVec3 drift = speed * kEdge * frame * axes * DVec3(0.5, 0.3, -0.4);
        return field_of(scene, q_at(frame), axes, origin + drift);
      };
      Skin skin(first, axes, origin, field_at(0));
      std::vector<std::string> events;
      for (int frame = 1; frame < 4; ++frame) {
        const auto field = field_at(frame);
        const EventReport report = skin.advance(field);
        for (const CriticalEvent& event : report.events) {
          EXPECT_TRUE(event.done) << event.kind << ": " << event.reason;
          EXPECT_EQ(frame, 2);
          events.push_back(event.kind);
        }
        const DigitalTopology& truth = oracle(scene, q_at(frame));
        const TriangleMesh& mesh = skin.mesh();
        const MeshPieces pieces = mesh_pieces(mesh);
        int euler = 0;
        for (const int e : pieces.euler) euler += e;
        EXPECT_EQ(euler, 2 * truth.euler) << "frame " << frame;
        EXPECT_EQ(int(pieces.count()), truth.components + truth.cavities) << "frame " << frame;
        if (!mesh.empty()) {
          ASSERT_TRUE(validate(mesh)) << validate(mesh).reason;
        }
        inverted += int(misplaced(mesh, *field));
        for (const Vec3& p : mesh.vertices.position) far += field->distance_estimate(DVec3(p)) > 0.01 * kEdge;
        vertices += int(mesh.vertex_count());
      }
      EXPECT_EQ(events, std::vector<std::string>{rising ? scene.rising : scene.falling});
    }
  }
  EXPECT_EQ(far, 0);
  EXPECT_LE(1000 * inverted, vertices);  // necks thinner than an edge fold a little
}

INSTANTIATE_TEST_SUITE_P(Tier1, MorseEvents, testing::Range(0, 8), [](const auto& which) {
  const Scene& scene = kScenes[which.param / 2];
  return std::string(which.param % 2 == 0 ? scene.rising : scene.falling);
});

}  // namespace
}  // namespace isoskin
