// The program from outside: exit statuses, one line for every bad input, nothing left behind.
#include <algorithm>
#include <limits>
#include <map>

#include <fmt/format.h>
#include <openvdb/openvdb.h>
#include <openvdb/tools/LevelSetSphere.h>
#include <nlohmann/json.hpp>

#include "core/io/ply.h"
#include "tests/program.h"
#include "tests/sanitized.h"
#include "tests/test_meshes.h"

namespace isoskin {
namespace {

namespace fs = std::filesystem;
using test::Ran;
using test::run_program;
using Arguments = std::vector<std::string>;

constexpr double kVoxel = 0.0625;

openvdb::FloatGrid::Ptr sphere() {
  openvdb::initialize();
  auto grid = openvdb::tools::createLevelSetSphere<openvdb::FloatGrid>(0.5f, openvdb::Vec3f(0), float(kVoxel));
  grid->setName("surface");
  return grid;
}

void write_grid(const fs::path& path, const openvdb::FloatGrid::Ptr& grid) {
  openvdb::io::File(path.string()).write({grid});
}

/// The voxel size as the file holds it, replaced by zero: OpenVDB itself refuses to make such a grid.
void zero_voxel_size(const fs::path& path) {
  std::string bytes = test::read_text(path);
  const double size = kVoxel, zero = 0.0;
  const std::string from(reinterpret_cast<const char*>(&size), sizeof size);
  const std::string to(reinterpret_cast<const char*>(&zero), sizeof zero);
  std::size_t replaced = 0;
  for (std::size_t at = bytes.find(from); at != std::string::npos; at = bytes.find(from, at + 1), ++replaced)
    bytes.replace(at, from.size(), to);
  ASSERT_GE(replaced, 3u);
  test::write_text(path, bytes);
}

class Program : public ::testing::Test {
protected:
  test::TemporaryFolder folder_;
  fs::path out_ = folder_ / "out";

  void SetUp() override { test::write_small_scene(folder_ / "balls.toml"); }

  std::string file(const std::string& name) const { return (folder_ / name).string(); }

  Arguments track(const std::string& input, const Arguments& more = {}) const {
    Arguments arguments{"track", input, "-o", out_.string()};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return arguments;
  }

  /// Exit status 2, one line that holds every one of `words`, no output.
  void expect_refused(const Arguments& arguments, const Arguments& words, const test::Surroundings& around = {}) const {
    const Ran ran = run_program(arguments, around);
    EXPECT_EQ(ran.status, 2) << ran.err;
    EXPECT_EQ(std::count(ran.err.begin(), ran.err.end(), '\n'), 1) << ran.err;
    EXPECT_TRUE(ran.err.ends_with('\n'));
    for (const std::string& word : words) EXPECT_NE(ran.err.find(word), std::string::npos) << ran.err;
    EXPECT_EQ(ran.out, "");
    EXPECT_FALSE(fs::exists(out_)) << "an output was left behind";
  }

  void write_scene_with(const std::string& line) {
    std::string text = test::read_text(folder_ / "balls.toml");
    test::write_text(folder_ / "bad.toml", line + "\n" + text);
  }
};

TEST_F(Program, missing_file) {
  expect_refused(track(file("nothing.vdb")), {"nothing.vdb"});
  expect_refused(track(file("nothing.toml")), {"nothing.toml"});
  expect_refused({"check", file("nothing.ply")}, {"nothing.ply"});
  expect_refused({"info", file("nothing.exr")}, {"nothing.exr"});
}

TEST_F(Program, truncated_vdb) {
  write_grid(folder_ / "cut.vdb", sphere());
  // From a file cut before its values OpenVDB 10 takes a size that it has not read, and asks for as much memory: that
  // throws, but AddressSanitizer ends the program.
  const std::uintmax_t whole = fs::file_size(folder_ / "cut.vdb"), cuts[] = {whole - 1000, whole * 2 / 3};
  for (int cut = 0; cut < test::repeats(2, 1); ++cut) {
    fs::resize_file(folder_ / "cut.vdb", cuts[cut]);
    expect_refused(track(file("cut.vdb")), {"cut.vdb"});
  }
  test::write_text(folder_ / "text.vdb", "not a grid");
  expect_refused(track(file("text.vdb")), {"text.vdb"});
}

TEST_F(Program, nan_grid) {
  const auto grid = sphere();
  grid->beginValueOn().setValue(std::numeric_limits<float>::quiet_NaN());
  write_grid(folder_ / "nan.vdb", grid);
  expect_refused(track(file("nan.vdb")), {"nan.vdb"});
}

TEST_F(Program, empty_grid) {
  const auto grid = sphere();
  grid->clear();
  write_grid(folder_ / "empty.vdb", grid);
  expect_refused(track(file("empty.vdb")), {"empty.vdb"});
}

TEST_F(Program, zero_voxel) {
  write_grid(folder_ / "zero.vdb", sphere());
  zero_voxel_size(folder_ / "zero.vdb");
  expect_refused(track(file("zero.vdb")), {"zero.vdb"});
}

TEST_F(Program, grid_that_is_not_there) {
  write_grid(folder_ / "sphere.vdb", sphere());
  expect_refused(track(file("sphere.vdb"), {"--grid", "density"}), {"density", "surface"});
}

TEST_F(Program, unknown_scene_key) {
  write_scene_with("colour = 3");
  expect_refused(track(file("bad.toml")), {"bad.toml:1", "colour"});
}

TEST_F(Program, scene_numbers_that_are_not_finite) {
  write_scene_with("seconds = nan");
  expect_refused(track(file("bad.toml")), {"bad.toml:1"});
}

TEST_F(Program, absurd_edge_length) {
  for (const char* length : {"0", "-1", "nan", "inf", "1e-9", "1e9", "abc"}) {
    SCOPED_TRACE(length);
    expect_refused(track(file("balls.toml"), {"--edge-length", length, "--backend", "reference"}), {"edge"});
  }
}

TEST_F(Program, numbers_out_of_range) {
  const std::vector<Arguments> bad{{"--angle", "0"},   {"--angle", "nan"}, {"--passes", "-1"}, {"--sagitta", "-1"},
                                   {"--passes", "99"}, {"--dt", "0"},      {"--dt", "-inf"},   {"--smooth", "-2"},
                                   {"--iso", "nan"},   {"--threads", "-3"}};
  for (const Arguments& more : bad) {
    SCOPED_TRACE(more[0] + " " + more[1]);
    expect_refused(track(file("balls.toml"), more), {more[0], "expected"});
  }
}

TEST_F(Program, unknown_options_and_values) {
  expect_refused(track(file("balls.toml"), {"--edgelength", "1"}), {"--edgelength"});
  expect_refused(track(file("balls.toml"), {"--mechanics", "jelly"}), {"jelly"});
  expect_refused(track(file("balls.toml"), {"--topology", "genus"}), {"--topology", "genus", "collision"});
  expect_refused(track(file("balls.toml"), {"--interpolation", "quintic"}), {"quintic"});
  expect_refused(track(file("balls.toml"), {"--backend", "cuda"}), {"cuda"});
  expect_refused({"track", file("balls.toml")}, {"--output"});
  expect_refused({"fly"}, {});
  expect_refused({}, {});
}

TEST_F(Program, bad_starts_extractions_and_seeds) {
  write_grid(folder_ / "sphere.vdb", sphere());
  const std::string balls = file("balls.toml"), mesh = file("x.ply");
  test::write_text(folder_ / "cut.ply", "ply\nformat binary_little_endian 1.0\n");
  expect_refused(track(balls, {"--start", file("nothing.ply")}), {"nothing.ply"});
  expect_refused(track(balls, {"--start", file("cut.ply")}), {"cut.ply"});
  expect_refused({"extract", balls, "--method", "magic", "-o", mesh}, {"magic", "particles"});
  expect_refused({"extract", file("nothing.vdb"), "-o", mesh}, {"nothing.vdb"});
  expect_refused({"seeds", file("sphere.vdb"), "-o", mesh}, {"sphere.vdb", "[[element]]"});
  expect_refused({"seeds", balls, "--spacing", "0", "-o", mesh}, {"--spacing", "expected"});
  expect_refused({"collide", balls, file("sphere.vdb")}, {"sphere.vdb", "[[element]]"});
  EXPECT_FALSE(fs::exists(mesh));
}

TEST_F(Program, bad_frame_range) {
  for (const char* range : {"5:2", "1-3", "a:b", "", ":x", "0:3", "1:99", "40:50", "1:2:3"}) {
    SCOPED_TRACE(range);
    expect_refused(track(file("balls.toml"), {"--frames", range}), {"frames"});
  }
}

TEST_F(Program, bad_pictures) {
  const std::string scene = file("balls.toml"), out = file("out/x.exr");
  for (const char* size : {"0x10", "10", "10x", "axb", "-5x5", "99999x99999", "10x10x10", ""}) {
    SCOPED_TRACE(size);
    expect_refused({"render", scene, "--what", "field", "-o", file("x.exr"), "--size", size}, {"--size", "expected"});
    EXPECT_FALSE(fs::exists(file("x.exr")));
  }
  expect_refused({"render", scene, "--what", "field", "-o", out}, {"out"});
  expect_refused({"render", scene, "--what", "field", "-o", file("x.jpg")}, {".exr"});
  expect_refused({"render", scene, "--what", "field", "-o", file("x.exr"), "--frame", "11"}, {"1", "10"});
  expect_refused({"render", scene, "--what", "field", "-o", file("x.exr"), "--camera", file("none.toml")},
                 {"none.toml"});
  test::write_text(folder_ / "camera.toml", "eye = [0, 0, 0]\ntarget = [0, 0, 0]\n");
  expect_refused({"render", scene, "--what", "field", "-o", file("x.exr"), "--camera", file("camera.toml")}, {"eye"});
  write_ply(folder_ / "mesh.ply", test_meshes::icosphere(1), {});
  expect_refused({"render", file("mesh.ply"), "--what", "field", "-o", file("x.exr")}, {"mesh.ply"});
  expect_refused({"compare", file("mesh.ply"), file("mesh.ply")}, {"mesh.ply"});
  EXPECT_FALSE(fs::exists(file("x.exr")));
  EXPECT_FALSE(fs::exists(file("x.png")));
}

TEST_F(Program, full_disk) {
  expect_refused(track(file("balls.toml"), {"--backend", "reference", "--edge-length", "0.15"}), {"out"},
                 {{}, 4096, ""});
}

TEST_F(Program, full_disk_in_mid_run_keeps_the_frames_before) {
  // The first frame shows how large a mesh is; the growing union of the balls later needs more.
  const Ran whole = run_program(test::track_small(folder_ / "balls.toml", out_));
  ASSERT_EQ(whole.status, 0) << whole.err;
  std::size_t least = std::numeric_limits<std::size_t>::max(), most = 0;
  for (const auto& entry : fs::directory_iterator(out_))
    if (entry.path().extension() == ".ply") {
      least = std::min<std::size_t>(least, entry.file_size());
      most = std::max<std::size_t>(most, entry.file_size());
    }
  ASSERT_LT(least, most);
  fs::remove_all(out_);
  const Ran ran = run_program(test::track_small(folder_ / "balls.toml", out_), {{}, most - 1, ""});
  EXPECT_EQ(ran.status, 2) << ran.err;
  EXPECT_EQ(std::count(ran.err.begin(), ran.err.end(), '\n'), 1) << ran.err;
  if (fs::exists(out_))
    for (const auto& entry : fs::directory_iterator(out_)) {
      if (entry.path().extension() == ".ply")
        EXPECT_TRUE(read_ply(entry.path()).closed) << entry.path();
      else
        EXPECT_TRUE(entry.path().extension() == ".json" || entry.path().extension() == ".jsonl") << entry.path();
    }
}

TEST_F(Program, standard_output_that_is_full) {
  const Ran ran = run_program({"devices"}, {{}, {}, "/dev/full"});
  EXPECT_EQ(ran.status, 2);
  EXPECT_EQ(std::count(ran.err.begin(), ran.err.end(), '\n'), 1) << ran.err;
}

TEST_F(Program, no_opencl_device) {
  const test::Surroundings none{{{"OCL_ICD_VENDORS", "/nonexistent"}}, {}, ""};
  expect_refused(track(file("balls.toml")), {"OpenCL", "pocl-opencl-icd"}, none);
  const Ran devices = run_program({"devices"}, none);
  EXPECT_EQ(devices.status, 0) << devices.err;
  EXPECT_NE(devices.out.find("pocl-opencl-icd"), std::string::npos) << devices.out;
}

TEST_F(Program, device_that_is_not_there) {
  expect_refused(track(file("balls.toml"), {"--device", "77"}), {"77"});
  expect_refused(track(file("balls.toml"), {"--device", "gpu"}), {"gpu"});
}

TEST_F(Program, folder_that_cannot_be_written) {
  test::write_text(folder_ / "file", "");
  for (const std::string& folder : {file("file"), file("file") + "/below", std::string("/proc/isoskin")}) {
    SCOPED_TRACE(folder);
    expect_refused({"track", file("balls.toml"), "-o", folder, "--backend", "reference"}, {folder});
  }
}

TEST_F(Program, folder_in_use) {
  test::Running first(test::track_small(folder_ / "balls.toml", out_));
  while (!fs::exists(out_ / "run.json") && !first.has_ended()) std::this_thread::yield();
  first.signal(SIGSTOP);  // or it might be done before the second has come to look
  const Ran second = run_program(test::track_small(folder_ / "balls.toml", out_));
  EXPECT_EQ(second.status, 2);
  EXPECT_NE(second.err.find("another run"), std::string::npos) << second.err;
  first.signal(SIGCONT);
  EXPECT_EQ(first.wait(), 0) << first.err();
}

TEST_F(Program, tracks_and_reports) {
  const Ran ran = run_program(
      test::track_small(folder_ / "balls.toml", out_, {"--frames", "2:4", "--json", "--self-intersections"}));
  ASSERT_EQ(ran.status, 0) << ran.err;
  EXPECT_EQ(ran.out, test::read_text(out_ / "report.jsonl"));
  std::istringstream text(ran.out);
  int frame = 2;
  for (std::string line; std::getline(text, line); ++frame) {
    const auto report = nlohmann::json::parse(line);
    EXPECT_EQ(report.at("frame"), frame);
    EXPECT_TRUE(report.at("certified").get<bool>());
    for (const char* key : {"self_intersections", "mechanical_self_intersections"}) EXPECT_EQ(report.at(key), 0) << key;
    for (const char* key : {"time", "mechanical_triangles", "geometric_triangles", "survived", "reextracted", "events",
                            "repairs", "angles", "peak_bytes"})
      EXPECT_TRUE(report.contains(key)) << key;
    for (const char* step : {"load", "certify", "write", "total"}) EXPECT_TRUE(report.at("ms").contains(step)) << step;
    const PlyMesh ply = read_ply(out_ / fmt::format("balls.mechanical.{:04}.ply", frame));
    EXPECT_EQ(ply.mesh.triangle_count(), report.at("mechanical_triangles"));
    EXPECT_EQ(ply.header.frame, frame);
  }
  EXPECT_EQ(frame, 5);
  const Ran checked = run_program({"check", out_.string(), "--field", file("balls.toml"), "--backend", "reference"});
  EXPECT_EQ(checked.status, 0) << checked.out << checked.err;
  EXPECT_EQ(run_program({"info", out_.string()}).status, 0);
}

TEST_F(Program, mesh_and_field_are_seen_alike) {
  ASSERT_EQ(run_program(test::track_small(folder_ / "balls.toml", out_, {"--frames", "1:2", "--angle", "2"})).status,
            0);
  const auto picture = [&](const std::string& input, const std::string& name, const Arguments& more) {
    Arguments arguments{"render", input, "--size", "160x120", "-o", file(name)};
    arguments.insert(arguments.end(), more.begin(), more.end());
    const Ran ran = run_program(arguments);
    EXPECT_EQ(ran.status, 0) << ran.err;
    EXPECT_TRUE(fs::exists(file(name)) && fs::exists(fs::path(file(name)).replace_extension(".png")));
  };
  // Whichever way the frame is named, the camera is the same.
  picture(out_.string(), "mesh.exr", {"--frame", "2"});
  picture((out_ / "balls.geometric.0002.ply").string(), "file.exr", {});
  picture(out_.string(), "field.exr", {"--frame", "2", "--what", "field"});
  picture(file("balls.toml"), "scene.exr", {"--frame", "2", "--what", "field"});
  picture(out_.string(), "other.exr", {"--frame", "1", "--what", "field"});
  picture(out_.string(), "wire.exr", {"--frame", "2", "--mesh", "mechanical", "--wireframe", "--antialias", "2"});
  const auto compared = [&](const std::string& a, const std::string& b) {
    const Ran ran = run_program({"compare", file(a), file(b), "--json", "-o", file("difference.exr")});
    return std::pair(ran.status, nlohmann::json::parse(ran.out));
  };
  const auto [same, figures] = compared("mesh.exr", "field.exr");
  EXPECT_EQ(same, 0) << figures.dump(2);
  EXPECT_TRUE(figures.at("passed").get<bool>());
  EXPECT_NEAR(figures.at("unit").get<double>(), 0.15, 1e-6);
  EXPECT_GT(figures.at("depth").at("mean").get<double>(), 0.0) << "a mesh is not its field";
  EXPECT_TRUE(fs::exists(file("difference.exr")));
  EXPECT_EQ(compared("mesh.exr", "file.exr").second.at("depth").at("max"), 0.0);
  EXPECT_EQ(compared("field.exr", "scene.exr").second.at("depth").at("max"), 0.0);
  EXPECT_EQ(compared("mesh.exr", "other.exr").first, 1);
}

TEST_F(Program, renders_a_field_without_tracking_it) {
  write_grid(folder_ / "sphere.vdb", sphere());
  for (const char* what : {"mesh", "field"}) {
    const Ran ran = run_program({"render", file("sphere.vdb"), "--what", what, "--angle", "5", "--size", "160x120",
                                 "--save-camera", file("camera.toml"), "-o", file(std::string(what) + ".exr")});
    ASSERT_EQ(ran.status, 0) << ran.err;
  }
  const Ran ran = run_program({"compare", file("mesh.exr"), file("field.exr")});
  EXPECT_EQ(ran.status, 0) << ran.out;
  const Ran again = run_program(
      {"render", file("sphere.vdb"), "--what", "field", "--camera", file("camera.toml"), "-o", file("again.exr")});
  ASSERT_EQ(again.status, 0) << again.err;
  EXPECT_EQ(test::read_text(file("again.exr")), test::read_text(file("field.exr")))
      << "the saved camera is not the one used";
}

TEST_F(Program, writes_only_what_is_wanted) {
  ASSERT_EQ(run_program(test::track_small(folder_ / "balls.toml", out_, {"--frames", "1", "--no-mechanical"})).status,
            0);
  EXPECT_FALSE(fs::exists(out_ / "balls.mechanical.0001.ply"));
  EXPECT_TRUE(fs::exists(out_ / "balls.geometric.0001.ply"));
  fs::remove_all(out_);
  expect_refused(track(file("balls.toml"), {"--no-mechanical", "--no-geometric"}), {"--no-geometric"});
}

TEST_F(Program, check_says_no_to_an_open_mesh) {
  TriangleMesh mesh = test_meshes::icosphere(2);
  write_ply(folder_ / "whole.ply", mesh, {});
  EXPECT_EQ(run_program({"check", file("whole.ply")}).status, 0);
  mesh.vertex.resize(mesh.vertex.size() - 3);
  write_ply(folder_ / "open.ply", mesh, {});
  const Ran ran = run_program({"check", file("whole.ply"), file("open.ply"), "--json"});
  EXPECT_EQ(ran.status, 1) << ran.err;
  EXPECT_NE(ran.out.find("\"ok\":false"), std::string::npos) << ran.out;
}

TEST_F(Program, check_says_no_to_a_mesh_of_another_frame) {
  ASSERT_EQ(run_program(test::track_small(folder_ / "balls.toml", out_, {"--frames", "1"})).status, 0);
  const std::string mesh = (out_ / "balls.mechanical.0001.ply").string(), scene = file("balls.toml");
  EXPECT_EQ(run_program({"check", mesh, "--field", scene, "--backend", "reference"}).status, 0);
  EXPECT_EQ(run_program({"check", mesh, "--field", scene, "--frame", "5", "--backend", "reference"}).status, 1);
}

TEST_F(Program, ledger_sums_up_a_run) {
  ASSERT_EQ(run_program(test::track_small(folder_ / "balls.toml", out_)).status, 0);
  const Ran tracked = run_program({"ledger", out_.string(), "--json"});
  ASSERT_EQ(tracked.status, 0) << tracked.err;
  const auto of_run = nlohmann::json::parse(tracked.out);
  EXPECT_EQ(of_run.at("reported"), 10);
  const std::string lines = test::read_text(out_ / "ledger.jsonl");
  EXPECT_EQ(of_run.at("entries"), std::count(lines.begin(), lines.end(), '\n'));
  EXPECT_EQ(of_run.at("worst").size(), 9u);
  EXPECT_NE(tracked.out.find("\"connect\""), std::string::npos) << "two balls meet";

  // Figures that are known.
  test::write_text(out_ / "report.jsonl", R"({"frame":1,"reextracted":[0,0,1],"repairs":1,"events":0,"ms":{"total":900}}
{"frame":2,"reextracted":[0,0.25,0],"repairs":1,"events":2,"ms":{"total":30}}
{"frame":3,"reextracted":[0,0,0],"repairs":0,"events":1,"ms":{"total":20}}
{"frame":4,"reextracted":[0,0.125,0.25],"repairs":3,"events":3,"ms":{"total":10}}
)");
  test::write_text(out_ / "ledger.jsonl", R"({"frame":2,"kind":"reskin","tier":2}
{"frame":2,"kind":"cut","tier":1}
{"frame":3,"kind":"cut","tier":1}
{"frame":4,"kind":"cut","tier":1}
{"frame":4,"kind":"cut","tier":1}
{"frame":4,"kind":"euler","tier":3}
)");
  const auto known = nlohmann::json::parse(run_program({"ledger", out_.string(), "--json", "--worst", "2"}).out);
  EXPECT_EQ(known, nlohmann::json::parse(R"({"reported":4,"entries":6,
    "kinds":[{"tier":1,"kind":"cut","count":4,"frames":[2,3,4,4]},
             {"tier":2,"kind":"reskin","count":1,"frames":[2]}, {"tier":3,"kind":"euler","count":1,"frames":[4]}],
    "frames":[{"frame":2,"kinds":{"cut":1,"reskin":1}}, {"frame":3,"kinds":{"cut":1}},
              {"frame":4,"kinds":{"cut":2,"euler":1}}],
    "worst":[{"frame":4,"reextracted":0.375,"repairs":3,"events":3,"ms":10.0},
             {"frame":2,"reextracted":0.25,"repairs":1,"events":2,"ms":30.0}]})"))
      << known.dump();
  const Ran readable = run_program({"ledger", out_.string()});
  EXPECT_NE(readable.out.find("4 frames, 6 events and repairs"), std::string::npos) << readable.out;
  EXPECT_NE(readable.out.find("    4  2 cut euler"), std::string::npos) << readable.out;

  test::write_text(out_ / "report.jsonl", "{\"frame\":\"one\"}\n{\"frame\":\"two\"}\n");
  const Ran damaged = run_program({"ledger", out_.string()});
  EXPECT_EQ(damaged.status, 2) << damaged.err;
  EXPECT_NE(damaged.err.find("report.jsonl"), std::string::npos) << damaged.err;
  fs::remove_all(out_);
  expect_refused({"ledger", out_.string()}, {out_.string(), "run.json"});
}

TEST_F(Program, says_that_it_compiles_kernels_on_the_first_run_only) {
  const test::Surroundings fresh{{{"POCL_CACHE_DIR", file("cache")}}, {}, ""};
  fs::create_directories(folder_ / "cache");
  write_grid(folder_ / "sphere.vdb", sphere());
  const std::string said = "compiling kernels";
  const Ran quiet = run_program(track(file("nothing.vdb"), {"--quiet"}), fresh);
  EXPECT_EQ(quiet.err.find(said), std::string::npos) << quiet.err;
  std::map<std::string, std::string> meshes;
  for (const char* run : {"first", "second"}) {
    const Ran ran = run_program(track(file("sphere.vdb")), fresh);
    ASSERT_EQ(ran.status, 0) << ran.err;
    EXPECT_EQ(ran.err.find(said) != std::string::npos, std::string(run) == "first") << ran.err;
    for (const auto& entry : fs::directory_iterator(out_))
      if (entry.path().extension() == ".ply") meshes[run] += test::read_text(entry.path());
  }
  EXPECT_FALSE(meshes["first"].empty());
  EXPECT_TRUE(meshes["first"] == meshes["second"]) << "who compiled does not matter";
}

TEST_F(Program, help_has_an_example_for_each_command) {
  EXPECT_EQ(run_program({"--version"}).status, 0);
  const Ran all = run_program({"--help"});
  EXPECT_EQ(all.status, 0);
  for (const std::string command : {"track", "render", "compare", "check", "ledger", "info", "devices"}) {
    EXPECT_NE(all.out.find(command), std::string::npos) << command;
    const Ran one = run_program({command, "--help"});
    EXPECT_EQ(one.status, 0);
    EXPECT_NE(one.out.find("isoskin " + command), std::string::npos) << one.out;
  }
}

}  // namespace
}  // namespace isoskin
