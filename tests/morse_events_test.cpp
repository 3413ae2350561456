// The eight canonical Morse events, forward and backward in time, in 20 rotations and at 5 speeds.
#include <array>
#include <cmath>
#include <map>
#include <random>

#include <gtest/gtest.h>

#include "core/field/skeleton_field.h"
#include "core/mesh/validate.h"
#include "core/sampling/marching_cubes.h"
#include "core/topology/events.h"
#include "tests/digital_topology.h"

namespace isoskin {
namespace {

constexpr double kEdge = 0.16;

SkeletonElement ball(const DVec3& center, double radius, double weight = 1.0) {
  SkeletonElement e;
  e.a = e.b = center;
  e.radius = radius;
  e.weight = weight;
  return e;
}

/// A scene whose one critical point near the origin crosses zero at q = 0, rising with q.
struct Scene {
  const char* rising;
  const char* falling;
  std::vector<SkeletonElement> (*elements)(double q);
  double iso;
};

const Scene kScenes[4] = {
    {"create", "destroy",
     [](double q) {
       const double w = (1.0 + 0.3 * q) * 0.3;
       return std::vector<SkeletonElement>{ball({0, 0, 0}, 1.0, w), ball({0.3, 0.1, 0}, 0.8, 0.7 * w)};
     },
     0.45434},
    {"connect", "cut",
     [](double q) {
       const double d = 0.7 - 0.06 * q;
       return std::vector<SkeletonElement>{ball({-d, 0, 0}, 1.0), ball({d, 0, 0}, 1.0)};
     },
     0.265302},
    {"spackle", "pierce",
     [](double q) {
       const double w = 0.7 - 0.3 * q;
       return std::vector<SkeletonElement>{ball({0, 0, 0}, 4.0), ball({0, 0, 0.7}, 1.0, -w), ball({0, 0, -0.7}, 1.0, -w)};
     },
     0.8142886},
    {"burst_bubble", "open_bubble",
     [](double q) {
       return std::vector<SkeletonElement>{ball({0, 0, 0}, 2.0), ball({0, 0, 0}, 1.0, -0.6 + 0.15 * q)};
     },
     0.4},
};

DMat3 rotation(int number) {
  if (number == 0) return DMat3(1.0);
  std::mt19937 random{unsigned(number)};
  std::normal_distribution<double> normal;
  const auto vector = [&] {
    const double x = normal(random), y = normal(random), z = normal(random);
    return DVec3(x, y, z);
  };
  const DVec3 x = glm::normalize(vector());
  DVec3 y = vector();
  y = glm::normalize(y - glm::dot(x, y) * x);
  return DMat3(x, y, glm::cross(x, y));
}

std::shared_ptr<const SkeletonField> field_of(const Scene& scene, double q, const DMat3& turn, const DVec3& shift) {
  std::vector<SkeletonElement> elements = scene.elements(q);
  for (SkeletonElement& e : elements) e.a = e.b = turn * e.a + shift;
  return std::make_shared<SkeletonField>(elements, scene.iso);
}

/// Topology of the unturned scene by labelling; the same for every rotation.
const DigitalTopology& oracle(const Scene& scene, double q) {
  static std::map<std::pair<const Scene*, double>, DigitalTopology> known;
  const auto [it, fresh] = known.try_emplace({&scene, q});
  if (fresh) {
    const auto field = field_of(scene, q, DMat3(1.0), DVec3(0.013, 0.007, -0.011));
    const Box bounds = field->bounds();
    if (!bounds.empty()) it->second = digital_topology(*field, bounds, 0.04);
  }
  return it->second;
}

struct Skin {
  TriangleMesh mesh;
  CriticalState state;
};

TEST(MorseEvents, DISABLED_probe) {
  for (const Scene& scene : kScenes)
    for (double q : {-1.2, -.6, -.2, -.1, -.05, 0.05,.1, .2, .6, 1.2}) {
      const auto field = field_of(scene, q, DMat3(1.0), DVec3(0.0));
      const auto& t = oracle(scene, q);
      CriticalOptions options;
      auto p = refine_critical_point(*field, DVec3(0.08,0,0), options);
      printf("%s q %g comps %d cav %d euler %d", scene.rising, q, t.components, t.cavities, t.euler);
      if (p) printf(" value %g kind %s at %g %g %g ev %g %g %g", p->value, name(p->kind), p->position.x,p->position.y,p->position.z,p->hessian.values[0],p->hessian.values[1],p->hessian.values[2]);
      printf("\n");
    }
}

}  // namespace
}  // namespace isoskin
