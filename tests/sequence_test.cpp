#include "core/io/sequence.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <openvdb/openvdb.h>
#include <openvdb/tools/LevelSetSphere.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <fstream>
#include <random>
#include <thread>

#include "core/io/frame_files.h"
#include "core/io/prefetch.h"

namespace isoskin {
namespace {

namespace fs = std::filesystem;
using openvdb::Coord;
using testing::HasSubstr;

class Sequence : public testing::Test {
protected:
  Sequence() {
    openvdb::initialize();
    const auto* info = testing::UnitTest::GetInstance()->current_test_info();
    folder = fs::temp_directory_path() / (std::string("isoskin_") + info->name() + "_" + std::to_string(::getpid()));
    fs::create_directories(folder);
  }
  ~Sequence() override { fs::remove_all(folder); }

  fs::path write(const std::string& name, const openvdb::GridPtrVec& grids) const {
    openvdb::io::File file((folder / name).string());
    file.write(grids);
    file.close();
    return folder / name;
  }

  static openvdb::FloatGrid::Ptr sphere(double radius = 1.0, double h = 0.125, const DVec3& center = DVec3(0.0),
                                        float half_width = 3.0f) {
    auto grid = openvdb::tools::createLevelSetSphere<openvdb::FloatGrid>(
        static_cast<float>(radius), openvdb::Vec3f(center.x, center.y, center.z), static_cast<float>(h), half_width);
    grid->setName("surface");
    return grid;
  }

  template <typename Action>
  static std::string error_of(const Action& action) {
    try {
      action();
    } catch (const InputError& error) {
      EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos) << error.what();
      return error.what();
    }
    ADD_FAILURE() << "no InputError";
    return {};
  }
  static std::string load_error(const fs::path& path, const GridOptions& options = {}) {
    return error_of([&] { load_grid(path, options); });
  }

  fs::path folder;
};

// Signs and values at the voxels of the file, read with OpenVDB here.
void expect_voxels(const fs::path& path, const GridField& field, double tolerance) {
  openvdb::io::File file(path.string());
  file.open();
  const auto grid = openvdb::gridPtrCast<openvdb::FloatGrid>(file.readGrid("surface"));
  std::size_t wrong_side = 0, wrong_value = 0, voxels = 0;
  for (auto voxel = grid->cbeginValueOn(); voxel; ++voxel) {
    const openvdb::Vec3d p = grid->indexToWorld(voxel.getCoord());
    const double value = field.value({p.x(), p.y(), p.z()});
    wrong_side += (value > 0.0) != (*voxel < 0.0f);
    wrong_value += std::abs(value + *voxel) > tolerance * field.resolution();
    ++voxels;
  }
  EXPECT_GT(voxels, 1000u);
  EXPECT_EQ(wrong_side, 0u);
  EXPECT_EQ(wrong_value, 0u);
}

TEST_F(Sequence, BundledFluidHasTheFilesSignsAtVoxelCentres) {
  for (const int frame : {27, 36, 50}) {
    const fs::path path = fs::path(ISOSKIN_TEST_DATA) / "dam_break" / ("dam_break.00" + std::to_string(frame) + ".vdb");
    for (const Interpolation interpolation : {Interpolation::linear, Interpolation::cubic}) {
      GridOptions options;
      options.interpolation = interpolation;
      expect_voxels(path, *load_grid(path, options), 1e-5);
    }
  }
}

TEST_F(Sequence, SphereIsASphere) {
  const DVec3 center(3.0, -1.0, 0.5);
  const fs::path path = write("sphere.vdb", {sphere(1.0, 0.125, center, 6.0f)});  // far from the band's kinks
  const auto field = load_grid(path, {});
  EXPECT_DOUBLE_EQ(field->resolution(), 0.125);
  expect_voxels(path, *field, 1e-5);
  std::mt19937 engine(3);
  std::normal_distribution<double> normal;
  for (int k = 0; k < 200; ++k) {
    const DVec3 n = glm::normalize(DVec3(normal(engine), normal(engine), normal(engine)));
    const FieldSample s = field->sample(center + n);
    EXPECT_NEAR(s.value, 0.0, 3e-5);
    EXPECT_NEAR(glm::length(s.gradient + n), 0.0, 1e-3);
  }
  EXPECT_GT(field->value(center), 0.0);
  EXPECT_LT(field->value(center + 10.0), 0.0);
  const Box box = field->bounds();
  for (int i = 0; i < 3; ++i) {
    EXPECT_NEAR(box.low[i], center[i] - 1.0, 0.25);
    EXPECT_NEAR(box.high[i], center[i] + 1.0, 0.25);
  }
}

TEST_F(Sequence, HalfAndDoubleGridsAreRead) {
  auto half = sphere();
  half->setSaveFloatAsHalf(true);
  auto wide = openvdb::DoubleGrid::create(1e6 + 0.375);
  wide->setTransform(openvdb::math::Transform::createLinearTransform(0.125));
  wide->setGridClass(openvdb::GRID_LEVEL_SET);
  for (auto voxel = half->cbeginValueAll(); voxel; ++voxel) {
    if (voxel.isVoxelValue()) wide->tree().setValue(voxel.getCoord(), *voxel + 1e6);
  }
  wide->setName("surface");
  const auto from_half = load_grid(write("half.vdb", {half}), {});
  const auto from_float = load_grid(write("float.vdb", {sphere()}), {});
  EXPECT_NEAR(from_half->value(DVec3(0.7, 0.6, 0.3)), from_float->value(DVec3(0.7, 0.6, 0.3)), 1e-3);
  // An iso value of a million with differences that floats of that size would lose.
  GridOptions options;
  options.iso = 1e6;
  const auto from_double = load_grid(write("double.vdb", {wide}), options);
  EXPECT_NEAR(from_double->value(DVec3(0.7, 0.6, 0.3)), from_float->value(DVec3(0.7, 0.6, 0.3)), 1e-5);
}

TEST_F(Sequence, FogVolumesWithHardEdges) {
  auto fog = openvdb::FloatGrid::create(0.0f);
  fog->setGridClass(openvdb::GRID_FOG_VOLUME);
  fog->setName("density");
  fog->fill(openvdb::CoordBBox(Coord(0), Coord(31)), 1.0f);  // tiles only: no leaf
  fog->fill(openvdb::CoordBBox(Coord(40, 3, 3), Coord(50, 9, 9)), 0.8f);
  const fs::path path = write("fog.vdb", {fog});
  const auto field = load_grid(path, {});  // iso 0.5
  for (int x = -3; x < 60; ++x) {
    for (int y = -3; y < 40; ++y) {
      for (const int z : {-1, 0, 5, 31, 32}) {
        EXPECT_EQ(field->value(DVec3(x, y, z)) > 0.0, fog->tree().getValue(Coord(x, y, z)) > 0.5f)
            << x << ' ' << y << ' ' << z;
      }
    }
  }
  GridOptions high;
  high.iso = 0.9;
  high.iso_given = true;
  EXPECT_LT(load_grid(path, high)->value(DVec3(45, 6, 6)), 0.0);
  EXPECT_GT(load_grid(path, high)->value(DVec3(16)), 0.0);
  high.interpolation = Interpolation::linear;  // a cubic spline of an edge of 0.8 swings above 0.9
  EXPECT_LT(load_grid(path, high)->bounds().high.x, 35.0);
}

TEST_F(Sequence, OneSignIsAFieldWithoutSurface) {
  auto grid = openvdb::FloatGrid::create(1.0f);
  grid->setGridClass(openvdb::GRID_LEVEL_SET);
  grid->setName("surface");
  grid->fill(openvdb::CoordBBox(Coord(0), Coord(5)), 0.5f);
  const auto field = load_grid(write("dry.vdb", {grid}), {});
  EXPECT_TRUE(field->bounds().empty());
  EXPECT_LT(field->value(DVec3(2.0)), 0.0);
}

TEST_F(Sequence, ZeroCountsAsOutsideAndIsMovedOffTheVoxel) {
  auto grid = sphere();
  grid->tree().setValue(Coord(8, 0, 0), 0.0f);
  const auto field = load_grid(write("zero.vdb", {grid}), {});
  const double value = field->value(DVec3(1.0, 0.0, 0.0));
  EXPECT_LT(value, 0.0);
  EXPECT_GT(value, -1e-5 * 0.125);
}

TEST_F(Sequence, SmoothingRunsOnLoad) {
  auto grid = sphere(1.0, 0.0625);
  std::mt19937 engine(1);
  std::uniform_real_distribution<float> noise(-0.03f, 0.03f);
  for (auto voxel = grid->beginValueOn(); voxel; ++voxel) voxel.setValue(*voxel + noise(engine));
  const fs::path path = write("rough.vdb", {grid});
  const auto roughness = [&](int iterations) {
    GridOptions options;
    options.smooth = iterations;
    const auto field = load_grid(path, options);
    double sum = 0.0;
    std::mt19937 directions(2);
    std::normal_distribution<double> normal;
    for (int k = 0; k < 300; ++k) {
      const DVec3 n = glm::normalize(DVec3(normal(directions), normal(directions), normal(directions)));
      const DVec3 g = field->sample(n).gradient;
      sum += glm::length(glm::normalize(g) + n);
    }
    return sum / 300.0;
  };
  const double before = roughness(0), after = roughness(8);
  EXPECT_LT(after, 0.5 * before);

  auto fog = openvdb::FloatGrid::create(0.0f);
  fog->fill(openvdb::CoordBBox(Coord(0), Coord(9)), 1.0f);
  fog->setName("density");
  GridOptions options;
  options.smooth = 1;
  EXPECT_THAT(load_error(write("fog.vdb", {fog}), options), HasSubstr("not a level set"));
}

TEST_F(Sequence, BadFilesAreNamed) {
  EXPECT_THAT(load_error(folder / "none.vdb"), HasSubstr("none.vdb: no such file"));
  EXPECT_THAT(load_error(folder), HasSubstr("is a folder"));
  std::ofstream(folder / "text.vdb") << "this is not OpenVDB";
  EXPECT_THAT(load_error(folder / "text.vdb"), HasSubstr("text.vdb: not a whole OpenVDB file"));
  std::ofstream(folder / "nothing.vdb");
  EXPECT_THAT(load_error(folder / "nothing.vdb"), HasSubstr("nothing.vdb: not a whole OpenVDB file"));

  const fs::path whole = write("whole.vdb", {sphere()});
  std::ifstream in(whole, std::ios::binary);
  const std::string bytes((std::istreambuf_iterator<char>(in)), {});
  for (const double share : {0.01, 0.1, 0.5, 0.9, 0.99}) {
    std::ofstream(folder / "cut.vdb", std::ios::binary)
        << bytes.substr(0, static_cast<std::size_t>(share * bytes.size()));
    EXPECT_THAT(load_error(folder / "cut.vdb"), HasSubstr("cut.vdb")) << share;
  }
}

TEST_F(Sequence, BadGridsAreNamed) {
  auto vectors = openvdb::Vec3SGrid::create();
  vectors->setName("vel");
  GridOptions options;
  options.grid = "fog";
  EXPECT_THAT(load_error(write("a.vdb", {sphere(), vectors}), options),
              HasSubstr("no grid fog; present: surface (float), vel (vec3s)"));
  options.grid = "vel";
  EXPECT_THAT(load_error(write("a.vdb", {sphere(), vectors}), options),
              HasSubstr("grid vel holds vec3s, expected float"));
  EXPECT_THAT(load_error(write("b.vdb", {vectors})), HasSubstr("no scalar grid"));

  auto empty = openvdb::FloatGrid::create(1.0f);
  empty->setName("surface");
  EXPECT_THAT(load_error(write("empty.vdb", {empty})), HasSubstr("grid surface: is empty"));

  auto nan = sphere();
  nan->tree().setValue(Coord(8, 1, -2), std::numeric_limits<float>::quiet_NaN());
  EXPECT_THAT(load_error(write("nan.vdb", {nan})),
              HasSubstr("not finite at voxel (8, 1, -2), world (1, 0.125, -0.25)"));
  auto infinite = sphere();
  infinite->tree().setValue(Coord(8, 1, -2), std::numeric_limits<float>::infinity());
  EXPECT_THAT(load_error(write("inf.vdb", {infinite})), HasSubstr("not finite at voxel (8, 1, -2)"));
}

TEST_F(Sequence, BadTransformsAreNamed) {
  const auto with = [&](const std::array<double, 9>& m) {
    auto grid = sphere();
    grid->setTransform(openvdb::math::Transform::createLinearTransform(
        openvdb::Mat4R(m[0], m[1], m[2], 0.0, m[3], m[4], m[5], 0.0, m[6], m[7], m[8], 0.0, 0.0, 0.0, 0.0, 1.0)));
    return load_error(write("t.vdb", {grid}));
  };
  EXPECT_THAT(with({0.1, 0, 0, 0, 0.2, 0, 0, 0, 0.1}), HasSubstr("voxel size 0.1 0.2 0.1"));
  EXPECT_THAT(with({0, 0.1, 0, -0.1, 0, 0, 0, 0, 0.1}), HasSubstr("no rotation"));
  EXPECT_THAT(with({0.08, 0.06, 0, -0.06, 0.08, 0, 0, 0, 0.1}), HasSubstr("rotated"));
  EXPECT_THAT(with({-0.1, 0, 0, 0, 0.1, 0, 0, 0, 0.1}), HasSubstr("mirroring"));

  auto tapered = sphere();
  tapered->setTransform(openvdb::math::Transform::createFrustumTransform(
      openvdb::BBoxd(openvdb::Vec3d(0), openvdb::Vec3d(10)), 0.5, 1.0, 0.1));
  EXPECT_THAT(load_error(write("frustum.vdb", {tapered})), HasSubstr("not linear"));
}

TEST_F(Sequence, AbsurdExtentIsRefused) {
  auto grid = sphere();
  grid->tree().setValue(Coord(20'000'000, 20'000'000, 20'000'000), 0.1f);
  EXPECT_THAT(load_error(write("far.vdb", {grid})), HasSubstr("spreads over"));
}

TEST_F(Sequence, VelocityGridsStaggeredAndCentred) {
  const double h = 0.5;
  const auto make = [&](bool staggered) {
    auto grid = openvdb::Vec3SGrid::create();
    grid->setTransform(openvdb::math::Transform::createLinearTransform(h));
    grid->setName("vel");
    if (staggered) grid->setGridClass(openvdb::GRID_STAGGERED);
    for (int x = -4; x < 12; ++x) {
      for (int y = -4; y < 12; ++y) {
        for (int z = -4; z < 12; ++z) {
          // v = (x, 2 y, z + 1); staggered components sit on the voxel's lower faces.
          const DVec3 p = h * (DVec3(x, y, z) - (staggered ? 0.5 : 0.0));
          grid->tree().setValue(Coord(x, y, z), openvdb::Vec3s(p.x, 2 * p.y, p.z + 1));
        }
      }
    }
    return grid;
  };
  auto surface = sphere(1.0, 0.125, DVec3(2.0));
  for (const bool staggered : {false, true}) {
    auto grid = make(staggered);
    grid->setSaveFloatAsHalf(!staggered);
    const fs::path path = write("fluid.0001.vdb", {surface, grid});
    SequenceOptions options;
    EXPECT_EQ(open_sequence(path.string(), options)->load(1).velocity, nullptr);
    options.grid.velocity = "vel";
    const FieldFrame frame = open_sequence(path.string(), options)->load(1);
    ASSERT_NE(frame.velocity, nullptr);
    for (const DVec3& p : {DVec3(1.0), DVec3(2.13, 0.77, 3.05), DVec3(0.1, 4.2, 2.9)}) {
      const DVec3 v = frame.velocity->velocity(p);
      EXPECT_NEAR(glm::length(v - DVec3(p.x, 2 * p.y, p.z + 1)), 0.0, staggered ? 1e-5 : 5e-3) << staggered;
    }
    options.grid.velocity = "wind";
    EXPECT_THAT(error_of([&] { open_sequence(path.string(), options)->load(1); }), HasSubstr("no grid wind; present:"));
    options.grid.velocity = "surface";
    EXPECT_THAT(error_of([&] { open_sequence(path.string(), options)->load(1); }), HasSubstr("expected vectors"));
  }
}

TEST_F(Sequence, FrameDurationComesFromCallerThenFile) {
  auto grid = sphere();
  const fs::path plain = write("plain.vdb", {grid});
  grid->insertMeta("frame_dt", openvdb::FloatMetadata(0.03f));
  const fs::path marked = write("marked.vdb", {grid});
  SequenceOptions options;
  EXPECT_DOUBLE_EQ(open_sequence(plain.string(), options)->frame_duration(), 1.0 / 24.0);
  EXPECT_NEAR(open_sequence(marked.string(), options)->frame_duration(), 0.03, 1e-7);
  options.dt = 0.5;
  EXPECT_DOUBLE_EQ(open_sequence(marked.string(), options)->frame_duration(), 0.5);
  options.dt = 0.0;
  EXPECT_THAT(error_of([&] { open_sequence(marked.string(), options); }), HasSubstr("dt must be positive"));
}

TEST_F(Sequence, OpensPatternsFoldersGlobsAndFiles) {
  for (const int frame : {8, 9, 10, 11}) {
    write(fmt::format("drop.{:04}.vdb", frame), {sphere(0.1 * frame)});
  }
  for (const std::string input : {"drop.%04d.vdb", "", "drop.*.vdb", "drop.00??.vdb"}) {
    const auto source = open_sequence((folder / input).string(), {});
    EXPECT_EQ(source->first_frame(), 8) << input;
    EXPECT_EQ(source->last_frame(), 11) << input;
    EXPECT_EQ(source->name(), "drop") << input;
    for (int frame = 8; frame <= 11; ++frame) {
      const FieldFrame loaded = source->load(frame);
      EXPECT_EQ(loaded.frame, frame);
      EXPECT_NEAR(loaded.time, (frame - 8) / 24.0, 1e-12);
      EXPECT_NEAR(loaded.field->value(DVec3(0.1 * frame, 0.0, 0.0)), 0.0, 2e-3);
    }
    EXPECT_THAT(error_of([&] { source->load(12); }), HasSubstr("no frame 12, expected 8 to 11"));
  }
  const auto one = open_sequence((folder / "drop.0009.vdb").string(), {});
  EXPECT_EQ(one->first_frame(), 9);
  EXPECT_EQ(one->last_frame(), 9);
  SequenceOptions part;
  part.first = 9;
  part.last = 10;
  const auto some = open_sequence((folder / "drop.%04d.vdb").string(), part);
  EXPECT_EQ(some->first_frame(), 9);
  EXPECT_EQ(some->last_frame(), 10);
  EXPECT_NEAR(some->load(9).time, 1.0 / 24.0, 1e-12);
  part.last = 14;
  EXPECT_THAT(error_of([&] { open_sequence((folder / "drop.%04d.vdb").string(), part); }),
              HasSubstr("present: 8 to 11"));

  write("sphere.vdb", {sphere()});
  const auto plain = open_sequence((folder / "sphere.vdb").string(), {});
  EXPECT_EQ(plain->first_frame(), 1);
  EXPECT_EQ(plain->name(), "sphere");
}

TEST_F(Sequence, MissingFramesAndMixedFilesAreNamed) {
  const auto open_error = [&](const std::string& input) {
    return error_of([&] { open_sequence((folder / input).string(), {}); });
  };
  EXPECT_THAT(open_error(""), HasSubstr("no .vdb files in this folder"));
  EXPECT_THAT(open_error("drop.%04d.vdb"), HasSubstr("no file matches the pattern"));
  EXPECT_THAT(open_error("drop.*.vdb"), HasSubstr("no file matches the glob"));
  EXPECT_THAT(open_error("drop.%04x.vdb"), HasSubstr("expected one frame number like %04d"));
  EXPECT_THAT(open_error("%d.%d.vdb"), HasSubstr("expected one frame number like %04d"));
  EXPECT_THAT(open_error("nowhere/drop.%d.vdb"), HasSubstr("there is no folder"));
  for (const int frame : {1, 2, 4}) write(fmt::format("drop.{:04}.vdb", frame), {sphere()});
  EXPECT_THAT(open_error(""), HasSubstr("frame 3 is missing, expected next to drop.0002.vdb"));
  write("drop.0003.vdb", {sphere()});
  write("drop.3.vdb", {sphere()});
  EXPECT_THAT(open_error(""), HasSubstr("two files for frame 3"));
  EXPECT_EQ(open_sequence((folder / "drop.%04d.vdb").string(), {})->last_frame(), 4);
  fs::remove(folder / "drop.3.vdb");
  write("rain.0001.vdb", {sphere()});
  EXPECT_THAT(open_error(""), HasSubstr("several sequences (drop and rain)"));
}

TEST_F(Sequence, ABrokenFrameFailsWhenItIsLoadedAndNotBefore) {
  for (int frame = 1; frame <= 4; ++frame) write(fmt::format("drop.{:04}.vdb", frame), {sphere()});
  std::ofstream(folder / "drop.0003.vdb") << "broken";
  const auto source = open_sequence(folder.string(), {});
  EXPECT_NE(source->load(1).field, nullptr);
  EXPECT_NE(source->load(2).field, nullptr);
  EXPECT_THAT(error_of([&] { source->load(3); }), HasSubstr("drop.0003.vdb: not a whole OpenVDB file"));
  EXPECT_NE(source->load(4).field, nullptr);
}

TEST_F(Sequence, InfoListsGrids) {
  auto vectors = openvdb::Vec3SGrid::create();
  vectors->setName("vel");
  vectors->tree().setValue(Coord(1, 2, 3), openvdb::Vec3s(1.0f));
  const auto infos = grid_info(write("two.vdb", {sphere(), vectors}));
  ASSERT_EQ(infos.size(), 2u);
  EXPECT_EQ(infos[0].name, "surface");
  EXPECT_EQ(infos[0].type, "float");
  EXPECT_EQ(infos[0].grid_class, "level set");
  EXPECT_DOUBLE_EQ(infos[0].voxel_size, 0.125);
  EXPECT_GT(infos[0].active_voxels, 1000u);
  EXPECT_EQ(infos[1].active_voxels, 1u);
  EXPECT_EQ(infos[1].low, IVec3(1, 2, 3));
  EXPECT_EQ(infos[1].high, IVec3(1, 2, 3));
}

TEST(Prefetch, LoadsInTheOrderOfNeedAndNoFurther) {
  std::mutex mutex;
  std::vector<int> order;
  std::atomic<int> loaded{0};
  Prefetch prefetch(
      [&](int frame) {
        const std::lock_guard lock(mutex);
        order.push_back(frame);
        ++loaded;
        FieldFrame result;
        result.frame = frame;
        return result;
      },
      9, 2);
  EXPECT_EQ(prefetch.get(1).frame, 1);
  while (loaded < 3) std::this_thread::yield();
  EXPECT_EQ(prefetch.get(2).frame, 2);
  EXPECT_EQ(prefetch.get(2).frame, 2);  // still there
  while (loaded < 4) std::this_thread::yield();
  EXPECT_EQ(prefetch.get(8).frame, 8);  // a jump drops the others
  while (loaded < 6) std::this_thread::yield();
  std::this_thread::sleep_for(std::chrono::milliseconds(20));
  const std::lock_guard lock(mutex);
  EXPECT_EQ(order, (std::vector<int>{1, 2, 3, 4, 8, 9}));
}

TEST(Prefetch, ErrorsBelongToTheirFrame) {
  Prefetch prefetch(
      [](int frame) {
        if (frame == 2) throw InputError("two");
        FieldFrame result;
        result.frame = frame;
        return result;
      },
      5, 3);
  EXPECT_EQ(prefetch.get(1).frame, 1);
  EXPECT_THROW(prefetch.get(2), InputError);
  EXPECT_THROW(prefetch.get(2), InputError);
  EXPECT_EQ(prefetch.get(3).frame, 3);
}

TEST(FrameFiles, NumbersAndNames) {
  std::string stem;
  EXPECT_EQ(frame_number("a/dam_break.0042.vdb", &stem), 42);
  EXPECT_EQ(stem, "dam_break");
  EXPECT_EQ(frame_number("smoke_7.vdb", &stem), 7);
  EXPECT_EQ(stem, "smoke");
  EXPECT_EQ(frame_number("sphere.vdb", &stem), -1);
  EXPECT_EQ(stem, "sphere");
  EXPECT_EQ(frame_number("0003.vdb", &stem), 3);
  EXPECT_EQ(stem, "");
}

}  // namespace
}  // namespace isoskin
