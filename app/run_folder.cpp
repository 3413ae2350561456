#include "app/run_folder.h"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <chrono>
#include <cstring>
#include <fstream>

#include <fmt/format.h>

#include "core/trace.h"

namespace isoskin {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kMostBytesBehind = std::size_t{1} << 28;  // of a frame that is written while the next is made

Json read_json(const fs::path& path) {
  std::ifstream file(path);
  return Json::parse(file, nullptr, false);
}

/// NAME.mechanical.0001.ply or NAME.geometric.0001.ply
bool is_mesh_file(const std::string& file, const std::string& name) {
  for (const char* kind : {".mechanical.", ".geometric."}) {
    const std::string start = name + kind;
    if (!file.starts_with(start) || !file.ends_with(".ply")) continue;
    const std::string number = file.substr(start.size(), file.size() - start.size() - 4);
    return !number.empty() && number.find_first_not_of("-0123456789") == std::string::npos;
  }
  return false;
}

/// What write_file_atomically leaves when it is killed in mid-write; the folder's lock says that nobody is writing.
bool is_temporary(const std::string& file) {
  return file.starts_with(".isoskin-") && file.ends_with(".tmp");
}

bool is_whole(const fs::path& path) {
  try {
    return read_ply(path).closed || fs::file_size(path) > 0;
  } catch (const InputError&) {
    return false;
  }
}

void remove_files(const fs::path& folder, const std::function<bool(const std::string&)>& wanted) {
  std::error_code ignored;
  std::vector<fs::path> files;
  for (const auto& entry : fs::directory_iterator(folder, ignored))
    if (wanted(entry.path().filename().string())) files.push_back(entry.path());
  for (const fs::path& file : files) fs::remove(file, ignored);
}

void write_lines(const fs::path& path, const std::vector<Json>& lines) {
  std::string text;
  for (const Json& line : lines) text += line.dump() + '\n';
  write_file_atomically(path, text);
}

}  // namespace

fs::path mesh_path(const fs::path& folder, const std::string& name, const std::string& kind, int frame) {
  return folder / fmt::format("{}.{}.{:04}.ply", name, kind, frame);
}

RunFolder::RunFolder(fs::path folder, std::string name, OutputKinds kinds, Json options)
    : folder_(std::move(folder)), name_(std::move(name)), kinds_(kinds), options_(std::move(options)) {
  std::error_code error;
  made_folder_ = fs::create_directories(folder_, error);
  if (error || !fs::is_directory(folder_))
    throw InputError(fmt::format("{}: {}; expected a folder that can be written", folder_.string(),
                                 error ? error.message() : "not a folder"));
  lock_ = open(folder_.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (lock_ >= 0 && flock(lock_, LOCK_EX | LOCK_NB) != 0) {
    close(lock_);
    throw InputError(fmt::format("{}: another run is writing here; expected a folder of its own", folder_.string()));
  }
  if (lock_ < 0 || access(folder_.c_str(), W_OK | X_OK) != 0) {
    const std::string reason = std::strerror(errno);
    if (lock_ >= 0) close(lock_);
    throw InputError(fmt::format("{}: {}; expected a folder that can be written", folder_.string(), reason));
  }
}

RunFolder::~RunFolder() {
  if (writing_.valid()) writing_.wait();
  report_.reset();
  ledger_.reset();
  if (!frame_complete_) {
    if (started_) remove_output(name_);
    std::error_code ignored;
    if (made_folder_) fs::remove(folder_, ignored);  // only when empty
  }
  close(lock_);
}

void RunFolder::remove_output(const std::string& name) const {
  remove_files(folder_, [&](const std::string& f) { return is_temporary(f) || is_mesh_file(f, name); });
  // run.json goes last: until then the folder is known as a run's.
  std::error_code ignored;
  for (const fs::path& path : {report_path(), ledger_path(), options_path()}) fs::remove(path, ignored);
}

void RunFolder::open_lines() {
  ledger_ = std::make_unique<JsonLines>(ledger_path());
  report_ = std::make_unique<JsonLines>(report_path());
}

void RunFolder::start() {
  const Json earlier = read_json(options_path());
  if (earlier.is_object() && earlier.contains("name")) remove_output(earlier["name"].get<std::string>());
  started_ = true;
  remove_output(name_);
  write_file_atomically(options_path(), options_.dump(2) + '\n');
  open_lines();
}

void RunFolder::require_same_options() const {
  const Json earlier = read_json(options_path());
  if (!earlier.is_object())
    throw InputError(fmt::format("{}: not readable; expected a run's options", options_path().string()));
  for (const auto& [key, value] : options_.items())
    if (!earlier.contains(key) || earlier[key] != value)
      throw InputError(fmt::format("{}: --resume with {} {}; expected {} as the run began", folder_.string(), key,
                                   value.dump(), earlier.value(key, Json()).dump()));
}

bool RunFolder::has_meshes(int frame) const {
  return (!kinds_.mechanical || fs::exists(mechanical_path(frame))) &&
         (!kinds_.geometric || fs::exists(geometric_path(frame)));
}

std::optional<int> RunFolder::resume(int first, int last) {
  if (!fs::exists(options_path())) {
    start();
    return std::nullopt;
  }
  require_same_options();
  started_ = true;
  remove_files(folder_, is_temporary);
  std::vector<Json> report = read_json_lines(report_path());
  std::size_t complete = 0;
  while (complete < report.size() && first + int(complete) <= last &&
         report[complete].value("frame", first - 1) == first + int(complete) && has_meshes(first + int(complete)))
    ++complete;
  // Only the last frames can have been touched when the machine, not just the run, went down.
  while (complete > 0 && !(is_whole(mechanical_path(first + int(complete) - 1)) &&
                           (!kinds_.geometric || is_whole(geometric_path(first + int(complete) - 1)))))
    --complete;
  if (complete == 0) {
    start();
    return std::nullopt;
  }
  frame_complete_ = true;
  const int done = first + int(complete) - 1;
  report.resize(complete);
  write_lines(report_path(), report);
  std::vector<Json> ledger = read_json_lines(ledger_path());
  std::erase_if(ledger, [&](const Json& line) { return line.value("frame", last + 1) > done; });
  write_lines(ledger_path(), ledger);
  open_lines();
  return done;
}

void RunFolder::write_frame(const FieldFrame& frame, FrameReport report, const Tracker& tracker, double ms_before,
                            std::function<void(const Json&)> written) {
  const Span span("write");
  const auto begin = std::chrono::steady_clock::now();
  struct File {
    fs::path path;
    std::vector<char> bytes;
  };
  std::vector<File> files;
  if (kinds_.mechanical)
    files.push_back({mechanical_path(frame.frame), ply_bytes(tracker.mechanical(), tracker.mechanical_normals(),
                                                             {frame.frame, frame.time, tracker.critical_points()})});
  if (kinds_.geometric)
    files.push_back({geometric_path(frame.frame),
                     ply_bytes(tracker.geometric().mesh, tracker.geometric().normal, {frame.frame, frame.time, {}})});
  std::vector<Json> ledger;
  for (const LedgerEntry& entry : tracker.ledger()) ledger.push_back(to_json(entry));
  finish();
  std::size_t bytes = 0;
  for (const File& file : files) bytes += file.bytes.size();
  const double ms = std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - begin).count();
  report.ms.emplace_back("write", ms);
  report.ms.emplace_back("total", ms_before + ms);
  Json line = to_json(report, frame.field->bounds());
  writing_ = std::async(std::launch::async, [this, files = std::move(files), ledger = std::move(ledger),
                                             line = std::move(line), written = std::move(written)]() mutable {
    for (File& file : files) {
      write_file_atomically(file.path, file.bytes);
      file.bytes = {};  // a future keeps what its task holds
    }
    ledger_->append(ledger);
    report_->append({line});
    frame_complete_ = true;
    written(line);
  });
  if (bytes > kMostBytesBehind) finish();
}

void RunFolder::finish() {
  if (writing_.valid()) writing_.get();
}

RunSummary read_run(const fs::path& folder) {
  RunSummary run{read_json(folder / "run.json"), read_json_lines(folder / "report.jsonl"),
                 read_json_lines(folder / "ledger.jsonl")};
  if (!run.options.is_object())
    throw InputError(fmt::format("{}: no run.json; expected a folder that `isoskin track` wrote", folder.string()));
  return run;
}

}  // namespace isoskin
