#include "render/raytrace.h"

#include <tbb/parallel_for.h>

#include <chrono>
#include <cmath>
#include <limits>

#include "render/embree_scene.h"
#include "render/rasterize.h"
#include "render/ray_root.h"

namespace isoskin {
namespace {

using Clock = std::chrono::steady_clock;

constexpr float kInfinity = std::numeric_limits<float>::infinity();
// Embree works in float32 relative to the eye: boxes grow by this share of their distance so that no ray slips by.
constexpr double kFloatSlack = 1e-6;
// Pieces of ray reach this share of a box beyond it, so that a zero on a face between boxes belongs to one at least.
constexpr double kOverlap = 1e-6;

double milliseconds_since(Clock::time_point begin) {
  return std::chrono::duration<double, std::milli>(Clock::now() - begin).count();
}

RTCRayHit ray_from_eye(const DVec3& direction, double near_depth) {
  RTCRayHit ray{};
  const Vec3 d(direction);
  ray.ray.dir_x = d.x;
  ray.ray.dir_y = d.y;
  ray.ray.dir_z = d.z;
  ray.ray.tnear = static_cast<float>(near_depth);
  ray.ray.tfar = kInfinity;
  ray.ray.mask = ~0u;
  ray.hit.geomID = RTC_INVALID_GEOMETRY_ID;
  return ray;
}

// What a ray found, in float64.
struct Hit {
  double depth = std::numeric_limits<double>::infinity();
  DVec3 normal{0.0};
  DVec3 rest{0.0};
  bool back = false;
};

Image empty_image(const CameraRays& rays, bool with_rest) {
  Image image{rays.width, rays.height, {}};
  for (const char* name : {"A", "P.X", "P.Y", "P.Z", "N.X", "N.Y", "N.Z", "back"}) image.add(name);
  if (with_rest) {
    for (const char* name : {"rest.X", "rest.Y", "rest.Z"}) image.add(name);
  }
  image.add("Z", kInfinity);
  return image;
}

// Calls shoot(direction, row) -> Hit for every pixel and fills the channels.
template <class Shoot>
Image trace_pixels(const CameraRays& rays, bool with_rest, const Shoot& shoot) {
  Image image = empty_image(rays, with_rest);
  auto &a = image.at("A"), &z = image.at("Z"), &back = image.at("back");
  const auto store = [&](const char* layer, std::size_t pixel, const DVec3& v) {
    static constexpr const char* kAxis[] = {".X", ".Y", ".Z"};
    for (int axis = 0; axis < 3; ++axis)
      image.at(std::string(layer) + kAxis[axis])[pixel] = static_cast<float>(v[axis]);
  };
  tbb::parallel_for(0, rays.height, [&](int y) {
    for (int x = 0; x < rays.width; ++x) {
      const DVec3 direction = rays.direction(x, y);
      const Hit hit = shoot(direction, y);
      if (!std::isfinite(hit.depth)) continue;
      const std::size_t pixel = static_cast<std::size_t>(y) * rays.width + x;
      a[pixel] = 1.0f;
      z[pixel] = static_cast<float>(hit.depth);
      back[pixel] = hit.back ? 1.0f : 0.0f;
      store("P", pixel, rays.eye + hit.depth * direction);
      store("N", pixel, hit.normal);
      if (with_rest) store("rest", pixel, hit.rest);
    }
  });
  return image;
}

std::size_t count_hits(const Image& image) {
  std::size_t hits = 0;
  for (const float a : image.at("A")) hits += a > 0.0f;
  return hits;
}

struct FieldScene {
  const SurfaceBoxes& boxes;
  DVec3 eye;
  double near_depth;
  double shortest;                      // share of a box's side
  std::vector<std::size_t> elements{};  // of each box's field

  double shortest_in(const Box& box) const { return shortest * (boxes.side > 0.0 ? boxes.side : box.size().x); }
};

struct Cost {
  std::size_t evaluations = 0, bounds = 0, elements = 0;
};

// A field that counts what it is asked for.
class CountedField final : public Field {
public:
  CountedField(const Field& field, std::size_t elements, Cost& cost)
      : field_(field), elements_(elements), cost_(cost) {}
  FieldSample sample(const DVec3& p) const override {
    ++cost_.evaluations;
    cost_.elements += elements_;
    return field_.sample(p);
  }
  double value(const DVec3& p) const override {
    ++cost_.evaluations;
    cost_.elements += elements_;
    return field_.value(p);
  }
  Box bounds() const override { return field_.bounds(); }
  Interval range(const Box& box) const override {
    ++cost_.bounds;
    cost_.elements += elements_;
    return field_.range(box);
  }

private:
  const Field& field_;
  std::size_t elements_;
  Cost& cost_;
};

// Embree hands this to the callbacks with every ray.
struct FieldRay {
  RTCIntersectContext context;
  DVec3 direction;
  double depth;  // of the nearest zero so far
  Cost* cost;
};

float rounded_down(double x) {
  return std::nextafter(static_cast<float>(x), -kInfinity);
}
float rounded_up(double x) {
  return std::nextafter(static_cast<float>(x), kInfinity);
}

void box_bounds(const RTCBoundsFunctionArguments* arguments) {
  const auto& scene = *static_cast<const FieldScene*>(arguments->geometryUserPtr);
  const Box& box = scene.boxes.boxes[arguments->primID].box;
  const DVec3 far_corner = glm::max(glm::abs(box.low - scene.eye), glm::abs(box.high - scene.eye));
  const double slack = kFloatSlack * glm::length(far_corner) + kOverlap * glm::length(box.size());
  const DVec3 low = box.low - scene.eye - slack, high = box.high - scene.eye + slack;
  RTCBounds& out = *arguments->bounds_o;
  out.lower_x = rounded_down(low.x);
  out.lower_y = rounded_down(low.y);
  out.lower_z = rounded_down(low.z);
  out.upper_x = rounded_up(high.x);
  out.upper_y = rounded_up(high.y);
  out.upper_z = rounded_up(high.z);
}

// The part of the ray in the box; empty when end <= begin.
RayPiece clip(const DVec3& eye, const DVec3& direction, const Box& box, double begin, double end) {
  const double overlap = kOverlap * std::max({box.size().x, box.size().y, box.size().z});
  for (int axis = 0; axis < 3; ++axis) {
    const double low = box.low[axis] - overlap - eye[axis], high = box.high[axis] + overlap - eye[axis];
    if (direction[axis] == 0.0) {
      if (low > 0.0 || high < 0.0) end = begin;
      continue;
    }
    const double t0 = low / direction[axis], t1 = high / direction[axis];
    begin = std::max(begin, std::min(t0, t1));
    end = std::min(end, std::max(t0, t1));
  }
  return {eye, direction, begin, end};
}

void intersect_box(const RTCIntersectFunctionNArguments* arguments) {
  if (!arguments->valid[0]) return;
  const auto& scene = *static_cast<const FieldScene*>(arguments->geometryUserPtr);
  auto& ray = *reinterpret_cast<FieldRay*>(arguments->context);
  const SurfaceBox& part = scene.boxes.boxes[arguments->primID];
  const RayPiece piece = clip(scene.eye, ray.direction, part.box, scene.near_depth, ray.depth);
  if (!(piece.end > piece.begin)) return;
  const CountedField field(*part.field, scene.elements[arguments->primID], *ray.cost);
  const auto root = scene.boxes.degree > 0
                        ? first_polynomial_root(field, piece, scene.boxes.degree)
                        : first_root(field, piece, scene.shortest_in(part.box) / glm::length(ray.direction));
  if (!root || !(*root < ray.depth)) return;
  ray.depth = *root;
  // Boxes that overlap at this depth are still visited: the answer does not depend on the order of the hierarchy.
  auto& embree = *reinterpret_cast<RTCRayHit*>(arguments->rayhit);
  embree.ray.tfar = rounded_up(*root * (1.0 + kFloatSlack) + kOverlap * part.box.diagonal());
  embree.hit.geomID = arguments->geomID;
  embree.hit.primID = arguments->primID;
}

Hit shoot_field(RTCScene embree, const Field& field, const FieldScene& scene, const DVec3& direction, Cost& cost) {
  FieldRay ray{{}, direction, std::numeric_limits<double>::infinity(), &cost};
  rtcInitIntersectContext(&ray.context);
  RTCRayHit shot = ray_from_eye(direction, 0.0);  // boxes about the near depth count; clip() cuts there
  rtcIntersect1(embree, &ray.context, &shot);
  if (shot.hit.geomID == RTC_INVALID_GEOMETRY_ID) return {};
  const DVec3 normal = outward_normal(field.sample(scene.eye + ray.depth * direction).gradient);
  return {ray.depth, normal, DVec3(0.0), glm::dot(normal, direction) > 0.0};
}

RTCGeometry box_geometry(const EmbreeDevice& device, FieldScene& scene) {
  RTCGeometry geometry = rtcNewGeometry(device.get(), RTC_GEOMETRY_TYPE_USER);
  rtcSetGeometryUserPrimitiveCount(geometry, static_cast<unsigned>(scene.boxes.boxes.size()));
  rtcSetGeometryUserData(geometry, &scene);
  rtcSetGeometryBoundsFunction(geometry, box_bounds, nullptr);
  rtcSetGeometryIntersectFunction(geometry, intersect_box);
  return geometry;
}

Hit shoot_mesh(RTCScene embree, const TriangleMesh& mesh, std::span<const Vec3> normals, const CameraRays& rays,
               const DVec3& direction) {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  RTCRayHit shot = ray_from_eye(direction, rays.near_depth);
  rtcIntersect1(embree, &context, &shot);
  if (shot.hit.geomID == RTC_INVALID_GEOMETRY_ID) return {};
  const Index* v = &mesh.vertex[3 * std::size_t{shot.hit.primID}];
  const double u = shot.hit.u, w = shot.hit.v;
  const auto blend = [&](const auto& column) {
    return (1.0 - u - w) * DVec3(column[v[0]]) + u * DVec3(column[v[1]]) + w * DVec3(column[v[2]]);
  };
  const auto& p = mesh.vertices.position;
  const DVec3 outward = glm::cross(DVec3(p[v[1]]) - DVec3(p[v[0]]), DVec3(p[v[2]]) - DVec3(p[v[0]]));
  const DVec3 smooth = blend(normals);
  const DVec3 normal = glm::length(smooth) > 1e-6 ? smooth : outward;
  const double length = glm::length(normal);
  return {rays.depth(blend(p)), length > 0.0 ? normal / length : DVec3(0.0), blend(mesh.vertices.rest),
          glm::dot(outward, direction) > 0.0};
}

}  // namespace

Raytraced raytrace(const Field& field, const Camera& camera, const RaytraceOptions& options) {
  camera_rays(camera);  // throws what is wrong with it
  const auto begin = Clock::now();
  const SurfaceBoxes boxes = surface_boxes(field, options.boxes);
  const double took = milliseconds_since(begin);
  Raytraced out = raytrace(field, boxes, camera, options);
  out.report.build_ms += took;
  return out;
}

Raytraced raytrace(const Field& field, const SurfaceBoxes& boxes, const Camera& camera,
                   const RaytraceOptions& options) {
  const CameraRays rays = camera_rays(camera);
  const auto begin = Clock::now();
  FieldScene scene{boxes, rays.eye, rays.near_depth, options.shortest};
  for (const SurfaceBox& part : boxes.boxes) scene.elements.push_back(element_count(*part.field));
  const EmbreeDevice device;
  const EmbreeScene embree(device, box_geometry(device, scene));
  Raytraced out;
  out.report.boxes = boxes.boxes.size();
  out.report.build_ms = milliseconds_since(begin);

  const auto traced = Clock::now();
  std::vector<Cost> cost(std::size_t(rays.height));  // of each row
  out.image = trace_pixels(rays, false, [&](const DVec3& direction, int row) {
    return shoot_field(embree.get(), field, scene, direction, cost[std::size_t(row)]);
  });
  out.report.trace_ms = milliseconds_since(traced);
  out.report.hits = count_hits(out.image);
  for (const Cost& c : cost) {
    out.report.evaluations += c.evaluations;
    out.report.bounds += c.bounds;
    out.report.elements += c.elements;
  }
  return out;
}

Raytraced raytrace(const TriangleMesh& mesh, std::span<const Vec3> normals, const Camera& camera) {
  if (!normals.empty() && normals.size() != mesh.vertex_count()) {
    throw std::invalid_argument("raytrace: expected one normal a vertex");
  }
  const CameraRays rays = camera_rays(camera);
  const auto begin = Clock::now();
  const std::vector<Vec3> own = normals.empty() ? area_weighted_normals(mesh) : std::vector<Vec3>{};
  const std::span<const Vec3> used = normals.empty() ? std::span<const Vec3>(own) : normals;
  const EmbreeDevice device;
  const EmbreeScene embree(device, triangle_geometry(device, mesh, rays.eye));
  Raytraced out;
  out.report.boxes = mesh.triangle_count();
  out.report.build_ms = milliseconds_since(begin);

  const auto traced = Clock::now();
  out.image = trace_pixels(
      rays, true, [&](const DVec3& direction, int) { return shoot_mesh(embree.get(), mesh, used, rays, direction); });
  out.report.trace_ms = milliseconds_since(traced);
  out.report.hits = count_hits(out.image);
  return out;
}

}  // namespace isoskin
