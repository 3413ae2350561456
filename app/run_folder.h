// The folder of a tracked sequence: which files, in which order, and what a run killed at any moment left (design 10).
//   run.json                    the options that decide the result
//   NAME.mechanical.0001.ply    NAME.geometric.0001.ply
//   ledger.jsonl report.jsonl   a line an event, a line a frame
// A frame counts once its report line is whole; that line is written last, after both meshes and the ledger.
#pragma once

#include <filesystem>
#include <functional>
#include <future>
#include <memory>
#include <optional>
#include <string>

#include "app/json_lines.h"
#include "core/io/ply.h"
#include "core/tracker.h"

namespace isoskin {

/// Which meshes of a frame are written.
struct OutputKinds {
  bool mechanical = true;
  bool geometric = true;
};

/// FOLDER/NAME.KIND.0001.ply
std::filesystem::path mesh_path(const std::filesystem::path& folder, const std::string& name, const std::string& kind,
                                int frame);

class RunFolder {
public:
  /// Makes the folder where needed and locks it. Throws InputError when it cannot be written or another run is in it.
  /// `name` starts the mesh files' names; `options` is what decides the result, for run.json.
  RunFolder(std::filesystem::path folder, std::string name, OutputKinds kinds, Json options);

  /// Unless a frame is complete, removes what this run made.
  ~RunFolder();
  RunFolder(const RunFolder&) = delete;
  RunFolder& operator=(const RunFolder&) = delete;

  /// Starts over: removes an earlier run's frames.
  void start();

  /// Goes on: drops what is not whole and returns the last frame f such that frames first..f are complete; starts over
  /// and returns nothing when there is none. Throws InputError when the folder's run had other options.
  std::optional<int> resume(int first, int last);

  /// Writes the meshes, then the ledger, then the report line, which it hands to `written`; all that while the caller
  /// goes on with the next frame. The line's steps end with `write`, how long the caller is held up, and `total`, that
  /// and ms_before, milliseconds the frame took so far. Throws InputError when the disk was full for this frame or the
  /// last; that frame is then not complete.
  void write_frame(const FieldFrame& frame, FrameReport report, const Tracker& tracker, double ms_before,
                   std::function<void(const Json&)> written);

  /// Waits until all is written. Throws as write_frame().
  void finish();

  std::filesystem::path mechanical_path(int frame) const { return mesh_path(folder_, name_, "mechanical", frame); }
  std::filesystem::path geometric_path(int frame) const { return mesh_path(folder_, name_, "geometric", frame); }
  std::filesystem::path report_path() const { return folder_ / "report.jsonl"; }
  std::filesystem::path ledger_path() const { return folder_ / "ledger.jsonl"; }
  std::filesystem::path options_path() const { return folder_ / "run.json"; }

private:
  std::filesystem::path folder_;
  std::string name_;
  OutputKinds kinds_;
  Json options_;
  bool made_folder_ = false;
  bool started_ = false;         // this run has written to the folder
  bool frame_complete_ = false;  // something in the folder is worth keeping
  int lock_ = -1;
  std::unique_ptr<JsonLines> report_, ledger_;
  std::future<void> writing_;  // the last frame

  bool has_meshes(int frame) const;
  void require_same_options() const;
  void remove_output(const std::string& name) const;
  void open_lines();
};

/// `isoskin track` output folders: the run's options, its report lines. Throws InputError when there is no run in it.
struct RunSummary {
  Json options;
  std::vector<Json> report;
  std::vector<Json> ledger;
};
RunSummary read_run(const std::filesystem::path& folder);

}  // namespace isoskin
