// Small closed meshes with known topology, for tests and benchmarks.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <random>

#include "core/mesh/triangle_mesh.h"

namespace isoskin::test_meshes {

/// 4 vertices, counter-clockwise from outside.
inline TriangleMesh tetrahedron(float radius = 1.0f) {
  const float s = radius / std::sqrt(3.0f);
  return make_mesh({{s, s, s}, {s, -s, -s}, {-s, s, -s}, {-s, -s, s}}, {0, 1, 2, 0, 2, 3, 0, 3, 1, 1, 3, 2});
}

/// Regular triangulation of a sphere: 20 * 4^levels triangles.
inline TriangleMesh icosphere(int levels, float radius = 1.0f, Vec3 center = Vec3(0)) {
  const float g = (1.0f + std::sqrt(5.0f)) / 2.0f;
  std::vector<Vec3> points = {{-1, g, 0},  {1, g, 0},  {-1, -g, 0}, {1, -g, 0}, {0, -1, g},  {0, 1, g},
                              {0, -1, -g}, {0, 1, -g}, {g, 0, -1},  {g, 0, 1},  {-g, 0, -1}, {-g, 0, 1}};
  std::vector<Index> triangles = {0, 11, 5,  0, 5,  1, 0, 1, 7, 0, 7,  10, 0, 10, 11, 1, 5, 9, 5, 11,
                                  4, 11, 10, 2, 10, 7, 6, 7, 1, 8, 3,  9,  4, 3,  4,  2, 3, 2, 6, 3,
                                  6, 8,  3,  8, 9,  4, 9, 5, 2, 4, 11, 6,  2, 10, 8,  6, 7, 9, 8, 1};
  for (int level = 0; level < levels; ++level) {
    std::map<std::pair<Index, Index>, Index> middles;
    const auto middle = [&](Index a, Index b) {
      const auto [it, fresh] = middles.try_emplace(std::minmax(a, b), Index(points.size()));
      if (fresh) points.push_back(0.5f * (points[a] + points[b]));
      return it->second;
    };
    std::vector<Index> finer;
    for (std::size_t t = 0; t < triangles.size(); t += 3) {
      const Index a = triangles[t], b = triangles[t + 1], c = triangles[t + 2];
      const Index ab = middle(a, b), bc = middle(b, c), ca = middle(c, a);
      finer.insert(finer.end(), {a, ab, ca, b, bc, ab, c, ca, bc, ab, bc, ca});
    }
    triangles = std::move(finer);
    for (Vec3& p : points) p = glm::normalize(p);
  }
  for (Vec3& p : points) p = center + radius * glm::normalize(p);
  return make_mesh(std::move(points), std::move(triangles));
}

/// around * across * 2 triangles; `around` steps along the big circle, `across` along the small one (both >= 3).
inline TriangleMesh torus(int around, int across, float big = 1.0f, float small = 0.4f, Vec3 center = Vec3(0)) {
  const float tau = 6.28318530717958647692f;
  std::vector<Vec3> points;
  std::vector<Index> triangles;
  for (int i = 0; i < around; ++i)
    for (int j = 0; j < across; ++j) {
      const float u = tau * float(i) / float(around), v = tau * float(j) / float(across), r = big + small * std::cos(v);
      points.push_back(center + Vec3(r * std::cos(u), r * std::sin(u), small * std::sin(v)));
      const auto at = [&](int a, int b) { return Index((a % around) * across + b % across); };
      const Index p = at(i, j), q = at(i + 1, j), s = at(i + 1, j + 1), t = at(i, j + 1);
      triangles.insert(triangles.end(), {p, q, s, p, s, t});
    }
  return make_mesh(std::move(points), std::move(triangles));
}

/// The surface of [-half, half]^3 with n by n quads a side, two triangles each.
inline TriangleMesh cube(int n, float half = 1.0f) {
  std::map<std::array<int, 3>, Index> index;
  std::vector<Vec3> points;
  std::vector<Index> triangles;
  const auto at = [&](std::array<int, 3> c) {
    const auto [it, fresh] = index.try_emplace(c, Index(points.size()));
    if (fresh) points.push_back(half * (2.0f / float(n) * Vec3(c[0], c[1], c[2]) - 1.0f));
    return it->second;
  };
  for (int axis = 0; axis < 3; ++axis)
    for (const int side : {0, n})
      for (int i = 0; i < n; ++i)
        for (int j = 0; j < n; ++j) {
          const auto corner = [&](int a, int b) {
            std::array<int, 3> c;
            c[axis] = side, c[(axis + 1) % 3] = a, c[(axis + 2) % 3] = b;
            return at(c);
          };
          const Index p = corner(i, j), q = corner(i + 1, j), s = corner(i + 1, j + 1), t = corner(i, j + 1);
          if (side)
            triangles.insert(triangles.end(), {p, q, s, p, s, t});
          else
            triangles.insert(triangles.end(), {p, s, q, p, t, s});
        }
  return make_mesh(std::move(points), std::move(triangles));
}

/// Moves every vertex by a random vector of at most `amplitude`; topology stays.
inline void jitter(TriangleMesh& mesh, float amplitude, unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<float> uniform(-amplitude, amplitude);
  for (Vec3& p : mesh.vertices.position) {
    const float x = uniform(random), y = uniform(random), z = uniform(random);
    p += Vec3(x, y, z) / 1.7320508f;
  }
}

}  // namespace isoskin::test_meshes
