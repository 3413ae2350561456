// isoskin ledger: what happened in a tracked sequence, and where it went worst.
#include <algorithm>
#include <map>
#include <tuple>

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include "app/command.h"
#include "app/options.h"
#include "app/run_folder.h"

namespace isoskin {
namespace {

constexpr int kMostWorst = 1'000'000;

struct LedgerCommand {
  std::string folder;
  int worst = 10;  // frames to list
  bool json = false;
};

/// How much a frame had to be mended.
struct FrameCost {
  int frame = 0;
  double reextracted = 0.0;  // share of the area, all tiers
  std::size_t repairs = 0, events = 0;
  double ms = 0.0;

  auto badness() const { return std::tuple(-reextracted, -double(repairs), -ms, frame); }
};

struct LedgerSummary {
  std::map<std::pair<int, std::string>, std::vector<int>> kinds;  // tier and kind: the frames of its entries
  std::map<int, std::map<std::string, std::size_t>> frames;       // frame: entries by kind
  std::vector<FrameCost> worst;                                   // worst first; without the run's first frame
  std::size_t entries = 0, reported = 0;
};

FrameCost cost_of(const Json& line) {
  FrameCost cost;
  cost.frame = line.value("frame", 0);
  for (const Json& share : line.value("reextracted", Json::array())) cost.reextracted += share.get<double>();
  cost.repairs = line.value("repairs", std::size_t{0});
  cost.events = line.value("events", std::size_t{0});
  cost.ms = line.value("ms", Json::object()).value("total", 0.0);
  return cost;
}

LedgerSummary summarize(const RunSummary& run) {
  LedgerSummary summary;
  summary.entries = run.ledger.size();
  summary.reported = run.report.size();
  for (const Json& entry : run.ledger) {
    const int frame = entry.value("frame", 0);
    const std::string kind = entry.value("kind", "");
    summary.kinds[{entry.value("tier", 0), kind}].push_back(frame);
    ++summary.frames[frame][kind];
  }
  // The first frame is all extracted: there was no skin to keep.
  for (std::size_t i = 1; i < run.report.size(); ++i) summary.worst.push_back(cost_of(run.report[i]));
  std::sort(summary.worst.begin(), summary.worst.end(),
            [](const FrameCost& a, const FrameCost& b) { return a.badness() < b.badness(); });
  return summary;
}

LedgerSummary summary_of(const std::string& folder) {
  const RunSummary run = read_run(folder);
  try {
    return summarize(run);
  } catch (const Json::exception& error) {
    throw InputError(fmt::format("{}: {}; expected report.jsonl and ledger.jsonl as `isoskin track` writes them",
                                 folder, error.what()));
  }
}

Json to_json(const LedgerSummary& summary) {
  Json kinds = Json::array(), frames = Json::array(), worst = Json::array();
  for (const auto& [what, where] : summary.kinds)
    kinds.push_back({{"tier", what.first}, {"kind", what.second}, {"count", where.size()}, {"frames", where}});
  for (const auto& [frame, entries] : summary.frames) frames.push_back({{"frame", frame}, {"kinds", entries}});
  for (const FrameCost& cost : summary.worst)
    worst.push_back({{"frame", cost.frame},
                     {"reextracted", cost.reextracted},
                     {"repairs", cost.repairs},
                     {"events", cost.events},
                     {"ms", cost.ms}});
  return {{"reported", summary.reported},
          {"entries", summary.entries},
          {"kinds", kinds},
          {"frames", frames},
          {"worst", worst}};
}

void print(const LedgerSummary& summary) {
  fmt::print("{} frames, {} events and repairs\n", summary.reported, summary.entries);
  if (!summary.kinds.empty()) fmt::print("\ntier  kind          count  first and last frame\n");
  for (const auto& [what, where] : summary.kinds) {
    const auto [first, last] = std::minmax_element(where.begin(), where.end());
    fmt::print("{:>4}  {:<12} {:>6}  {} {}\n", what.first, what.second, where.size(), *first, *last);
  }
  if (!summary.frames.empty()) fmt::print("\nframe  events and repairs\n");
  for (const auto& [frame, entries] : summary.frames) {
    fmt::print("{:>5} ", frame);
    for (const auto& [kind, count] : entries) count == 1 ? fmt::print(" {}", kind) : fmt::print(" {} {}", count, kind);
    fmt::print("\n");
  }
  if (!summary.worst.empty()) fmt::print("\nworst frame  re-extracted  repairs  events      ms\n");
  for (const FrameCost& cost : summary.worst)
    fmt::print("{:>11}  {:>10.2f} %  {:>7}  {:>6}  {:>6.0f}\n", cost.frame, 100.0 * cost.reextracted, cost.repairs,
               cost.events, cost.ms);
}

int run(const LedgerCommand& command) {
  require_range("--worst", command.worst, 0, kMostWorst);
  LedgerSummary summary = summary_of(command.folder);
  summary.worst.resize(std::min(summary.worst.size(), std::size_t(command.worst)));
  if (command.json)
    fmt::print("{}\n", to_json(summary).dump());
  else
    print(summary);
  return kOk;
}

}  // namespace

void add_ledger(CLI::App& app, Action& action) {
  CLI::App* command =
      app.add_subcommand("ledger", "Sums up a tracked folder: events and repairs by kind and frame, the worst frames");
  const auto o = std::make_shared<LedgerCommand>();
  command->add_option("folder", o->folder, "A folder that `isoskin track` wrote")->required();
  command
      ->add_option("--worst", o->worst,
                   "Frames to list, the most re-extracted first; the run's first frame is not among them")
      ->capture_default_str();
  command->add_flag("--json", o->json, "Print the summary as one line of JSON");
  command->footer("Example:\n  isoskin ledger out --worst 5");
  command->callback([o, &action] { action = [o] { return run(*o); }; });
}

}  // namespace isoskin
