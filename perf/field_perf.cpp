// Field evaluation, value and gradient of a million points: the OpenCL kernel beside the same loop in C++ with oneTBB.
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <cfloat>
#include <cmath>
#include <cstring>
#include <random>

#include "core/field/grid_field.h"
#include "core/field/skeleton_field.h"
#include "kernels/opencl_backend.h"
#include "perf/side_by_side.h"

using namespace isoskin;

namespace {

constexpr std::size_t kPoints = 1u << 20;
constexpr double kPointBytes = 28;  // position in, value and gradient out
constexpr double kBallOperations = 22, kTrilinearOperations = 58, kTricubicOperations = 450;  // each point, counted
constexpr int kLanes = 16;
using Lanes = float __attribute__((vector_size(64)));
using Four = float __attribute__((vector_size(16)));

Backend& device() {
  static const std::unique_ptr<Backend> backend = make_opencl_backend();
  return *backend;
}

/// 128 x 128 x 64 points of [-1, 1]^3 along a Morton curve.
std::vector<Vec3> morton_points() {
  std::vector<Vec3> points(kPoints);
  for (std::size_t i = 0; i < kPoints; ++i) {
    unsigned at[3] = {0, 0, 0};
    for (unsigned bit = 0; bit < 20; ++bit) at[bit % 3] |= ((i >> bit) & 1u) << (bit / 3);
    points[i] = Vec3(at[0], at[1], at[2]) * Vec3(1.98f / 127, 1.98f / 127, 1.98f / 63) - 0.99f;
  }
  return points;
}

struct Ball {
  float x, y, z, over_r2, weight, slope;
};

/// As kernels/evaluate.cl, which the loops below do all of: within the range of float.
inline Lanes held(Lanes v) {
  v = v > FLT_MAX ? Lanes{} + FLT_MAX : v;
  return v < -FLT_MAX ? Lanes{} - FLT_MAX : v;
}

/// The loop the kernel runs, over 16 points at once.
void metaballs(const Ball* balls, std::size_t count, float iso, const Vec3* points, float* values, Vec3* gradients,
               std::size_t begin, std::size_t end) {
  for (std::size_t first = begin; first < end; first += kLanes) {
    Lanes x, y, z;
    for (int i = 0; i < kLanes; ++i) x[i] = points[first + i].x, y[i] = points[first + i].y, z[i] = points[first + i].z;
    Lanes f = Lanes{} - iso, gx{}, gy{}, gz{};
    for (std::size_t k = 0; k < count; ++k) {
      const Ball& b = balls[k];
      const Lanes dx = x - b.x, dy = y - b.y, dz = z - b.z;
      const Lanes inside = 1.0f - (dx * dx + dy * dy + dz * dz) * b.over_r2;
      const Lanes c = inside > 0.0f ? inside : Lanes{};
      const Lanes c2 = c * c;
      f += b.weight * c2 * c;
      const Lanes s = b.slope * c2;
      gx += s * dx, gy += s * dy, gz += s * dz;
    }
    const auto good = (x - x == 0.0f) & (y - y == 0.0f) & (z - z == 0.0f);  // finite
    f = good ? held(f) : Lanes{} + NAN;
    gx = good ? held(gx) : Lanes{}, gy = good ? held(gy) : Lanes{}, gz = good ? held(gz) : Lanes{};
    for (int i = 0; i < kLanes; ++i) values[first + i] = f[i], gradients[first + i] = Vec3(gx[i], gy[i], gz[i]);
  }
}

template <class Range>
void parallel(const Range& body) {
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, kPoints / 1024),
                    [&](const auto& r) { body(1024 * r.begin(), 1024 * r.end()); });
}

/// range(0) metaballs of radius range(1) percent of the box; at 400 all of them reach every point, so that the loops
/// do the same work; below, the kernel's cell lists skip what is far.
void BM_metaballs(benchmark::State& state) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  std::vector<SkeletonElement> elements(state.range(0));
  std::vector<Ball> balls;
  for (SkeletonElement& e : elements) {
    const double x = uniform(random), y = uniform(random), z = uniform(random);
    e.a = e.b = DVec3(x, y, z);
    e.radius = 0.01 * double(state.range(1));
    const float over_r2 = float(1.0 / (e.radius * e.radius));
    balls.push_back({float(x), float(y), float(z), over_r2, 1.0f, -6.0f * over_r2});
  }
  device().set_field(std::make_shared<SkeletonField>(elements, 0.5));
  const std::vector<Vec3> points = morton_points();
  std::vector<float> values(kPoints);
  std::vector<Vec3> gradients(kPoints);
  // What does not reach a point need not be computed: only the C++ loop does.
  const bool all_reach = state.range(1) == 400;
  perf::side_by_side(
      state, {kPoints * kPointBytes, all_reach ? kPoints * kBallOperations * double(balls.size()) : 0.0},
      [&] { device().evaluate(points, values, gradients); },
      [&] {
        parallel([&](std::size_t begin, std::size_t end) {
          metaballs(balls.data(), balls.size(), 0.5f, points.data(), values.data(), gradients.data(), begin, end);
        });
      });
}

std::shared_ptr<BrickGrid> dense_grid(Interpolation interpolation) {
  auto grid = std::make_shared<BrickGrid>();
  constexpr int kSide = 16;  // bricks
  grid->origin = DVec3(-1.0);
  grid->h = 2.0 / (kSide * BrickGrid::kBrick);
  grid->interpolation = interpolation;
  grid->table_size = IVec3(kSide);
  grid->outside = -1.0f;
  for (int x = 0; x < kSide; ++x)
    for (int y = 0; y < kSide; ++y)
      for (int z = 0; z < kSide; ++z) {
        grid->table.push_back(std::int32_t(grid->brick_coordinate.size()));
        grid->brick_coordinate.push_back({x, y, z});
        for (int t = 0; t < BrickGrid::kTapValues; ++t) {
          const DVec3 p =
              grid->origin + grid->h * DVec3(8 * x + t / 121 - 1, 8 * y + t / 11 % 11 - 1, 8 * z + t % 11 - 1);
          grid->tap.push_back(float(0.7 - glm::length(p)));
        }
      }
  return grid;
}

/// Where the taps of a point begin; none where a constant holds, as beyond the grid.
inline const float* locate(const BrickGrid& g, const Vec3& p, const Vec3& origin, float over_h, Vec3& t) {
  const Vec3 u = (p - origin) * over_h, size = Vec3(g.table_size * BrickGrid::kBrick);
  if (!(u.x >= 0 && u.y >= 0 && u.z >= 0 && u.x < size.x && u.y < size.y && u.z < size.z)) return nullptr;
  const IVec3 c(u);
  t = u - Vec3(c);
  const std::int32_t entry = g.table[((c.x >> 3) * g.table_size.y + (c.y >> 3)) * g.table_size.z + (c.z >> 3)];
  if (entry < 0) return nullptr;
  return g.tap.data() + std::size_t(entry) * BrickGrid::kTapValues + ((c.x & 7) * 11 + (c.y & 7)) * 11 + (c.z & 7);
}

inline Four load4(const float* from) {
  Four v;
  std::memcpy(&v, from, sizeof v);
  return v;
}
inline Four value_weights(float t) {
  const float s = 1 - t;
  return Four{s * s * s, 4 + 3 * t * t * (t - 2), 4 + 3 * s * s * (s - 2), t * t * t} * (1.0f / 6);
}
inline Four slope_weights(float t) {
  const float s = 1 - t;
  return Four{-s * s, t * (3 * t - 4), s * (4 - 3 * s), t * t} * 0.5f;
}
inline float sum4(Four v) {
  return (v[0] + v[1]) + (v[2] + v[3]);
}

inline void store(const Vec3& point, float value, const Vec3& gradient, float& value_out, Vec3& gradient_out) {
  const bool good = std::isfinite(point.x) && std::isfinite(point.y) && std::isfinite(point.z);
  value_out = good ? glm::clamp(value, -FLT_MAX, FLT_MAX) : NAN;
  gradient_out = good ? glm::clamp(gradient, -FLT_MAX, FLT_MAX) : Vec3(0.0f);
}

void tricubic(const BrickGrid& g, const Vec3* points, float* values, Vec3* gradients, std::size_t begin,
              std::size_t end) {
  const float over_h = float(1.0 / g.h);
  const Vec3 origin(g.origin);
  for (std::size_t i = begin; i < end; ++i) {
    Vec3 t;
    const float* tap = locate(g, points[i], origin, over_h, t);
    if (!tap) {
      store(points[i], g.outside, Vec3(0.0f), values[i], gradients[i]);
      continue;
    }
    const Four wx = value_weights(t.x), wy = value_weights(t.y), wz = value_weights(t.z);
    const Four dx = slope_weights(t.x), dy = slope_weights(t.y), dz = slope_weights(t.z);
    Four f{}, fx{}, fy{};
    for (int x = 0; x < 4; ++x) {
      Four line{}, line_y{};
      for (int y = 0; y < 4; ++y) {
        const Four row = load4(tap + (x * 11 + y) * 11);
        line += wy[y] * row;
        line_y += dy[y] * row;
      }
      f += wx[x] * line;
      fx += dx[x] * line;
      fy += wx[x] * line_y;
    }
    store(points[i], sum4(f * wz), Vec3(sum4(fx * wz), sum4(fy * wz), sum4(f * dz)) * over_h, values[i], gradients[i]);
  }
}

void trilinear(const BrickGrid& g, const Vec3* points, float* values, Vec3* gradients, std::size_t begin,
               std::size_t end) {
  const float over_h = float(1.0 / g.h);
  const Vec3 origin(g.origin);
  for (std::size_t i = begin; i < end; ++i) {
    Vec3 t;
    const float* tap = locate(g, points[i], origin, over_h, t);
    if (!tap) {
      store(points[i], g.outside, Vec3(0.0f), values[i], gradients[i]);
      continue;
    }
    const float* c = tap + 12 * 11 + 1;
    const float a0 = c[0], a1 = c[1], b0 = c[11], b1 = c[12], c0 = c[121], c1 = c[122], d0 = c[132], d1 = c[133];
    const float low0 = a0 + t.y * (b0 - a0), low1 = a1 + t.y * (b1 - a1);
    const float high0 = c0 + t.y * (d0 - c0), high1 = c1 + t.y * (d1 - c1);
    const float f0 = low0 + t.x * (high0 - low0), f1 = low1 + t.x * (high1 - low1);
    const float y0 = (b0 - a0) + t.x * ((d0 - c0) - (b0 - a0)), y1 = (b1 - a1) + t.x * ((d1 - c1) - (b1 - a1));
    store(points[i], f0 + t.z * (f1 - f0),
          Vec3((high0 - low0) + t.z * ((high1 - low1) - (high0 - low0)), y0 + t.z * (y1 - y0), f1 - f0) * over_h,
          values[i], gradients[i]);
  }
}

void grid_benchmark(benchmark::State& state, Interpolation interpolation) {
  const auto grid = dense_grid(interpolation);
  device().set_field(std::make_shared<GridField>(grid));
  std::vector<Vec3> points = morton_points();
  if (state.range(0)) std::shuffle(points.begin(), points.end(), std::mt19937(1));
  std::vector<float> values(kPoints);
  std::vector<Vec3> gradients(kPoints);
  const bool cubic = interpolation == Interpolation::cubic;
  const auto loop = cubic ? tricubic : trilinear;
  perf::side_by_side(
      state,
      {kPoints * kPointBytes + sizeof(float) * double(grid->tap.size()),
       kPoints * (cubic ? kTricubicOperations : kTrilinearOperations)},
      [&] { device().evaluate(points, values, gradients); },
      [&] {
        parallel([&](std::size_t begin, std::size_t end) {
          loop(*grid, points.data(), values.data(), gradients.data(), begin, end);
        });
      });
}

void BM_trilinear(benchmark::State& state) {
  grid_benchmark(state, Interpolation::linear);
}
void BM_tricubic(benchmark::State& state) {
  grid_benchmark(state, Interpolation::cubic);
}

}  // namespace

BENCHMARK(BM_metaballs)
    ->ArgNames({"count", "radius_percent"})
    ->ArgsProduct({{7, 64, 1024}, {400}})
    ->Args({64, 50})
    ->Args({1024, 20})
    ->UseManualTime()
    ->Unit(benchmark::kMillisecond);
BENCHMARK(BM_trilinear)->ArgName("shuffled")->Arg(0)->Arg(1)->UseManualTime()->Unit(benchmark::kMillisecond);
BENCHMARK(BM_tricubic)->ArgName("shuffled")->Arg(0)->Arg(1)->UseManualTime()->Unit(benchmark::kMillisecond);
