#include "core/trace.h"

#include <atomic>
#include <fstream>
#include <mutex>
#include <vector>

#include <nlohmann/json.hpp>

#include "core/types.h"

namespace isoskin::trace {
namespace {

struct Event {
  const char* track;
  std::string name;
  std::chrono::steady_clock::time_point begin, end;
};

std::atomic<bool> on{false};
std::mutex guard;
std::vector<Event> events;

double microseconds(std::chrono::steady_clock::duration d) {
  return std::chrono::duration<double, std::micro>(d).count();
}

}  // namespace

void enable(bool value) {
  on = value;
}

bool enabled() {
  return on;
}

void add(const char* track, std::string name, std::chrono::steady_clock::time_point begin,
         std::chrono::steady_clock::time_point end) {
  const std::lock_guard lock(guard);
  events.push_back({track, std::move(name), begin, end});
}

double total_seconds(const std::string& track) {
  const std::lock_guard lock(guard);
  double sum = 0.0;
  for (const Event& e : events)
    if (track == e.track) sum += 1e-6 * microseconds(e.end - e.begin);
  return sum;
}

void write(const std::filesystem::path& path) {
  const std::lock_guard lock(guard);
  nlohmann::json list = nlohmann::json::array();
  const auto origin = events.empty() ? std::chrono::steady_clock::time_point{} : events.front().begin;
  for (const Event& e : events)
    list.push_back({{"name", e.name},
                    {"cat", e.track},
                    {"ph", "X"},
                    {"pid", 1},
                    {"tid", e.track},
                    {"ts", microseconds(e.begin - origin)},
                    {"dur", microseconds(e.end - e.begin)}});
  std::ofstream file(path);
  file << nlohmann::json{{"traceEvents", std::move(list)}}.dump() << '\n';
  if (!file.flush()) throw InputError(path.string() + ": cannot write the trace; expected a writable file");
  events.clear();
}

}  // namespace isoskin::trace
