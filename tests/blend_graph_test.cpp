// Skeletons that blend only with their neighbours: Desbrun, Tsingos and Gascuel 1995, section 4.
#include "core/field/blend_graph.h"

#include <cmath>

#include <gtest/gtest.h>

#include "core/counter_random.h"
#include "core/io/scene.h"
#include "core/mesh/validate.h"
#include "core/sampling/marching_cubes.h"
#include "core/tracker.h"
#include "kernels/opencl_backend.h"
#include "tests/program.h"

namespace isoskin {
namespace {

using Groups = std::vector<std::vector<Index>>;

std::vector<SkeletonElement> random_elements(std::size_t n) {
  std::vector<SkeletonElement> elements(n);
  for (std::size_t i = 0; i < n; ++i) {
    SkeletonElement& e = elements[i];
    e.a = 2.0 * counter_point(1, i) - 1.0;
    e.b = i % 2 ? e.a : e.a + 0.5 * counter_point(2, i);
    e.radius = 0.6 + 0.4 * counter_uniform(3, i);
    e.potential = i % 3 ? Potential::metaball : Potential::inverse_square;
    e.norm = i % 5 ? 2.0 : 3.0;
  }
  return elements;
}

TEST(BlendGroups, AreTheMaximalCliques) {
  EXPECT_EQ(blend_groups(4, {{0, 1}, {1, 2}, {2, 3}}), (Groups{{0, 1}, {1, 2}, {2, 3}}));
  EXPECT_EQ(blend_groups(4, {{2, 1}, {0, 1}, {0, 2}}), (Groups{{0, 1, 2}, {3}}));
  EXPECT_EQ(blend_groups(3, {}), (Groups{{0}, {1}, {2}}));
  EXPECT_EQ(blend_groups(3, {{0, 1}, {1, 2}, {2, 0}}), (Groups{{0, 1, 2}}));
  // against all subsets
  constexpr std::size_t kCount = 9;
  std::vector<BlendEdge> edges;
  bool adjacent[kCount][kCount] = {};
  for (Index i = 0; i < kCount; ++i)
    for (Index j = 0; j < i; ++j)
      if (counter_uniform(5, i * kCount + j) < 0.5) {
        edges.push_back({i, j});
        adjacent[i][j] = adjacent[j][i] = true;
      }
  const auto is_clique = [&](unsigned set) {
    for (Index i = 0; i < kCount; ++i)
      for (Index j = 0; j < i; ++j)
        if ((set >> i & 1) && (set >> j & 1) && !adjacent[i][j]) return false;
    return true;
  };
  Groups expected;
  for (unsigned set = 1; set < 1u << kCount; ++set) {
    bool maximal = is_clique(set);
    for (Index i = 0; i < kCount && maximal; ++i) maximal = (set >> i & 1) || !is_clique(set | 1u << i);
    if (!maximal) continue;
    expected.emplace_back();
    for (Index i = 0; i < kCount; ++i)
      if (set >> i & 1) expected.back().push_back(i);
  }
  std::sort(expected.begin(), expected.end());
  EXPECT_EQ(blend_groups(kCount, edges), expected);
  EXPECT_THROW(blend_groups(3, {{0, 3}}), InputError);
  EXPECT_THROW(blend_groups(3, {{1, 1}}), InputError);
}

TEST(BlendGraph, IsTheLargestSumOfAGroup) {
  const auto elements = random_elements(6);
  const Groups groups = blend_groups(6, {{0, 1}, {1, 2}, {2, 0}, {3, 4}});
  const BlendGraphField field(elements, 0.4, groups);
  for (std::uint64_t i = 0; i < 200; ++i) {
    const DVec3 p = 4.0 * counter_point(6, i) - 2.0;
    const auto sum = [&](std::initializer_list<int> members) {
      double s = -0.4;
      for (const int m : members) s += SkeletonField({elements[m]}, 0.0).value(p);
      return s;
    };
    const double expected = std::max({sum({0, 1, 2}), sum({3, 4}), sum({5})});
    EXPECT_NEAR(field.value(p), expected, 1e-12 * (1.0 + std::abs(expected)));
    EXPECT_EQ(field.sample(p).value, field.value(p));
    const Box box{p - 0.1, p + 0.1};
    const Interval range = field.range(box);
    for (std::uint64_t k = 0; k < 5; ++k)
      EXPECT_TRUE(range.contains(field.value(p + 0.2 * counter_point(7, 5 * i + k) - 0.1)));
    if (field.value(p) > 0.0) {
      const Box bounds = field.bounds();
      EXPECT_TRUE(glm::all(glm::greaterThanEqual(p, bounds.low)) && glm::all(glm::lessThanEqual(p, bounds.high)));
    }
  }
}

TEST(BlendGraph, OnTheDeviceIsWhatItIsOnTheHost) {
  const auto backend = make_opencl_backend();
  for (const std::size_t count : {std::size_t(2), std::size_t(12)}) {
    std::vector<BlendEdge> chain;
    for (Index i = 1; i < count; ++i) chain.push_back({i - 1, i});
    chain.pop_back();
    const auto field = std::make_shared<BlendGraphField>(random_elements(count), 0.4, blend_groups(count, chain));
    backend->set_field(field);
    std::vector<Vec3> points(333), gradients(points.size());
    std::vector<float> values(points.size()), hessians(6 * points.size());
    for (std::size_t i = 0; i < points.size(); ++i) points[i] = Vec3(3.0 * counter_point(8, i) - 1.5);
    backend->evaluate(points, values, gradients);
    backend->evaluate_hessian(points, hessians);
    for (std::size_t i = 0; i < points.size(); ++i) {
      const FieldSample s = field->sample(DVec3(points[i]));
      const double size = std::abs(s.value) + 1.0, slope = glm::length(s.gradient) + 1.0;
      EXPECT_NEAR(values[i], s.value, 2e-5 * size);
      // at a crease either side will do
      double second = -1e9;
      for (const SkeletonField& g : field->groups())
        if (const double v = g.value(DVec3(points[i])); v < s.value) second = std::max(second, v);
      if (s.value - second < 1e-4 * size) continue;
      EXPECT_LT(glm::length(DVec3(gradients[i]) - s.gradient), 1e-4 * slope);
      EXPECT_NEAR(hessians[6 * i], field->hessian(DVec3(points[i]))[0][0], 1e-3 * slope * slope + 1e-3);
    }
  }
}

TEST(BlendGraph, EndsOfThePapersStringDoNotBlend) {
  const auto topology_of = [](const std::shared_ptr<const Field>& field) {
    const auto backend = make_reference_backend();
    backend->set_field(field);
    return lattice_topology(sample_lattice(*field, *backend, 0.04)).euler;
  };
  const Scene scene = load_scene(ISOSKIN_TEST_DATA "/string.toml");
  const std::shared_ptr<const Field> field = scene.source->load(24).field;
  EXPECT_EQ(topology_of(field), std::vector<int>{2});
  std::vector<SkeletonElement> all;  // the same elements, each once, all blending
  for (const SkeletonField& group : dynamic_cast<const BlendGraphField&>(*field).groups())
    for (const SkeletonElement& e : group.elements())
      if (std::none_of(all.begin(), all.end(), [&](const SkeletonElement& x) { return x.a == e.a && x.b == e.b; }))
        all.push_back(e);
  ASSERT_EQ(all.size(), 12u);
  EXPECT_EQ(topology_of(std::make_shared<SkeletonField>(all, 0.3)), std::vector<int>{0});
}

TEST(BlendGraph, ThePapersStringIsTracked) {
  Scene scene = load_scene(ISOSKIN_TEST_DATA "/string.toml");
  const FieldFrame first = scene.source->load(22);
  TrackOptions options;
  options.edge_length = 0.1;
  options.validate = true;
  Tracker tracker(make_opencl_backend(), resolved(options, *first.field));
  for (int frame = 22; frame <= 24; ++frame) {
    const FrameReport report = tracker.advance(scene.source->load(frame));
    EXPECT_TRUE(report.certified) << report.certificate;
    EXPECT_EQ(mesh_pieces(tracker.mechanical()).euler, std::vector<int>{2});
  }
}

TEST(BlendScene, SaysWhatIsWrong) {
  const test::TemporaryFolder folder;
  const auto error_of = [&](const std::string& blend) -> std::string {
    test::write_text(folder / "s.toml",
                     "iso = 0.3\nblend = " + blend +
                         "\n[[element]]\nposition = [0.0, 0.0, 0.0]\n[[element]]\nposition = [1.0, 0.0, 0.0]\n");
    try {
      load_scene(folder / "s.toml").source->load(1);
    } catch (const InputError& error) {
      return error.what();
    }
    return "";
  };
  EXPECT_EQ(error_of("[[1, 2]]"), "");
  EXPECT_EQ(error_of("[]"), "");
  for (const char* blend : {"[[1, 3]]", "[[0, 1]]", "[[1, 1]]", "[[1]]", "3", "[[1, 2.5]]"})
    EXPECT_NE(error_of(blend).find("s.toml:2: blend"), std::string::npos) << blend << ": " << error_of(blend);
}

}  // namespace
}  // namespace isoskin
