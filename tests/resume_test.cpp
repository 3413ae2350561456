// A run killed at any moment leaves whole files only, and --resume ends in what an uninterrupted run would have
// written.
#include <map>
#include <random>

#include <nlohmann/json.hpp>

#include "core/io/ply.h"
#include "core/mesh/validate.h"
#include "tests/program.h"
#include "tests/sanitized.h"

namespace isoskin {
namespace {

using Json = nlohmann::json;
using test::Running;
using test::fs::path;
namespace fs = std::filesystem;

constexpr int kFrames = 10;
constexpr int kKills = test::repeats(20, 4);

std::vector<Json> lines(const path& file, bool drop_cut_line) {
  std::istringstream text(test::read_text(file));
  std::vector<Json> result;
  std::string line;
  while (std::getline(text, line)) {
    if (text.eof() && drop_cut_line) break;
    result.push_back(Json::parse(line));
  }
  return result;
}

/// Every file of a run by name: meshes as their bytes, reports without times and memory.
std::map<std::string, std::string> contents(const path& folder) {
  std::map<std::string, std::string> all;
  for (const auto& entry : fs::directory_iterator(folder)) {
    std::string& text = all[entry.path().filename().string()];
    if (entry.path().extension() != ".jsonl") {
      text = test::read_text(entry.path());
      continue;
    }
    for (Json line : lines(entry.path(), false)) {
      line.erase("ms");
      line.erase("peak_bytes");
      text += line.dump() + '\n';
    }
  }
  return all;
}

void expect_same(const path& folder, const std::map<std::string, std::string>& expected) {
  const auto found = contents(folder);
  ASSERT_EQ(found.size(), expected.size());
  for (const auto& [name, text] : expected) {
    ASSERT_TRUE(found.contains(name)) << name;
    EXPECT_TRUE(found.at(name) == text) << name << " differs";
  }
}

void expect_whole_files(const path& folder) {
  if (!fs::exists(folder)) return;  // killed before anything was written
  for (const auto& entry : fs::directory_iterator(folder)) {
    if (entry.path().extension() != ".ply") continue;
    const PlyMesh ply = read_ply(entry.path());
    EXPECT_TRUE(ply.closed) << entry.path() << ' ' << ply.open_reason;
    EXPECT_TRUE(validate(ply.mesh)) << entry.path() << ' ' << validate(ply.mesh).reason;
  }
  for (const Json& line : lines(folder / "report.jsonl", true))
    for (const char* kind : {"mechanical", "geometric"}) {
      char name[64];
      std::snprintf(name, sizeof name, "balls.%s.%04d.ply", kind, line["frame"].get<int>());
      EXPECT_TRUE(fs::exists(folder / name)) << name << " was reported";
    }
}

class Resume : public ::testing::Test {
protected:
  static void SetUpTestSuite() {
    folder_ = new test::TemporaryFolder;
    test::write_small_scene(scene());
    const auto begin = std::chrono::steady_clock::now();
    const test::Ran ran = test::run_program(test::track_small(scene(), *folder_ / "whole"));
    seconds_ = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    ASSERT_EQ(ran.status, 0) << ran.err;
    whole_ = contents(*folder_ / "whole");
    ASSERT_EQ(whole_.size(), 2 * kFrames + 3u);
  }
  static void TearDownTestSuite() { delete folder_; }

  static path scene() { return *folder_ / "balls.toml"; }
  static std::vector<std::string> arguments(const path& out, bool resume) {
    return test::track_small(scene(), out, resume ? std::vector<std::string>{"--resume"} : std::vector<std::string>{});
  }

  static inline test::TemporaryFolder* folder_ = nullptr;
  static inline double seconds_ = 0.0;
  static inline std::map<std::string, std::string> whole_;
};

TEST_F(Resume, after_sigkill_at_random_moments) {
  std::mt19937 random(2026);
  int killed = 0;
  for (int k = 0; k < kKills; ++k) {
    SCOPED_TRACE(k);
    const path out = *folder_ / ("killed" + std::to_string(k));
    {
      Running running(arguments(out, false));
      // Half of the kills at any time; half just when a frame's first mesh appears, among its other writes.
      if (k % 2 == 0) {
        std::this_thread::sleep_for(
            std::chrono::duration<double>(std::uniform_real_distribution<>(0.0, seconds_)(random)));
      } else {
        char name[64];
        std::snprintf(name, sizeof name, "balls.mechanical.%04d.ply",
                      std::uniform_int_distribution<>(1, kFrames)(random));
        while (!fs::exists(out / name) && !running.has_ended()) std::this_thread::yield();
        std::this_thread::sleep_for(std::chrono::microseconds(std::uniform_int_distribution<>(0, 2000)(random)));
      }
      running.signal(SIGKILL);
      killed += running.wait() == -SIGKILL;
    }
    expect_whole_files(out);
    const test::Ran resumed = test::run_program(arguments(out, true));
    ASSERT_EQ(resumed.status, 0) << resumed.err;
    expect_same(out, whole_);
    fs::remove_all(out);
  }
  EXPECT_GE(killed, kKills / 2) << "most runs must still have been at work when they were killed";
}

TEST_F(Resume, after_damage_goes_back_to_the_last_whole_frame) {
  const path out = *folder_ / "damaged";
  fs::copy(*folder_ / "whole", out);
  fs::remove(out / "balls.geometric.0006.ply");
  fs::resize_file(out / "balls.mechanical.0005.ply", 100);
  test::write_text(out / "report.jsonl", test::read_text(out / "report.jsonl") + "{\"frame\": 11, \"ti");
  const test::Ran resumed = test::run_program(arguments(out, true));
  ASSERT_EQ(resumed.status, 0) << resumed.err;
  expect_same(out, whole_);
}

TEST_F(Resume, of_a_finished_run_changes_nothing) {
  const path out = *folder_ / "finished";
  fs::copy(*folder_ / "whole", out);
  const auto before = fs::last_write_time(out / "balls.mechanical.0010.ply");
  ASSERT_EQ(test::run_program(arguments(out, true)).status, 0);
  EXPECT_EQ(fs::last_write_time(out / "balls.mechanical.0010.ply"), before);
  expect_same(out, whole_);
}

TEST_F(Resume, with_other_options_is_refused) {
  const path out = *folder_ / "other";
  fs::copy(*folder_ / "whole", out);
  const test::Ran ran = test::run_program(test::track_small(scene(), out, {"--resume", "--angle", "12"}));
  EXPECT_EQ(ran.status, 2);
  EXPECT_EQ(std::count(ran.err.begin(), ran.err.end(), '\n'), 1) << ran.err;
  EXPECT_NE(ran.err.find("angle"), std::string::npos) << ran.err;
  expect_same(out, whole_);
}

TEST_F(Resume, after_control_c_the_frame_in_work_is_whole) {
  const path out = *folder_ / "interrupted";
  Running running(arguments(out, false));
  while (!fs::exists(out / "balls.mechanical.0002.ply") && !running.has_ended()) std::this_thread::yield();
  running.signal(SIGINT);
  EXPECT_EQ(running.wait(), 130);
  EXPECT_NE(running.err().find("interrupted"), std::string::npos) << running.err();
  const std::size_t reported = lines(out / "report.jsonl", false).size();
  EXPECT_GE(reported, 1u);
  EXPECT_LT(reported, std::size_t(kFrames));
  EXPECT_EQ(std::size_t(std::distance(fs::directory_iterator(out), fs::directory_iterator())), 2 * reported + 3);
  ASSERT_EQ(test::run_program(arguments(out, true)).status, 0);
  expect_same(out, whole_);
}

TEST_F(Resume, a_new_run_replaces_the_frames_of_the_old_one) {
  const path out = *folder_ / "again";
  fs::copy(*folder_ / "whole", out);
  test::write_text(out / "notes.txt", "mine");
  const test::Ran ran = test::run_program(test::track_small(scene(), out, {"--frames", "1:3"}));
  ASSERT_EQ(ran.status, 0) << ran.err;
  EXPECT_EQ(std::distance(fs::directory_iterator(out), fs::directory_iterator()), 2 * 3 + 3 + 1);
  EXPECT_EQ(test::read_text(out / "notes.txt"), "mine");
}

TEST_F(Resume, the_result_does_not_depend_on_threads) {
  for (const char* threads : {"1", "4"}) {
    SCOPED_TRACE(threads);
    const path out = *folder_ / ("threads" + std::string(threads));
    const test::Ran ran = test::run_program(test::track_small(scene(), out, {"--threads", threads}));
    ASSERT_EQ(ran.status, 0) << ran.err;
    expect_same(out, whole_);
  }
}

TEST_F(Resume, the_opencl_result_does_not_depend_on_threads) {
  std::map<std::string, std::string> first;
  for (const char* threads : {"1", "4"}) {
    SCOPED_TRACE(threads);
    const path out = *folder_ / ("opencl" + std::string(threads));
    const test::Ran ran =
        test::run_program(test::track_small(scene(), out, {"--threads", threads, "--backend", "opencl"}));
    ASSERT_EQ(ran.status, 0) << ran.err;
    if (first.empty())
      first = contents(out);
    else
      expect_same(out, first);
  }
}

}  // namespace
}  // namespace isoskin
