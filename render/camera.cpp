#include "render/camera.h"

#include <fmt/format.h>

#include <toml++/toml.h>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "core/io/ply.h"

namespace isoskin {
namespace {

constexpr double kNearFraction = 1e-3;  // near_depth, of the distance from eye to target
constexpr double kLeastSine = 1e-6;     // of the angle between up and the view axis
constexpr double kLeastExtent = 1e-6;   // of a box to frame, relative to its distance from the origin

bool finite(const DVec3& v) {
  return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z);
}

double tangent_of_half(double fov) {
  return std::tan(0.5 * fov * std::numbers::pi / 180.0);
}

[[noreturn]] void fail(const std::string& file, const toml::source_region& where, const std::string& what) {
  throw InputError(fmt::format("{}:{}: {}", file, where.begin.line, what));
}

template <std::size_t N>
std::array<double, N> numbers(const std::string& file, std::string_view key, const toml::node& node) {
  const toml::array* list = node.as_array();
  std::array<double, N> out{};
  bool right = list && list->size() == N;
  for (std::size_t i = 0; right && i < N; ++i) {
    const auto number = (*list)[i].value<double>();
    right = number && std::isfinite(*number);
    if (right) out[i] = *number;
  }
  if (!right) fail(file, node.source(), fmt::format("{} must be {} finite numbers in brackets", key, N));
  return out;
}

DVec3 vector(const std::string& file, std::string_view key, const toml::node& node) {
  const auto v = numbers<3>(file, key, node);
  return {v[0], v[1], v[2]};
}

void read_key(Camera& camera, const std::string& file, std::string_view key, const toml::node& node) {
  if (key == "eye") {
    camera.eye = vector(file, key, node);
  } else if (key == "target") {
    camera.target = vector(file, key, node);
  } else if (key == "up") {
    camera.up = vector(file, key, node);
  } else if (key == "fov") {
    const auto fov = node.value<double>();
    if (!fov) fail(file, node.source(), "fov must be a number of degrees");
    camera.fov = *fov;
  } else if (key == "size") {
    const auto size = numbers<2>(file, key, node);
    for (const double side : size) {
      if (side != std::floor(side) || side < 1 || side > kMaxImageSide) {
        fail(file, node.source(), fmt::format("size must be two whole numbers of pixels, 1 to {}", kMaxImageSide));
      }
    }
    camera.width = static_cast<int>(size[0]);
    camera.height = static_cast<int>(size[1]);
  } else {
    fail(file, node.source(), fmt::format("unknown key {}; expected eye, target, up, fov or size", key));
  }
}

}  // namespace

glm::dvec2 CameraRays::pixel(const DVec3& point) const {
  const double z = depth(point);
  const double u = glm::dot(point - eye, right) / (z * half_width);
  const double v = glm::dot(point - eye, up) / (z * half_height);
  return {0.5 * ((u + 1.0) * width - 1.0), 0.5 * ((1.0 - v) * height - 1.0)};
}

CameraRays camera_rays(const Camera& camera) {
  if (!finite(camera.eye) || !finite(camera.target) || !finite(camera.up)) {
    throw InputError("camera: eye, target and up must be finite");
  }
  if (!(camera.fov > 0.0 && camera.fov < 180.0)) {
    throw InputError(fmt::format("camera: fov is {}; expected degrees between 0 and 180", camera.fov));
  }
  if (camera.width < 1 || camera.height < 1 || camera.width > kMaxImageSide || camera.height > kMaxImageSide) {
    throw InputError(fmt::format("camera: size is {} x {}; expected 1 to {} pixels a side", camera.width, camera.height,
                                 kMaxImageSide));
  }
  const DVec3 view = camera.target - camera.eye;
  const double distance = glm::length(view);
  if (!(distance > 0.0)) throw InputError("camera: eye and target are the same point");
  const DVec3 forward = view / distance;
  const DVec3 across = glm::cross(forward, camera.up);
  if (!(glm::length(across) > kLeastSine * glm::length(camera.up))) {
    throw InputError("camera: up is zero or lies along the view axis");
  }
  const DVec3 right = glm::normalize(across);
  const double half_height = tangent_of_half(camera.fov);
  return {camera.eye,
          right,
          glm::cross(right, forward),
          forward,
          half_height * camera.width / camera.height,
          half_height,
          camera.width,
          camera.height,
          kNearFraction * distance};
}

Camera frame_box(const Box& box, int width, int height, const FramingOptions& options) {
  if (box.empty() || !finite(box.low) || !finite(box.high)) {
    throw InputError("camera: nothing to frame; the object's box is empty or not finite");
  }
  const double least = kLeastExtent * std::max(1.0, glm::length(box.center()));
  const Box framed = box.diagonal() < least ? box.grown(least) : box;

  Camera camera{
      framed.center() + glm::normalize(options.from), framed.center(), options.up, options.fov, width, height};
  const CameraRays rays = camera_rays(camera);
  // Each corner asks for some distance at which it is just inside; the largest wins.
  double distance = 0.0;
  for (int corner = 0; corner < 8; ++corner) {
    const DVec3 from_center =
        DVec3(corner & 1 ? 0.5 : -0.5, corner & 2 ? 0.5 : -0.5, corner & 4 ? 0.5 : -0.5) * framed.size();
    const double sideways = std::abs(glm::dot(from_center, rays.right)) / ((1.0 - options.margin) * rays.half_width);
    const double upward = std::abs(glm::dot(from_center, rays.up)) / ((1.0 - options.margin) * rays.half_height);
    distance = std::max(distance, std::max(sideways, upward) - glm::dot(from_center, rays.forward));
  }
  camera.eye = framed.center() + distance * glm::normalize(options.from);
  return camera;
}

Camera load_camera(const std::filesystem::path& path) {
  const std::string file = path.string();
  if (!std::filesystem::is_regular_file(path)) throw InputError(fmt::format("{}: no such file", file));
  toml::table table;
  try {
    table = toml::parse_file(file);
  } catch (const toml::parse_error& error) {
    fail(file, error.source(), std::string(error.description()));
  }
  Camera camera;
  for (const auto& [key, node] : table) read_key(camera, file, key.str(), node);
  for (const char* key : {"eye", "target"}) {
    if (!table.contains(key)) throw InputError(fmt::format("{}: {} = [x, y, z] is missing", file, key));
  }
  try {
    camera_rays(camera);
  } catch (const InputError& error) {
    throw InputError(fmt::format("{}: {}", file, error.what()));
  }
  return camera;
}

void save_camera(const std::filesystem::path& path, const Camera& camera) {
  const auto list = [](const DVec3& v) { return fmt::format("[{}, {}, {}]", v.x, v.y, v.z); };
  const std::string text =
      fmt::format("eye = {}\ntarget = {}\nup = {}\nfov = {}  # vertical, degrees\nsize = [{}, {}]\n", list(camera.eye),
                  list(camera.target), list(camera.up), camera.fov, camera.width, camera.height);
  write_file_atomically(path, text);
}

}  // namespace isoskin
