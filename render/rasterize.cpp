#include "render/rasterize.h"

#include <epoxy/gl.h>
#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <array>
#include <limits>

#include "render/gl_context.h"
#include "render/perlin.h"

namespace isoskin {
namespace {

// Positions are in view space: x right, y up, z = depth, relative to the eye, so float32 loses nothing far from the
// origin. Depth is reversed (near / z), which spreads float32 precision evenly.
constexpr char kVisibilityVertex[] = R"(#version 450 core
layout(location = 0) in vec3 position;
uniform vec2 half_size;
uniform float near_depth;
void main() { gl_Position = vec4(position.xy / half_size, near_depth, position.z); }
)";

constexpr char kVisibilityFragment[] = R"(#version 450 core
layout(location = 0) out uint id;
void main() { id = uint(gl_PrimitiveID) + 1u; }
)";

constexpr char kResolveVertex[] = R"(#version 450 core
void main() { gl_Position = vec4(gl_VertexID == 1 ? 3 : -1, gl_VertexID == 2 ? 3 : -1, 0, 1); }
)";

// Meets the ray of the pixel's centre with the plane of the visible triangle.
constexpr char kResolveHead[] = R"(#version 450 core
layout(std430, binding = 4) readonly buffer Permutation { uint permutation[]; };
)";
constexpr char kResolveFragment[] = R"(
layout(std430, binding = 0) readonly buffer Positions { float position[]; };
layout(std430, binding = 1) readonly buffer Normals { float normal[]; };
layout(std430, binding = 2) readonly buffer Rests { float rest[]; };
layout(std430, binding = 3) readonly buffer Corners { uint corner[]; };
layout(binding = 0) uniform usampler2D ids;
uniform vec2 half_size;
uniform vec2 size;
uniform mat3 view_to_world;
layout(location = 0) out vec4 normal_depth;
layout(location = 1) out vec4 rest_back;
layout(location = 2) out vec2 wire_noise;
uniform float over_noise_size;

struct Triangle { vec3 a, ab, ac, n; };

vec3 view_position(uint v) { return vec3(position[3 * v], position[3 * v + 1], position[3 * v + 2]); }
vec3 vertex_normal(uint v) { return vec3(normal[3 * v], normal[3 * v + 1], normal[3 * v + 2]); }
vec3 rest_position(uint v) { return vec3(rest[3 * v], rest[3 * v + 1], rest[3 * v + 2]); }

vec3 ray(vec2 window) { return vec3((2 * window.x / size.x - 1) * half_size.x, (1 - 2 * window.y / size.y) * half_size.y, 1); }

vec3 weights(Triangle t, vec3 direction) {
  vec3 q = dot(t.n, t.a) / dot(t.n, direction) * direction - t.a;
  float nn = dot(t.n, t.n);
  float b = dot(cross(q, t.ac), t.n) / nn;
  float c = dot(cross(t.ab, q), t.n) / nn;
  return vec3(1 - b - c, b, c);
}

void main() {
  uint id = texelFetch(ids, ivec2(gl_FragCoord.xy), 0).r;
  if (id == 0u) discard;
  uvec3 v = uvec3(corner[3 * id - 3], corner[3 * id - 2], corner[3 * id - 1]);
  Triangle t;
  t.a = view_position(v.x);
  t.ab = view_position(v.y) - t.a;
  t.ac = view_position(v.z) - t.a;
  t.n = cross(t.ab, t.ac);
  vec3 direction = ray(gl_FragCoord.xy);
  vec3 w = weights(t, direction);

  // The nearest edge, in pixels: how fast each weight changes from pixel to pixel.
  vec3 dx = weights(t, ray(gl_FragCoord.xy + vec2(1, 0))) - w;
  vec3 dy = weights(t, ray(gl_FragCoord.xy + vec2(0, 1))) - w;
  vec3 pixels = w / sqrt(dx * dx + dy * dy);
  wire_noise = vec2(max(0, min(pixels.x, min(pixels.y, pixels.z))), 0);

  // Window coordinates are snapped to 1/256 pixel, so the centre may lie a hair outside.
  w = max(w, vec3(0));
  w = any(isnan(w)) || any(isinf(w)) ? vec3(1.0 / 3.0) : w / (w.x + w.y + w.z);
  float depth = t.a.z + w.y * t.ab.z + w.z * t.ac.z;

  // (right, up, forward) is left-handed, so the cross product above points inward.
  vec3 outward = -(view_to_world * t.n);
  vec3 n = w.x * vertex_normal(v.x) + w.y * vertex_normal(v.y) + w.z * vertex_normal(v.z);
  n = dot(n, n) > 1e-12 ? n : outward;
  normal_depth = vec4(dot(n, n) > 0 ? normalize(n) : vec3(0), depth);
  vec3 at_rest = w.x * rest_position(v.x) + w.y * rest_position(v.y) + w.z * rest_position(v.z);
  rest_back = vec4(at_rest, dot(t.n, direction) < 0 ? 1 : 0);
  if (over_noise_size > 0) wire_noise.y = fractal_noise(over_noise_size * at_rest);
}
)";

class Program {
public:
  Program(const char* vertex, const std::string& fragment) : id_(glCreateProgram()) {
    attach(GL_VERTEX_SHADER, vertex);
    attach(GL_FRAGMENT_SHADER, fragment.c_str());
    glLinkProgram(id_);
    GLint linked = 0;
    glGetProgramiv(id_, GL_LINK_STATUS, &linked);
    if (!linked) {
      char log[512] = "";
      glGetProgramInfoLog(id_, sizeof log, nullptr, log);
      throw std::runtime_error(fmt::format("rasterizer: the driver rejects a program: {}", log));
    }
  }
  GLint uniform(const char* name) const { return glGetUniformLocation(id_, name); }
  void use() const { glUseProgram(id_); }

private:
  void attach(GLenum kind, const char* source) const {
    const GLuint shader = glCreateShader(kind);
    glShaderSource(shader, 1, &source, nullptr);
    glCompileShader(shader);
    GLint compiled = 0;
    glGetShaderiv(shader, GL_COMPILE_STATUS, &compiled);
    if (!compiled) {
      char log[512] = "";
      glGetShaderInfoLog(shader, sizeof log, nullptr, log);
      throw std::runtime_error(fmt::format("rasterizer: the driver rejects a shader: {}", log));
    }
    glAttachShader(id_, shader);
    glDeleteShader(shader);
  }

  GLuint id_;  // lives as long as the process's context
};

struct Programs {
  Program visibility{kVisibilityVertex, kVisibilityFragment};
  Program resolve{kResolveVertex, std::string(kResolveHead) + kPerlinShader + kResolveFragment};
};

// Made by the first caller, who holds the context.
const Programs& programs() {
  static const Programs made;
  return made;
}

class Buffer {
public:
  template <class T>
  Buffer(const std::vector<T>& data, const char* what) {
    const std::size_t bytes = data.size() * sizeof(T);
    GLint64 limit = 0;
    glGetInteger64v(GL_MAX_SHADER_STORAGE_BLOCK_SIZE, &limit);
    if (bytes > static_cast<std::size_t>(limit)) {
      throw InputError(fmt::format("rasterizer: {} of the mesh take {} MB; this OpenGL driver allows {}", what,
                                   bytes >> 20, limit >> 20));
    }
    glCreateBuffers(1, &id_);
    glNamedBufferStorage(id_, static_cast<GLsizeiptr>(bytes), data.data(), 0);
  }
  ~Buffer() { glDeleteBuffers(1, &id_); }
  Buffer(const Buffer&) = delete;
  Buffer& operator=(const Buffer&) = delete;
  GLuint id() const { return id_; }

private:
  GLuint id_ = 0;
};

class Texture {
public:
  Texture(GLenum format, int width, int height) {
    glCreateTextures(GL_TEXTURE_2D, 1, &id_);
    glTextureStorage2D(id_, 1, format, width, height);
    glTextureParameteri(id_, GL_TEXTURE_MIN_FILTER, GL_NEAREST);
    glTextureParameteri(id_, GL_TEXTURE_MAG_FILTER, GL_NEAREST);
  }
  ~Texture() { glDeleteTextures(1, &id_); }
  Texture(const Texture&) = delete;
  Texture& operator=(const Texture&) = delete;
  GLuint id() const { return id_; }
  std::vector<float> read(GLenum format, std::size_t floats) const {
    std::vector<float> out(floats);
    glGetTextureImage(id_, 0, format, GL_FLOAT, static_cast<GLsizei>(floats * sizeof(float)), out.data());
    return out;
  }

private:
  GLuint id_ = 0;
};

class Framebuffer {
public:
  explicit Framebuffer(std::span<const GLuint> colors, GLuint depth = 0) {
    glCreateFramebuffers(1, &id_);
    std::vector<GLenum> targets;
    for (std::size_t i = 0; i < colors.size(); ++i) {
      targets.push_back(GL_COLOR_ATTACHMENT0 + static_cast<GLenum>(i));
      glNamedFramebufferTexture(id_, targets.back(), colors[i], 0);
    }
    if (depth) glNamedFramebufferTexture(id_, GL_DEPTH_ATTACHMENT, depth, 0);
    glNamedFramebufferDrawBuffers(id_, static_cast<GLsizei>(targets.size()), targets.data());
    if (glCheckNamedFramebufferStatus(id_, GL_FRAMEBUFFER) != GL_FRAMEBUFFER_COMPLETE) {
      throw InputError("rasterizer: this OpenGL driver cannot render to float32 images of that size");
    }
  }
  ~Framebuffer() { glDeleteFramebuffers(1, &id_); }
  Framebuffer(const Framebuffer&) = delete;
  Framebuffer& operator=(const Framebuffer&) = delete;
  void bind() const { glBindFramebuffer(GL_FRAMEBUFFER, id_); }
  void clear_float(int target, std::array<float, 4> value) const {
    glClearNamedFramebufferfv(id_, GL_COLOR, target, value.data());
  }
  GLuint id() const { return id_; }

private:
  GLuint id_ = 0;
};

class VertexArray {
public:
  VertexArray() { glCreateVertexArrays(1, &id_); }
  ~VertexArray() { glDeleteVertexArrays(1, &id_); }
  VertexArray(const VertexArray&) = delete;
  VertexArray& operator=(const VertexArray&) = delete;
  GLuint id() const { return id_; }

private:
  GLuint id_ = 0;
};

struct GpuMesh {
  Buffer positions, normals, rests, corners, permutation;
};

std::vector<Vec3> view_positions(const TriangleMesh& mesh, const CameraRays& rays) {
  std::vector<Vec3> out(mesh.vertex_count());
  tbb::parallel_for(std::size_t{0}, out.size(), [&](std::size_t v) {
    const DVec3 from_eye = DVec3(mesh.position(static_cast<Index>(v))) - rays.eye;
    out[v] = {glm::dot(from_eye, rays.right), glm::dot(from_eye, rays.up), glm::dot(from_eye, rays.forward)};
  });
  return out;
}

// Which triangle each pixel's centre sees, plus one; 0 where none.
void draw_visibility(const GpuMesh& mesh, GLsizei corners, const CameraRays& rays, const Texture& ids) {
  const Texture depth(GL_DEPTH_COMPONENT32F, rays.width, rays.height);
  const std::array colors{ids.id()};
  const Framebuffer frame(colors, depth.id());
  const GLuint nothing[4] = {0, 0, 0, 0};
  const float farthest = 0.0f;
  glClearNamedFramebufferuiv(frame.id(), GL_COLOR, 0, nothing);
  glClearNamedFramebufferfv(frame.id(), GL_DEPTH, 0, &farthest);
  frame.bind();
  glEnable(GL_DEPTH_TEST);
  glDepthFunc(GL_GREATER);

  const VertexArray layout;
  glVertexArrayVertexBuffer(layout.id(), 0, mesh.positions.id(), 0, sizeof(Vec3));
  glEnableVertexArrayAttrib(layout.id(), 0);
  glVertexArrayAttribFormat(layout.id(), 0, 3, GL_FLOAT, GL_FALSE, 0);
  glVertexArrayElementBuffer(layout.id(), mesh.corners.id());
  glBindVertexArray(layout.id());
  const Program& program = programs().visibility;
  program.use();
  glUniform2f(program.uniform("half_size"), static_cast<float>(rays.half_width), static_cast<float>(rays.half_height));
  glUniform1f(program.uniform("near_depth"), static_cast<float>(rays.near_depth));
  glDrawElements(GL_TRIANGLES, corners, GL_UNSIGNED_INT, nullptr);
}

void draw_attributes(const GpuMesh& mesh, const CameraRays& rays, const Texture& ids, const Framebuffer& frame,
                     double noise_size) {
  frame.clear_float(0, {0, 0, 0, std::numeric_limits<float>::infinity()});
  frame.clear_float(1, {0, 0, 0, 0});
  frame.clear_float(2, {0, 0, 0, 0});
  frame.bind();
  glDisable(GL_DEPTH_TEST);
  const GLuint buffers[] = {mesh.positions.id(), mesh.normals.id(), mesh.rests.id(), mesh.corners.id(),
                            mesh.permutation.id()};
  glBindBuffersBase(GL_SHADER_STORAGE_BUFFER, 0, 5, buffers);
  glBindTextureUnit(0, ids.id());
  const VertexArray none;
  glBindVertexArray(none.id());
  const Program& program = programs().resolve;
  program.use();
  const glm::mat3 view_to_world(rays.right, rays.up, rays.forward);
  glUniform2f(program.uniform("half_size"), static_cast<float>(rays.half_width), static_cast<float>(rays.half_height));
  glUniform2f(program.uniform("size"), static_cast<float>(rays.width), static_cast<float>(rays.height));
  glUniform1f(program.uniform("over_noise_size"), noise_size > 0.0 ? static_cast<float>(1.0 / noise_size) : 0.0f);
  glUniformMatrix3fv(program.uniform("view_to_world"), 1, GL_FALSE, &view_to_world[0][0]);
  glDrawArrays(GL_TRIANGLES, 0, 3);
}

Image empty_image(const CameraRays& rays, const RasterizeOptions& options) {
  Image image{rays.width, rays.height, {}};
  for (const char* name : {"A", "P.X", "P.Y", "P.Z", "N.X", "N.Y", "N.Z", "rest.X", "rest.Y", "rest.Z", "back"}) {
    image.add(name);
  }
  image.add("Z", std::numeric_limits<float>::infinity());
  if (options.wire) image.add("wire");
  if (options.noise_size > 0.0) image.add("noise");
  return image;
}

void fill_image(Image& image, const CameraRays& rays, const std::vector<float>& normal_depth,
                const std::vector<float>& rest_back) {
  auto &a = image.at("A"), &z = image.at("Z"), &back = image.at("back");
  std::array position{&image.at("P.X"), &image.at("P.Y"), &image.at("P.Z")};
  std::array normal{&image.at("N.X"), &image.at("N.Y"), &image.at("N.Z")};
  std::array rest{&image.at("rest.X"), &image.at("rest.Y"), &image.at("rest.Z")};
  tbb::parallel_for(0, rays.height, [&](int y) {
    for (int x = 0; x < rays.width; ++x) {
      const std::size_t pixel = static_cast<std::size_t>(y) * rays.width + x;
      const float depth = normal_depth[4 * pixel + 3];
      if (depth == std::numeric_limits<float>::infinity()) continue;
      a[pixel] = 1.0f;
      z[pixel] = depth;
      back[pixel] = rest_back[4 * pixel + 3];
      const DVec3 p = rays.eye + static_cast<double>(depth) * rays.direction(x, y);
      for (int axis = 0; axis < 3; ++axis) {
        (*position[axis])[pixel] = static_cast<float>(p[axis]);
        (*normal[axis])[pixel] = normal_depth[4 * pixel + axis];
        (*rest[axis])[pixel] = rest_back[4 * pixel + axis];
      }
    }
  });
}

}  // namespace

Image rasterize(const TriangleMesh& mesh, std::span<const Vec3> normals, const Camera& camera,
                const RasterizeOptions& options) {
  if (!normals.empty() && normals.size() != mesh.vertex_count()) {
    throw std::invalid_argument("rasterize: expected one normal a vertex");
  }
  const CameraRays rays = camera_rays(camera);
  Image image = empty_image(rays, options);
  if (mesh.empty()) return image;

  const std::vector<Vec3> own =
      normals.empty() ? area_weighted_normals(mesh) : std::vector(normals.begin(), normals.end());
  const GlCurrent current;
  glViewport(0, 0, rays.width, rays.height);
  glClipControl(GL_UPPER_LEFT, GL_ZERO_TO_ONE);
  const GpuMesh gpu{{view_positions(mesh, rays), "positions"},
                    {own, "normals"},
                    {mesh.vertices.rest, "rest positions"},
                    {mesh.vertex, "triangles"},
                    {std::vector(kPerlinPermutation.begin(), kPerlinPermutation.end()), "permutation"}};
  const Texture ids(GL_R32UI, rays.width, rays.height);
  draw_visibility(gpu, static_cast<GLsizei>(mesh.vertex.size()), rays, ids);
  const Texture normal_depth(GL_RGBA32F, rays.width, rays.height), rest_back(GL_RGBA32F, rays.width, rays.height);
  const Texture wire_noise(GL_RG32F, rays.width, rays.height);
  const std::array targets{normal_depth.id(), rest_back.id(), wire_noise.id()};
  const Framebuffer frame(targets);
  draw_attributes(gpu, rays, ids, frame, options.noise_size);
  fill_image(image, rays, normal_depth.read(GL_RGBA, 4 * image.pixels()), rest_back.read(GL_RGBA, 4 * image.pixels()));
  const auto read_half = [&](const char* name, std::size_t half) {
    const std::vector<float> both = wire_noise.read(GL_RG, 2 * image.pixels());
    std::vector<float>& channel = image.at(name);
    for (std::size_t pixel = 0; pixel < channel.size(); ++pixel) channel[pixel] = both[2 * pixel + half];
  };
  if (options.wire) read_half("wire", 0);
  if (options.noise_size > 0.0) read_half("noise", 1);
  if (const GLenum error = glGetError(); error != GL_NO_ERROR) {
    throw InputError(fmt::format("rasterizer: OpenGL error {:#x} for {} triangles at {} x {} pixels", error,
                                 mesh.triangle_count(), rays.width, rays.height));
  }
  return image;
}

std::vector<Vec3> area_weighted_normals(const TriangleMesh& mesh) {
  std::vector<DVec3> sum(mesh.vertex_count(), DVec3(0.0));
  for (std::size_t t = 0; t < mesh.triangle_count(); ++t) {
    const Index* v = &mesh.vertex[3 * t];
    const DVec3 a(mesh.position(v[0])), b(mesh.position(v[1])), c(mesh.position(v[2]));
    const DVec3 normal = glm::cross(b - a, c - a);
    for (int i = 0; i < 3; ++i) sum[v[i]] += normal;
  }
  std::vector<Vec3> unit(sum.size());
  for (std::size_t v = 0; v < sum.size(); ++v) {
    const double length = glm::length(sum[v]);
    unit[v] = length > 0.0 ? Vec3(sum[v] / length) : Vec3(0.0f);
  }
  return unit;
}

}  // namespace isoskin
