#include "render/raytrace.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "core/field/blend_graph.h"
#include "core/field/grid_field.h"
#include "core/field/skeleton_field.h"
#include "render/rasterize.h"
#include "tests/analytic_fields.h"
#include "tests/test_meshes.h"

using namespace isoskin;

namespace {

Vec3 vector_at(const Image& image, const char* layer, std::size_t pixel) {
  return VectorChannels(image, layer)[pixel];
}

// The larger of two fields: their union.
class UnionField final : public Field {
public:
  UnionField(const Field& a, const Field& b) : a_(a), b_(b) {}
  FieldSample sample(const DVec3& p) const override {
    const FieldSample a = a_.sample(p), b = b_.sample(p);
    return a.value > b.value ? a : b;
  }
  Box bounds() const override {
    Box box = a_.bounds();
    box.add(b_.bounds());
    return box;
  }
  Interval range(const Box& box) const override {
    const Interval a = a_.range(box), b = b_.range(box);
    return {std::max(a.low, b.low), std::max(a.high, b.high)};
  }

private:
  const Field &a_, &b_;
};

// F = half - |z| between x and y = -1 .. 1, with a resolution of its own.
class SlabField final : public Field {
public:
  SlabField(double half, double h) : half_(half), h_(h) {}
  FieldSample sample(const DVec3& p) const override {
    return {half_ - std::abs(p.z), DVec3(0.0, 0.0, p.z > 0.0 ? -1.0 : 1.0)};
  }
  Box bounds() const override { return {{-1, -1, -half_}, {1, 1, half_}}; }
  Interval range(const Box& box) const override {
    const double most = std::max(std::abs(box.low.z), std::abs(box.high.z));
    const double least = std::max({box.low.z, -box.high.z, 0.0});
    return {half_ - most, half_ - least};
  }
  double resolution() const override { return h_; }

private:
  double half_, h_;
};

// Hides what a field is, so that the tracer must treat it as any other.
class Veiled final : public Field {
public:
  explicit Veiled(const Field& field) : field_(field) {}
  FieldSample sample(const DVec3& p) const override { return field_.sample(p); }
  double value(const DVec3& p) const override { return field_.value(p); }
  Box bounds() const override { return field_.bounds(); }
  Interval range(const Box& box) const override { return field_.range(box); }

private:
  const Field& field_;
};

// One brick of given taps; beyond it the field is -1.
template <class Tap>
GridField one_brick(Interpolation interpolation, double h, const Tap& tap) {
  auto grid = std::make_shared<BrickGrid>();
  grid->origin = {0.1, -0.2, 0.3};
  grid->h = h;
  grid->interpolation = interpolation;
  grid->table_size = IVec3(1);
  grid->table = {0};
  grid->outside = -1.0f;
  grid->brick_coordinate = {IVec3(0)};
  for (int x = -1; x <= 9; ++x) {
    for (int y = -1; y <= 9; ++y) {
      for (int z = -1; z <= 9; ++z) grid->tap.push_back(static_cast<float>(tap(x, y, z)));
    }
  }
  return GridField(grid);
}

GridField random_brick(Interpolation interpolation, unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> real(-1.0, 0.6);
  return one_brick(interpolation, 0.5, [&](int, int, int) { return real(random); });
}

// What dense sampling of F along each ray finds. It may step over thin parts: the tracer may be nearer, never farther,
// and where it is nearer F must change sign there.
void expect_first_hits(const Field& field, const Camera& camera, const Image& image, const Box& region, double step) {
  const CameraRays rays = camera_rays(camera);
  std::size_t hits = 0, earlier = 0;
  for (int y = 0; y < camera.height; ++y) {
    for (int x = 0; x < camera.width; ++x) {
      const std::size_t pixel = static_cast<std::size_t>(y) * camera.width + x;
      const DVec3 d = rays.direction(x, y);
      double begin = rays.near_depth, end = 1e30;
      for (int axis = 0; axis < 3; ++axis) {
        const double a = (region.low[axis] - rays.eye[axis]) / d[axis],
                     b = (region.high[axis] - rays.eye[axis]) / d[axis];
        begin = std::max(begin, std::min(a, b));
        end = std::min(end, std::max(a, b));
      }
      double first = std::numeric_limits<double>::infinity();
      const bool start = end > begin && field.value(rays.eye + begin * d) > 0.0;
      for (double t = begin; t < end && first > end; t += step) {
        if ((field.value(rays.eye + t * d) > 0.0) != start) first = t;
      }
      const double z = image.at("Z")[pixel];
      if (std::isfinite(first)) {
        ASSERT_LE(z, first + 1e-5) << x << ", " << y;
      }
      if (!std::isfinite(z)) continue;
      ++hits;
      ASSERT_GE(z, begin - 1e-5);
      const double slope = std::max(1e-3, std::abs(glm::dot(field.sample(rays.eye + z * d).gradient, d)));
      ASSERT_LE(std::abs(field.value(rays.eye + z * d)), 3e-6 * std::max(1.0, slope) + 1e-6) << x << ", " << y;
      earlier += z < first - 2.0 * step;
    }
  }
  EXPECT_GT(hits, static_cast<std::size_t>(camera.width * camera.height / 10));
  EXPECT_LT(earlier, hits / 20);
}

}  // namespace

TEST(Raytrace, ASphereIsExact) {
  const DVec3 center(0.2, -0.1, 0.4);
  const Camera camera{{0.3, -4, 0.8}, {0, 0, 0}, {0, 0, 1}, 40.0, 160, 120};
  const CameraRays rays = camera_rays(camera);
  const Raytraced traced = raytrace(analytic::SphereField(center, 0.9), camera);
  std::size_t covered = 0;
  for (int y = 0; y < camera.height; ++y) {
    for (int x = 0; x < camera.width; ++x) {
      const std::size_t pixel = static_cast<std::size_t>(y) * camera.width + x;
      const DVec3 d = rays.direction(x, y), from = rays.eye - center;
      const double a = glm::dot(d, d), b = glm::dot(from, d);
      const double discriminant = b * b - a * (glm::dot(from, from) - 0.81);
      if (std::abs(discriminant) < 1e-6) continue;  // grazes the silhouette
      ASSERT_EQ(traced.image.at("A")[pixel], discriminant > 0.0 ? 1.0f : 0.0f) << x << ", " << y;
      if (discriminant < 0.0) {
        ASSERT_EQ(traced.image.at("Z")[pixel], std::numeric_limits<float>::infinity());
        continue;
      }
      ++covered;
      const double depth = (-b - std::sqrt(discriminant)) / a;
      const DVec3 p = rays.eye + depth * d;
      ASSERT_NEAR(traced.image.at("Z")[pixel], depth, 1e-6);
      ASSERT_LT(glm::length(DVec3(vector_at(traced.image, "P", pixel)) - p), 2e-6);
      ASSERT_LT(glm::length(DVec3(vector_at(traced.image, "N", pixel)) - (p - center) / 0.9), 2e-6);
      ASSERT_EQ(traced.image.at("back")[pixel], 0.0f);
    }
  }
  EXPECT_GT(covered, 3000u);
  EXPECT_NEAR(static_cast<double>(traced.report.hits), static_cast<double>(covered), 5.0);
}

TEST(Raytrace, ATorusHasItsFirstHits) {
  const analytic::TorusField torus(1.0, 0.3);
  const Camera camera{{0.2, -3, 1.6}, {0, 0, 0}, {0, 0, 1}, 44.0, 90, 70};
  const Image image = raytrace(torus, camera).image;
  expect_first_hits(torus, camera, image, torus.bounds(), 1e-3);
}

TEST(Raytrace, ASlabATenthOfACellThickIsNeverMissed) {
  const double h = 0.125, half = 0.05 * h;
  for (const DVec3 eye : {DVec3(0.3, -3, 2), DVec3(1, -4, 0.2), DVec3(0.1, 0.2, 5), DVec3(0.5, -4, -0.04)}) {
    const Camera camera{eye, {0, 0, 0}, {0, 1, 0.1}, 30.0, 80, 80};
    const CameraRays rays = camera_rays(camera);
    const Image image = raytrace(SlabField(half, h), camera).image;
    std::size_t hits = 0;
    for (int y = 0; y < 80; ++y) {
      for (int x = 0; x < 80; ++x) {
        const DVec3 d = rays.direction(x, y);
        const double depth = (std::copysign(half, eye.z) - eye.z) / d.z;
        const DVec3 p = eye + depth * d;
        // Where the ray enters by the slab's face; its sides are cut off by the bounds.
        const double room = 1.0 - std::max(std::abs(p.x), std::abs(p.y));
        if (!(depth > 0.0) || room < 1e-3) continue;
        ++hits;
        ASSERT_NEAR(image.at("Z")[static_cast<std::size_t>(y) * 80 + x], depth, 2e-6 * depth) << x << ", " << y;
      }
    }
    EXPECT_GT(hits, 30u);
  }
}

TEST(Raytrace, ASplineSheetATenthOfACellThickIsNeverMissed) {
  // Taps k^2 make the spline z^2 + 1/3, so F = half^2 - (z - middle)^2 in voxels.
  const double h = 0.25, middle = 4.37, half = 0.05;
  const GridField sheet = one_brick(
      Interpolation::cubic, h, [&](int, int, int z) { return half * half + 1.0 / 3.0 - (z - middle) * (z - middle); });
  const DVec3 origin = sheet.grid()->origin;
  const Camera camera{origin + h * DVec3(4, -16, 9), origin + h * DVec3(4, 4, 4), {0, 0, 1}, 24.0, 90, 90};
  const CameraRays rays = camera_rays(camera);
  const Image image = raytrace(sheet, camera).image;
  std::size_t hits = 0;
  for (int y = 0; y < 90; ++y) {
    for (int x = 0; x < 90; ++x) {
      const DVec3 d = rays.direction(x, y);
      const double depth = (origin.z + h * (middle + half) - camera.eye.z) / d.z;
      const DVec3 voxel = (camera.eye + depth * d - origin) / h;
      if (!(depth > 0.0) || std::min({voxel.x, voxel.y, 8 - voxel.x, 8 - voxel.y}) < 0.01) continue;
      ++hits;
      // float32 taps of size 20 carry errors of 1e-6, the slope at the sheet is 0.1: 1e-5 voxel, more at a slant.
      ASSERT_NEAR(image.at("Z")[static_cast<std::size_t>(y) * 90 + x], depth, 1e-3 * h) << x << ", " << y;
    }
  }
  EXPECT_GT(hits, 500u);
}

TEST(Raytrace, ATinySphereBesideALargeOneIsSeen) {
  const analytic::SphereField large(DVec3(0.0), 1.0), tiny(DVec3(1.4, 0.0, 0.0), 0.001);
  const UnionField both(large, tiny);
  const Camera camera{{1.4, -0.5, 0}, {1.4, 0, 0}, {0, 0, 1}, 0.5, 32, 32};  // 32 pixels on 0.0044
  const CameraRays rays = camera_rays(camera);
  const Image image = raytrace(both, camera).image;
  for (int y = 0; y < 32; ++y) {
    for (int x = 0; x < 32; ++x) {
      const DVec3 d = rays.direction(x, y), from = rays.eye - DVec3(1.4, 0, 0);
      const double a = glm::dot(d, d), b = glm::dot(from, d);
      const double discriminant = b * b - a * (glm::dot(from, from) - 1e-6);
      if (std::abs(discriminant) < 1e-8) continue;
      ASSERT_EQ(image.at("A")[static_cast<std::size_t>(y) * 32 + x] > 0.0f, discriminant > 0.0) << x << ", " << y;
    }
  }
}

TEST(Raytrace, RandomSplinesHaveTheirFirstHits) {
  for (const auto interpolation : {Interpolation::cubic, Interpolation::linear}) {
    const GridField field = random_brick(interpolation, 5);
    const DVec3 low = field.grid()->origin, high = low + 8.0 * field.grid()->h;
    const Camera camera = frame_box({low, high}, 48, 40);
    expect_first_hits(field, camera, raytrace(field, camera).image, Box{low, high}.grown(-1e-7), 0.5 / 300.0);
  }
}

TEST(Raytrace, SkeletonsLookTheSameWholeAndInParts) {
  std::vector<SkeletonElement> elements;
  for (int i = 0; i < 12; ++i) {
    const DVec3 a(std::cos(0.9 * i), std::sin(0.9 * i), 0.15 * i - 0.8);
    elements.push_back({a, i % 3 ? a : a + DVec3(0.3, 0, 0.3), 0.6, i == 4 ? -0.5 : 1.0, 2.0,
                        i % 2 ? Potential::metaball : Potential::wyvill});
  }
  const SkeletonField field(elements, 0.2);
  const Camera camera = frame_box(field.bounds(), 64, 48);
  const Image parts = raytrace(field, camera).image, whole = raytrace(Veiled(field), camera).image;
  EXPECT_EQ(parts.at("A"), whole.at("A"));
  for (std::size_t pixel = 0; pixel < parts.pixels(); ++pixel) {
    if (parts.at("A")[pixel] == 0.0f) continue;
    ASSERT_NEAR(parts.at("Z")[pixel], whole.at("Z")[pixel], 1e-5);
  }
  expect_first_hits(field, camera, parts, field.bounds(), 2e-3);
}

// Desbrun, Tsingos and Gascuel 1995, section 5: the boxes of the seeds find the same surface as the main box, and ask
// fewer elements, as each box holds those that are felt there.
TEST(Raytrace, BoxesOfSeedsSaveEvaluations) {
  std::vector<SkeletonElement> chain;
  std::vector<BlendEdge> blend;
  for (int i = 0; i < 10; ++i) {
    const DVec3 a(std::cos(0.7 * i), std::sin(0.7 * i), 0.15 * i - 0.8);
    chain.push_back({a, i % 3 ? a : a + DVec3(0.3, 0, 0.3), 0.5, 1.0, 2.0, Potential::metaball});
    if (i > 0) blend.push_back({Index(i - 1), Index(i)});
  }
  chain[4].shape = Shape::triangle;
  chain[4].b = chain[4].a + DVec3(0.2, 0.0, 0.1);
  chain[4].c = chain[4].a + DVec3(0.0, 0.2, 0.0);
  const std::vector<std::shared_ptr<const Field>> fields{std::make_shared<SkeletonField>(chain, 0.2),
                                                         blended(chain, 0.2, blend_groups(chain.size(), blend))};
  for (const std::shared_ptr<const Field>& field : fields) {
    const Camera camera = frame_box(field->bounds(), 64, 48);
    Seeds seeds({.spacing = 0.08});
    const auto backend = make_reference_backend();
    backend->set_field(field);
    seeds.move_to(skeleton_parts(*field), *backend);
    const SurfaceBoxes local = seed_boxes(*field, seeds);
    EXPECT_EQ(local.boxes.size(), chain.size());
    for (const SurfaceBox& b : local.boxes) EXPECT_LT(skeleton_parts(*b.field).elements->size(), chain.size());
    const Raytraced by_seeds = raytrace(*field, local, camera), by_main = raytrace(*field, main_box(*field), camera);
    EXPECT_GT(by_main.report.hits, 300u);
    EXPECT_EQ(by_seeds.image.at("A"), by_main.image.at("A"));
    for (std::size_t pixel = 0; pixel < by_main.image.pixels(); ++pixel)
      if (by_main.image.at("A")[pixel] > 0.0f) {
        ASSERT_NEAR(by_seeds.image.at("Z")[pixel], by_main.image.at("Z")[pixel], 1e-4);
      }
    EXPECT_LT(by_seeds.report.elements, by_main.report.elements * 9 / 10);
  }
}

TEST(Raytrace, FromInsideTheSurfaceIsSeenFromBehind) {
  const Camera camera{{0, 0, 0}, {0, 1, 0}, {0, 0, 1}, 60.0, 20, 20};
  const Image image = raytrace(analytic::SphereField(), camera).image;
  EXPECT_THAT(image.at("A"), ::testing::Each(1.0f));
  EXPECT_THAT(image.at("back"), ::testing::Each(1.0f));
}

TEST(Raytrace, NothingNearerThanTheNearDepthIsSeen) {
  // The eye is 1e-4 outside a sphere of radius 1 and the near depth is 1e-3 * 1: the far side is what remains.
  const Camera camera{{0, -1.0001, 0}, {0, -0.0001, 0}, {0, 0, 1}, 1.0, 3, 3};
  const Image image = raytrace(analytic::SphereField(), camera).image;
  EXPECT_NEAR(image.at("Z")[4], 2.0001, 1e-6);
  EXPECT_EQ(image.at("back")[4], 1.0f);
}

TEST(Raytrace, NoSurfaceGivesAnEmptyImage) {
  const Raytraced traced = raytrace(analytic::SphereField(DVec3(0.0), -1.0), {.width = 8, .height = 8});
  EXPECT_EQ(traced.report.boxes, 0u);
  EXPECT_THAT(traced.image.at("A"), ::testing::Each(0.0f));
  EXPECT_THAT(raytrace(TriangleMesh{}, {}, {.width = 8, .height = 8}).image.at("A"), ::testing::Each(0.0f));
}

TEST(Raytrace, OneThreadOrManySameBytes) {
  const GridField field = random_brick(Interpolation::cubic, 9);
  const DVec3 low = field.grid()->origin;
  const Camera camera = frame_box({low, low + 4.0}, 64, 64);
  const TriangleMesh mesh = test_meshes::torus(80, 40);
  const Camera mesh_camera = frame_box({DVec3(-1.4), DVec3(1.4)}, 64, 64);
  const Image many = raytrace(field, camera).image, mesh_many = raytrace(mesh, {}, mesh_camera).image;
  const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
  EXPECT_EQ(raytrace(field, camera).image.channel, many.channel);
  EXPECT_EQ(raytrace(mesh, {}, mesh_camera).image.channel, mesh_many.channel);
}

TEST(Raytrace, MeshesLookAsTheRasterizerDrawsThem) {
  TriangleMesh mesh = test_meshes::torus(48, 24);
  append(mesh, test_meshes::icosphere(3, 0.5f, Vec3(0.1f, 0.0f, 0.2f)));
  Box box;
  for (const Vec3& p : mesh.vertices.position) box.add(DVec3(p));
  const Camera camera = frame_box(box, 200, 150);
  const Image traced = raytrace(mesh, {}, camera).image, drawn = rasterize(mesh, {}, camera);
  std::size_t differ = 0, covered = 0;
  for (std::size_t pixel = 0; pixel < traced.pixels(); ++pixel) {
    const bool silhouette =
        traced.at("A")[pixel] != drawn.at("A")[pixel] ||
        (traced.at("A")[pixel] > 0.0f && std::abs(traced.at("Z")[pixel] - drawn.at("Z")[pixel]) > 1e-3);
    differ += silhouette;
    if (silhouette || traced.at("A")[pixel] == 0.0f) continue;
    ++covered;
    for (const char* channel : {"Z", "P.X", "P.Y", "P.Z", "N.X", "N.Y", "N.Z", "rest.X", "rest.Y", "rest.Z"}) {
      ASSERT_NEAR(traced.at(channel)[pixel], drawn.at(channel)[pixel], 2e-3) << channel;
    }
    ASSERT_EQ(traced.at("back")[pixel], drawn.at("back")[pixel]);
  }
  EXPECT_LE(differ, 4u);  // centres within OpenGL's 1/256 pixel of a silhouette
  EXPECT_GT(covered, 5000u);
}
