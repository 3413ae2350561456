#include "core/io/prefetch.h"

#include <algorithm>
#include <limits>

namespace isoskin {
namespace {

constexpr int kNoFrame = std::numeric_limits<int>::min();

}  // namespace

Prefetch::Prefetch(std::function<FieldFrame(int)> load, int last_frame, int ahead, std::size_t most_bytes)
    : load_(std::move(load)),
      last_frame_(last_frame),
      ahead_(ahead),
      most_bytes_(most_bytes),
      asked_(kNoFrame),
      loading_(kNoFrame),
      thread_([this] { work(); }) {}

Prefetch::~Prefetch() {
  {
    const std::lock_guard lock(mutex_);
    stop_ = true;
  }
  changed_.notify_all();
  thread_.join();
}

/// How many frames may be loaded ahead.
int Prefetch::window() const {
  return static_cast<int>(std::min<std::size_t>(ahead_, most_bytes_ / std::max<std::size_t>(bytes_, 1)));
}

FieldFrame Prefetch::get(int frame) {
  std::unique_lock lock(mutex_);
  const auto in_window = [&](int f) { return f >= frame && f <= frame + window(); };
  std::erase_if(loaded_, [&](const auto& entry) { return !in_window(entry.first); });
  asked_ = frame;
  wanted_.clear();
  for (int f = frame; f <= std::min(frame + window(), last_frame_) || f == frame; ++f) {
    if (f != loading_ && !loaded_.contains(f)) wanted_.push_back(f);
  }
  changed_.notify_all();
  changed_.wait(lock, [&] { return loaded_.contains(frame); });
  const Loaded result = loaded_.at(frame);
  if (result.error) {
    loaded_.erase(frame);
    std::rethrow_exception(result.error);
  }
  return result.frame;
}

void Prefetch::work() {
  std::unique_lock lock(mutex_);
  while (true) {
    changed_.wait(lock, [&] { return stop_ || !wanted_.empty(); });
    if (stop_) return;
    const int frame = loading_ = wanted_.front();
    wanted_.pop_front();
    lock.unlock();
    Loaded result;
    try {
      result.frame = load_(frame);
    } catch (...) {
      result.error = std::current_exception();
    }
    lock.lock();
    loading_ = kNoFrame;
    bytes_ = result.frame.field ? result.frame.field->bytes() : 0;
    std::erase_if(wanted_, [&](int f) { return f - asked_ > window(); });
    loaded_[frame] = std::move(result);
    changed_.notify_all();
  }
}

}  // namespace isoskin
