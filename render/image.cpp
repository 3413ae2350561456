#include "render/image.h"

#include <ImfChannelList.h>
#include <ImfFloatAttribute.h>
#include <ImfFrameBuffer.h>
#include <ImfHeader.h>
#include <ImfIO.h>
#include <ImfInputFile.h>
#include <ImfOutputFile.h>
#include <ImfStandardAttributes.h>
#include <fmt/format.h>
#include <png.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <map>
#include <optional>

#include "core/io/ply.h"

namespace isoskin {
namespace {

constexpr std::size_t kMaxPixels = std::size_t{1} << 28;  // a header that asks for more is corrupt

constexpr const char* kUnit = "isoskin.unit";
constexpr const char* kDepthTolerance = "isoskin.depth_tolerance";

float float_attribute(const Imf::Header& header, const char* name) {
  const auto* attribute = header.findTypedAttribute<Imf::FloatAttribute>(name);
  return attribute ? attribute->value() : 0.0f;
}

// Collects what OpenEXR writes, so that one write_file_atomically serves every format.
class MemoryStream final : public Imf::OStream {
public:
  MemoryStream() : OStream("memory") {}
  void write(const char bytes[], int n) override {
    if (at_ + n > bytes_.size()) bytes_.resize(at_ + n);
    std::memcpy(bytes_.data() + at_, bytes, n);
    at_ += n;
  }
  std::uint64_t tellp() override { return at_; }
  void seekp(std::uint64_t at) override { at_ = at; }
  const std::vector<char>& bytes() const { return bytes_; }

private:
  std::vector<char> bytes_;
  std::size_t at_ = 0;
};

std::string one_line(std::string text) {
  std::replace(text.begin(), text.end(), '\n', ' ');
  return text;
}

Imf::Slice slice(std::vector<float>& data, const Imath::Box2i& window, int width) {
  return Imf::Slice::Make(Imf::FLOAT, data.data(), window.min, width, window.max.y - window.min.y + 1, sizeof(float),
                          sizeof(float) * width);
}

float srgb(float linear) {
  const float x = std::clamp(linear, 0.0f, 1.0f);
  return x <= 0.0031308f ? 12.92f * x : 1.055f * std::pow(x, 1.0f / 2.4f) - 0.055f;
}

/// The distinct colours of a picture, 3 bytes each, and which of them each pixel has.
struct Palette {
  std::vector<png_byte> colors, index;
};

/// Of `rows` (3 bytes a pixel) rounded to `bits` a channel, 0 and 255 kept; nothing when a PNG's palette cannot hold
/// it.
std::optional<Palette> palette_of(const std::vector<png_byte>& rows, int bits) {
  constexpr std::size_t kMost = 256;
  const int most = (1 << bits) - 1;
  Palette palette;
  std::map<std::array<png_byte, 3>, png_byte> known;
  for (std::size_t at = 0; at < rows.size(); at += 3) {
    std::array<png_byte, 3> color;
    for (int c = 0; c < 3; ++c) color[c] = png_byte((rows[at + c] * most + 127) / 255 * 255 / most);
    const auto [entry, fresh] = known.try_emplace(color, png_byte(known.size()));
    if (known.size() > kMost) return std::nullopt;
    if (fresh) palette.colors.insert(palette.colors.end(), color.begin(), color.end());
    palette.index.push_back(entry->second);
  }
  return palette;
}

Palette finest_palette(const std::vector<png_byte>& rows) {
  for (int bits = 8; bits > 2; --bits)
    if (std::optional<Palette> palette = palette_of(rows, bits)) return *std::move(palette);
  return *palette_of(rows, 2);  // 64 colours
}

}  // namespace

std::vector<float>& Image::add(const std::string& name, float fill) {
  auto& data = channel[name];
  data.assign(pixels(), fill);
  return data;
}

const std::vector<float>& Image::at(const std::string& name) const {
  const auto found = channel.find(name);
  if (found == channel.end()) throw InputError(fmt::format("image has no channel {}", name));
  return found->second;
}

std::vector<float>& Image::at(const std::string& name) {
  return const_cast<std::vector<float>&>(static_cast<const Image&>(*this).at(name));
}

VectorChannels::VectorChannels(const Image& image, const std::string& name)
    : x(&image.at(name + ".X")), y(&image.at(name + ".Y")), z(&image.at(name + ".Z")) {}

void save_exr(const std::filesystem::path& path, const Image& image, const std::string& comments) {
  for (const auto& [name, data] : image.channel) {
    if (data.size() != image.pixels()) throw std::invalid_argument("save_exr: channel " + name + " has the wrong size");
  }
  Imf::Header header(image.width, image.height);
  header.compression() = Imf::ZIP_COMPRESSION;
  if (!comments.empty()) Imf::addComments(header, comments);
  header.insert(kUnit, Imf::FloatAttribute(image.unit));
  header.insert(kDepthTolerance, Imf::FloatAttribute(image.depth_tolerance));
  Imf::FrameBuffer frame;
  for (const auto& [name, data] : image.channel) {
    header.channels().insert(name, Imf::Channel(Imf::FLOAT));
    frame.insert(name, slice(const_cast<std::vector<float>&>(data), header.dataWindow(), image.width));
  }
  MemoryStream stream;
  try {
    Imf::OutputFile file(stream, header);
    file.setFrameBuffer(frame);
    file.writePixels(image.height);
  } catch (const std::exception& error) {
    throw InputError(fmt::format("{}: cannot encode as OpenEXR: {}", path.string(), one_line(error.what())));
  }
  write_file_atomically(path, stream.bytes());
}

Image load_exr(const std::filesystem::path& path) {
  if (!std::filesystem::exists(path)) throw InputError(fmt::format("{}: no such file", path.string()));
  try {
    Imf::InputFile file(path.c_str());
    const auto window = file.header().dataWindow();
    const auto columns = std::int64_t{window.max.x} - window.min.x + 1,
               rows = std::int64_t{window.max.y} - window.min.y + 1;
    if (columns < 1 || rows < 1 || static_cast<std::size_t>(columns * rows) > kMaxPixels) {
      throw InputError(fmt::format("{}: an image of {} x {} pixels cannot be read", path.string(), columns, rows));
    }
    Image image;
    image.width = static_cast<int>(columns);
    image.height = static_cast<int>(rows);
    image.unit = float_attribute(file.header(), kUnit);
    image.depth_tolerance = float_attribute(file.header(), kDepthTolerance);
    Imf::FrameBuffer frame;
    const auto& channels = file.header().channels();
    for (auto c = channels.begin(); c != channels.end(); ++c) {
      if (c.channel().xSampling != 1 || c.channel().ySampling != 1) {
        throw InputError(
            fmt::format("{}: channel {} is subsampled; expected one value a pixel", path.string(), c.name()));
      }
      frame.insert(c.name(), slice(image.add(c.name()), window, image.width));
    }
    file.setFrameBuffer(frame);
    file.readPixels(window.min.y, window.max.y);
    return image;
  } catch (const InputError&) {
    throw;
  } catch (const std::exception& error) {
    throw InputError(fmt::format("{}: not a readable OpenEXR image: {}", path.string(), one_line(error.what())));
  }
}

void save_png(const std::filesystem::path& path, const Image& image, const PngOptions& options) {
  const std::vector<float>* color[] = {&image.at("R"), &image.at("G"), &image.at("B")};
  const std::vector<float>* alpha = image.has("A") ? &image.at("A") : nullptr;
  std::vector<png_byte> rows(3 * image.pixels());
  for (std::size_t pixel = 0; pixel < image.pixels(); ++pixel) {
    const float down = (static_cast<float>(pixel / image.width) + 0.5f) / static_cast<float>(image.height);
    const float through = alpha ? 1.0f - (*alpha)[pixel] : 0.0f;
    for (int c = 0; c < 3; ++c) {
      const float behind = options.top[c] + down * (options.bottom[c] - options.top[c]);
      rows[3 * pixel + c] = static_cast<png_byte>(std::lround(255.0f * srgb((*color[c])[pixel] + through * behind)));
    }
  }

  const Palette palette = options.palette ? finest_palette(rows) : Palette{};
  png_image png{};
  png.version = PNG_IMAGE_VERSION;
  png.width = image.width;
  png.height = image.height;
  png.format = !options.palette ? PNG_FORMAT_RGB : PNG_FORMAT_RGB_COLORMAP;
  png.colormap_entries = png_uint_32(palette.colors.size() / 3);
  std::vector<char> bytes(PNG_IMAGE_PNG_SIZE_MAX(png));
  png_alloc_size_t size = bytes.size();
  const png_byte* pixels = !options.palette ? rows.data() : palette.index.data();
  if (!png_image_write_to_memory(&png, bytes.data(), &size, 0, pixels, 0, palette.colors.data())) {
    throw InputError(fmt::format("{}: cannot encode as PNG: {}", path.string(), png.message));
  }
  bytes.resize(size);
  write_file_atomically(path, bytes);
}

Image downsample(const Image& image, int factor) {
  if (factor < 1 || image.width % factor || image.height % factor) {
    throw std::invalid_argument("downsample: the factor must divide the image's size");
  }
  Image small;
  small.width = image.width / factor;
  small.height = image.height / factor;
  for (const char* name : {"R", "G", "B", "A"}) {
    if (!image.has(name)) continue;
    const auto& from = image.at(name);
    auto& to = small.add(name);
    for (int y = 0; y < image.height; ++y) {
      for (int x = 0; x < image.width; ++x) {
        to[static_cast<std::size_t>(y / factor) * small.width + x / factor] +=
            from[static_cast<std::size_t>(y) * image.width + x];
      }
    }
    for (float& value : to) value /= static_cast<float>(factor * factor);
  }
  return small;
}

}  // namespace isoskin
