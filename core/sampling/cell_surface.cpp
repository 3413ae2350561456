#include "core/sampling/cell_surface.h"

#include <algorithm>
#include <cmath>

namespace isoskin {
namespace {

constexpr double kRingRadius = 0.2;  // of the distance between the loops' centres

DVec3 loop_centre(const CellShape& s, int loop, const CellCrossings& crossing) {
  DVec3 sum(0.0);
  for (int k = s.first[loop]; k < s.first[loop + 1]; ++k) sum += crossing[s.edge[k]];
  return sum / static_cast<double>(s.size(loop));
}

/// Twice the loop's vector area: it points outside.
DVec3 loop_area(const CellShape& s, int loop, const CellCrossings& crossing) {
  const DVec3 centre = loop_centre(s, loop, crossing);
  DVec3 sum(0.0);
  for (int k = 0; k < s.size(loop); ++k) {
    const DVec3 p = crossing[s.edge[s.first[loop] + k]], q = crossing[s.edge[s.first[loop] + (k + 1) % s.size(loop)]];
    sum += glm::cross(p - centre, q - centre);
  }
  return sum;
}

void add_triangle(CellSurface& out, int loop, int a, int b, int c) {
  out.loop_of_triangle[out.triangles] = static_cast<std::uint8_t>(loop);
  out.triangle[out.triangles++] = {static_cast<std::uint8_t>(a), static_cast<std::uint8_t>(b),
                                   static_cast<std::uint8_t>(c)};
}

int add_extra(CellSurface& out, int loop, const DVec3& p) {
  out.loop_of_extra[out.extras] = static_cast<std::uint8_t>(loop);
  out.extra[out.extras] = p;
  return 12 + out.extras++;
}

/// The strip between a loop and the ring; both run the same way about the neck.
void weave(CellSurface& out, const CellShape& s, int loop, const CellCrossings& crossing,
           const std::array<int, CellSurface::kRing>& ring) {
  constexpr int m = CellSurface::kRing;
  const int n = s.size(loop);
  const auto edge = [&](int i) { return s.edge[s.first[loop] + i % n]; };
  int start = 0;
  for (int j = 1; j < m; ++j)
    if (glm::distance(out.extra[ring[j] - 12], crossing[edge(0)]) <
        glm::distance(out.extra[ring[start] - 12], crossing[edge(0)]))
      start = j;
  const auto about = [&](int j) { return ring[(start + j) % m]; };
  for (int i = 0, j = 0; i < n || j < m;) {
    if (i < n && (j == m || (i + 1) * m <= (j + 1) * n)) {
      add_triangle(out, 0, edge(i), edge(i + 1), about(j));
      ++i;
    } else {
      add_triangle(out, 0, edge(i), about(j + 1), about(j));
      ++j;
    }
  }
}

void add_tunnel(CellSurface& out, const CellShape& s, const CellCrossings& crossing) {
  const DVec3 from = loop_centre(s, 0, crossing), to = loop_centre(s, 1, crossing);
  const DVec3 axis = glm::normalize(to - from);
  DVec3 u = crossing[s.edge[0]] - from;
  u -= glm::dot(u, axis) * axis;
  if (!(glm::length(u) > 1e-6 * glm::distance(from, to)))
    u = glm::cross(axis, std::abs(axis.x) < 0.5 ? DVec3(1, 0, 0) : DVec3(0, 1, 0));
  u = glm::normalize(u);
  const DVec3 v = glm::dot(loop_area(s, 0, crossing), axis) > 0.0 ? glm::cross(axis, u) : glm::cross(u, axis);
  std::array<int, CellSurface::kRing> ring;
  for (int j = 0; j < CellSurface::kRing; ++j) {
    const double angle = 2.0 * M_PI * j / CellSurface::kRing;
    ring[j] = add_extra(
        out, 0,
        0.5 * (from + to) + kRingRadius * glm::distance(from, to) * (std::cos(angle) * u + std::sin(angle) * v));
  }
  weave(out, s, 0, crossing, ring);
  std::reverse(ring.begin(), ring.end());  // loop 1 runs the other way about the neck
  weave(out, s, 1, crossing, ring);
}

}  // namespace

std::optional<Neck> find_neck(const CellShape& s, const CellCrossings& crossing) {
  if (s.loops != 2) return {};
  Neck neck{loop_centre(s, 0, crossing), loop_centre(s, 1, crossing), false};
  const DVec3 along = neck.to - neck.from;
  neck.outside = glm::dot(loop_area(s, 0, crossing), along) > 0.0;
  const bool agrees = (glm::dot(loop_area(s, 1, crossing), along) < 0.0) == neck.outside;
  if (!agrees) return {};
  return neck;
}

CellSurface cell_surface(const CellShape& s, bool tunnel, const CellCrossings& crossing) {
  CellSurface out;
  if (tunnel) {
    add_tunnel(out, s, crossing);
    return out;
  }
  for (int l = 0; l < s.loops; ++l) {
    const int centre = s.has_centre(l) ? add_extra(out, l, loop_centre(s, l, crossing)) : 0;
    for (int k = s.first_triangle[l]; k < s.first_triangle[l + 1]; ++k) {
      const auto corner = [&](int i) {
        return s.triangle[k][i] == CellShape::kCentre ? centre : int{s.triangle[k][i]};
      };
      add_triangle(out, l, corner(0), corner(1), corner(2));
    }
  }
  return out;
}

int triangle_count(const CellShape& s, bool tunnel, int loop) {
  if (tunnel) return loop == 0 ? s.size(0) + s.size(1) + 2 * CellSurface::kRing : 0;
  return s.first_triangle[loop + 1] - s.first_triangle[loop];
}

int extra_count(const CellShape& s, bool tunnel, int loop) {
  if (tunnel) return loop == 0 ? CellSurface::kRing : 0;
  return s.has_centre(loop);
}

}  // namespace isoskin
