#include "core/io/prefetch.h"

#include <limits>

namespace isoskin {
namespace {

constexpr int kNoFrame = std::numeric_limits<int>::min();

}  // namespace

Prefetch::Prefetch(std::function<FieldFrame(int)> load, int last_frame, int ahead)
    : load_(std::move(load)), last_frame_(last_frame), ahead_(ahead), loading_(kNoFrame), thread_([this] { work(); }) {}

Prefetch::~Prefetch() {
  {
    const std::lock_guard lock(mutex_);
    stop_ = true;
  }
  changed_.notify_all();
  thread_.join();
}

FieldFrame Prefetch::get(int frame) {
  std::unique_lock lock(mutex_);
  const auto in_window = [&](int f) { return f >= frame && f <= frame + ahead_; };
  std::erase_if(loaded_, [&](const auto& entry) { return !in_window(entry.first); });
  wanted_.clear();
  for (int f = frame; f <= std::min(frame + ahead_, last_frame_) || f == frame; ++f) {
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
    loaded_[frame] = std::move(result);
    changed_.notify_all();
  }
}

}  // namespace isoskin
