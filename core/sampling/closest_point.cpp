#include "core/sampling/closest_point.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <utility>

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>

namespace isoskin {
namespace {

constexpr std::size_t kLeaf = 4;       // triangles
constexpr int kMortonBits = 21;        // an axis
constexpr int kDeepest = 64;           // levels of the tree, and twice the stack of a query
constexpr double kSlack = 1.0 + 1e-9;  // a box is passed over only when it is farther than rounding could explain

struct BoundingBox {
  Vec3 low{std::numeric_limits<float>::infinity()};
  Vec3 high{-std::numeric_limits<float>::infinity()};

  void add(const BoundingBox& b) {
    low = glm::min(low, b.low);
    high = glm::max(high, b.high);
  }
  double squared_distance(const DVec3& p) const {
    const DVec3 d = glm::max(glm::max(DVec3(low) - p, p - DVec3(high)), DVec3(0.0));
    return glm::dot(d, d);
  }
};

std::uint64_t spread(std::uint64_t x) {
  x = (x | x << 32) & 0x1f00000000ffffull;
  x = (x | x << 16) & 0x1f0000ff0000ffull;
  x = (x | x << 8) & 0x100f00f00f00f00full;
  x = (x | x << 4) & 0x10c30c30c30c30c3ull;
  return (x | x << 2) & 0x1249249249249249ull;
}

/// Weights of the corners of the point of triangle abc that is nearest to p (Ericson 2005, 5.1.5).
DVec3 nearest_weights(const DVec3& p, const DVec3& a, const DVec3& b, const DVec3& c) {
  const DVec3 ab = b - a, ac = c - a, ap = p - a;
  const double d1 = glm::dot(ab, ap), d2 = glm::dot(ac, ap);
  if (d1 <= 0.0 && d2 <= 0.0) return {1.0, 0.0, 0.0};
  const DVec3 bp = p - b;
  const double d3 = glm::dot(ab, bp), d4 = glm::dot(ac, bp);
  if (d3 >= 0.0 && d4 <= d3) return {0.0, 1.0, 0.0};
  const double vc = d1 * d4 - d3 * d2;
  if (vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0) {
    const double t = d1 / (d1 - d3);
    return {1.0 - t, t, 0.0};
  }
  const DVec3 cp = p - c;
  const double d5 = glm::dot(ab, cp), d6 = glm::dot(ac, cp);
  if (d6 >= 0.0 && d5 <= d6) return {0.0, 0.0, 1.0};
  const double vb = d5 * d2 - d1 * d6;
  if (vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0) {
    const double t = d2 / (d2 - d6);
    return {1.0 - t, 0.0, t};
  }
  const double va = d3 * d6 - d5 * d4;
  if (va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0) {
    const double t = (d4 - d3) / ((d4 - d3) + (d5 - d6));
    return {0.0, 1.0 - t, t};
  }
  const double sum = va + vb + vc;
  return {va / sum, vb / sum, vc / sum};
}

}  // namespace

/// A complete binary tree over triangles in Morton order; the children of node i are 2i + 1 and 2i + 2, leaves last.
struct ClosestPoint::Tree {
  std::vector<std::array<Vec3, 3>> corner;  // of triangles in Morton order
  std::vector<Index> triangle;              // their numbers in the mesh
  std::vector<BoundingBox> node;
  std::size_t first_leaf = 0;

  explicit Tree(const TriangleMesh& mesh) {
    sort_triangles(mesh);
    const std::size_t leaves = std::bit_ceil(std::max<std::size_t>(1, (triangle.size() + kLeaf - 1) / kLeaf));
    first_leaf = leaves - 1;
    node.resize(2 * leaves - 1);
    tbb::parallel_for(std::size_t{0}, leaves, [&](std::size_t l) {
      for (std::size_t t = l * kLeaf; t < std::min(triangle.size(), (l + 1) * kLeaf); ++t)
        for (const Vec3& p : corner[t]) node[first_leaf + l].add({p, p});
    });
    for (std::size_t width = leaves / 2; width > 0; width /= 2)
      tbb::parallel_for(width - 1, 2 * width - 1, [&](std::size_t i) {
        node[i] = node[2 * i + 1];
        node[i].add(node[2 * i + 2]);
      });
  }

  void sort_triangles(const TriangleMesh& mesh) {
    const std::size_t count = mesh.triangle_count();
    BoundingBox all;
    for (const Vec3& p : mesh.vertices.position) all.add({p, p});
    const DVec3 scale = double((1 << kMortonBits) - 1) / glm::max(DVec3(all.high) - DVec3(all.low), DVec3(1e-30));
    std::vector<std::pair<std::uint64_t, Index>> order(count);
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, count, 1024), [&](const auto& range) {
      for (std::size_t t = range.begin(); t != range.end(); ++t) {
        DVec3 centre(0.0);
        for (int i = 0; i < 3; ++i) centre += DVec3(mesh.position(mesh.vertex[3 * t + i])) / 3.0;
        const DVec3 q = glm::clamp((centre - DVec3(all.low)) * scale, DVec3(0.0), DVec3((1 << kMortonBits) - 1));
        order[t] = {spread(std::uint64_t(q.x)) << 2 | spread(std::uint64_t(q.y)) << 1 | spread(std::uint64_t(q.z)),
                    Index(t)};
      }
    });
    tbb::parallel_sort(order.begin(), order.end());
    corner.resize(count);
    triangle.resize(count);
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, count, 1024), [&](const auto& range) {
      for (std::size_t k = range.begin(); k != range.end(); ++k) {
        triangle[k] = order[k].second;
        for (int i = 0; i < 3; ++i) corner[k][i] = mesh.position(mesh.vertex[3 * std::size_t{triangle[k]} + i]);
      }
    });
  }

  struct Best {
    std::size_t at = 0;  // in Morton order
    Index triangle = kNone;
    DVec3 weight{0.0};
    double squared = std::numeric_limits<double>::infinity();
  };

  void look_at(std::size_t k, const DVec3& p, const DVec3& side, Best& best) const {
    const DVec3 a(corner[k][0]), b(corner[k][1]), c(corner[k][2]);
    if (side != DVec3(0.0) && points_against(k, side)) return;
    const DVec3 w = nearest_weights(p, a, b, c);
    const DVec3 d = w.x * a + w.y * b + w.z * c - p;
    const double squared = glm::dot(d, d);
    if (squared < best.squared || (squared == best.squared && triangle[k] < best.triangle))
      best = {k, triangle[k], w, squared};
  }

  bool points_against(std::size_t k, const DVec3& side) const {
    const DVec3 a(corner[k][0]), b(corner[k][1]), c(corner[k][2]);
    return glm::dot(glm::cross(b - a, c - a), side) < 0.0;
  }

  /// Nearest triangle that does not point against `side`, no farther than sqrt(most). Looks at `first` first.
  Best search(const DVec3& p, const DVec3& side, double most, std::size_t first) const {
    Best best;
    best.squared = most;
    if (triangle.empty()) return best;
    if (first < triangle.size()) look_at(first, p, side, best);
    struct Open {
      std::size_t node;
      double squared;
    };
    std::array<Open, kDeepest> stack;
    int depth = 0;
    stack[depth++] = {0, node[0].squared_distance(p)};
    while (depth > 0) {
      const auto [i, squared] = stack[--depth];
      if (!(squared <= best.squared * kSlack)) continue;
      if (i >= first_leaf) {
        const std::size_t from = (i - first_leaf) * kLeaf;
        for (std::size_t k = from; k < std::min(triangle.size(), from + kLeaf); ++k) look_at(k, p, side, best);
        continue;
      }
      Open near{2 * i + 1, node[2 * i + 1].squared_distance(p)}, far{2 * i + 2, node[2 * i + 2].squared_distance(p)};
      if (far.squared < near.squared) std::swap(near, far);
      stack[depth++] = far;
      stack[depth++] = near;
    }
    return best;
  }
};

ClosestPoint::ClosestPoint(const TriangleMesh& mesh) : tree_(std::make_unique<Tree>(mesh)) {}
ClosestPoint::~ClosestPoint() = default;

SurfacePoint ClosestPoint::nearest(const Vec3& p, const Vec3& side, float max_distance, Neighbour* neighbour) const {
  constexpr double kAnywhere = std::numeric_limits<double>::infinity();
  const DVec3 from(p);
  // The nearest of all is nearly always on the right side, and much sooner found.
  Neighbour own;
  Neighbour& near = neighbour ? *neighbour : own;
  Tree::Best best = tree_->search(from, DVec3(0.0), kAnywhere, near.nearest);
  if (best.triangle == kNone) return {};
  near.nearest = best.at;
  if (side != Vec3(0.0f) && tree_->points_against(best.at, DVec3(side))) {
    const Tree::Best agreeing = tree_->search(from, DVec3(side), double(max_distance) * max_distance, near.agreeing);
    if (agreeing.triangle != kNone) {
      best = agreeing;
      near.agreeing = best.at;
    }
  }
  return {best.triangle, Vec3(best.weight), static_cast<float>(std::sqrt(best.squared))};
}

void carry_attributes(TriangleMesh& mesh, Index first, const TriangleMesh& old, Backend& backend) {
  if (old.empty() || first >= mesh.vertex_count()) return;
  const std::span<const Vec3> points(mesh.vertices.position.begin() + first, mesh.vertices.position.end());
  std::vector<float> values(points.size());
  std::vector<Vec3> gradients(points.size());
  backend.evaluate(points, values, gradients);
  const ClosestPoint closest(old);
  // Farther than this the other side of a near sheet is the better guess.
  constexpr double kReachInEdges = 8.0;
  double edges = 0.0;
  for (Index h = 0; h < old.vertex.size(); ++h)
    edges += glm::distance(old.position(old.from(h)), old.position(old.to(h)));
  const float reach = static_cast<float>(kReachInEdges * edges / double(old.vertex.size()));
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, points.size(), 32), [&](const auto& range) {
    ClosestPoint::Neighbour neighbour;
    for (std::size_t i = range.begin(); i != range.end(); ++i) {
      const SurfacePoint at = closest.nearest(points[i], Vec3(outward_normal(DVec3(gradients[i]))), reach, &neighbour);
      if (at.triangle == kNone) continue;  // not a finite point
      Vec3 rest(0.0f), velocity(0.0f);
      for (int k = 0; k < 3; ++k) {
        const Index v = old.vertex[3 * std::size_t{at.triangle} + k];
        rest += at.weight[k] * old.vertices.rest[v];
        velocity += at.weight[k] * old.vertices.velocity[v];
      }
      mesh.vertices.rest[first + i] = rest;
      mesh.vertices.velocity[first + i] = velocity;
    }
  });
}

}  // namespace isoskin
