// Chrome trace of host steps and kernels (`--trace FILE`, open it in chrome://tracing or Perfetto).
#pragma once

#include <chrono>
#include <filesystem>
#include <string>

namespace isoskin {

/// Events collect in memory while tracing is on; off by default and then nearly free. Thread safe.
namespace trace {
void enable(bool on);
bool enabled();
/// A finished span on `track` ("host", "kernel", "copy", "launch"), times from steady_clock.
void add(const char* track, std::string name, std::chrono::steady_clock::time_point begin,
         std::chrono::steady_clock::time_point end);
/// Writes the JSON and forgets the events. Throws InputError when the file cannot be written.
void write(const std::filesystem::path& path);

/// Total seconds recorded on a track so far.
double total_seconds(const std::string& track);
}  // namespace trace

/// Times a scope as a host step.
class Span {
public:
  explicit Span(const char* name) : name_(name), begin_(std::chrono::steady_clock::now()) {}
  ~Span() {
    if (trace::enabled()) trace::add("host", name_, begin_, std::chrono::steady_clock::now());
  }
  Span(const Span&) = delete;
  Span& operator=(const Span&) = delete;

private:
  const char* name_;
  std::chrono::steady_clock::time_point begin_;
};

}  // namespace isoskin
