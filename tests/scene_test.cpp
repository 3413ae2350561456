#include "core/io/scene.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <tbb/parallel_for.h>
#include <unistd.h>

#include <array>
#include <fstream>
#include <numeric>

#include "core/field/skeleton_field.h"
#include "core/io/key_track.h"

namespace isoskin {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

const fs::path kData = ISOSKIN_TEST_DATA;

class SceneFile : public testing::Test {
protected:
  SceneFile() {
    folder =
        fs::temp_directory_path() /
        fmt::format("isoskin_scene_{}_{}", testing::UnitTest::GetInstance()->current_test_info()->name(), ::getpid());
    fs::create_directories(folder);
  }
  ~SceneFile() override { fs::remove_all(folder); }

  fs::path write(const std::string& text) const {
    std::ofstream(folder / "scene.toml") << text;
    return folder / "scene.toml";
  }
  std::string error(const std::string& text, const SequenceOptions& overrides = {}) const {
    try {
      load_scene(write(text), overrides);
    } catch (const InputError& e) {
      EXPECT_EQ(std::string(e.what()).find('\n'), std::string::npos) << e.what();
      return e.what();
    }
    ADD_FAILURE() << "no InputError for " << text;
    return {};
  }

  fs::path folder;
};

const SkeletonField& skeleton(const FieldFrame& frame) {
  return dynamic_cast<const SkeletonField&>(*frame.field);
}

// Pieces (6-connected) of lattice points inside, pieces outside, and the Euler characteristic of the inside.
struct Digital {
  int inside = 0, outside = 0, euler = 0;
};

Digital digital_topology(const Field& field, int points) {
  const Box box = field.bounds();
  const double spacing = std::max({box.size().x, box.size().y, box.size().z}) / points;
  const IVec3 n = IVec3(box.size() / spacing) + 4;
  const auto index = [&](const IVec3& v) { return (v.x * n.y + v.y) * n.z + v.z; };
  std::vector<std::uint8_t> in(std::size_t(n.x) * n.y * n.z);
  tbb::parallel_for(0, n.x, [&](int x) {
    for (int y = 0; y < n.y; ++y) {
      for (int z = 0; z < n.z; ++z) {
        in[index({x, y, z})] = field.value(box.low + spacing * (DVec3(x, y, z) - 1.5)) > 0.0;
      }
    }
  });
  std::vector<int> parent(in.size());
  std::iota(parent.begin(), parent.end(), 0);
  const auto root = [&](int i) {
    while (parent[i] != i) i = parent[i] = parent[parent[i]];
    return i;
  };
  Digital result;
  for (int x = 0; x < n.x; ++x) {
    for (int y = 0; y < n.y; ++y) {
      for (int z = 0; z < n.z; ++z) {
        const IVec3 v(x, y, z);
        const bool here = in[index(v)];
        // Outside points hang together across corners (26), inside ones across faces (6).
        for (int d = 0; d < 13; ++d) {  // the other 13 neighbours look back
          const IVec3 step = IVec3(d / 9, d / 3 % 3, d % 3) - 1, w = v + step;
          const int reach = std::abs(step.x) + std::abs(step.y) + std::abs(step.z);
          if (glm::any(glm::lessThan(w, IVec3(0))) || glm::any(glm::greaterThanEqual(w, n))) continue;
          if (in[index(w)] == here && (!here || reach == 1)) parent[root(index(w))] = root(index(v));
        }
        // Points - edges + squares - cubes of the inside lattice.
        for (int d = 0; here && d < 8; ++d) {
          const IVec3 reach(d & 1, d >> 1 & 1, d >> 2);
          bool whole = true;
          for (int c = 0; whole && c < 8; ++c) {
            const IVec3 w = v + IVec3(c & 1, c >> 1 & 1, c >> 2) * reach;
            whole = glm::all(glm::lessThan(w, n)) && in[index(w)];
          }
          if (whole) result.euler += (reach.x + reach.y + reach.z) % 2 ? -1 : 1;
        }
      }
    }
  }
  for (std::size_t i = 0; i < in.size(); ++i) {
    if (root(static_cast<int>(i)) == static_cast<int>(i)) ++(in[i] ? result.inside : result.outside);
  }
  return result;
}

TEST(BundledScenes, AllLoadWithASurfaceInEveryFrame) {
  for (const auto& [name, elements, last] :
       std::vector<std::tuple<std::string, std::size_t, int>>{{"two_points", 2, 80},
                                                              {"chain12", 12, 120},
                                                              {"metaballs7", 7, 200},
                                                              {"metaballs60", 60, 120},
                                                              {"solids", 3, 48},
                                                              {"norm_p10", 1, 24},
                                                              {"norm_p4", 1, 24},
                                                              {"norm_p1", 1, 24},
                                                              {"norm_p06", 1, 24}}) {
    const Scene scene = open_input((kData / (name + ".toml")).string());
    EXPECT_EQ(scene.source->name(), name);
    EXPECT_EQ(scene.source->first_frame(), 1);
    EXPECT_EQ(scene.source->last_frame(), last);
    EXPECT_DOUBLE_EQ(scene.source->frame_duration(), 0.04);
    for (int frame = 1; frame <= last; frame += 23) {
      const FieldFrame loaded = scene.source->load(frame);
      EXPECT_EQ(skeleton(loaded).elements().size(), elements);
      EXPECT_FALSE(loaded.field->bounds().empty());
      EXPECT_DOUBLE_EQ(loaded.time, (frame - 1) * 0.04);
    }
  }
}

TEST(BundledScenes, SevenMetaballsStayOneBall) {
  const Scene scene = load_scene(kData / "metaballs7.toml");
  double moved = 0.0;
  FieldFrame before = scene.source->load(1);
  for (int frame = 1; frame <= 200; frame += 4) {
    const FieldFrame now = scene.source->load(frame);
    const Digital t = digital_topology(*now.field, 28);
    ASSERT_EQ(t.inside, 1) << frame;
    ASSERT_EQ(t.outside, 1) << frame;
    ASSERT_EQ(t.euler, 1) << frame;
    for (int i = 0; i < 7; ++i)
      moved += glm::length(skeleton(now).elements()[i].a - skeleton(before).elements()[i].a) / 7;
    before = now;
  }
  EXPECT_GT(moved, 0.8);
}

TEST(BundledScenes, TwoPointsMergeAndSplit) {
  const Scene scene = load_scene(kData / "two_points.toml");
  std::vector<int> pieces;
  for (int frame = 1; frame <= 80; ++frame) {
    const int now = digital_topology(*scene.source->load(frame).field, 28).inside;
    if (pieces.empty() || pieces.back() != now) pieces.push_back(now);
  }
  EXPECT_EQ(pieces, (std::vector<int>{2, 1, 2}));
}

TEST(BundledScenes, SixtyMetaballsChangeTopology) {
  const Scene scene = load_scene(kData / "metaballs60.toml");
  std::vector<int> pieces;
  for (int frame = 1; frame <= 120; frame += 17)
    pieces.push_back(digital_topology(*scene.source->load(frame).field, 40).inside);
  const auto [low, high] = std::minmax_element(pieces.begin(), pieces.end());
  EXPECT_GT(*high - *low, 3);
}

TEST_F(SceneFile, EveryKeyIsRead) {
  const Scene scene = load_scene(write(R"(
name = "thing"
frames = [5, 9]
dt = 0.5
iso = 0.25
[meshing]
edge_length = 0.1
angle = 18
passes = 3
sagitta = 0.002
sharp = true
[[element]]
kind = "segment"
potential = "wyvill"
norm = 4
a = [1, 2, 3]
b = [4.5, 5, 6]
radius = 2
weight = -0.5
[[element]]
potential = "inverse_square"
position = [0, 0, 1]
keys = [ { frame = 5, radius = 1.0 }, { frame = 9, radius = 3.0 } ]
)"));
  EXPECT_EQ(scene.source->name(), "thing");
  EXPECT_EQ(scene.source->first_frame(), 5);
  EXPECT_EQ(scene.source->last_frame(), 9);
  EXPECT_EQ(scene.source->frame_duration(), 0.5);
  EXPECT_EQ(scene.meshing.edge_length, 0.1);
  EXPECT_EQ(scene.meshing.angle, 18.0);
  EXPECT_EQ(scene.meshing.passes, 3);
  EXPECT_EQ(scene.meshing.sagitta, 0.002);
  EXPECT_EQ(scene.meshing.sharp, true);
  const FieldFrame frame = scene.source->load(7);
  EXPECT_EQ(frame.frame, 7);
  EXPECT_DOUBLE_EQ(frame.time, 1.0);
  const SkeletonField& field = skeleton(frame);
  EXPECT_EQ(field.iso(), 0.25);
  const SkeletonElement &s = field.elements()[0], &p = field.elements()[1];
  EXPECT_EQ(s.a, DVec3(1, 2, 3));
  EXPECT_EQ(s.b, DVec3(4.5, 5, 6));
  EXPECT_EQ(s.norm, 4.0);
  EXPECT_EQ(s.radius, 2.0);
  EXPECT_EQ(s.weight, -0.5);
  EXPECT_EQ(s.potential, Potential::wyvill);
  EXPECT_EQ(p.a, DVec3(0, 0, 1));
  EXPECT_EQ(p.a, p.b);
  EXPECT_EQ(p.radius, 2.0);
  EXPECT_EQ(p.weight, 1.0);
  EXPECT_EQ(p.potential, Potential::inverse_square);
  EXPECT_THROW(scene.source->load(4), InputError);
  EXPECT_THROW(scene.source->load(10), InputError);
}

TEST_F(SceneFile, TrianglesAndTurningBoxes) {
  const Scene scene = load_scene(write(R"(
iso = 0.2
frames = [1, 5]
[[element]]
kind = "triangle"
a = [0, 0, 0]
b = [1, 0, 0]
keys = [ { frame = 1, c = [0, 1, 0] }, { frame = 5, c = [0, 3, 0] } ]
[[element]]
kind = "box"
size = [2, 4, 6]
keys = [ { frame = 1, position = [1, 2, 3], rotation = [0, 0, 0] }, { frame = 5, position = [5, 2, 3], rotation = [0, 0, 360] } ]
)"));
  const SkeletonField first = skeleton(scene.source->load(1)), later = skeleton(scene.source->load(2));
  EXPECT_EQ(later.elements()[0].shape, Shape::triangle);
  EXPECT_EQ(later.elements()[0].c, DVec3(0, 1.5, 0));
  const SkeletonElement &box = first.elements()[1], &turned = later.elements()[1];
  EXPECT_EQ(box.shape, Shape::box);
  EXPECT_EQ(extent(box).low, DVec3(0, 0, 0));
  EXPECT_EQ(extent(box).high, DVec3(2, 4, 6));
  EXPECT_LT(glm::distance(center(turned), DVec3(2, 2, 3)), 1e-12);
  EXPECT_LT(glm::distance(turned.b - turned.a, DVec3(0, 2, 0)), 1e-12);  // a quarter of a turn about z
  EXPECT_LT(glm::distance(turned.c - turned.a, DVec3(-4, 0, 0)), 1e-12);
  EXPECT_LT(glm::distance(turned.d - turned.a, DVec3(0, 0, 6)), 1e-12);
}

TEST_F(SceneFile, OverridesWin) {
  SequenceOptions overrides;
  overrides.dt = 2.0;
  overrides.first = 3;
  overrides.last = 4;
  const fs::path file = write("iso = 0.2\nframes = [1, 9]\ndt = 0.1\n[[element]]\nposition = [0, 0, 0]\n");
  const Scene scene = load_scene(file, overrides);
  EXPECT_EQ(scene.source->first_frame(), 3);
  EXPECT_EQ(scene.source->last_frame(), 4);
  EXPECT_EQ(scene.source->load(3).time, 4.0);  // two frames after the scene's first
  EXPECT_EQ(scene.source->name(), "scene");
  overrides.last = 10;
  try {
    load_scene(file, overrides);
    FAIL();
  } catch (const InputError& e) {
    EXPECT_THAT(e.what(), HasSubstr("no frames 3 to 10; the scene has 1 to 9"));
  }
}

TEST_F(SceneFile, SequencesInAScene) {
  const fs::path pattern = kData / "dam_break" / "dam_break.%04d.vdb";
  const auto text = [&](const std::string& more) {
    return fmt::format("name = \"dam\"\nframes = [30, 33]\n[sequence]\nfiles = \"{}\"\n{}", pattern.string(), more);
  };
  const Scene scene = load_scene(write(text("grid = \"surface\"\ninterpolation = \"linear\"\n")));
  EXPECT_EQ(scene.source->name(), "dam");
  EXPECT_EQ(scene.source->first_frame(), 30);
  EXPECT_EQ(scene.source->last_frame(), 33);
  EXPECT_FALSE(scene.source->load(30).field->is_c2());
  EXPECT_TRUE(load_scene(write(text(""))).source->load(31).field->is_c2());
  EXPECT_NEAR(scene.source->frame_duration(), 1.0 / 48.0, 1e-6);

  EXPECT_THAT(error("[sequence]\nfiles = \"none.%04d.vdb\"\n"), HasSubstr("scene.toml:2: "));
  EXPECT_THAT(error("[sequence]\nfiles = \"none.%04d.vdb\"\n"), HasSubstr("no file matches the pattern"));
  EXPECT_THAT(error("iso = 0.5\n[sequence]\nfiles = \"a\"\n"),
              HasSubstr("scene.toml:1: iso: expected it in [sequence]"));
  EXPECT_THAT(error("[sequence]\nfile = \"a\"\n"), HasSubstr("scene.toml:2: unknown key file"));
  EXPECT_THAT(error("[sequence]\ngrid = \"a\"\n"), HasSubstr("scene.toml:1: sequence without files"));
  EXPECT_THAT(error(text("interpolation = \"quadratic\"\n")),
              HasSubstr("scene.toml:5: interpolation: expected one of: linear, cubic"));
  EXPECT_THAT(error(text("smooth = -1\n")), HasSubstr("scene.toml:5: smooth"));
}

TEST_F(SceneFile, BadScenesNameTheLine) {
  const std::string good = "iso = 0.2\n[[element]]\nposition = [0, 0, 0]\n";  // further lines begin at 4
  const std::vector<std::pair<std::string, std::string>> cases = {
      {"iso = \n", "scene.toml:1: "},
      {"iso = 0.2\n", "expected either [[element]] or [sequence]"},
      {"[[element]]\nposition = [0, 0, 0]\n", "scene without iso"},
      {"iso = \"big\"\n[[element]]\nposition = [0, 0, 0]\n", "scene.toml:1: iso: expected a number, found string"},
      {"iso = nan\n[[element]]\nposition = [0, 0, 0]\n", "scene.toml:1: iso: expected a finite number"},
      {"colour = 1\n" + good, "scene.toml:1: unknown key colour, expected one of: name, frames"},
      {"frames = [1]\n" + good, "scene.toml:1: frames: expected [first, last]"},
      {"frames = [2, 1]\n" + good, "scene.toml:1: frames: expected the first not to exceed"},
      {"frames = [1.5, 2]\n" + good, "scene.toml:1: frames: expected an integer, found floating-point"},
      {"frames = [-1, 2]\n" + good, "scene.toml:1: frames: expected an integer from 0"},
      {"dt = 0\n" + good, "scene.toml:1: dt: expected a positive number"},
      {"name = \"a/b\"\n" + good, "scene.toml:1: name: expected a word"},
      {"element = 3\niso = 1\n", "scene.toml:1: element: expected an array, found integer"},
      {"element = []\niso = 1\n", "scene.toml:1: element: expected at least one"},
      {good + "radius = 0\n", "scene.toml:4: radius: expected a positive number"},
      {good + "radius = inf\n", "scene.toml:4: radius: expected a finite number"},
      {good + "weight = true\n", "scene.toml:4: weight: expected a number, found boolean"},
      {good + "norm = -2\n", "scene.toml:4: norm: expected a positive number"},
      {good + "kind = \"cube\"\n", "scene.toml:4: kind: expected one of: point, segment, triangle, box; found cube"},
      {good + "potential = 3\n", "scene.toml:4: potential: expected a string, found integer"},
      {good + "motion = \"jerky\"\n", "scene.toml:4: motion: expected one of: linear, smooth"},
      {good + "a = [0, 0, 0]\n", "scene.toml:4: unknown key a, expected one of: kind"},
      {good + "keys = [ { frame = 1, position = [1, 0, 0] } ]\n",
       "scene.toml:4: position is given for the whole element too"},
      {good + "keys = []\n", "scene.toml:4: keys: expected at least one key"},
      {good + "keys = [ { radius = 2 } ]\n", "scene.toml:4: key without frame"},
      {good + "keys = [ { frame = 2, radius = 2 },\n { frame = 2, radius = 2 } ]\n",
       "scene.toml:5: keys: expected frames in increasing order"},
      {good + "keys = [ { frame = 2, size = 2 } ]\n", "scene.toml:4: unknown key size"},
      {good + "[meshing]\nedge_length = 0\n", "scene.toml:5: edge_length: expected a positive number"},
      {good + "[meshing]\nangle = 200\n", "scene.toml:5: angle: expected degrees under 180"},
      {good + "[meshing]\nsharp = 1\n", "scene.toml:5: sharp: expected true or false, found integer"},
      {good + "[[element]]\nradius = 1\n", "scene.toml:4: element without position"},
      {good + "[[element]]\nkind = \"segment\"\na = [0, 0, 0]\n", "scene.toml:4: element without b"},
      {good + "[[element]]\nkind = \"triangle\"\na = [0, 0, 0]\nb = [1, 0, 0]\n", "scene.toml:4: element without c"},
      {good + "[[element]]\nkind = \"box\"\nposition = [0, 0, 0]\n", "scene.toml:4: element without size"},
      {good + "[[element]]\nkind = \"box\"\nposition = [0, 0, 0]\nsize = [1, -1, 1]\n",
       "scene.toml:7: size: expected none below 0"},
      {good + "[[element]]\nposition = [0, 0]\n", "scene.toml:5: position: expected three numbers"},
      {good + "[[element]]\nposition = [0, 0, \"x\"]\n", "scene.toml:5: position: expected a number, found string"},
  };
  for (const auto& [text, expected] : cases) EXPECT_THAT(error(text), HasSubstr(expected)) << text;
}

TEST_F(SceneFile, MissingInputIsNamed) {
  for (const std::string name : {"none.toml", "none.vdb", "none"}) {
    try {
      open_input((folder / name).string());
      FAIL() << name;
    } catch (const InputError& e) {
      EXPECT_THAT(e.what(), HasSubstr(name + ": no such file"));
    }
  }
}

TEST(KeyTrack, LinearAndHeldAtTheEnds) {
  const KeyTrack<double> track{Motion::linear, {2.0, 4.0, 8.0}, {1.0, 3.0, -1.0}};
  EXPECT_EQ(track.at(-5.0), 1.0);
  EXPECT_EQ(track.at(2.0), 1.0);
  EXPECT_EQ(track.at(3.0), 2.0);
  EXPECT_EQ(track.at(6.0), 1.0);
  EXPECT_EQ(track.at(8.0), -1.0);
  EXPECT_EQ(track.at(80.0), -1.0);
}

TEST(KeyTrack, SmoothPassesThroughKeysWithContinuousSpeed) {
  const KeyTrack<DVec3> track{Motion::smooth,
                              {1.0, 3.0, 4.0, 9.0},
                              {DVec3(0.0), DVec3(1.0, -1.0, 2.0), DVec3(3.0, 0.0, 2.5), DVec3(0.0, 4.0, 1.0)}};
  constexpr double kStep = 1e-6;
  for (std::size_t k = 0; k < track.frame.size(); ++k) {
    const double f = track.frame[k];
    EXPECT_NEAR(glm::length(track.at(f) - track.value[k]), 0.0, 1e-12);
    const DVec3 before = (track.at(f) - track.at(f - kStep)) / kStep,
                after = (track.at(f + kStep) - track.at(f)) / kStep;
    EXPECT_NEAR(glm::length(after - before), 0.0, 1e-4) << k;
  }
}

TEST(KeyTrack, SmoothNumbersStayBetweenTheirKeys) {
  const KeyTrack<double> track{Motion::smooth, {0.0, 1.0, 2.0, 10.0, 11.0}, {1.0, 0.01, 0.02, 5.0, 0.01}};
  for (double f = 0.0; f <= 11.0; f += 0.01) {
    const std::size_t k = f < 1.0 ? 0 : f < 2.0 ? 1 : f < 10.0 ? 2 : 3;
    EXPECT_GE(track.at(f), std::min(track.value[k], track.value[k + 1]) - 1e-12);
    EXPECT_LE(track.at(f), std::max(track.value[k], track.value[k + 1]) + 1e-12);
  }
}

}  // namespace
}  // namespace isoskin
