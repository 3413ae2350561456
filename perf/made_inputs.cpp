#include "perf/made_inputs.h"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <functional>
#include <stdexcept>

#include <fmt/format.h>
#include <openvdb/openvdb.h>
#include <openvdb/tools/Composite.h>
#include <openvdb/tools/LevelSetSphere.h>
#include <openvdb/tools/SignedFloodFill.h>

namespace isoskin::perf {
namespace {

using openvdb::FloatGrid;
using openvdb::Vec3d;

constexpr double kBand = 3.0;  // voxels, half the width of the narrow band

/// Frames 1 .. count of one level set each, in voxels.
std::string write_frames(const std::string& name, const std::filesystem::path& folder, int count,
                         const std::function<FloatGrid::Ptr(int)>& grid_of) {
  for (int frame = 1; frame <= count; ++frame) {
    const FloatGrid::Ptr grid = grid_of(frame);
    grid->setName("surface");
    openvdb::io::File file((folder / fmt::format("{}.{:04d}.vdb", name, frame)).string());
    file.write({grid});
  }
  return (folder / (name + ".%04d.vdb")).string();
}

FloatGrid::Ptr sphere(double radius, const Vec3d& centre) {
  return openvdb::tools::createLevelSetSphere<FloatGrid>(float(radius), openvdb::Vec3f(centre), 1.0f, float(kBand));
}

/// A small ball sunk by half its width in a large one, `turn` radians along the equator.
FloatGrid::Ptr ball_on_ball(double turn, const Vec3d& centre) {
  constexpr double kLarge = 100.0, kSmall = 12.0;
  const FloatGrid::Ptr large = sphere(kLarge, centre);
  openvdb::tools::csgUnion(*large, *sphere(kSmall, centre + kLarge * Vec3d(std::cos(turn), std::sin(turn), 0.0)));
  return large;
}

/// About the z axis, `outer` voxels from end to end of x.
FloatGrid::Ptr ring(double outer, double tube, const Vec3d& centre) {
  const FloatGrid::Ptr grid = FloatGrid::create(float(kBand));
  grid->setGridClass(openvdb::GRID_LEVEL_SET);
  grid->setTransform(openvdb::math::Transform::createLinearTransform(1.0));
  FloatGrid::Accessor at = grid->getAccessor();
  const double middle = 0.5 * outer - tube;
  const int reach = int(0.5 * outer + kBand + 2.0), height = int(tube + kBand + 2.0);
  for (int x = -reach; x <= reach; ++x)
    for (int y = -reach; y <= reach; ++y) {
      const double from_circle = std::hypot(x - centre.x(), y - centre.y()) - middle;
      if (std::abs(from_circle) > tube + kBand) continue;
      for (int z = -height; z <= height; ++z) {
        const double distance = std::hypot(from_circle, z - centre.z()) - tube;
        if (std::abs(distance) < kBand) at.setValue({x, y, z}, float(distance));
      }
    }
  openvdb::tools::signedFloodFill(grid->tree());
  return grid;
}

std::string write_metaballs(const std::filesystem::path& folder, int count) {
  constexpr int kAcross = 20, kLayers = 5;  // half of them in every other row are moved aside
  constexpr double kApart = 0.6, kRadius = 0.7;
  const std::filesystem::path path = folder / "metaballs1000.toml";
  std::ofstream out(path);
  out << fmt::format("frames = [1, {}]\ndt = 0.04\niso = 0.2\n", count)
      << "[meshing]\nedge_length = 0.12\nsagitta = 0.0\n";
  for (int i = 0; i < kAcross * kAcross / 2 * kLayers; ++i) {
    const int x = i / (kLayers * kAcross / 2), y = i / kLayers % (kAcross / 2), z = i % kLayers;
    const double px = kApart * x, py = 2.0 * kApart * y + (x % 2) * kApart, pz = kApart * z;
    out << fmt::format("[[element]]\nradius = {}\n", kRadius);
    if (i == kLayers * (kAcross / 4))
      out << fmt::format(
          "keys = [{{ frame = 1, position = [{}, {}, {}] }}, {{ frame = {}, position = [{}, {}, {}] }}]\n", px, py, pz,
          std::max(2, count), px - kApart, py, pz);
    else
      out << fmt::format("position = [{}, {}, {}]\n", px, py, pz);
  }
  return path.string();
}

}  // namespace

const std::vector<std::string>& made_inputs() {
  static const std::vector<std::string> names{"still", "moving", "wide", "wide2048", "wide4096", "metaballs1000"};
  return names;
}

std::string make_input(const std::string& name, const std::filesystem::path& folder, int frames) {
  constexpr double kTurn = 0.005, kStep = 0.33;  // radians and voxels a frame: the ball rolls by half a voxel
  const Vec3d step(0.7 * kStep, 0.5 * kStep, 0.5 * kStep);
  const int count = frames + 1;
  if (name == "still")
    return write_frames(name, folder, count, [&](int frame) { return ball_on_ball(kTurn * frame, Vec3d(0.0)); });
  if (name == "moving")
    return write_frames(name, folder, count, [&](int frame) { return ball_on_ball(kTurn * frame, frame * step); });
  struct Ring {
    const char* name;
    double outer, tube;
  };
  for (const Ring& wide : {Ring{"wide", 1024.0, 12.0}, {"wide2048", 2048.0, 25.0}, {"wide4096", 4096.0, 125.0}})
    if (name == wide.name)
      return write_frames(name, folder, count, [&](int frame) { return ring(wide.outer, wide.tube, frame * step); });
  if (name == "metaballs1000") return write_metaballs(folder, count);
  throw std::invalid_argument("no such input: " + name);
}

}  // namespace isoskin::perf
