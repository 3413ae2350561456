#include "core/field/grid_field.h"

#include <gtest/gtest.h>
#include <rapidcheck.h>

#include <cmath>
#include <random>

#include "core/field/brick_builder.h"

namespace isoskin {
namespace {

// A dense box of voxel values in blocks, and double precision oracles of what a field on it must be.
class DenseGrid {
public:
  static constexpr int kBlocks = 3, kSide = 8 * kBlocks;
  static constexpr int kPad = 24;  // outside voxels on each side in the oracle
  static constexpr int kPadded = kSide + 2 * kPad;
  const IVec3 low_block{-2, 1, -1};
  const DVec3 origin{0.3, -1.0, 2.0};
  const double h = 0.25;
  const float outside = -0.75f;

  template <typename F>
  explicit DenseGrid(const F& f) : padded_(std::size_t(kPadded) * kPadded * kPadded, outside) {
    for (int x = 0; x < kSide; ++x) {
      for (int y = 0; y < kSide; ++y) {
        for (int z = 0; z < kSide; ++z) at(padded_, {x, y, z}) = static_cast<float>(f(IVec3(x, y, z)));
      }
    }
    coefficients_ = padded_;
    for (int axis = 0; axis < 3; ++axis) solve(axis);
  }

  GridField field(Interpolation interpolation) const {
    std::vector<float> storage(std::size_t(kSide) * kSide * kSide);
    BlockValues blocks{low_block, IVec3(kBlocks), {}, std::vector<float>(kBlocks * kBlocks * kBlocks), outside};
    for (int block = 0; block < kBlocks * kBlocks * kBlocks; ++block) {
      float* values = storage.data() + block * 512;
      const IVec3 corner = 8 * IVec3(block / (kBlocks * kBlocks), block / kBlocks % kBlocks, block % kBlocks);
      for (int v = 0; v < 512; ++v)
        values[v] = static_cast<float>(at(padded_, corner + IVec3(v >> 6, v >> 3 & 7, v & 7)));
      blocks.values.push_back(values);
    }
    return GridField(std::make_shared<const BrickGrid>(build_bricks(blocks, origin, h, interpolation)));
  }

  DVec3 world(const DVec3& voxel) const { return origin + h * (voxel + DVec3(8 * low_block)); }
  double voxel(const IVec3& v) const { return at(padded_, v); }
  double coefficient(const IVec3& v) const { return at(coefficients_, v); }

  // From the coefficients by the B-spline's definition (truncated powers), from the values by the hat function.
  double oracle(const DVec3& voxel_position, Interpolation interpolation) const {
    const auto cubic = [](double t) {
      const auto power = [](double x) { return x > 0.0 ? x * x * x : 0.0; };
      return (power(t + 2) - 4 * power(t + 1) + 6 * power(t) - 4 * power(t - 1) + power(t - 2)) / 6.0;
    };
    const auto hat = [](double t) { return std::max(0.0, 1.0 - std::abs(t)); };
    const bool smooth = interpolation == Interpolation::cubic;
    const IVec3 cell(glm::floor(voxel_position));
    double sum = 0.0;
    for (int x = -2; x <= 3; ++x) {
      for (int y = -2; y <= 3; ++y) {
        for (int z = -2; z <= 3; ++z) {
          const IVec3 v = cell + IVec3(x, y, z);
          const DVec3 t = voxel_position - DVec3(v);
          sum += smooth ? at(coefficients_, v) * cubic(t.x) * cubic(t.y) * cubic(t.z)
                        : at(padded_, v) * hat(t.x) * hat(t.y) * hat(t.z);
        }
      }
    }
    return sum;
  }

private:
  static std::size_t index(const IVec3& v) {
    return (std::size_t(v.x + kPad) * kPadded + (v.y + kPad)) * kPadded + (v.z + kPad);
  }
  static double& at(std::vector<double>& values, const IVec3& v) { return values[index(v)]; }
  static double at(const std::vector<double>& values, const IVec3& v) { return values[index(v)]; }

  // Thomas' algorithm for (c[i-1] + 4 c[i] + c[i+1]) / 6 = f[i] along every line; the ends lie in a constant.
  void solve(int axis) {
    const std::size_t stride = axis == 0 ? std::size_t(kPadded) * kPadded : axis == 1 ? kPadded : 1;
    const auto solve_line = [&](double* line) {
      std::vector<double> upper(kPadded);
      double before = line[0];
      line[0] = before;
      upper[0] = 0.0;
      for (int i = 1; i + 1 < kPadded; ++i) {
        const double pivot = 4.0 / 6.0 - upper[i - 1] / 6.0;
        upper[i] = (1.0 / 6.0) / pivot;
        line[i * stride] = (line[i * stride] - line[(i - 1) * stride] / 6.0) / pivot;
      }
      for (int i = kPadded - 2; i > 0; --i) line[i * stride] -= upper[i] * line[(i + 1) * stride];
    };
    for (int a = 0; a < kPadded; ++a) {
      for (int b = 0; b < kPadded; ++b) {
        const std::size_t start = axis == 0   ? std::size_t(a) * kPadded + b
                                  : axis == 1 ? std::size_t(a) * kPadded * kPadded + b
                                              : (std::size_t(a) * kPadded + b) * kPadded;
        solve_line(coefficients_.data() + start);
      }
    }
  }

  std::vector<double> padded_, coefficients_;
};

const DenseGrid& noise() {
  static const DenseGrid grid = [] {
    std::mt19937 engine(5);
    std::uniform_real_distribution<double> value(-1.0, 1.0);
    return DenseGrid([&](const IVec3&) { return value(engine); });
  }();
  return grid;
}

double ball_value(const IVec3& v) {
  return 7.3 - glm::length(DVec3(v) - DVec3(11.2, 12.4, 10.9));
}

const DenseGrid& ball() {  // a narrow band: distances cut off where the outside begins
  static const DenseGrid grid([](const IVec3& v) { return std::clamp(ball_value(v), -0.75, 0.75); });
  return grid;
}

struct Random {
  std::mt19937_64 engine;
  double operator()(double low, double high) { return std::uniform_real_distribution<double>(low, high)(engine); }
  DVec3 vector(double low, double high) { return {(*this)(low, high), (*this)(low, high), (*this)(low, high)}; }
};

TEST(GridField, CoefficientsAreThoseOfADenseSolve) {
  for (const DenseGrid* grid : {&noise(), &ball()}) {
    const GridField field = grid->field(Interpolation::cubic);
    const BrickGrid& bricks = *field.grid();
    double worst = 0.0;
    for (std::size_t b = 0; b < bricks.brick_coordinate.size(); ++b) {
      const IVec3 corner = 8 * (bricks.brick_coordinate[b] - grid->low_block) - 1;
      for (int t = 0; t < BrickGrid::kTapValues; ++t) {
        const double expected = grid->coefficient(corner + IVec3(t / 121, t / 11 % 11, t % 11));
        worst = std::max(worst, std::abs(bricks.tap[b * BrickGrid::kTapValues + t] - expected));
      }
    }
    EXPECT_LT(worst, 1e-5);  // noise has coefficients up to about 10
  }
}

TEST(GridField, PassesThroughVoxelValues) {
  for (const Interpolation interpolation : {Interpolation::linear, Interpolation::cubic}) {
    const GridField field = noise().field(interpolation);
    double worst = 0.0;
    for (int v = 0; v < DenseGrid::kSide * DenseGrid::kSide * DenseGrid::kSide; ++v) {
      const IVec3 voxel(v / (DenseGrid::kSide * DenseGrid::kSide), v / DenseGrid::kSide % DenseGrid::kSide,
                        v % DenseGrid::kSide);
      worst = std::max(worst, std::abs(field.value(noise().world(DVec3(voxel))) - noise().voxel(voxel)));
    }
    EXPECT_LT(worst, 5e-6);
  }
}

TEST(GridField, ValueGradientHessianMatchOracle) {
  for (const Interpolation interpolation : {Interpolation::linear, Interpolation::cubic}) {
    const GridField field = noise().field(interpolation);
    EXPECT_TRUE(rc::check([&](std::uint64_t seed) {
      Random random{std::mt19937_64(seed)};
      const DVec3 q = random.vector(-1.0, DenseGrid::kSide);
      const DVec3 t = q - glm::floor(q);
      constexpr double kStep = 1e-3;
      const auto F = [&](const DVec3& x) { return noise().oracle(x, interpolation); };
      const FieldSample s = field.sample(noise().world(q));
      RC_ASSERT(std::abs(s.value - F(q)) < 1e-5);
      if (glm::any(glm::lessThan(glm::min(t, 1.0 - t), DVec3(2 * kStep)))) return;  // differences would leave the cell
      const DMat3 h = field.hessian(noise().world(q));
      for (int i = 0; i < 3; ++i) {
        DVec3 di(0.0);
        di[i] = kStep;
        RC_ASSERT(std::abs(s.gradient[i] * noise().h - (F(q + di) - F(q - di)) / (2 * kStep)) < 3e-5);
        for (int j = 0; j < 3; ++j) {
          DVec3 dj(0.0);
          dj[j] = kStep;
          const double expected =
              (F(q + di + dj) - F(q + di - dj) - F(q - di + dj) + F(q - di - dj)) / (4 * kStep * kStep);
          RC_ASSERT(std::abs(h[i][j] * noise().h * noise().h - expected) < 2e-4);
        }
      }
    }));
  }
}

TEST(GridField, ValuesOfALatticeAreThoseOfItsPoints) {
  const DenseGrid grid([](const IVec3& v) { return std::sin(0.7 * v.x) + std::cos(0.5 * v.y) * 0.1 * (v.z - 12); });
  for (const Interpolation interpolation : {Interpolation::linear, Interpolation::cubic}) {
    const GridField field = grid.field(interpolation);
    const DVec3 from = grid.world({-3.1, 5.3, 19.7});  // from beyond the table into three blocks and out again
    const IVec3 count(40, 9, 11);
    const double spacing = 0.23;
    std::vector<double> values(std::size_t(count.x) * count.y * count.z);
    field.values(from, spacing, count, values);
    for (std::size_t i = 0; i < values.size(); ++i) {
      const DVec3 p = from + spacing * DVec3(i / 99, i / 11 % 9, i % 11);
      ASSERT_EQ(values[i], field.value(p)) << i;
      ASSERT_NEAR(values[i], field.sample(p).value, 1e-12);
    }
  }
}

TEST(GridField, RangeContainsSampledValues) {
  for (const Interpolation interpolation : {Interpolation::linear, Interpolation::cubic}) {
    for (const DenseGrid* grid : {&noise(), &ball()}) {
      const GridField field = grid->field(interpolation);
      EXPECT_TRUE(rc::check([&](std::uint64_t seed) {
        Random random{std::mt19937_64(seed)};
        Box box;
        const DVec3 a = random.vector(-20.0, 40.0);
        box.add(grid->world(a));
        box.add(grid->world(a + std::pow(10.0, random(-3.0, 1.7)) * random.vector(0.0, 1.0)));
        const Interval range = field.range(box);
        for (int k = 0; k < 60; ++k) {
          const DVec3 p = glm::mix(box.low, box.high, random.vector(0.0, 1.0));
          RC_ASSERT(range.contains(field.value(p)));
        }
        RC_ASSERT(range.contains(field.value(box.low)) && range.contains(field.value(box.high)));
      }));
    }
  }
}

TEST(GridField, RangeOfACellIsTheHullOfItsTaps) {
  const GridField field = noise().field(Interpolation::linear);
  const Interval range = field.range({noise().world(DVec3(7.1)), noise().world(DVec3(7.9))});
  double low = 1.0, high = -1.0;
  for (int corner = 0; corner < 8; ++corner) {
    const double value = noise().voxel(IVec3(7) + IVec3(corner & 1, corner >> 1 & 1, corner >> 2));
    low = std::min(low, value);
    high = std::max(high, value);
  }
  EXPECT_NEAR(range.low, low, 1e-12);
  EXPECT_NEAR(range.high, high, 1e-12);
}

TEST(GridField, RangeOfEverythingAndOfNothing) {
  const GridField field = ball().field(Interpolation::cubic);
  const double infinity = std::numeric_limits<double>::infinity();
  const Interval all = field.range({DVec3(-infinity), DVec3(infinity)});
  EXPECT_LE(all.low, -0.75);
  EXPECT_GE(all.high, 0.75);
  const Interval far = field.range({DVec3(1e30), DVec3(2e30)});
  EXPECT_NEAR(far.low, -0.75, 1e-6);
  EXPECT_NEAR(far.high, -0.75, 1e-6);
}

TEST(GridField, BoundsAreThoseOfTheSurfaceToACell) {
  const GridField field = ball().field(Interpolation::cubic);
  const Box box = field.bounds();
  const DVec3 center = ball().world(DVec3(11.2, 12.4, 10.9));
  const double radius = 7.3 * ball().h;
  for (int i = 0; i < 3; ++i) {
    EXPECT_LE(box.low[i], center[i] - radius);
    EXPECT_GE(box.low[i], center[i] - radius - 2.5 * ball().h);
    EXPECT_GE(box.high[i], center[i] + radius);
    EXPECT_LE(box.high[i], center[i] + radius + 2.5 * ball().h);
  }
}

TEST(GridField, NoSurfaceMeansEmptyBounds) {
  const DenseGrid grid([](const IVec3& v) { return -0.5 - 0.01 * v.x; });
  EXPECT_TRUE(grid.field(Interpolation::cubic).bounds().empty());
}

TEST(GridField, ConstantBeyondTheTable) {
  const GridField field = noise().field(Interpolation::cubic);
  for (const DVec3& p : {DVec3(1e6), DVec3(-1e300, 0.0, 0.0), DVec3(0.0, 1e12, 0.0)}) {
    const FieldSample s = field.sample(p);
    EXPECT_EQ(s.value, -0.75);
    EXPECT_EQ(s.gradient, DVec3(0.0));
    EXPECT_EQ(field.hessian(p), DMat3(0.0));
  }
  EXPECT_EQ(field.resolution(), 0.25);
  EXPECT_TRUE(field.is_c2());
  EXPECT_FALSE(noise().field(Interpolation::linear).is_c2());
}

TEST(BrickBuilder, UniformBlocksNeedNoBrickUnlessTheSurfaceIsNear) {
  // Two blocks of one value each, touching: the surface lies between them, in the last layer of cells of the first.
  BlockValues blocks{IVec3(0), IVec3(2, 1, 1), {nullptr, nullptr}, {0.5f, -0.5f}, -0.5f};
  const GridField field(std::make_shared<const BrickGrid>(build_bricks(blocks, DVec3(0.0), 1.0, Interpolation::cubic)));
  for (int x = -9; x < 20; ++x) {
    for (int y = -9; y < 20; ++y) {
      const bool inside = x >= 0 && x < 8 && y >= 0 && y < 8;
      EXPECT_EQ(field.value(DVec3(x, y, 4)) > 0.0, inside) << x << ' ' << y;
    }
  }
  // Half way, but for what still rings of the other face: 0.27 a voxel, 8 voxels away.
  EXPECT_NEAR(field.value(DVec3(7.5, 4.0, 4.0)), 0.0, std::pow(0.27, 8.0));
  EXPECT_NEAR(field.value(DVec3(-0.5, 4.0, 4.0)), 0.0, std::pow(0.27, 8.0));
  // A grid of one value has no brick at all.
  const BlockValues flat{IVec3(0), IVec3(1), {nullptr}, {-0.5f}, -0.5f};
  EXPECT_TRUE(build_bricks(flat, DVec3(0.0), 1.0, Interpolation::cubic).brick_coordinate.empty());
}

TEST(BrickBuilder, EveryCellWithASignChangeLiesInABrick) {
  // Sparse noise: blocks of values next to constants of both signs.
  std::mt19937 engine(11);
  std::vector<float> storage(64 * 512);
  for (float& value : storage) value = std::uniform_real_distribution<float>(-1.0f, 1.0f)(engine);
  BlockValues blocks{IVec3(-1), IVec3(4), {}, {}, -1.0f};
  for (int block = 0; block < 64; ++block) {
    blocks.values.push_back(engine() % 3 == 0 ? storage.data() + 512 * block : nullptr);
    blocks.constant.push_back(engine() % 2 ? 1.0f : -1.0f);
  }
  const auto value = [&](const IVec3& v) {
    const IVec3 b = (v >> 3) - blocks.low;
    if (glm::any(glm::lessThan(b, IVec3(0))) || glm::any(glm::greaterThanEqual(b, blocks.size))) return blocks.outside;
    const std::size_t entry = blocks.entry(v >> 3);
    return blocks.values[entry] ? blocks.values[entry][(v.x & 7) * 64 + (v.y & 7) * 8 + (v.z & 7)]
                                : blocks.constant[entry];
  };
  const BrickGrid grid = build_bricks(blocks, DVec3(0.0), 1.0, Interpolation::linear);
  const auto has_brick = [&](const IVec3& cell) {
    const IVec3 b = (cell >> 3) - grid.table_low;
    return grid.table[(std::size_t(b.x) * grid.table_size.y + b.y) * grid.table_size.z + b.z] >= 0;
  };
  for (int x = -16; x < 32; ++x) {
    for (int y = -16; y < 32; ++y) {
      for (int z = -16; z < 32; ++z) {
        bool in = false, out = false;
        for (int corner = 0; corner < 8; ++corner) {
          const bool positive = value(IVec3(x, y, z) + IVec3(corner & 1, corner >> 1 & 1, corner >> 2)) > 0.0f;
          (positive ? in : out) = true;
        }
        ASSERT_TRUE(!(in && out) || has_brick({x, y, z})) << x << ' ' << y << ' ' << z;
      }
    }
  }
}

}  // namespace
}  // namespace isoskin
