#include "app/options.h"

#include <charconv>
#include <cmath>
#include <cstdlib>

#include <fmt/format.h>
#include <tbb/global_control.h>
#include <CLI/CLI.hpp>

namespace isoskin {
namespace {

constexpr int kMostThreads = 1024;
constexpr int kMostSmoothing = 1000;
constexpr double kLongestFrame = 1e6;  // seconds

std::optional<int> parse_int(std::string_view text) {
  int value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  return error == std::errc() && end == text.data() + text.size() ? std::optional(value) : std::nullopt;
}

}  // namespace

void require_range(const char* what, double value, double low, double high) {
  if (!(value >= low && value <= high))
    throw InputError(fmt::format("{} {}: expected a number from {} to {}", what, value, low, high));
}

void add_input_options(CLI::App& command, InputOptions& options) {
  command.add_option("--grid", options.grid, "Name of the grid to read (default: the first scalar grid)");
  command.add_option("--iso", options.iso, "Iso value in the grid's own values (default: 0, or 0.5 for fog)");
  command.add_option("--interpolation", options.interpolation, "Between voxels")
      ->check(CLI::IsMember({"linear", "cubic"}))
      ->capture_default_str();
  command.add_option("--smooth", options.smooth, "Iterations of OpenVDB's level-set filter on load (default: 0)");
  command.add_option("--velocity", options.velocity, "Name of a velocity grid, used to predict motion");
  command.add_option("--dt", options.dt, "Seconds from a frame to the next (default: the input's own, or 1/24)");
}

FrameRange parse_frame_range(const std::string& text) {
  FrameRange range;
  const std::size_t colon = text.find(':');
  const std::string first = text.substr(0, colon);
  const std::string last = colon == std::string::npos ? first : text.substr(colon + 1);
  range.first = parse_int(first);
  range.last = parse_int(last);
  const bool readable = (range.first || first.empty()) && (range.last || last.empty()) && text != "";
  if (!readable || (range.first && range.last && *range.first > *range.last))
    throw InputError(fmt::format("--frames '{}': expected A:B with A <= B, for instance 1:24", text));
  return range;
}

Scene open_frames(const InputOptions& options, const FrameRange& range) {
  SequenceOptions sequence;
  sequence.grid.grid = options.grid;
  if (options.iso) {
    if (!std::isfinite(*options.iso)) throw InputError(fmt::format("--iso {}: expected a finite number", *options.iso));
    sequence.grid.iso = *options.iso;
    sequence.grid.iso_given = true;
  }
  sequence.grid.interpolation = options.interpolation == "linear" ? Interpolation::linear : Interpolation::cubic;
  if (options.smooth) require_range("--smooth", *options.smooth, 0, kMostSmoothing);
  sequence.grid.smooth = options.smooth.value_or(0);
  sequence.grid.velocity = options.velocity;
  if (options.dt) {
    require_range("--dt", *options.dt, 1.0 / kLongestFrame, kLongestFrame);
    sequence.dt = *options.dt;
  }
  sequence.first = range.first;
  sequence.last = range.last;
  Scene scene = open_input(options.input, sequence);
  const int first = scene.source->first_frame(), last = scene.source->last_frame();
  if (range.first.value_or(first) < first || range.last.value_or(last) > last || range.first.value_or(first) > last ||
      range.last.value_or(last) < first)
    throw InputError(fmt::format("{}: has frames {}:{}; expected --frames within them", options.input, first, last));
  return scene;
}

void add_backend_options(CLI::App& command, BackendOptions& options) {
  command.add_option("--backend", options.backend, "Where data-parallel steps run")
      ->check(CLI::IsMember({"opencl", "reference"}))
      ->capture_default_str();
  command.add_option("--device", options.device,
                     "Index in `isoskin devices`, or 'reference' (default: the first GPU, else the first device)");
  command.add_option("--threads", options.threads, "Threads to use; the result does not depend on it (default: all)");
}

std::optional<OpenClOptions> opencl_options(const BackendOptions& options) {
  if (options.backend == "reference" || options.device == "reference") return std::nullopt;
  OpenClOptions opencl;
  if (!options.device.empty()) {
    const std::optional<int> index = parse_int(options.device);
    if (!index || *index < 0)
      throw InputError(
          fmt::format("--device '{}': expected an index from `isoskin devices`, or reference", options.device));
    opencl.device = *index;
  }
  return opencl;
}

std::unique_ptr<Backend> make_backend(const BackendOptions& options, bool trace) {
  std::optional<OpenClOptions> opencl = opencl_options(options);
  if (!opencl) return make_reference_backend();
  opencl->trace = trace;
  return make_opencl_backend(*opencl);
}

std::shared_ptr<void> limit_threads(int threads) {
  if (threads == 0) return nullptr;
  require_range("--threads", threads, 1, kMostThreads);
  const std::string count = std::to_string(threads);
  for (const char* variable : {"POCL_MAX_PTHREAD_COUNT", "POCL_CPU_MAX_CU_COUNT"})  // up to PoCL 3.1 / from PoCL 4
    setenv(variable, count.c_str(), 1);
  return std::make_shared<tbb::global_control>(tbb::global_control::max_allowed_parallelism, std::size_t(threads));
}

}  // namespace isoskin
