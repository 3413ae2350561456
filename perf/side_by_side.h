// Times a kernel and the same loop in C++ in turns, so that a busy machine slows both alike.
#pragma once

#include <benchmark/benchmark.h>

#include <algorithm>
#include <chrono>
#include <ctime>

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

/// Reports the cheapest run of each, wall and CPU milliseconds, and kernel / cpp of both (1.3: the kernel takes 30 %
/// longer). On a busy machine the ratio of CPU times is the one to read.
template <class KernelBody, class CppBody>
void side_by_side(benchmark::State& state, const KernelBody& kernel, const CppBody& cpp) {
  kernel();  // compiles
  cpp();
  Cost best_kernel, best_cpp;
  for (auto _ : state) {
    const Cost now = cost_of(kernel);
    state.SetIterationTime(now.wall);
    best_kernel.add(now);
    best_cpp.add(cost_of(cpp));
  }
  state.counters["kernel_ms"] = 1e3 * best_kernel.wall;
  state.counters["cpp_ms"] = 1e3 * best_cpp.wall;
  state.counters["ratio"] = best_kernel.wall / best_cpp.wall;
  state.counters["kernel_cpu_ms"] = 1e3 * best_kernel.cpu;
  state.counters["cpp_cpu_ms"] = 1e3 * best_cpp.cpu;
  state.counters["cpu_ratio"] = best_kernel.cpu / best_cpp.cpu;
}

}  // namespace isoskin::perf
