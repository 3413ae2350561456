// The demo's two scenes at default settings, tracked as the program tracks them: the picture of the geometric mesh at
// 18 degrees against the ray-traced field, within the tolerances that `isoskin compare` applies.
#include <gtest/gtest.h>

#include "core/io/scene.h"
#include "core/tracker.h"
#include "kernels/opencl_backend.h"
#include "render/compare.h"
#include "render/rasterize.h"
#include "render/raytrace.h"
#include "tests/sanitized.h"

using namespace isoskin;

namespace {

constexpr int kSize = 512;  // pixels a side

struct Case {
  const char* input;
  int frame;    // compared
  int earlier;  // frames tracked before it
};

std::ostream& operator<<(std::ostream& out, const Case& c) {
  return out << c.input << " frame " << c.frame;
}

class DemoAgreement : public ::testing::TestWithParam<Case> {};

}  // namespace

TEST_P(DemoAgreement, TrackedMeshAndTracedFieldAreOnePicture) {
  const Case& c = GetParam();
  const Scene scene = open_input(std::string(ISOSKIN_TEST_DATA) + "/" + c.input);
  FieldFrame frame = scene.source->load(c.frame - c.earlier);
  ASSERT_FALSE(scene.meshing.edge_length || scene.meshing.angle || scene.meshing.passes || scene.meshing.sagitta);
  const TrackOptions track = resolved({}, *frame.field);
  ASSERT_EQ(track.refine.angle, 18.0f);
  Tracker tracker(make_opencl_backend(), track);
  tracker.advance(frame);
  while (frame.frame < c.frame) tracker.advance(frame = scene.source->load(frame.frame + 1));

  const double voxel = frame.field->resolution();
  CompareOptions options;
  options.unit = voxel > 0.0 ? voxel : track.edge_length;
  options.depth_p99 = voxel > 0.0 ? 0.25 : 0.02;
  const Camera camera = frame_box(frame.field->bounds(), kSize, kSize);
  const GeometricMesh& mesh = tracker.geometric();
  const CompareReport report =
      compare(rasterize(mesh.mesh, mesh.normal, camera), raytrace(*frame.field, camera).image, options).report;
  EXPECT_EQ(report.beyond_rim, 0u);
  EXPECT_LT(report.depth_inside.p99, options.depth_p99);
  EXPECT_LT(report.normal.mean, 3.0);
  EXPECT_GT(report.depth_inside.pixels, 30000u);
}

INSTANTIATE_TEST_SUITE_P(Demo, DemoAgreement,
                         ::testing::Values(Case{"two_points.toml", 22, 1}, Case{"two_points.toml", 34, 1},
                                           Case{"dam_break/dam_break.%04d.vdb", 27, 0},
                                           Case{"dam_break/dam_break.%04d.vdb", 44, test::repeats(1, 0)},
                                           Case{"dam_break/dam_break.%04d.vdb", 50, test::repeats(1, 0)}));
