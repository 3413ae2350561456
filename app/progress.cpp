#include "app/progress.h"

#include <unistd.h>

#include <fmt/format.h>

namespace isoskin {

std::string readable_time(double seconds) {
  const long s = long(seconds + 0.5);
  if (s < 60) return fmt::format("{} s", s);
  if (s < 3600) return fmt::format("{} min {:02} s", s / 60, s % 60);
  return fmt::format("{} h {:02} min", s / 3600, s / 60 % 60);
}

Progress::Progress(int done, int total, bool quiet)
    : shown_(!quiet && isatty(STDERR_FILENO)),
      first_(done),
      done_(done),
      total_(total),
      begin_(std::chrono::steady_clock::now()) {
  draw();
}

Progress::~Progress() {
  if (shown_) fmt::print(stderr, "\n");
}

void Progress::step() {
  ++done_;
  draw();
}

void Progress::draw() {
  if (!shown_) return;
  constexpr int kWidth = 24;
  const int filled = total_ > 0 ? kWidth * done_ / total_ : kWidth;
  fmt::print(stderr, "\r\x1b[K[{:#<{}}{:.<{}}] {}/{} frames", "", filled, "", kWidth - filled, done_, total_);
  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin_).count();
  if (done_ > first_ && seconds > 0.0) {
    const double speed = (done_ - first_) / seconds;
    fmt::print(stderr, "  {:.2f} frames/s  {} left", speed, readable_time((total_ - done_) / speed));
  }
  std::fflush(stderr);
}

}  // namespace isoskin
