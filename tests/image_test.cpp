#include "render/image.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <png.h>
#include <unistd.h>

#include <cmath>
#include <cstdio>
#include <fstream>
#include <limits>
#include <random>

using namespace isoskin;
namespace fs = std::filesystem;

namespace {

class ImageFiles : public ::testing::Test {
protected:
  void SetUp() override {
    folder_ = fs::temp_directory_path() / ("isoskin_image_test_" + std::to_string(::getpid()));
    fs::create_directories(folder_);
  }
  void TearDown() override { fs::remove_all(folder_); }

  fs::path folder_;
};

Image random_image(int width, int height) {
  Image image{width, height, {}};
  std::mt19937 random(7);
  for (const char* name : {"R", "G", "B", "A", "Z", "N.X", "N.Y", "N.Z", "P.X", "P.Y", "P.Z", "rest.X"}) {
    for (float& value : image.add(name)) value = std::uniform_real_distribution<float>(-100.0f, 100.0f)(random);
  }
  image.at("Z")[0] = std::numeric_limits<float>::infinity();
  image.at("Z")[1] = std::numeric_limits<float>::denorm_min();
  return image;
}

std::string message_of(const auto& action) {
  try {
    action();
  } catch (const InputError& error) {
    return error.what();
  }
  return "no InputError";
}

std::string output_of(const std::string& command) {
  std::string text;
  FILE* pipe = ::popen((command + " 2>&1").c_str(), "r");
  if (!pipe) return text;
  char buffer[4096];
  while (const std::size_t n = std::fread(buffer, 1, sizeof buffer, pipe)) text.append(buffer, n);
  ::pclose(pipe);
  return text;
}

std::vector<char> bytes_of(const fs::path& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

void write_bytes(const fs::path& path, const std::vector<char>& bytes) {
  std::ofstream(path, std::ios::binary).write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
}

std::vector<png_byte> read_png(const fs::path& path, int& width, int& height, bool palette = false) {
  png_image png{};
  png.version = PNG_IMAGE_VERSION;
  EXPECT_TRUE(png_image_begin_read_from_file(&png, path.c_str())) << png.message;
  EXPECT_EQ(png.format, static_cast<png_uint_32>(palette ? PNG_FORMAT_RGB_COLORMAP : PNG_FORMAT_RGB));
  png.format = PNG_FORMAT_RGB;
  std::vector<png_byte> rows(PNG_IMAGE_SIZE(png));
  EXPECT_TRUE(png_image_finish_read(&png, nullptr, rows.data(), 0, nullptr)) << png.message;
  width = static_cast<int>(png.width);
  height = static_cast<int>(png.height);
  return rows;
}

}  // namespace

TEST_F(ImageFiles, ExrKeepsEveryBit) {
  const Image image = random_image(37, 19);
  save_exr(folder_ / "a.exr", image, "made by a test");
  const Image back = load_exr(folder_ / "a.exr");
  EXPECT_EQ(back.width, 37);
  EXPECT_EQ(back.height, 19);
  EXPECT_EQ(back.channel, image.channel);
}

TEST_F(ImageFiles, SameImageSameBytes) {
  const Image image = random_image(300, 200);
  save_exr(folder_ / "a.exr", image);
  save_exr(folder_ / "b.exr", image);
  EXPECT_EQ(bytes_of(folder_ / "a.exr"), bytes_of(folder_ / "b.exr"));
}

TEST_F(ImageFiles, StockToolsReadTheExr) {
  if (output_of("command -v exrheader").empty()) GTEST_SKIP() << "exrheader is not installed";
  save_exr(folder_ / "a.exr", random_image(37, 19), "made by a test");
  const std::string header = output_of("exrheader " + (folder_ / "a.exr").string());
  for (const char* channel : {"A", "R", "Z", "N.X", "P.Z", "rest.X"}) {
    EXPECT_THAT(header, ::testing::HasSubstr(std::string("    ") + channel + ", 32-bit floating-point"));
  }
  EXPECT_THAT(header, ::testing::HasSubstr("dataWindow (type box2i): (0 0) - (36 18)"));
  EXPECT_THAT(header, ::testing::HasSubstr("made by a test"));

  output_of("exrstdattr -owner somebody " + (folder_ / "a.exr").string() + " " + (folder_ / "b.exr").string());
  EXPECT_EQ(load_exr(folder_ / "b.exr").channel, random_image(37, 19).channel);
}

TEST_F(ImageFiles, MissingTruncatedAndForeignFilesAreOneClearLine) {
  using ::testing::AllOf, ::testing::HasSubstr, ::testing::Not;
  const auto line = [](const std::string& file, const std::string& what) {
    return AllOf(HasSubstr(file), HasSubstr(what), Not(HasSubstr("\n")));
  };
  EXPECT_THAT(message_of([&] { load_exr(folder_ / "none.exr"); }), line("none.exr", "no such file"));

  write_bytes(folder_ / "text.exr", {'h', 'e', 'l', 'l', 'o'});
  EXPECT_THAT(message_of([&] { load_exr(folder_ / "text.exr"); }), line("text.exr", "not a readable OpenEXR image"));
  write_bytes(folder_ / "empty.exr", {});
  EXPECT_THAT(message_of([&] { load_exr(folder_ / "empty.exr"); }), line("empty.exr", "not a readable OpenEXR image"));
  EXPECT_THAT(message_of([&] { load_exr(folder_); }), line(folder_.string(), "not a readable OpenEXR image"));

  save_exr(folder_ / "whole.exr", random_image(200, 100));
  const auto whole = bytes_of(folder_ / "whole.exr");
  for (const double share : {0.002, 0.1, 0.5, 0.9, 0.999}) {
    const std::size_t size = static_cast<std::size_t>(share * static_cast<double>(whole.size()));
    write_bytes(folder_ / "cut.exr", {whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(size)});
    EXPECT_THAT(message_of([&] { load_exr(folder_ / "cut.exr"); }), line("cut.exr", "not a readable OpenEXR image"))
        << "cut at " << share;
  }
}

TEST_F(ImageFiles, AnUnwritableFolderIsAnInputErrorAndLeavesNothing) {
  const Image image = random_image(8, 8);
  EXPECT_THROW(save_exr(folder_ / "missing" / "a.exr", image), InputError);
  EXPECT_THROW(save_png(folder_ / "missing" / "a.png", image), InputError);
  EXPECT_FALSE(fs::exists(folder_ / "missing"));
}

TEST_F(ImageFiles, PngShowsLinearColourOverTheGradient) {
  Image image{2, 2, {}};
  // Top row covered: linear 0.5 and white; bottom row: nothing, and half covered black.
  image.channel = {{"R", {0.5f, 1.0f, 0.0f, 0.0f}},
                   {"G", {0.0f, 1.0f, 0.0f, 0.0f}},
                   {"B", {0.0f, 2.0f, 0.0f, 0.0f}},
                   {"A", {1.0f, 1.0f, 0.0f, 0.5f}}};
  save_png(folder_ / "a.png", image, {.top = {0.0f, 0.0f, 0.0f}, .bottom = {0.8f, 0.4f, 0.0f}});
  int width = 0, height = 0;
  const auto rows = read_png(folder_ / "a.png", width, height);
  ASSERT_EQ(width, 2);
  ASSERT_EQ(height, 2);
  // sRGB of 0.5, 0.6 = 0.75 * 0.8, 0.3, 0.15 from the standard's table.
  const std::vector<png_byte> expected{188, 0, 0, 255, 255, 255, 203, 149, 0, 149, 108, 0};
  EXPECT_EQ(rows, expected);
  save_png(folder_ / "b.png", image, {.top = {0.0f, 0.0f, 0.0f}, .bottom = {0.8f, 0.4f, 0.0f}, .palette = true});
  EXPECT_EQ(read_png(folder_ / "b.png", width, height, true), expected);  // five colours: none is rounded
}

TEST_F(ImageFiles, PalettesHoldPicturesOfAllColours) {
  Image image{64, 64, {}};
  for (const char* name : {"R", "G", "B"}) image.add(name);
  for (std::size_t i = 0; i < image.pixels(); ++i) {
    image.at("R")[i] = float(i % 64) / 63.0f;
    image.at("G")[i] = float(i / 64) / 63.0f;
    image.at("B")[i] = float(i * 37 % 101) / 100.0f;
  }
  save_png(folder_ / "full.png", image);
  save_png(folder_ / "palette.png", image, {.palette = true});
  int width = 0, height = 0;
  const auto full = read_png(folder_ / "full.png", width, height),
             few = read_png(folder_ / "palette.png", width, height, true);
  ASSERT_EQ(full.size(), few.size());
  int worst = 0;
  for (std::size_t i = 0; i < full.size(); ++i) worst = std::max(worst, std::abs(int(full[i]) - int(few[i])));
  EXPECT_LE(worst, 43);  // 2 bits at least: half of 255 / 3
  EXPECT_GT(worst, 0);
}

TEST(Image, DownsampleAveragesColourAndCoverage) {
  Image image{4, 2, {}};
  image.channel = {{"R", {1, 3, 0, 0, 5, 7, 0, 4}}, {"A", {1, 1, 0, 0, 1, 1, 0, 1}}, {"Z", {1, 1, 1, 1, 1, 1, 1, 1}}};
  const Image small = downsample(image, 2);
  EXPECT_EQ(small.width, 2);
  EXPECT_EQ(small.height, 1);
  EXPECT_EQ(small.at("R"), (std::vector<float>{4.0f, 1.0f}));
  EXPECT_EQ(small.at("A"), (std::vector<float>{1.0f, 0.25f}));
  EXPECT_FALSE(small.has("Z"));
  EXPECT_THROW(downsample(image, 3), std::invalid_argument);
}

TEST(Image, AMissingChannelIsNamed) {
  const Image image{1, 1, {}};
  EXPECT_THAT(message_of([&] { image.at("N.X"); }), ::testing::HasSubstr("N.X"));
}
