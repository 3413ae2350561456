// isoskin render: a picture of a mesh (rasterized) or of the field itself (ray traced), as EXR and PNG.
#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include "app/command.h"
#include "app/meshing.h"
#include "app/options.h"
#include "app/run_folder.h"
#include "render/rasterize.h"
#include "render/raytrace.h"
#include "render/shade.h"
#include "render/shadow.h"

namespace isoskin {
namespace {

namespace fs = std::filesystem;

constexpr int kMostAntialias = 4;
constexpr double kSeedSpacings = 60.0;  // along the field's diagonal
constexpr double kWireWidth = 0.8;      // pixels
// By how much a mesh may be off its field in depth, as `compare` judges it: of a voxel, or of the edge length.
constexpr double kVoxelTolerance = 0.25, kEdgeTolerance = 0.02;

struct RenderCommand {
  InputOptions input;
  BackendOptions backend;
  MeshingOptions meshing;
  std::string what = "mesh", mesh = "geometric", shading = "plain";
  std::string camera, save_camera, output, bounds = "bisected";
  std::optional<std::string> size;
  std::optional<double> pattern_size;
  std::optional<int> frame;
  int antialias = 1;
  bool wireframe = false, count = false;
};

/// What is to be seen, and the box that frames it. A mesh that `track` wrote is framed by the box of its field, which
/// its report holds, so the default camera is the same for a frame's meshes and its field.
struct Subject {
  Box box;
  std::shared_ptr<const Field> field;
  TriangleMesh mesh;
  std::vector<Vec3> normals;
  double unit = 0.0, depth_tolerance = 0.0;  // see Image

  void set_unit(double voxel, double edge_length) {
    unit = voxel > 0.0 ? voxel : edge_length;
    depth_tolerance = voxel > 0.0 ? kVoxelTolerance : kEdgeTolerance;
  }
};

Box box_of(const TriangleMesh& mesh) {
  Box box;
  for (const Vec3& p : mesh.vertices.position) box.add(DVec3(p));
  return box;
}

std::optional<Box> reported_box(const fs::path& folder, int frame) {
  for (const Json& line : read_json_lines(folder / "report.jsonl"))
    if (line.value("frame", frame - 1) == frame && line.value("bounds", Json()).is_array()) {
      const auto bounds = line["bounds"].get<std::array<std::array<double, 3>, 2>>();
      return Box{{bounds[0][0], bounds[0][1], bounds[0][2]}, {bounds[1][0], bounds[1][1], bounds[1][2]}};
    }
  return std::nullopt;
}

Subject mesh_file(const fs::path& file) {
  PlyMesh ply = read_ply(file);
  if (ply.mesh.empty()) throw InputError(fmt::format("{}: no triangle; expected something to see", file.string()));
  Subject subject;
  const fs::path folder = fs::absolute(file).parent_path();
  subject.box = reported_box(folder, ply.header.frame).value_or(box_of(ply.mesh));
  if (fs::exists(folder / "run.json")) {
    const Json run = read_run(folder).options;
    subject.set_unit(run.value("voxel", 0.0), run.value("edge-length", 0.0));
  } else {
    subject.set_unit(0.0, shape_statistics(ply.mesh).mean_edge);
  }
  subject.mesh = std::move(ply.mesh);
  subject.normals = std::move(ply.normals);
  return subject;
}

/// The field of a frame; its mesh as the first frame of a run would make it.
Subject field_frame(const RenderCommand& command, const InputOptions& input) {
  const Scene scene = open_frames(input, {command.frame, command.frame});
  const FieldFrame frame = scene.source->load(command.frame.value_or(scene.source->first_frame()));
  Subject subject;
  subject.field = frame.field;
  subject.box = frame.field->bounds();
  const TrackOptions options = track_options(command.meshing, scene.meshing, *frame.field);
  subject.set_unit(frame.field->resolution(), options.edge_length);
  if (command.what == "field") return subject;
  Tracker tracker(make_backend(command.backend), options);
  tracker.advance(frame);
  const bool mechanical = command.mesh == "mechanical";
  subject.mesh = mechanical ? tracker.mechanical() : tracker.geometric().mesh;
  subject.normals = mechanical ? tracker.mechanical_normals() : tracker.geometric().normal;
  return subject;
}

Subject tracked_frame(const RenderCommand& command, const fs::path& folder) {
  const Json run = read_run(folder).options;
  const int frame = command.frame.value_or(run.at("frames").at(0).get<int>());
  if (command.what == "mesh") return mesh_file(mesh_path(folder, run.at("name"), command.mesh, frame));
  RenderCommand of_field = command;
  of_field.frame = frame;
  if (!of_field.meshing.edge_length) of_field.meshing.edge_length = run.at("edge-length").get<double>();
  InputOptions input = command.input;
  input.input = run.at("input");
  input.grid = run.at("grid");
  if (!run.at("iso").is_null()) input.iso = run.at("iso").get<double>();
  input.interpolation = run.at("interpolation");
  input.smooth = run.at("smooth").get<int>();
  return field_frame(of_field, input);
}

Subject subject_of(const RenderCommand& command) {
  const fs::path input = command.input.input;
  if (fs::exists(input / "run.json")) return tracked_frame(command, input);
  if (input.extension() != ".ply") return field_frame(command, command.input);
  if (command.what == "field")
    throw InputError(
        fmt::format("{}: a mesh; expected a grid, a scene or a tracked folder to render its field", input.string()));
  return mesh_file(input);
}

std::pair<int, int> parse_size(const std::string& text) {
  int width = 0, height = 0, end = 0;
  if (std::sscanf(text.c_str(), "%5dx%5d%n", &width, &height, &end) != 2 || std::size_t(end) != text.size() ||
      width < 1 || height < 1 || width > kMaxImageSide || height > kMaxImageSide)
    throw InputError(fmt::format("--size '{}': expected WIDTHxHEIGHT, each from 1 to {}", text, kMaxImageSide));
  return {width, height};
}

Camera camera_of(const RenderCommand& command, const Box& box) {
  Camera camera;
  if (!command.camera.empty()) camera = load_camera(command.camera);
  if (command.size) std::tie(camera.width, camera.height) = parse_size(*command.size);
  if (!command.camera.empty()) return camera;
  if (box.empty()) throw InputError("no surface in this frame; expected something to see, or --camera");
  return frame_box(box, camera.width, camera.height);
}

/// The field through the camera, bounded by what the command asks for.
Raytraced traced(const RenderCommand& command, const std::shared_ptr<const Field>& field, const Camera& camera) {
  if (command.bounds == "bisected") return raytrace(*field, camera);
  if (command.bounds == "main") return raytrace(*field, main_box(*field), camera);
  const SkeletonParts parts = skeleton_parts(*field, command.input.input);
  SeedOptions options;
  options.spacing = field->bounds().diagonal() / kSeedSpacings;
  Seeds seeds(options);
  const std::unique_ptr<Backend> backend = make_reference_backend();
  backend->set_field(field);
  seeds.move_to(parts, *backend);
  return raytrace(*field, seed_boxes(*field, seeds), camera);
}

Image shaded(const RenderCommand& command, const Subject& subject, const Camera& camera,
             RaytraceReport* report = nullptr) {
  ShadeOptions options;
  if (command.shading == "checker") options.pattern = Pattern::checker;
  if (command.shading == "noise") options.pattern = Pattern::noise;
  options.pattern_size = command.pattern_size.value_or(0.0);
  Image image;
  if (command.what == "field") {
    Raytraced picture = traced(command, subject.field, camera);
    image = std::move(picture.image);
    if (report) *report = picture.report;
  } else {
    image = rasterize(subject.mesh, subject.normals, camera,
                      {.wire = command.wireframe,
                       .noise_size = options.pattern == Pattern::noise ? pattern_size(options, camera) : 0.0});
  }
  if (command.wireframe) options.wire_width = kWireWidth * command.antialias;
  if (command.what == "mesh") add_shadows(image, subject.mesh, camera);
  shade(image, camera, options);
  image.unit = float(subject.unit);
  image.depth_tolerance = float(subject.depth_tolerance);
  return image;
}

void check(const RenderCommand& command) {
  if (fs::path(command.output).extension() != ".exr")
    throw InputError(fmt::format("-o {}: expected a name that ends in .exr (a .png is put beside it)", command.output));
  if (!fs::is_directory(fs::absolute(command.output).parent_path()))
    throw InputError(fmt::format("-o {}: no such folder; expected one that exists", command.output));
  if (command.size) parse_size(*command.size);
  require_range("--antialias", command.antialias, 1, kMostAntialias);
  if (command.count && command.what != "field")
    throw InputError("--count with --what mesh: expected --what field; a mesh is not evaluated");
  if (command.wireframe && command.what == "field")
    throw InputError("--wireframe with --what field: expected --what mesh; a field has no edges");
}

int run(const RenderCommand& command) {
  check(command);
  const auto threads = limit_threads(command.backend.threads);
  const Subject subject = subject_of(command);
  const Camera camera = camera_of(command, subject.box);
  camera_rays(camera);  // throws what is wrong with it
  const std::string comment = fmt::format("isoskin {}: {} of {}", ISOSKIN_VERSION, command.what, command.input.input);
  RaytraceReport report;
  const Image image = shaded(command, subject, camera, &report);
  save_exr(command.output, image, comment);
  const fs::path preview = fs::path(command.output).replace_extension(".png");
  if (command.antialias == 1) {
    save_png(preview, image);
  } else {
    Camera finer = camera;
    finer.width *= command.antialias;
    finer.height *= command.antialias;
    save_png(preview, downsample(shaded(command, subject, finer), command.antialias));
  }
  if (!command.save_camera.empty()) save_camera(command.save_camera, camera);
  fmt::print("{}\n{}\n", command.output, preview.string());
  if (command.what == "field" && command.count)
    fmt::print("{} boxes, {} pixels hit, {} evaluations of the field, {} of its bounds, {} elements asked\n",
               report.boxes, report.hits, report.evaluations, report.bounds, report.elements);
  return kOk;
}

}  // namespace

void add_render(CLI::App& app, Action& action) {
  CLI::App* command = app.add_subcommand("render", "Renders a mesh, or the field itself as the reference");
  const auto o = std::make_shared<RenderCommand>();
  command
      ->add_option("input", o->input.input,
                   "A folder that `track` wrote, a .ply mesh, or a grid, sequence or scene.toml")
      ->required();
  command->add_option("-o,--output", o->output, "The .exr to write; a .png is put beside it")->required();
  command->add_option("--what", o->what, "Rasterize the mesh, or ray trace the field")
      ->check(CLI::IsMember({"mesh", "field"}))
      ->capture_default_str();
  command->add_option("--mesh", o->mesh, "Which mesh, where the input is not one")
      ->check(CLI::IsMember({"mechanical", "geometric"}))
      ->capture_default_str();
  command->add_option("--frame", o->frame, "Frame to render (default: the first)");
  command->add_option("--size", o->size, "WIDTHxHEIGHT in pixels (default: the camera file's, or 1024x768)");
  command->add_option("--camera", o->camera, "Camera file (default: frames the object)");
  command->add_option("--save-camera", o->save_camera, "Write the camera that was used, for --camera");
  command
      ->add_option("--shading", o->shading,
                   "Plain, or a texture that sticks to the surface: a checker, or Perlin noise")
      ->check(CLI::IsMember({"plain", "checker", "noise"}))
      ->capture_default_str();
  command
      ->add_option("--pattern-size", o->pattern_size,
                   "Side of a checker or of the coarsest noise, world units (default: 1/18 of the picture's height)")
      ->check(CLI::PositiveNumber);
  command->add_flag("--wireframe", o->wireframe, "Draw the mesh's edges");
  command->add_option("--antialias", o->antialias, "Samples of the PNG a pixel and axis")->capture_default_str();
  command
      ->add_option(
          "--bounds", o->bounds,
          "What bounds the field's rays: small boxes bisected from the field, the local boxes of the skeleton's "
          "seeds, or one box")
      ->check(CLI::IsMember({"bisected", "seeds", "main"}))
      ->capture_default_str();
  command->add_flag("--count", o->count, "Tell how often the field was evaluated");
  add_meshing_options(*command, o->meshing);
  add_input_options(*command, o->input);
  add_backend_options(*command, o->backend);
  command->footer(
      "Example:\n  isoskin render out --frame 12 --what mesh --shading checker --size 1024x768 -o mesh.exr\n"
      "  isoskin render out --frame 12 --what field --size 1024x768 -o field.exr\n"
      "  isoskin compare mesh.exr field.exr");
  command->callback([o, &action] { action = [o] { return run(*o); }; });
}

}  // namespace isoskin
