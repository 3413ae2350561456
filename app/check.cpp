// isoskin check: are meshes on disk whole, closed and manifold, and do they have the field's sides and topology?
#include <algorithm>

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include "app/command.h"
#include "app/options.h"
#include "app/run_folder.h"
#include "core/mesh/validate.h"
#include "core/topology/certificate.h"

namespace isoskin {
namespace {

namespace fs = std::filesystem;

struct CheckCommand {
  std::vector<std::string> files;  // or folders of a tracked sequence
  InputOptions field;
  BackendOptions backend;
  std::optional<int> frame;
  std::optional<double> edge_length;
  bool json = false;
};

struct Verdict {
  std::string file;
  std::size_t triangles = 0, pieces = 0;
  ShapeStatistics shape;
  std::string fault;        // empty: closed, oriented 2-manifold
  std::string certificate;  // empty: not asked for
  bool certified = true;

  bool ok() const { return fault.empty() && certified; }
};

std::vector<fs::path> mesh_files(const std::vector<std::string>& names) {
  std::vector<fs::path> files;
  for (const std::string& name : names) {
    if (!fs::is_directory(name)) {
      files.emplace_back(name);
      continue;
    }
    const std::size_t before = files.size();
    for (const auto& entry : fs::directory_iterator(name))
      if (entry.path().extension() == ".ply") files.push_back(entry.path());
    if (files.size() == before) throw InputError(fmt::format("{}: no .ply file; expected meshes to check", name));
    std::sort(files.begin() + std::ptrdiff_t(before), files.end());
  }
  return files;
}

/// The field of one frame with its lattice, kept for all meshes of that frame.
class Certifier {
public:
  /// Lengths are those of a run that began with the field's first frame and wrote `file`.
  Certifier(const CheckCommand& command, const fs::path& file)
      : command_(command), scene_(open_frames(command.field)), backend_(make_backend(command.backend)) {
    frame_ = scene_.source->load(scene_.source->first_frame());
    options_.edge_length = edge_length(file);
    options_ = resolved(options_, *frame_.field);
    sample();
  }

  int frame_of(const fs::path& file, const PlyHeader& header) const {
    const int first = scene_.source->first_frame(), last = scene_.source->last_frame();
    const int frame = first == last ? first : command_.frame.value_or(header.frame);
    if (frame < first || frame > last)
      throw InputError(
          fmt::format("{}: frame {}; expected --frame within the field's {}:{}", file.string(), frame, first, last));
    return frame;
  }

  Certificate certify(const fs::path& file, const PlyMesh& ply) {
    load(frame_of(file, ply.header));
    CertifyOptions options;
    options.tolerance = options_.tolerance;
    return isoskin::certify(ply.mesh, mesh_pieces(ply.mesh), *frame_.field, lattice_, topology_, options);
  }

private:
  const CheckCommand& command_;
  Scene scene_;
  std::unique_ptr<Backend> backend_;
  FieldFrame frame_;
  TrackOptions options_;
  BrickLattice lattice_;
  LatticeTopology topology_;

  /// It decides how finely a skeleton field is sampled: the run's own where its folder is known.
  double edge_length(const fs::path& file) const {
    if (command_.edge_length) return *command_.edge_length;
    const fs::path folder = fs::absolute(file).parent_path();
    if (fs::exists(folder / "run.json")) return read_run(folder).options.value("edge-length", 0.0);
    return scene_.meshing.edge_length.value_or(0.0);
  }

  void load(int frame) {
    if (frame_.frame == frame) return;
    if (frame < frame_.frame) scene_ = open_frames(command_.field);  // sources only go forward
    frame_ = scene_.source->load(frame);
    sample();
  }

  void sample() {
    backend_->set_field(frame_.field);
    lattice_ = sample_lattice(*frame_.field, *backend_, options_.lattice_spacing);
    topology_ = lattice_topology(lattice_);
  }
};

Verdict judge(const fs::path& file, Certifier* certifier) {
  const PlyMesh ply = read_ply(file);
  Verdict verdict;
  verdict.file = file.string();
  verdict.triangles = ply.mesh.triangle_count();
  verdict.fault = ply.closed ? validate(ply.mesh).reason : ply.open_reason;
  if (!verdict.fault.empty()) return verdict;
  verdict.pieces = mesh_pieces(ply.mesh).count();
  verdict.shape = shape_statistics(ply.mesh);
  if (certifier) {
    const Certificate certificate = certifier->certify(file, ply);
    verdict.certified = certificate.passed;
    verdict.certificate = certificate.summary();
  }
  return verdict;
}

void print(const Verdict& v, bool json) {
  if (json) {
    Json line = {{"file", v.file}, {"ok", v.ok()}, {"triangles", v.triangles}, {"pieces", v.pieces}};
    line["angles"] = {{"min", v.shape.min_angle}, {"p1", v.shape.p1_angle}, {"mean", v.shape.mean_angle}};
    line["fault"] = v.fault;
    if (!v.certificate.empty()) line["certified"] = v.certified, line["certificate"] = v.certificate;
    fmt::print("{}\n", line.dump());
  } else if (!v.fault.empty()) {
    fmt::print("{}: BAD: {}\n", v.file, v.fault);
  } else {
    fmt::print("{}: {}closed manifold, {} triangles, {} pieces, smallest angles min {:.1f} mean {:.1f}{}{}\n", v.file,
               v.ok() ? "" : "BAD: ", v.triangles, v.pieces, v.shape.min_angle, v.shape.mean_angle,
               v.certificate.empty() ? "" : "; certificate: ", v.certificate);
  }
}

int run(const CheckCommand& command) {
  const auto threads = limit_threads(command.backend.threads);
  const std::vector<fs::path> files = mesh_files(command.files);
  std::unique_ptr<Certifier> certifier;
  if (!command.field.input.empty()) certifier = std::make_unique<Certifier>(command, files.front());
  bool all_ok = true;
  for (const fs::path& file : files) {
    const Verdict verdict = judge(file, certifier.get());
    print(verdict, command.json);
    all_ok = all_ok && verdict.ok();
  }
  return all_ok ? kOk : kNo;
}

}  // namespace

void add_check(CLI::App& app, Action& action) {
  CLI::App* command =
      app.add_subcommand("check", "Checks meshes on disk: closed, manifold, and certified by the field");
  const auto o = std::make_shared<CheckCommand>();
  command->add_option("files", o->files, "PLY files, or folders of them")->required();
  command->add_option("--field", o->field.input, "What was tracked: compare sides and topology with it");
  command->add_option("--frame", o->frame, "Frame of the field (default: the one the file names)");
  command->add_option("--edge-length", o->edge_length, "As for track; decides how finely a skeleton field is sampled");
  add_input_options(*command, o->field);
  add_backend_options(*command, o->backend);
  command->add_flag("--json", o->json, "A line of JSON for each file");
  command->footer("Example:\n  isoskin check out/*.ply --field 'dam_break/dam_break.%04d.vdb'");
  command->callback([o, &action] { action = [o] { return run(*o); }; });
}

}  // namespace isoskin
