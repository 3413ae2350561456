// Times the steps of a frame.
#pragma once

#include <algorithm>
#include <chrono>

#include "core/trace.h"
#include "core/tracker.h"

namespace isoskin {

/// From its making to its end, into the frame's report and, when on, into the trace.
class Step {
public:
  Step(FrameReport& report, const char* name)
      : report_(report), span_(name), name_(name), begin_(std::chrono::steady_clock::now()) {}
  ~Step() {
    const double ms = std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - begin_).count();
    const auto same =
        std::find_if(report_.ms.begin(), report_.ms.end(), [&](const auto& e) { return e.first == name_; });
    if (same != report_.ms.end())
      same->second += ms;
    else
      report_.ms.emplace_back(name_, ms);
  }

private:
  FrameReport& report_;
  Span span_;
  const char* name_;
  std::chrono::steady_clock::time_point begin_;
};

}  // namespace isoskin
