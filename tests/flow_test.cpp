// Fast fronts: skins are taken along by what moves, also where it moves within its own surface.
#include "core/mechanics/flow.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include <gtest/gtest.h>

#include "core/mechanics/motion.h"
#include "core/tracker.h"
#include "tests/analytic_fields.h"
#include "tests/test_meshes.h"

using namespace isoskin;
using namespace isoskin::analytic;

namespace {

constexpr double kStep = 0.04;

/// A flat drop, `thin` high and 1 wide, about a centre. |grad F| is 1 at its rim, more on its flats.
class DropField final : public Field {
public:
  DropField(const DVec3& centre, double thin) : centre_(centre), stretch_(1.0, 1.0, 1.0 / (thin * thin)) {}
  FieldSample sample(const DVec3& p) const override {
    const DVec3 d = p - centre_;
    return {0.5 * (1.0 - glm::dot(d, stretch_ * d)), -stretch_ * d};
  }
  Box bounds() const override {
    Box box;
    box.add(centre_ - 1.0);
    box.add(centre_ + 1.0);
    return box;
  }
  Interval range(const Box&) const override {
    constexpr double kAll = std::numeric_limits<double>::infinity();
    return {-kAll, kAll};
  }

private:
  DVec3 centre_, stretch_;
};

/// A round sheet in the plane z = height: what is nearer than `half` to a disc. F is a distance.
class SheetField final : public Field {
public:
  SheetField(double radius, double half, double height = 0.0) : radius_(radius), half_(half), height_(height) {}
  FieldSample sample(const DVec3& at) const override {
    const DVec3 p(at.x, at.y, at.z - height_);
    const double r = std::hypot(p.x, p.y);
    const double beyond = std::max(0.0, r - radius_);
    const DVec3 from_disc(r > 0.0 ? beyond / r * p.x : 0.0, r > 0.0 ? beyond / r * p.y : 0.0, p.z);
    const double distance = glm::length(from_disc);
    return {half_ - distance, distance > 0.0 ? -from_disc / distance : DVec3(0.0)};
  }
  Box bounds() const override {
    const DVec3 size(radius_ + half_, radius_ + half_, half_), middle(0.0, 0.0, height_);
    Box box;
    box.add(middle - size);
    box.add(middle + size);
    return box;
  }
  Interval range(const Box&) const override {
    constexpr double kAll = std::numeric_limits<double>::infinity();
    return {-kAll, kAll};
  }

private:
  double radius_, half_, height_;
};

/// The skin of a round sheet of half thickness `half`, edges of 0.12.
TriangleMesh skin_of_sheet(double half) {
  TrackOptions options;
  options.edge_length = 0.12;
  const FieldFrame frame{0, 0.0, std::make_shared<SheetField>(1.0, half), nullptr};
  Tracker tracker(make_reference_backend(), resolved(options, *frame.field));
  tracker.advance(frame);
  return tracker.mechanical();
}

/// How such a skin flows to the same sheet `up` above, whose faces it lands on by what they face.
std::vector<Vec3> flow_up(const TriangleMesh& mesh, double half, float up) {
  const auto after = std::make_shared<SheetField>(1.0, half, up);
  const auto backend = make_reference_backend();
  backend->set_field(after);
  FlowOptions flow;
  flow.facing = true;
  return surface_flow(mesh, kStep, *after, *backend, 0.06f, flow);
}

}  // namespace

TEST(Flow, a_rim_that_has_outrun_the_skin_is_found_where_the_sheet_ends) {
  constexpr double kHalf = 0.1, kFrom = 1.0, kTo = 1.6;
  TrackOptions options;
  options.edge_length = 0.12;
  const FieldFrame first{0, 0.0, std::make_shared<SheetField>(kFrom, kHalf), nullptr};
  Tracker tracker(make_reference_backend(), resolved(options, *first.field));
  tracker.advance(first);
  const TriangleMesh& mesh = tracker.mechanical();
  const auto backend = make_reference_backend();
  const auto after = std::make_shared<SheetField>(kTo, kHalf);
  backend->set_field(after);
  for (const auto& [follow, few] : {std::pair(false, 0), std::pair(true, 0), std::pair(true, 4096)}) {
    FlowOptions flow;
    flow.half_sheet = follow ? 1.5f * float(kHalf) : 0.0f;
    flow.few_walkers = few;
    const std::vector<Vec3> way = surface_flow(mesh, kStep, *after, *backend, 0.06f, flow);
    std::size_t rims = 0, arrived = 0;
    for (Index v = 0; v < mesh.vertex_count(); ++v) {
      const Vec3 &from = mesh.position(v), to = from + way[v];
      if (glm::length(glm::vec2(from)) < kFrom + 0.9 * kHalf) continue;
      ++rims;
      arrived += std::abs(glm::length(glm::vec2(to)) - (kTo + kHalf)) < 0.05;
    }
    EXPECT_GT(rims, 20u);
    EXPECT_EQ(arrived, follow ? rims : 0u);
  }
}

TEST(Flow, what_would_land_on_the_other_side_of_a_sheet_goes_where_its_neighbours_go) {
  constexpr double kHalf = 0.1;
  constexpr float kUp = 0.25f;
  TriangleMesh mesh = skin_of_sheet(kHalf);
  for (Index v = 0; v < mesh.vertex_count(); ++v)  // new ones know nothing yet
    mesh.vertices.velocity[v] = v % 7 == 0 ? Vec3(0.0f) : Vec3(0.0f, 0.0f, kUp / float(kStep));
  const std::vector<Vec3> way = flow_up(mesh, kHalf, kUp);
  std::size_t on_top = 0;
  for (Index v = 0; v < mesh.vertex_count(); ++v) {
    if (mesh.position(v).z < 0.99f * float(kHalf)) continue;
    ++on_top;
    EXPECT_NEAR(way[v].z, kUp, 0.02f) << v;
  }
  EXPECT_GT(on_top, 100u);
}

TEST(Flow, a_sheet_that_went_farther_than_it_is_thick_is_found) {
  constexpr double kHalf = 0.06;
  constexpr float kUp = 0.16f;
  const TriangleMesh mesh = skin_of_sheet(kHalf);  // that has not moved yet
  const std::vector<Vec3> way = flow_up(mesh, kHalf, kUp);
  std::size_t on_flats = 0;
  for (Index v = 0; v < mesh.vertex_count(); ++v) {
    if (std::abs(mesh.position(v).z) < 0.99f * float(kHalf)) continue;
    ++on_flats;
    EXPECT_NEAR(way[v].z, kUp, 0.02f) << v;
  }
  EXPECT_GT(on_flats, 200u);
}

TEST(Flow, a_body_that_moves_takes_all_of_its_skin_along) {
  const Vec3 step(0.1f, 0.05f, 0.0f);
  TriangleMesh mesh = test_meshes::icosphere(3);
  std::vector<Vec3> start = mesh.vertices.position;
  for (Index v = 0; v < mesh.vertex_count(); ++v)  // all that a surface tells of its motion
    mesh.vertices.velocity[v] = glm::dot(step, start[v]) / float(kStep) * start[v];
  const auto backend = make_reference_backend();
  constexpr int kFrames = 6;
  for (int frame = 1; frame <= kFrames; ++frame) {
    const auto sphere = std::make_shared<SphereField>(DVec3(float(frame) * step), 1.0);
    backend->set_field(sphere);
    predict(mesh, nullptr, kStep, *sphere, *backend, ProjectOptions{});
  }
  const float way = float(kFrames) * glm::length(step);
  for (Index v = 0; v < mesh.vertex_count(); ++v)
    ASSERT_LT(glm::distance(mesh.position(v), start[v] + float(kFrames) * step), 0.05f * way) << v;
}

TEST(Flow, what_stands_still_stays_and_what_grows_grows_straight) {
  TriangleMesh mesh = test_meshes::icosphere(3);
  const std::vector<Vec3> start = mesh.vertices.position;
  const auto backend = make_reference_backend();
  for (const double radius : {1.0, 1.1}) {
    const auto sphere = std::make_shared<SphereField>(DVec3(0.0), radius);
    backend->set_field(sphere);
    predict(mesh, nullptr, kStep, *sphere, *backend, ProjectOptions{.tolerance = 1e-6f});
    for (Index v = 0; v < mesh.vertex_count(); ++v)
      ASSERT_LT(glm::distance(mesh.position(v), float(radius) * start[v]), 0.01f * float(radius)) << v;
  }
}

TEST(Flow, the_rim_of_a_thin_drop_does_not_outrun_its_flats) {
  constexpr double kThin = 0.12, kPerFrame = 0.2;
  constexpr int kFrames = 8;
  TrackOptions options;
  options.edge_length = 0.1;
  options.validate = true;
  const auto at = [&](int frame) {
    return FieldFrame{frame, frame * kStep, std::make_shared<DropField>(DVec3(frame * kPerFrame, 0, 0), kThin),
                      nullptr};
  };
  const FieldFrame first = at(0), second = at(1);
  Tracker tracker(make_reference_backend(), resolved(options, *first.field));
  tracker.advance(first, &second);
  for (int frame = 1; frame <= kFrames; ++frame) {
    const FrameReport report = tracker.advance(at(frame));
    EXPECT_TRUE(report.certified);
    EXPECT_GT(report.survived, 0.94) << frame;
    EXPECT_LE(report.inverted, 5u) << frame;
    EXPECT_EQ(report.reextracted[1] + report.reextracted[2], 0.0) << frame;
  }
}
