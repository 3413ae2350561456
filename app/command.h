// The commands of the program: each adds itself to the parser and leaves the action to run once parsing is done.
#pragma once

#include <functional>

namespace CLI {
class App;
}

namespace isoskin {

/// Exit statuses. bad_input is anything the user gave: arguments, files, folders, devices.
enum ExitStatus { kOk = 0, kNo = 1, kBadInput = 2, kInternal = 3, kInterrupted = 130 };

using Action = std::function<int()>;

void add_track(CLI::App& app, Action& action);
void add_extract(CLI::App& app, Action& action);
void add_seeds(CLI::App& app, Action& action);
void add_collide(CLI::App& app, Action& action);
void add_render(CLI::App& app, Action& action);
void add_compare(CLI::App& app, Action& action);
void add_check(CLI::App& app, Action& action);
void add_ledger(CLI::App& app, Action& action);
void add_info(CLI::App& app, Action& action);
void add_devices(CLI::App& app, Action& action);

}  // namespace isoskin
