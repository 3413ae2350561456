// Local re-skin: whatever is done to a mesh, a frame on the same field mends it where it was hurt.
#include "core/topology/reskin.h"

#include <cstdio>
#include <cstdlib>

#include <gtest/gtest.h>

#include "core/field/skeleton_field.h"
#include "core/io/scene.h"
#include "core/mesh/validate.h"
#include "core/tracker.h"
#include "kernels/opencl_backend.h"
#include "tests/analytic_fields.h"
#include "tests/damage.h"
#include "tests/sanitized.h"

using namespace isoskin;

namespace {

/// How many damages to try: ISOSKIN_FUZZ=10000 for the long run.
int fuzz_count(int usual) {
  const char* wanted = std::getenv("ISOSKIN_FUZZ");
  return wanted ? std::atoi(wanted) : usual;
}

std::shared_ptr<const Field> random_metaballs(damage::Random& random) {
  std::vector<SkeletonElement> elements;
  for (int i = 0; i < 9; ++i) {
    SkeletonElement ball;
    ball.a = ball.b =
        DVec3(damage::uniform(random, -1, 1), damage::uniform(random, -1, 1), damage::uniform(random, -1, 1));
    ball.radius = damage::uniform(random, 0.4f, 0.8f);
    elements.push_back(ball);
  }
  return std::make_shared<SkeletonField>(elements, 0.3);
}

struct Tally {
  int tried = 0, certified = 0, without_tier3 = 0;
};

void try_damages(const std::shared_ptr<const Field>& field, double edge_length, int count, damage::Random& random,
                 std::vector<Tally>& tally) {
  TrackOptions options;
  options.edge_length = edge_length;
  options = resolved(options, *field);
  Tracker first(make_opencl_backend(), options);
  first.advance({1, 0.04, field, nullptr});
  const TriangleMesh good = first.mechanical();
  for (int i = 0; i < count; ++i) {
    const auto kind = Damage(i % int(Damage::count));
    const TriangleMesh bad = damaged(good, kind, random, float(options.edge_length));
    ASSERT_TRUE(validate(bad)) << name(kind) << ": " << validate(bad).reason;
    first.resume(bad, {1, 0.04, field, nullptr});
    const FrameReport report = first.advance({2, 0.08, field, nullptr});
    const ValidateReport valid = validate(first.mechanical());
    EXPECT_TRUE(valid) << name(kind) << ": " << valid.reason;
    EXPECT_TRUE(report.certified) << name(kind) << ": " << report.certificate;
    ++tally[int(kind)].tried;
    tally[int(kind)].certified += report.certified;
    tally[int(kind)].without_tier3 += report.reextracted[2] == 0.0;
  }
}

}  // namespace

TEST(Reskin, MendsRandomDamageWithoutReextraction) {
  damage::Random random(20261122);
  std::vector<Tally> tally(int(Damage::count));
  const int fields = 3, total = fuzz_count(test::repeats(120, 30));
  for (int f = 0; f < fields; ++f) try_damages(random_metaballs(random), 0.08, total / fields, random, tally);
  int tried = 0, local = 0;
  for (int k = 0; k < int(Damage::count); ++k) {
    std::printf("%-20s tried %5d  certified %5d  without tier 3 %5d\n", name(Damage(k)), tally[k].tried,
                tally[k].certified, tally[k].without_tier3);
    tried += tally[k].tried;
    local += tally[k].without_tier3;
  }
  EXPECT_GE(double(local), 0.99 * tried);
}
