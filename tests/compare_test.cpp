#include "render/compare.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>

using namespace isoskin;
using ::testing::HasSubstr;

namespace {

constexpr int kWidth = 60, kHeight = 40;

// depth(x, y) < 0: not covered.
Image picture(const std::function<double(int, int)>& depth, DVec3 normal = {0, 0, 1}) {
  Image image{kWidth, kHeight, {}};
  auto &a = image.add("A"), &z = image.add("Z", std::numeric_limits<float>::infinity());
  auto &nx = image.add("N.X"), &ny = image.add("N.Y"), &nz = image.add("N.Z");
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      const double d = depth(x, y);
      if (d < 0.0) continue;
      const std::size_t pixel = static_cast<std::size_t>(y) * kWidth + x;
      a[pixel] = 1.0f;
      z[pixel] = static_cast<float>(d);
      nx[pixel] = static_cast<float>(normal.x);
      ny[pixel] = static_cast<float>(normal.y);
      nz[pixel] = static_cast<float>(normal.z);
    }
  }
  return image;
}

Image square(int left, double depth = 5.0) {
  return picture([=](int x, int y) { return x >= left && x < left + 20 && y >= 10 && y < 30 ? depth : -1.0; });
}

}  // namespace

TEST(Compare, AnImageEqualsItself) {
  const CompareReport report = compare(square(10), square(10)).report;
  EXPECT_EQ(report.covered_a, 400u);
  EXPECT_EQ(report.covered_b, 400u);
  EXPECT_EQ(report.coverage_mismatch, 0u);
  EXPECT_EQ(report.depth.pixels, 400u);
  EXPECT_EQ(report.depth.max, 0.0);
  EXPECT_EQ(report.normal.max, 0.0);
  EXPECT_TRUE(report.passed);
  EXPECT_EQ(report.verdict, "passed");
}

TEST(Compare, AOnePixelShiftIsRimAThreePixelShiftIsNot) {
  const CompareReport one = compare(square(10), square(11)).report;
  EXPECT_EQ(one.coverage_mismatch, 40u);
  EXPECT_EQ(one.beyond_rim, 0u);
  EXPECT_TRUE(one.passed);

  const CompareReport three = compare(square(10), square(13)).report;
  EXPECT_EQ(three.coverage_mismatch, 120u);
  EXPECT_EQ(three.beyond_rim, 80u);  // of each strip of three columns, the one beside the other square is rim
  EXPECT_FALSE(three.passed);
  EXPECT_THAT(three.verdict, HasSubstr("80 pixels beyond the 1-pixel rim"));
  EXPECT_EQ(compare(square(10), square(13), {.rim = 3}).report.beyond_rim, 0u);
}

TEST(Compare, ASpeckThatOneImageLacksIsBeyondTheRim) {
  const auto speck = picture([](int x, int y) { return x == 50 && y == 5 ? 1.0 : x < 20 ? 5.0 : -1.0; });
  const auto none = picture([](int x, int) { return x < 20 ? 5.0 : -1.0; });
  EXPECT_EQ(compare(speck, none).report.beyond_rim, 1u);
  EXPECT_EQ(compare(none, speck).report.beyond_rim, 1u);
}

TEST(Compare, DepthErrorsAreToldInUnits) {
  const CompareReport report = compare(square(10, 5.0), square(10, 5.0625), {.unit = 0.5}).report;
  EXPECT_DOUBLE_EQ(report.depth.mean, 0.125);
  EXPECT_DOUBLE_EQ(report.depth.p99, 0.125);
  EXPECT_TRUE(report.passed);
  const CompareReport strict = compare(square(10, 5.0), square(10, 5.0625), {.unit = 0.125}).report;
  EXPECT_DOUBLE_EQ(strict.depth_inside.p99, 0.5);
  EXPECT_FALSE(strict.passed);
  EXPECT_THAT(strict.verdict, HasSubstr("depth error p99 0.5 units (allowed 0.25)"));
}

TEST(Compare, ThePercentileForgivesOnePixelInAHundred) {
  const auto with_outliers = [](int count) {
    return picture([count](int x, int y) { return y * kWidth + x < count ? 6.0 : 5.0; });
  };
  CompareOptions options;
  options.jump = 10.0;
  EXPECT_EQ(compare(with_outliers(24), with_outliers(0), options).report.depth.p99, 0.0);
  const CompareReport more = compare(with_outliers(48), with_outliers(0), options).report;
  EXPECT_EQ(more.depth.p99, 1.0);
  EXPECT_DOUBLE_EQ(more.depth.mean, 48.0 / 2400.0);
}

TEST(Compare, InnerSilhouettesAreRimToo) {
  const auto step = [](int at) { return picture([at](int x, int) { return x < at ? 5.0 : 9.0; }); };
  const CompareReport one = compare(step(30), step(31)).report;
  EXPECT_EQ(one.depth.max, 4.0);
  EXPECT_EQ(one.depth_inside.max, 0.0);
  EXPECT_TRUE(one.passed);
  const CompareReport three = compare(step(30), step(33)).report;
  EXPECT_EQ(three.depth_inside.max, 4.0);  // the column between both rims
  EXPECT_EQ(three.depth_inside.pixels, static_cast<std::size_t>(kHeight) * (kWidth - 4));
}

TEST(Compare, NormalsAreComparedByAngle) {
  const double degree = std::acos(-1.0) / 180.0;
  const auto flat = [](int, int) { return 5.0; };
  const Image up = picture(flat), tilted = picture(flat, {std::sin(2.0 * degree), 0.0, std::cos(2.0 * degree)});
  const CompareReport report = compare(up, tilted).report;
  EXPECT_NEAR(report.normal.mean, 2.0, 1e-4);
  EXPECT_TRUE(report.passed);
  const CompareReport opposite = compare(up, picture(flat, {0, 0, -1})).report;
  EXPECT_NEAR(opposite.normal.mean, 180.0, 1e-9);
  EXPECT_THAT(opposite.verdict, HasSubstr("mean normal error 180 degrees (allowed 3)"));
}

TEST(Compare, TheDifferenceImageShowsWhere) {
  const Image difference = compare(square(10, 5.0), square(13, 5.5), {.unit = 2.0}).difference;
  const auto at = [&](const char* channel, int x) { return difference.at(channel)[20 * kWidth + x]; };
  EXPECT_EQ(at("coverage", 10), 1.0f);
  EXPECT_EQ(at("coverage", 32), -1.0f);
  EXPECT_EQ(at("coverage", 20), 0.0f);
  EXPECT_EQ(at("depth", 20), -0.25f);
  EXPECT_EQ(at("depth", 5), 0.0f);
  EXPECT_EQ(at("R", 10), 1.0f);  // beyond the rim: red
  EXPECT_EQ(at("G", 10), 0.0f);
  EXPECT_EQ(at("R", 5), 0.0f);
}

TEST(Compare, ADepthThatIsNotANumberFails) {
  Image broken = square(10);
  for (float& z : broken.at("Z")) z = std::nanf("");
  EXPECT_FALSE(compare(broken, square(10)).report.passed);
}

TEST(Compare, ImagesThatDoNotMatchAreRefused) {
  const auto message = [](const Image& a, const Image& b) -> std::string {
    try {
      compare(a, b);
    } catch (const InputError& error) {
      return error.what();
    }
    return "no InputError";
  };
  Image small{10, 10, {}};
  EXPECT_THAT(message(square(10), small), HasSubstr("60 x 40 and 10 x 10"));
  Image bare = square(10);
  bare.channel.erase("N.Y");
  EXPECT_THAT(message(square(10), bare), HasSubstr("no channel N.Y"));
  EXPECT_THROW(compare(square(10), square(10), {.unit = 0.0}), std::invalid_argument);
}
