// Skins that carry material: rigid rotation, a vortex, first frames, slides on a standing surface.
#include "core/mechanics/motion.h"

#include <cmath>

#include <gtest/gtest.h>

#include "core/io/sequence.h"
#include "core/sampling/closest_point.h"
#include "core/tracker.h"
#include "kernels/opencl_backend.h"
#include "tests/analytic_fields.h"
#include "tests/sanitized.h"
#include "tests/test_meshes.h"

using namespace isoskin;
using namespace isoskin::analytic;
using isoskin::test_meshes::icosphere;

namespace {

/// Turns about the z axis, `rate` radians a second.
class Rotation final : public VelocityField {
public:
  explicit Rotation(double rate) : rate_(rate) {}
  DVec3 velocity(const DVec3& p) const override { return rate_ * DVec3(-p.y, p.x, 0.0); }

private:
  double rate_;
};

DVec3 turned(const DVec3& p, double angle) {
  return {std::cos(angle) * p.x - std::sin(angle) * p.y, std::sin(angle) * p.x + std::cos(angle) * p.y, p.z};
}

std::unique_ptr<Backend> backend_with(std::shared_ptr<const Field> field) {
  auto backend = make_reference_backend();
  backend->set_field(std::move(field));
  return backend;
}

}  // namespace

TEST(Motion, prediction_with_a_velocity_grid_is_of_second_order) {
  const auto sphere = std::make_shared<SphereField>(DVec3(0.0), 1.0);
  const auto backend = backend_with(sphere);
  const Rotation rotation(1.0);
  const auto error = [&](double dt) {
    TriangleMesh mesh = icosphere(3);
    sample_velocities(mesh, rotation);
    const std::vector<Vec3> old = mesh.vertices.position;
    predict(mesh, &rotation, dt, *sphere, *backend, ProjectOptions{.tolerance = 1e-7f});
    double worst = 0.0;
    for (Index v = 0; v < mesh.vertex_count(); ++v)
      worst = std::max(worst, glm::distance(DVec3(mesh.position(v)), turned(DVec3(old[v]), dt)));
    return worst;
  };
  const double coarse = error(0.4), fine = error(0.2);
  EXPECT_LT(coarse, 0.4 * 0.4 * 0.4 / 4.0);
  EXPECT_GT(coarse / fine, 6.0);  // a step's error is of third order
}

TEST(Motion, slides_carry_linear_rest_positions_exactly) {
  TriangleMesh mesh = icosphere(4);
  const std::vector<Vec3> before = mesh.vertices.position;
  const auto from = [](const Vec3& p) { return DVec3(2.0 * p.x - p.y, p.z + 0.5 * p.y, 3.0 * p.x + 0.25); };
  for (Index v = 0; v < mesh.vertex_count(); ++v) mesh.vertices.rest[v] = Vec3(from(before[v]));
  const double edge = shape_statistics(mesh).mean_edge;
  for (Index v = 0; v < mesh.vertex_count(); ++v) {  // within the one-ring, over the surface
    const Vec3 n = glm::normalize(before[v]);
    const Vec3 side = glm::cross(n, std::abs(n.x) < 0.5f ? Vec3(1, 0, 0) : Vec3(0, 1, 0));
    mesh.vertices.position[v] = glm::normalize(before[v] + float(0.3 * edge * std::sin(7.0 * v)) * side);
  }
  slide_rest(mesh, before);
  double worst = 0.0, unmoved = 0.0;
  for (Index v = 0; v < mesh.vertex_count(); ++v) {
    worst = std::max(worst, glm::distance(DVec3(mesh.vertices.rest[v]), from(mesh.position(v))));
    unmoved = std::max(unmoved, glm::distance(from(before[v]), from(mesh.position(v))));
  }
  EXPECT_LT(worst, 0.06 * edge);  // the triangle's plane cuts under the sphere by an eighth of edge^2
  EXPECT_GT(unmoved, 0.5 * edge);
}

TEST(Motion, a_vertex_that_stays_keeps_its_rest_position_to_the_bit) {
  TriangleMesh mesh = icosphere(2);
  for (Index v = 0; v < mesh.vertex_count(); ++v) mesh.vertices.rest[v] = Vec3(float(v), -1.5f, 1.0f / float(v + 3));
  const std::vector<Vec3> rest = mesh.vertices.rest;
  slide_rest(mesh, std::vector<Vec3>(mesh.vertices.position));
  EXPECT_EQ(mesh.vertices.rest, rest);
}

TEST(Motion, texture_sticks_to_a_turning_torus) {
  constexpr double kRate = 2.0, kStep = 0.05;
  constexpr int kFrames = 12;
  const auto torus = std::make_shared<TorusField>(1.0, 0.4);
  const auto rotation = std::make_shared<Rotation>(kRate);
  TrackOptions options;
  options.edge_length = 0.12;
  options.validate = true;
  Tracker tracker(make_reference_backend(), resolved(options, *torus));
  for (int frame = 0; frame <= kFrames; ++frame) tracker.advance({frame, frame * kStep, torus, rotation});
  const TriangleMesh& mesh = tracker.mechanical();
  std::vector<double> errors;
  for (Index v = 0; v < mesh.vertex_count(); ++v)
    errors.push_back(
        glm::distance(turned(DVec3(mesh.vertices.rest[v]), kRate * kStep * kFrames), DVec3(mesh.position(v))));
  std::sort(errors.begin(), errors.end());
  const double e = tracker.options().edge_length;
  std::printf("turned by %.0f degrees: rest positions are off by %.3f e (median), %.3f e (worst)\n",
              kRate * kStep * kFrames * 180.0 / M_PI, errors[errors.size() / 2] / e, errors.back() / e);
  EXPECT_LT(errors[errors.size() / 2], 0.1 * e);  // turning by 1.2 radians moves a vertex by 10 e
  EXPECT_LT(errors.back(), 0.5 * e);
}

TEST(Motion, first_frames_know_their_velocity_from_the_second) {
  const auto now = std::make_shared<SphereField>(DVec3(0.0), 1.0),
             later = std::make_shared<SphereField>(DVec3(0.02, 0, 0), 1.05);
  Tracker tracker(make_reference_backend(), resolved({}, *now));
  const FieldFrame second{2, 0.04, later, nullptr};
  tracker.advance({1, 0.0, now, nullptr}, &second);
  for (Index v = 0; v < tracker.mechanical().vertex_count(); ++v) {
    const DVec3 p = DVec3(tracker.mechanical().position(v)) + 0.04 * DVec3(tracker.mechanical().vertices.velocity[v]);
    ASSERT_LT(later->distance_estimate(p), 1e-3);
  }
}

TEST(Motion, p_plus_v_dt_lands_within_a_voxel_of_the_next_fluid_surface) {
  const auto source = open_sequence(std::string(ISOSKIN_TEST_DATA) + "/dam_break/dam_break.%04d.vdb", {});
  std::unique_ptr<Tracker> tracker;
  FieldFrame frame = source->load(source->first_frame());
  for (int k = 0; k < test::repeats(4, 2); ++k) {
    const FieldFrame next = source->load(frame.frame + 1);
    if (!tracker) tracker = std::make_unique<Tracker>(make_opencl_backend(), resolved({}, *frame.field));
    tracker->advance(frame, &next);
    const TriangleMesh& mesh = tracker->mechanical();
    std::size_t near = 0;
    for (Index v = 0; v < mesh.vertex_count(); ++v) {
      const DVec3 p = DVec3(mesh.position(v)) + (next.time - frame.time) * DVec3(mesh.vertices.velocity[v]);
      near += next.field->distance_estimate(p) < next.field->resolution();
    }
    EXPECT_GE(double(near), 0.95 * double(mesh.vertex_count())) << "frame " << frame.frame;
    frame = next;
  }
}
