// The isoskin program: hands each command its arguments and turns what goes wrong into one line and an exit status.
#include <algorithm>
#include <csignal>
#include <string>

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include "app/command.h"
#include "core/types.h"

namespace isoskin {
namespace {

int fail(ExitStatus status, std::string reason) {
  while (!reason.empty() && reason.back() == '\n') reason.pop_back();
  std::replace(reason.begin(), reason.end(), '\n', ' ');
  std::fputs(("isoskin: " + reason + '\n').c_str(), stderr);  // may fail where fmt::print would throw
  return status;
}

/// What was printed must have arrived: a report cut short by a full disk is not a success.
int finish(int status) {
  return std::fflush(stdout) == 0 && !std::ferror(stdout)
             ? status
             : fail(kBadInput, "standard output: cannot be written; expected room on its device");
}

int run(int argc, char** argv) {
  CLI::App app("Keeps a triangle mesh on an animated implicit surface.", "isoskin");
  app.set_version_flag("--version", std::string("isoskin ") + ISOSKIN_VERSION);
  app.require_subcommand(1);
  app.footer(
      "Example:\n  isoskin track 'dam_break/dam_break.%04d.vdb' -o out\n"
      "`isoskin COMMAND --help` shows the options and an example of each command.\n"
      "Exit status: 0 done, 1 compare or check says no, 2 bad input (one line on standard error says what).");
  Action action;
  add_track(app, action);
  add_extract(app, action);
  add_seeds(app, action);
  add_collide(app, action);
  add_render(app, action);
  add_compare(app, action);
  add_check(app, action);
  add_ledger(app, action);
  add_info(app, action);
  add_devices(app, action);
  try {
    app.parse(argc, argv);
    return finish(action());
  } catch (const CLI::Success& wanted) {  // --help, --version
    return finish(app.exit(wanted));
  } catch (const CLI::ConversionError& error) {
    return fail(kBadInput, fmt::format("{}; expected a number", error.what()));
  } catch (const CLI::ParseError& error) {
    return fail(kBadInput, fmt::format("{}; `isoskin --help` shows what is expected", error.what()));
  } catch (const InputError& error) {
    return fail(kBadInput, error.what());
  } catch (const std::system_error& error) {  // a file or folder that went away, a full disk under standard output
    return fail(kBadInput, error.what());
  } catch (const std::bad_alloc&) {
    return fail(kBadInput, "out of memory; expected a larger --edge-length or --angle, or a smaller input");
  } catch (const std::exception& error) {
    return fail(kInternal, fmt::format("internal error: {}", error.what()));
  }
}

}  // namespace
}  // namespace isoskin

int main(int argc, char** argv) {
  // A file beyond the size limit is then an error to report, not a death in mid-write.
  std::signal(SIGXFSZ, SIG_IGN);
  return isoskin::run(argc, argv);
}
