// isoskin info: what is in a file.
#include <algorithm>

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include "app/command.h"
#include "app/options.h"
#include "app/run_folder.h"
#include "core/mesh/validate.h"
#include "render/image.h"

namespace isoskin {
namespace {

namespace fs = std::filesystem;

std::string text(const DVec3& v) {
  return fmt::format("({:.6g}, {:.6g}, {:.6g})", v.x, v.y, v.z);
}

void print_grids(const std::string& file) {
  for (const GridInfo& g : grid_info(file))
    fmt::print("grid {}: {}, {}, voxel {:.6g}, {} active voxels, index ({}, {}, {}) .. ({}, {}, {})\n", g.name, g.type,
               g.grid_class, g.voxel_size, g.active_voxels, g.low.x, g.low.y, g.low.z, g.high.x, g.high.y, g.high.z);
}

void print_source(const std::string& input) {
  InputOptions options;
  options.input = input;
  const Scene scene = open_frames(options);
  FieldSource& source = *scene.source;
  const FieldFrame frame = source.load(source.first_frame());
  const Box box = frame.field->bounds();
  fmt::print("{}: frames {}:{}, {:.6g} s each\n", source.name(), source.first_frame(), source.last_frame(),
             source.frame_duration());
  if (box.empty())
    fmt::print("frame {}: no surface\n", frame.frame);
  else
    fmt::print("frame {}: surface within {} .. {}, diagonal {:.6g}\n", frame.frame, text(box.low), text(box.high),
               box.diagonal());
}

void print_mesh(const std::string& file) {
  const PlyMesh ply = read_ply(file);
  const TriangleMesh& mesh = ply.mesh;
  fmt::print("frame {}, time {:.6g} s\n{} vertices, {} triangles\n", ply.header.frame, ply.header.time,
             mesh.vertex_count(), mesh.triangle_count());
  const std::string fault = ply.closed ? validate(mesh).reason : ply.open_reason;
  if (!fault.empty()) {
    fmt::print("not a closed manifold: {}\n", fault);
    return;
  }
  const MeshPieces pieces = mesh_pieces(mesh);
  const ShapeStatistics shape = shape_statistics(mesh);
  int euler = 0;
  double volume = 0.0;
  for (std::size_t p = 0; p < pieces.count(); ++p) euler += pieces.euler[p], volume += pieces.volume[p];
  fmt::print("closed manifold, {} pieces, Euler characteristic {}, volume {:.6g}, area {:.6g}\n", pieces.count(), euler,
             volume, shape.area);
  fmt::print("mean edge {:.6g}; smallest angle of a triangle: min {:.1f}, 1st percentile {:.1f}, mean {:.1f} degrees\n",
             shape.mean_edge, shape.min_angle, shape.p1_angle, shape.mean_angle);
}

void print_image(const std::string& file) {
  const Image image = load_exr(file);
  fmt::print("{} x {} pixels\n", image.width, image.height);
  for (const auto& [channel, values] : image.channel) {
    std::vector<float> finite;
    std::copy_if(values.begin(), values.end(), std::back_inserter(finite), [](float v) { return std::isfinite(v); });
    const auto [low, high] = std::minmax_element(finite.begin(), finite.end());
    if (finite.empty())
      fmt::print("channel {}: nothing finite\n", channel);
    else
      fmt::print("channel {}: {:.6g} .. {:.6g}, {} of {} finite\n", channel, *low, *high, finite.size(), values.size());
  }
}

void print_run(const std::string& folder) {
  const RunSummary run = read_run(folder);
  fmt::print("{} {}: {}\n", run.options.value("program", ""), run.options.value("version", ""),
             run.options.value("input", ""));
  for (const auto& [key, value] : run.options.items())
    if (key != "program" && key != "version" && key != "input") fmt::print("  {} {}\n", key, value.dump());
  const Json frames = run.options.value("frames", Json::array({0, -1}));
  double ms = 0.0, survived = 0.0;
  std::size_t certified = 0, peak = 0;
  for (const Json& line : run.report) {
    ms += line.value("ms", Json::object()).value("total", 0.0);
    survived += line.value("survived", 0.0);
    certified += line.value("certified", false);
    peak = std::max(peak, line.value("peak_bytes", std::size_t(0)));
  }
  const double n = std::max<double>(1.0, double(run.report.size()));
  fmt::print("{} of {} frames done, {} certified, {} ledger entries\n", run.report.size(),
             frames[1].get<int>() - frames[0].get<int>() + 1, certified, run.ledger.size());
  fmt::print("a frame: {:.0f} ms, {:.1f}% of vertices survive; peak memory {:.2f} GiB\n", ms / n, 100.0 * survived / n,
             double(peak) / double(1u << 30));
}

int run(const std::string& file) {
  const std::string extension = fs::path(file).extension().string();
  if (fs::exists(fs::path(file) / "run.json"))
    print_run(file);
  else if (extension == ".ply")
    print_mesh(file);
  else if (extension == ".exr")
    print_image(file);
  else if (extension == ".vdb" && fs::exists(file))
    print_grids(file);
  else
    print_source(file);
  return kOk;
}

}  // namespace

void add_info(CLI::App& app, Action& action) {
  CLI::App* command = app.add_subcommand("info", "Says what is in a grid, scene, mesh, image or output folder");
  const auto file = std::make_shared<std::string>();
  command->add_option("file", *file, "A .vdb, .toml, .ply or .exr file, a sequence, or a folder that `track` wrote")
      ->required();
  command->footer("Example:\n  isoskin info dam_break/dam_break.0001.vdb\n  isoskin info out");
  command->callback([file, &action] { action = [file] { return run(*file); }; });
}

}  // namespace isoskin
