// Loads frames ahead of need on one background thread (design 9).
#pragma once

#include <condition_variable>
#include <cstddef>
#include <deque>
#include <exception>
#include <functional>
#include <map>
#include <mutex>
#include <thread>

#include "core/field/field.h"

namespace isoskin {

/// Calls `load` for frames in the order they will be wanted: the one asked for, then up to `ahead` following ones, but
/// never more than `most_bytes` hold when they are as large as the last one loaded (FieldFrame::bytes()). What `load`
/// throws is thrown by get() of that frame. Keeps at most ahead + 1 frames. get() is not thread safe.
class Prefetch {
public:
  static constexpr std::size_t kMostBytes = std::size_t{1} << 28;

  Prefetch(std::function<FieldFrame(int)> load, int last_frame, int ahead, std::size_t most_bytes = kMostBytes);
  ~Prefetch();  // waits for the frame that is being loaded

  /// Waits until `frame` is loaded.
  FieldFrame get(int frame);

private:
  struct Loaded {
    FieldFrame frame;
    std::exception_ptr error;
  };
  void work();
  int window() const;

  std::function<FieldFrame(int)> load_;
  int last_frame_;
  int ahead_;
  std::size_t most_bytes_, bytes_ = 0;  // of a frame
  std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<int> wanted_;
  std::map<int, Loaded> loaded_;
  int asked_, loading_;
  bool stop_ = false;
  std::thread thread_;  // last: it uses all of the above
};

}  // namespace isoskin
