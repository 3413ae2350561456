#include "core/topology/critical_tracking.h"

#include <cmath>
#include <numeric>
#include <random>

#include <gtest/gtest.h>

#include "core/field/skeleton_field.h"
#include "core/topology/critical_interval.h"
#include "core/topology/events.h"

namespace isoskin {
namespace {

SkeletonElement ball(const DVec3& center, double radius = 1.0, double weight = 1.0) {
  SkeletonElement e;
  e.a = e.b = center;
  e.radius = radius;
  e.weight = weight;
  return e;
}

SkeletonField pair_of_balls(double half, double iso) {
  return {{ball({-half, 0.01, 0.02}), ball({half, -0.02, 0.03})}, iso};
}

CriticalOptions options_for(double edge_length) {
  CriticalOptions options;
  options.edge_length = edge_length;
  return options;
}

std::vector<CriticalPoint> all_of(const SkeletonField& field, const CriticalOptions& options) {
  // Farther below the surface lies the empty space beyond the balls, where F is constant.
  const double least = -0.5 * field.iso();
  const IntervalSearch found = find_all_critical_points(field, {DVec3(-3.0), DVec3(3.0)}, options,
                                                        {.values = {least, 100.0}, .least_box = 1e-8});
  EXPECT_TRUE(found.complete && found.unresolved.empty());
  return found.points;
}

/// The Euler characteristic of {F > 0} by Morse theory, from every critical point inside.
int euler_of(const std::vector<CriticalPoint>& points) {
  return std::accumulate(points.begin(), points.end(), 0, [](int sum, const CriticalPoint& p) {
    if (!(p.value > 0.0)) return sum;
    return sum + (p.kind == CriticalKind::maximum || p.kind == CriticalKind::one_saddle ? 1 : -1);
  });
}

TEST(Track, follows_a_saddle_through_zero) {
  const CriticalOptions options = options_for(0.1);
  const SkeletonField before = pair_of_balls(0.75, 0.265), after = pair_of_balls(0.65, 0.265);
  const CriticalTracking tracking = track(all_of(before, options), all_of(after, options), before, after, options);
  EXPECT_EQ(tracking.matched, 3u);
  EXPECT_EQ(tracking.born + tracking.died, 0u);
  ASSERT_EQ(tracking.paths.size(), 3u);
  int crossings = 0;
  for (const CriticalPath& path : tracking.paths) {
    EXPECT_EQ(path.first.kind, path.last.kind);
    if (!path.crossing) continue;
    ++crossings;
    EXPECT_EQ(path.crossing->kind, CriticalKind::two_saddle);
    EXPECT_TRUE(path.rising);
    const BlendField between(before, after, path.crossing_time);
    EXPECT_LT(std::abs(between.value(path.crossing->position)), 0.01);
    EXPECT_LT(glm::length(between.sample(path.crossing->position).gradient), 1e-6);
  }
  EXPECT_EQ(crossings, 1);
}

TEST(Track, is_the_same_backward) {
  const CriticalOptions options = options_for(0.1);
  const SkeletonField a = pair_of_balls(0.75, 0.265), b = pair_of_balls(0.65, 0.265);
  const auto there = track(all_of(a, options), all_of(b, options), a, b, options);
  const auto back = track(all_of(b, options), all_of(a, options), b, a, options);
  for (const CriticalPath& path : there.paths)
    if (path.crossing)
      for (const CriticalPath& other : back.paths)
        if (other.crossing) {
          EXPECT_NEAR(path.crossing_time, 1.0 - other.crossing_time, 0.02);
          EXPECT_NE(path.rising, other.rising);
        }
}

TEST(Track, pairs_are_born_and_die_together) {
  // Two balls become one: a maximum and the saddle meet on the way (both maxima and the saddle by symmetry, so the
  // balls differ).
  const CriticalOptions options = options_for(0.1);
  const SkeletonField apart({ball({-0.6, 0, 0}), ball({0.6, 0, 0}, 1.0, 0.7)}, 0.1);
  const SkeletonField together({ball({-0.2, 0, 0}), ball({0.2, 0, 0}, 1.0, 0.7)}, 0.1);
  const auto points = all_of(apart, options), one = all_of(together, options);
  ASSERT_EQ(points.size(), 3u);
  ASSERT_EQ(one.size(), 1u);
  const auto merging = track(points, one, apart, together, options);
  EXPECT_EQ(merging.matched, 1u);
  EXPECT_EQ(merging.died, 2u);
  EXPECT_EQ(merging.born, 0u);
  std::vector<CriticalPath> ended;
  for (const CriticalPath& path : merging.paths)
    if (!path.exists_after()) ended.push_back(path);
  ASSERT_EQ(ended.size(), 2u);
  EXPECT_NEAR(ended[0].end, ended[1].end, 1e-2);
  EXPECT_LT(glm::distance(ended[0].last.position, ended[1].last.position), 0.1);
  const auto parting = track(one, points, together, apart, options);
  EXPECT_EQ(parting.matched, 1u);
  EXPECT_EQ(parting.born, 2u);
  EXPECT_EQ(parting.died, 0u);
}

TEST(Track, crossings_account_for_the_change_of_topology) {
  // Random scenes in motion: the Euler characteristic before, plus what the crossings change it by, is that after.
  const CriticalOptions options = options_for(0.1);
  int events = 0;
  for (unsigned seed = 0; seed < 16; ++seed) {
    std::mt19937 random(seed);
    std::uniform_real_distribution<double> place(-1.1, 1.1), step(-0.15, 0.15);
    std::vector<SkeletonElement> elements, moved;
    for (int i = 0; i < 8; ++i) {
      const double x = place(random), y = place(random), z = place(random);
      elements.push_back(ball({x, y, z}, 0.9));
      const double dx = step(random), dy = step(random), dz = step(random);
      moved.push_back(ball(elements.back().a + DVec3(dx, dy, dz), 0.9));
    }
    const SkeletonField before(elements, 0.25), after(moved, 0.25);
    const auto then = all_of(before, options), now = all_of(after, options);
    const CriticalTracking tracking = track(then, now, before, after, options);
    int change = 0;
    for (const CriticalPath& path : tracking.paths) {
      if (!path.crossing) continue;
      ++events;
      const bool even = path.first.kind == CriticalKind::maximum || path.first.kind == CriticalKind::one_saddle;
      change += (even ? 1 : -1) * (path.rising ? 1 : -1);
    }
    EXPECT_EQ(euler_of(then) + change, euler_of(now)) << "seed " << seed;
  }
  EXPECT_GT(events, 5);
}

TEST(Track, what_the_field_does_not_change_about_is_still) {
  const CriticalOptions options = options_for(0.1);
  const SkeletonField before({ball({-2, 0, 0}, 0.9), ball({0.5, 0, 0}, 0.9), ball({1.8, 0, 0}, 0.9)}, 0.25);
  const SkeletonField after({ball({-2, 0.05, 0}, 0.9), ball({0.5, 0, 0}, 0.9), ball({1.8, 0, 0}, 0.9)}, 0.25);
  const auto then = all_of(before, options), now = all_of(after, options);
  const ChangeMask changed(changes_between(before, after), options.reach * options.edge_length);
  const CriticalTracking whole = track(then, now, before, after, options),
                         part = track(then, now, before, after, options, {}, changed);
  ASSERT_EQ(part.still.size(), 3u);
  EXPECT_EQ(part.still.size() + part.paths.size(), whole.paths.size());
  EXPECT_EQ(part.matched, whole.matched);
  for (const Index i : part.still) EXPECT_GT(then[i].position.x, 0.0);
  for (const CriticalPath& path : part.paths) EXPECT_LT(path.first.position.x, 0.0);
}

TEST(BlendField, is_what_it_says) {
  const SkeletonField a = pair_of_balls(0.7, 0.2), b = pair_of_balls(0.5, 0.3);
  const auto skeleton = field_between(a, b, 0.3);
  const BlendField blend(a, b, 0.3);
  ASSERT_TRUE(skeleton);
  std::mt19937 random(5);
  std::uniform_real_distribution<double> place(-1.5, 1.5);
  for (int i = 0; i < 100; ++i) {
    const double x = place(random), y = place(random), z = place(random);
    const DVec3 p(x, y, z);
    EXPECT_NEAR(blend.value(p), 0.7 * a.value(p) + 0.3 * b.value(p), 1e-14);
    EXPECT_NEAR(skeleton->value(p), blend.value(p), 1e-14);
    EXPECT_LT(glm::distance(skeleton->sample(p).gradient, blend.sample(p).gradient), 1e-13);
    EXPECT_TRUE(blend.range({p - 0.1, p + 0.1}).contains(blend.value(p)));
    if (blend.value(p) > 0.0) {
      const Box box = blend.bounds();
      EXPECT_EQ(glm::clamp(p, box.low, box.high), p);
    }
  }
}

TEST(TimeBetweenEvents, keeps_neighbours_apart) {
  const auto crossing_at = [](double time, const DVec3& at) {
    CriticalPath path;
    path.crossing.emplace().position = at;
    path.crossing_time = time;
    return path;
  };
  const EventOptions options = event_options(0.1);  // 0.6 apart is enough
  EventPlan plan;
  EXPECT_FALSE(time_between_events(plan, options));
  plan.crossings = {crossing_at(0.2, DVec3(0.0)), crossing_at(0.5, DVec3(1.0, 0, 0))};
  EXPECT_FALSE(time_between_events(plan, options));
  plan.crossings.push_back(crossing_at(0.7, DVec3(0.1, 0.0, 0.0)));
  EXPECT_DOUBLE_EQ(time_between_events(plan, options).value(), 0.6);
  plan.crossings = {crossing_at(0.5, DVec3(0.0)), crossing_at(0.5, DVec3(0.1, 0, 0))};
  EXPECT_FALSE(time_between_events(plan, options));  // simultaneous
}

}  // namespace
}  // namespace isoskin
