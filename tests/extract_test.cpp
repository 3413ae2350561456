// `isoskin extract` and `track --start`, from outside.
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "core/io/ply.h"
#include "core/mesh/validate.h"
#include "tests/program.h"

namespace isoskin {
namespace {

using test::Ran;
using test::run_program;

class Extract : public ::testing::Test {
protected:
  test::TemporaryFolder folder_;

  void SetUp() override { test::write_small_scene(folder_ / "balls.toml"); }
  std::string file(const std::string& name) const { return (folder_ / name).string(); }

  Ran extract(const std::string& method, const std::string& to, const std::vector<std::string>& more = {}) const {
    std::vector<std::string> arguments{"extract", file("balls.toml"), "--method",  method,     "--edge-length", "0.2",
                                       "-o",      file(to),           "--backend", "reference"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return run_program(arguments);
  }
};

TEST_F(Extract, EveryMethodWritesACertifiedClosedMeshOfTwoBalls) {
  for (const std::string method : {"marching-cubes", "particles", "spring-lattice"}) {
    SCOPED_TRACE(method);
    const Ran ran = extract(method, method + ".ply");
    EXPECT_EQ(ran.status, 0) << ran.err;
    EXPECT_NE(ran.out.find("2 of Euler characteristic 4 in all; certificate passed"), std::string::npos) << ran.out;
    const PlyMesh ply = read_ply(folder_ / (method + ".ply"));
    EXPECT_TRUE(ply.closed);
    EXPECT_TRUE(validate(ply.mesh));
    EXPECT_EQ(ply.normals.size(), ply.mesh.vertex_count());
    EXPECT_EQ(extract(method, "again.ply", {"--threads", "1"}).status, 0);
    EXPECT_EQ(test::read_text(folder_ / (method + ".ply")), test::read_text(folder_ / "again.ply"));
  }
}

TEST_F(Extract, JsonIsOneLineOfWhatTheTextSays) {
  const Ran ran = extract("marching-cubes", "json.ply", {"--json"});
  EXPECT_EQ(ran.status, 0) << ran.err;
  EXPECT_EQ(std::count(ran.out.begin(), ran.out.end(), '\n'), 1) << ran.out;
  const auto line = nlohmann::json::parse(ran.out);
  const PlyMesh ply = read_ply(folder_ / "json.ply");
  EXPECT_EQ(line.at("triangles"), ply.mesh.triangle_count());
  EXPECT_EQ(line.at("vertices"), ply.mesh.vertex_count());
  EXPECT_EQ(line.at("euler"), 4);
  EXPECT_EQ(line.at("pieces"), 2);
  EXPECT_EQ(line.at("certified"), true);
  EXPECT_EQ(line.at("edge_length"), 0.2);
  EXPECT_NEAR(line.at("angles").at("mean").get<double>(), shape_statistics(ply.mesh).mean_angle, 1e-3);
}

TEST_F(Extract, AMeshStartsTrackingWithItsIdsAndRestPositions) {
  ASSERT_EQ(extract("particles", "start.ply").status, 0);
  PlyMesh start = read_ply(folder_ / "start.ply");
  for (Vec3& r : start.mesh.vertices.rest) r += Vec3(100.0f, 0.0f, 0.0f);  // a texture of the user's own
  write_ply(folder_ / "start.ply", start.mesh, {});
  const Ran ran =
      run_program(test::track_small(folder_ / "balls.toml", folder_ / "out", {"--start", file("start.ply")}));
  ASSERT_EQ(ran.status, 0) << ran.err;
  const PlyMesh first = read_ply(folder_ / "out/balls.mechanical.0001.ply");
  std::size_t kept = 0;
  for (std::size_t v = 0; v < first.mesh.vertex_count(); ++v) {
    kept += first.mesh.vertices.id[v] < start.mesh.next_id;
    EXPECT_GT(first.mesh.vertices.rest[v].x, 90.0f);
  }
  EXPECT_GT(kept, first.mesh.vertex_count() / 2);
  EXPECT_NE(test::read_text(folder_ / "out/report.jsonl").find("\"certified\":true"), std::string::npos);
}

TEST_F(Extract, WhatCannotStartOrBeExtractedIsOneLine) {
  test::write_text(
      folder_ / "open.ply",
      "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
      "element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n");
  const auto track = [&](const std::string& start) {
    return run_program(test::track_small(folder_ / "balls.toml", folder_ / "out", {"--start", start}));
  };
  for (const Ran& ran :
       {track(file("open.ply")), track(file("none.ply")), extract("magic", "mesh.ply"),
        extract("particles", "nowhere/mesh.ply"), extract("particles", "mesh.ply", {"--frame", "11"})}) {
    EXPECT_EQ(ran.status, 2);
    EXPECT_EQ(std::count(ran.err.begin(), ran.err.end(), '\n'), 1) << ran.err;
    EXPECT_EQ(ran.err.rfind("isoskin: ", 0), 0u) << ran.err;
  }
  EXPECT_FALSE(test::fs::exists(folder_ / "out"));
}

}  // namespace
}  // namespace isoskin
