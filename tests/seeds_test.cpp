// Desbrun, Tsingos and Gascuel 1995: seeds, scales, pieces, boxes.
#include "core/seeds/seeds.h"

#include <cmath>

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include "core/field/blend_graph.h"
#include "core/io/ply.h"
#include "core/mesh/validate.h"
#include "tests/analytic_fields.h"
#include "tests/program.h"

namespace isoskin {
namespace {

SeedOptions spaced(double spacing) {
  SeedOptions options;
  options.spacing = spacing;
  return options;
}

struct Object {
  std::shared_ptr<const Field> field;
  std::unique_ptr<Backend> backend = make_reference_backend();
  Seeds seeds = Seeds(spaced(0.12));
  SeedReport report;

  explicit Object(std::vector<SkeletonElement> elements) { move(std::move(elements)); }
  void move(std::vector<SkeletonElement> elements) {
    field = std::make_shared<SkeletonField>(std::move(elements), 0.3);
    backend->set_field(field);
    report = seeds.move_to(skeleton_parts(*field), *backend);
  }
};

SkeletonElement ball(const DVec3& at, double radius = 1.0) {
  SkeletonElement e;
  e.a = e.b = at;
  e.radius = radius;
  return e;
}

SkeletonElement rod(const DVec3& a, const DVec3& b, double radius = 0.6) {
  SkeletonElement e;
  e.a = a;
  e.b = b;
  e.radius = radius;
  return e;
}

std::vector<SkeletonElement> chain(const DVec3& at) {
  return {ball(at), rod(at + DVec3(0.5, 0.1, 0.0), at + DVec3(1.4, 0.6, 0.2)), ball(at + DVec3(1.8, 0.8, 0.4), 0.8)};
}

TEST(Seeds, ValidOnesLieOnTheSurfaceWhereTheirElementIsPreponderant) {
  const Object object(chain(DVec3(0.0)));
  EXPECT_EQ(object.report.lost, 0u);
  std::size_t valid = 0;
  const auto& elements = *skeleton_parts(*object.field).elements;
  for (std::size_t s = 0; s < object.seeds.position().size(); ++s) {
    if (!object.seeds.valid()[s]) continue;
    ++valid;
    const DVec3 p(object.seeds.position()[s]);
    EXPECT_LT(object.field->distance_estimate(p), 1e-3 * 0.12);
    const double own = SkeletonField({elements[object.seeds.element()[s]]}, 0.0).value(p);
    for (const SkeletonElement& e : elements) EXPECT_LE(SkeletonField({e}, 0.0).value(p), own);
  }
  EXPECT_EQ(valid, object.report.valid);
  EXPECT_GT(valid, 400u);
  EXPECT_LT(valid, object.report.seeds);  // those inside a neighbour are not
}

TEST(Seeds, CoverTheWholeSurface) {
  const Object object(chain(DVec3(0.0)));
  // of random points of the surface the nearest seed is never farther than two spacings
  for (int i = 0; i < 200; ++i) {
    const double z = -0.99 + 1.98 * i / 199.0, turn = 2.4 * i;
    const DVec3 direction(std::sqrt(1.0 - z * z) * std::cos(turn), std::sqrt(1.0 - z * z) * std::sin(turn), z);
    const DVec3 middle(0.9, 0.4, 0.2);
    double low = 0.0, high = 4.0;
    for (int k = 0; k < 50; ++k) {
      const double m = 0.5 * (low + high);
      (object.field->value(middle + m * direction) > 0.0 ? low : high) = m;
    }
    double nearest = 1e9;
    for (std::size_t s = 0; s < object.seeds.position().size(); ++s)
      if (object.seeds.valid()[s])
        nearest = std::min(nearest, glm::distance(DVec3(object.seeds.position()[s]), middle + low * direction));
    EXPECT_LT(nearest, 0.24);
  }
}

TEST(Seeds, ARigidMotionMovesThemAndCostsNoSearch) {
  Object object(chain(DVec3(0.0)));
  const std::vector<Vec3> before = object.seeds.position();
  const std::size_t valid = object.report.valid;
  object.move(chain(DVec3(3.0, 0.0, 0.0)));
  EXPECT_EQ(object.report.valid, valid);
  for (std::size_t s = 0; s < before.size(); ++s) {
    if (!object.seeds.valid()[s]) continue;
    EXPECT_LT(glm::distance(object.seeds.position()[s], before[s] + Vec3(3, 0, 0)), 1e-3f);
  }
}

TEST(Seeds, AreValidAgainOnceTheObjectBreaks) {
  Object object({ball(DVec3(-0.3, 0.0, 0.0)), ball(DVec3(0.3, 0.0, 0.0))});
  const std::size_t all = object.report.seeds;
  EXPECT_LT(object.report.valid, 9 * all / 10);
  object.move({ball(DVec3(-1.5, 0.0, 0.0)), ball(DVec3(1.5, 0.0, 0.0))});
  EXPECT_EQ(object.report.seeds, all);
  EXPECT_EQ(object.report.valid, all);
}

SkeletonElement plate(const DVec3& at, const DVec3& u, const DVec3& v, double radius = 0.7) {
  SkeletonElement e = rod(at, at + u, radius);
  e.shape = Shape::triangle;
  e.c = at + v;
  return e;
}

SkeletonElement brick(const DVec3& at, const DMat3& frame, const DVec3& size, double radius = 0.5) {
  SkeletonElement e = rod(at, at + size.x * frame[0], radius);
  e.shape = Shape::box;
  e.c = at + size.y * frame[1];
  e.d = at + size.z * frame[2];
  return e;
}

// Alone, an element's surface lies everywhere at one distance from it, where its potential is iso.
TEST(Seeds, OfTrianglesAndBoxesGoAroundThem) {
  const DMat3 frame(DVec3(0.48, 0.6, 0.64), DVec3(0.8, 0.0, -0.6), DVec3(-0.36, 0.8, -0.48));
  const DMat3 mirrored(frame[0], frame[1], -frame[2]);
  for (const SkeletonElement& e :
       {plate({0.1, 0.2, 0.3}, frame[0], 0.3 * frame[0] + 0.8 * frame[1]),
        brick({0.5, 0.0, 0.0}, frame, {1.0, 0.6, 0.4}), brick({0.5, 0.0, 0.0}, mirrored, {1.0, 0.6, 0.4}),
        brick({0.0, 0.0, 1.0}, frame, {1.0, 0.8, 0.0})}) {
    Object object({e});
    EXPECT_EQ(object.report.lost, 0u);
    EXPECT_EQ(object.report.valid, object.report.seeds);
    const double off = e.radius * std::sqrt(1.0 - std::cbrt(0.3));
    Box around;
    for (const Vec3& p : object.seeds.position()) {
      EXPECT_NEAR(glm::length(offset_from(e, DVec3(p)).x), off, 1e-4);
      around.add(DVec3(p));
    }
    const Box whole = extent(e).grown(off);
    for (int i = 0; i < 3; ++i) {  // nearly as far as the surface reaches, on all sides
      EXPECT_NEAR(around.low[i], whole.low[i], 0.12);
      EXPECT_NEAR(around.high[i], whole.high[i], 0.12);
    }
    const TriangleMesh piece = object.seeds.pieces();
    const ValidateReport valid = validate(piece);
    EXPECT_TRUE(valid) << valid.reason;
    EXPECT_GT(mesh_pieces(piece).volume.at(0), 0.0);  // its triangles face outward
    // and turning with the element costs no new grid
    const std::vector<Vec3> before = object.seeds.position();
    SkeletonElement turned = e;
    const auto turn = [](const DVec3& p) { return DVec3(-p.y + 2.0, p.x, p.z); };
    for (DVec3* corner : {&turned.a, &turned.b, &turned.c, &turned.d}) *corner = turn(*corner);
    object.move({turned});
    ASSERT_EQ(object.seeds.position().size(), before.size());
    for (std::size_t s = 0; s < before.size(); ++s)
      EXPECT_LT(glm::distance(DVec3(object.seeds.position()[s]), turn(DVec3(before[s]))), 1e-3);
  }
}

TEST(Seeds, DensityStaysWhenASkeletonGrows) {
  Object object({ball(DVec3(0.0), 1.0)});
  const double per_area = double(object.report.seeds);
  object.move({ball(DVec3(0.0), 2.0)});
  EXPECT_NEAR(double(object.report.seeds), 4.0 * per_area, 0.15 * 4.0 * per_area);
}

TEST(Seeds, PiecesAreClosedAndScalesLieOnTheSurface) {
  const Object object(chain(DVec3(0.0)));
  const TriangleMesh pieces = object.seeds.pieces();
  const ValidateReport valid = validate(pieces);
  EXPECT_TRUE(valid) << valid.reason;
  const MeshPieces parts = mesh_pieces(pieces);
  EXPECT_EQ(parts.euler, (std::vector<int>{2, 2, 2}));
  for (const double v : parts.volume) EXPECT_GT(v, 0.0);
  const TriangleMesh scales = object.seeds.scales(*object.backend);
  EXPECT_EQ(scales.triangle_count(), 4 * object.report.valid);
  for (const Vec3& p : scales.vertices.position) EXPECT_LT(object.field->distance_estimate(DVec3(p)), 0.03);
}

TEST(Seeds, FindPenetrationOnlyWhereBoxesMeet) {
  const Object a(chain(DVec3(0.0)));
  const double surface = 1.0 * std::sqrt(1.0 - std::cbrt(0.3));  // of a ball of radius 1 and iso 0.3
  Object b({ball(DVec3(-2.0 * surface - 0.1, 0.0, 0.0)), ball(DVec3(-5.0, 0.0, 0.0)), ball(DVec3(-8.0, 0.0, 0.0))});
  Penetration p = find_penetration(a.seeds, *a.backend, b.seeds, *b.backend, true);
  EXPECT_FALSE(p.any());
  b.move({ball(DVec3(-2.0 * surface + 0.1, 0.0, 0.0)), ball(DVec3(-5.0, 0.0, 0.0)), ball(DVec3(-8.0, 0.0, 0.0))});
  p = find_penetration(a.seeds, *a.backend, b.seeds, *b.backend, true);
  EXPECT_FALSE(p.of_first.empty());
  EXPECT_FALSE(p.of_second.empty());
  EXPECT_LT(p.evaluations, p.without_boxes / 2);
  for (const Index s : p.of_first) EXPECT_GT(b.field->value(DVec3(a.seeds.position()[s])), 0.0);
  std::size_t inside = 0;
  for (std::size_t s = 0; s < a.seeds.position().size(); ++s)
    inside += a.seeds.valid()[s] && b.field->value(DVec3(a.seeds.position()[s])) > 0.0;
  EXPECT_NEAR(double(p.of_first.size()), double(inside), 1.0);  // none is missed for the boxes
  const Penetration one = find_penetration(a.seeds, *a.backend, b.seeds, *b.backend, false);
  EXPECT_TRUE(one.any());
  EXPECT_LE(one.evaluations, p.evaluations);
  b.move({ball(DVec3(30.0, 0.0, 0.0))});
  EXPECT_EQ(find_penetration(a.seeds, *a.backend, b.seeds, *b.backend, true).evaluations, 0u);
}

TEST(SeedsProgram, WritesScalesAndPiecesAndFindsCollisions) {
  const test::TemporaryFolder folder;
  const auto ball_at = [&](const std::string& name, const std::string& x) {
    test::write_text(folder / name, "iso = 0.3\n[[element]]\nposition = [" + x + ", 0.0, 0.0]\n");
    return (folder / name).string();
  };
  const std::string a = ball_at("a.toml", "0.0"), near = ball_at("near.toml", "1.0"), far = ball_at("far.toml", "1.2");
  const std::string out = (folder / "out.ply").string();
  const auto run = [](std::vector<std::string> arguments) {
    arguments.insert(arguments.end(), {"--backend", "reference"});
    return test::run_program(arguments);
  };
  EXPECT_EQ(run({"seeds", a, "-o", out}).status, 0);
  EXPECT_FALSE(read_ply(out).closed);
  EXPECT_EQ(run({"seeds", a, "--as", "pieces", "-o", out}).status, 0);
  EXPECT_TRUE(read_ply(out).closed);
  EXPECT_EQ(run({"collide", a, near}).status, 1);
  EXPECT_EQ(run({"collide", a, far, "--all"}).status, 0);
  EXPECT_EQ(run({"seeds", a, "--spacing", "0", "-o", out}).status, 2);
  EXPECT_EQ(run({"collide", a, (folder / "none.toml").string()}).status, 2);
}

TEST(Seeds, OfOtherFieldsAreRefused) {
  EXPECT_THROW(skeleton_parts(analytic::SphereField()), InputError);
}

TEST(Seeds, DoNotDependOnThreads) {
  const Object all(chain(DVec3(0.0)));
  const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
  const Object single(chain(DVec3(0.0)));
  EXPECT_EQ(all.seeds.position(), single.seeds.position());
  EXPECT_EQ(all.seeds.valid(), single.seeds.valid());
}

}  // namespace
}  // namespace isoskin
