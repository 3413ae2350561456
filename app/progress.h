// The progress line of a long run: frames done, speed, time left.
#pragma once

#include <chrono>
#include <string>

namespace isoskin {

/// Draws on standard error, on a terminal only and unless told to be quiet.
class Progress {
public:
  Progress(int done, int total, bool quiet);
  ~Progress();
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  /// One more frame is done.
  void step();

private:
  bool shown_;
  int first_, done_, total_;
  std::chrono::steady_clock::time_point begin_;
  void draw();
};

/// "12 s", "3 min 05 s", "2 h 10 min".
std::string readable_time(double seconds);

}  // namespace isoskin
