// isoskin devices: what --device takes.
#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include "app/command.h"
#include "kernels/opencl_backend.h"

namespace isoskin {
namespace {

int run() {
  const std::vector<DeviceInfo> devices = list_devices();
  for (const DeviceInfo& d : devices)
    fmt::print("{}\t{} ({}), {} compute units, {:.1f} GiB, {}, driver {}, {}\n", d.index, d.name, d.cpu ? "CPU" : "GPU",
               d.compute_units, double(d.global_bytes) / double(1u << 30), d.platform, d.driver, d.version);
  if (devices.empty())
    fmt::print("no OpenCL device; expected one: install pocl-opencl-icd for the CPU, or your GPU's OpenCL driver\n");
  fmt::print("reference\tplain float64 host code, slow, needs no device\n");
  return kOk;
}

}  // namespace

void add_devices(CLI::App& app, Action& action) {
  CLI::App* command = app.add_subcommand("devices", "Lists the devices that --device takes");
  command->footer("Example:\n  isoskin devices");
  command->callback([&action] { action = [] { return run(); }; });
}

}  // namespace isoskin
