// Loading a grid (reading included) and evaluating fields on the host.
#include <benchmark/benchmark.h>

#include <filesystem>
#include <random>

#include "core/io/scene.h"

namespace isoskin {
namespace {

const std::filesystem::path kData = ISOSKIN_TEST_DATA;

GridOptions options_of(const benchmark::State& state) {
  GridOptions options;
  options.interpolation = state.range(0) ? Interpolation::cubic : Interpolation::linear;
  return options;
}

void load(benchmark::State& state) {
  std::size_t bricks = 0;
  for (auto _ : state) {
    bricks = load_grid(kData / "dam_break" / "dam_break.0050.vdb", options_of(state))->grid()->brick_coordinate.size();
  }
  state.counters["bricks"] = static_cast<double>(bricks);
}
BENCHMARK(load)->ArgName("cubic")->Arg(0)->Arg(1)->Unit(benchmark::kMillisecond)->UseRealTime();

std::vector<DVec3> random_points(const Box& box) {
  std::mt19937_64 engine(1);
  std::uniform_real_distribution<double> share(0.0, 1.0);
  std::vector<DVec3> points(4096);
  for (DVec3& p : points) p = box.low + DVec3(share(engine), share(engine), share(engine)) * box.size();
  return points;
}

void sample(benchmark::State& state, const Field& field) {
  const std::vector<DVec3> points = random_points(field.bounds());
  for (auto _ : state) {
    for (const DVec3& p : points) benchmark::DoNotOptimize(field.sample(p));
  }
  state.SetItemsProcessed(static_cast<std::int64_t>(state.iterations() * points.size()));
}

void range(benchmark::State& state, const Field& field, double half) {
  const std::vector<DVec3> points = random_points(field.bounds());
  for (auto _ : state) {
    for (const DVec3& p : points) benchmark::DoNotOptimize(field.range(Box{p, p}.grown(half)));
  }
  state.SetItemsProcessed(static_cast<std::int64_t>(state.iterations() * points.size()));
}

void grid_sample(benchmark::State& state) {
  sample(state, *load_grid(kData / "dam_break" / "dam_break.0050.vdb", options_of(state)));
}
BENCHMARK(grid_sample)->ArgName("cubic")->Arg(0)->Arg(1);

void grid_range_of_two_voxels(benchmark::State& state) {
  const auto field = load_grid(kData / "dam_break" / "dam_break.0050.vdb", options_of(state));
  range(state, *field, field->resolution());
}
BENCHMARK(grid_range_of_two_voxels)->ArgName("cubic")->Arg(0)->Arg(1);

void skeleton_sample(benchmark::State& state, const char* scene) {
  sample(state, *load_scene(kData / scene).source->load(1).field);
}
BENCHMARK_CAPTURE(skeleton_sample, seven, "metaballs7.toml");
BENCHMARK_CAPTURE(skeleton_sample, sixty, "metaballs60.toml");

void skeleton_range(benchmark::State& state, const char* scene) {
  range(state, *load_scene(kData / scene).source->load(1).field, 0.05);
}
BENCHMARK_CAPTURE(skeleton_range, seven, "metaballs7.toml");
BENCHMARK_CAPTURE(skeleton_range, sixty, "metaballs60.toml");

}  // namespace
}  // namespace isoskin
