// Options that several commands share, and the checks of what was given.
#pragma once

#include <memory>
#include <optional>
#include <string>

#include "core/backend.h"
#include "core/io/scene.h"
#include "kernels/opencl_backend.h"

namespace CLI {
class App;
}

namespace isoskin {

/// What to open and how: the field's side of `track`, `render`, `check` and `info`.
struct InputOptions {
  std::string input;
  std::string grid;                     // grid name; empty: the first scalar grid
  std::optional<double> iso;            // in the grid's own values
  std::string interpolation = "cubic";  // or linear
  std::optional<int> smooth;            // level-set filter iterations on load
  std::string velocity;                 // velocity grid name
  std::optional<double> dt;             // seconds a frame
};
/// Adds all of InputOptions but `input`.
void add_input_options(CLI::App& command, InputOptions& options);

/// Closed range of frames; an end that is not set is the input's own.
struct FrameRange {
  std::optional<int> first, last;
};
/// "A:B", "A:", ":B" or "A". Throws InputError for anything else, and when A > B.
FrameRange parse_frame_range(const std::string& text);

/// Opens options.input and checks that it has all of `range`. Throws InputError.
Scene open_frames(const InputOptions& options, const FrameRange& range = {});

/// Where the data-parallel steps run.
struct BackendOptions {
  std::string backend = "opencl";  // or reference
  std::string device;              // index in `isoskin devices`, or reference; empty: the first GPU, else the first
  int threads = 0;                 // 0: all cores
};
void add_backend_options(CLI::App& command, BackendOptions& options);

/// The OpenCL device to use; nothing when it is to be the reference backend. Throws InputError for a device that is no
/// number.
std::optional<OpenClOptions> opencl_options(const BackendOptions& options);

/// Throws InputError when there is no such device; the line names the remedy.
std::unique_ptr<Backend> make_backend(const BackendOptions& options, bool trace = false);

/// Bounds oneTBB and a CPU OpenCL device to `threads` while the returned object lives; 0: no bound. Must come before
/// the first OpenCL call. Throws InputError when negative or absurd.
std::shared_ptr<void> limit_threads(int threads);

/// Throws InputError "WHAT VALUE: expected a number from LOW to HIGH" unless low <= value <= high.
void require_range(const char* what, double value, double low, double high);

}  // namespace isoskin
