// Times a kernel, the same loop in C++, and what memory and arithmetic can do at best, in turns, so that a busy machine
// slows all alike.
#pragma once

#include <benchmark/benchmark.h>

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <chrono>
#include <ctime>
#include <vector>

namespace isoskin::perf {

struct Cost {
  double wall = 1e30, cpu = 1e30;  // seconds; cpu of all threads
  void add(const Cost& other) {
    wall = std::min(wall, other.wall);
    cpu = std::min(cpu, other.cpu);
  }
};

inline double cpu_seconds() {
  timespec t;
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
  return double(t.tv_sec) + 1e-9 * double(t.tv_nsec);
}

template <class Body>
Cost cost_of(const Body& body) {
  const auto begin = std::chrono::steady_clock::now();
  const double cpu = cpu_seconds();
  body();
  return {std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count(), cpu_seconds() - cpu};
}

/// What a loop cannot do without: bytes that have to come from or go to memory at least once, and float32 operations
/// (a multiplication and an addition count as two: kernels are built without contraction).
struct Work {
  double bytes = 0, operations = 0;
};

/// Measures on the spot how fast all threads stream and compute.
class Machine {
public:
  void measure() {
    triad_.add(cost_of([&] {
      tbb::parallel_for(tbb::blocked_range<std::size_t>(0, kFloats, kGrain), [&](const auto& r) {
        for (std::size_t i = r.begin(); i < r.end(); ++i) a_[i] = b_[i] + 3.0f * c_[i];
      });
    }));
    arithmetic_.add(cost_of([&] {
      tbb::parallel_for(0, kTasks, [&](int task) {
        Lanes x[kChains];
        for (int k = 0; k < kChains; ++k) x[k] = Lanes{} + float(task + k);
        for (int turn = 0; turn < kTurns; ++turn)
          for (Lanes& lane : x) lane = lane * 0.999f + 0.5f;
        for (const Lanes& lane : x) a_[std::size_t(task)] += lane[0];
      });
    }));
  }
  double bytes_a_second() const { return 3.0 * sizeof(float) * kFloats / triad_.wall; }
  double operations_a_second() const { return 2.0 * 16 * kChains * kTurns * kTasks / arithmetic_.wall; }
  /// Seconds, at least.
  double bound(const Work& work) const {
    return std::max(work.bytes / bytes_a_second(), work.operations / operations_a_second());
  }

private:
  using Lanes = float __attribute__((vector_size(64)));
  static constexpr std::size_t kFloats = 1u << 24, kGrain = 1u << 16;
  static constexpr int kTasks = 256, kTurns = 2000, kChains = 8;  // so many hide an addition's latency
  std::vector<float> a_ = std::vector<float>(kFloats, 1.0f), b_ = a_, c_ = a_;
  Cost triad_, arithmetic_;
};

/// Reports the cheapest run of each, wall and CPU milliseconds, kernel / cpp of both (1.3: the kernel takes 30 %
/// longer; on a busy machine the ratio of CPU times is the one to read), and which share of the machine's bound for
/// `work` the kernel reaches.
template <class KernelBody, class CppBody>
void side_by_side(benchmark::State& state, const Work& work, const KernelBody& kernel, const CppBody& cpp) {
  static Machine machine;
  kernel();  // compiles
  cpp();
  Cost best_kernel, best_cpp;
  for (auto _ : state) {
    const Cost now = cost_of(kernel);
    state.SetIterationTime(now.wall);
    best_kernel.add(now);
    best_cpp.add(cost_of(cpp));
    machine.measure();
  }
  state.counters["kernel_ms"] = 1e3 * best_kernel.wall;
  state.counters["cpp_ms"] = 1e3 * best_cpp.wall;
  state.counters["ratio"] = best_kernel.wall / best_cpp.wall;
  state.counters["kernel_cpu_ms"] = 1e3 * best_kernel.cpu;
  state.counters["cpp_cpu_ms"] = 1e3 * best_cpp.cpu;
  state.counters["cpu_ratio"] = best_kernel.cpu / best_cpp.cpu;
  state.counters["bound_ms"] = 1e3 * machine.bound(work);
  state.counters["of_bound"] = machine.bound(work) / best_kernel.wall;
  state.counters["GB_s"] = 1e-9 * machine.bytes_a_second();
  state.counters["Gop_s"] = 1e-9 * machine.operations_a_second();
}

}  // namespace isoskin::perf
