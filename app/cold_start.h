// The first run on a machine, on which PoCL compiles kernels for seconds: says so, and compiles while the input loads.
#pragma once

#include <future>
#include <optional>

#include "app/options.h"
#include "core/field/grid_field.h"

namespace isoskin {

class ColdStart {
public:
  /// For an input of `grids` that are not loaded yet, compiles in the background when no kernels are compiled. Throws
  /// InputError when there is no such device.
  ColdStart(const BackendOptions& backend, std::optional<Interpolation> grids);

  /// Says that kernels are compiled, when they are (a line on standard error, unless `silent`), and waits for the
  /// background: must come before anything else runs kernels, and after the input is found good: what is wrong with it
  /// is one line alone.
  void wait(bool silent);

  /// A frame is done, so kernels are compiled: the next run is not the first.
  void note_first_frame();

private:
  std::optional<OpenClOptions> cold_;  // the device, when it is one that has to compile
  std::future<void> compiling_;
};

}  // namespace isoskin
