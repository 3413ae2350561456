#include "core/topology/bad_sites.h"

#include <algorithm>
#include <array>
#include <numeric>
#include <tuple>

#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>

#include "core/disjoint_sets.h"
#include "core/mesh/independent_edits.h"
#include "core/parallel.h"
#include "core/topology/sides.h"
#include "core/topology/simple_point.h"
#include "core/trace.h"

namespace isoskin {
namespace {

constexpr int kCorners = BrickLattice::kCorners;

/// A lattice corner by its coordinates, packed so that sorting goes x, y, z.
std::uint64_t key_of(const IVec3& c) {
  constexpr int kOffset = 1 << 20;
  return (std::uint64_t(c.x + kOffset) << 42) | (std::uint64_t(c.y + kOffset) << 21) | std::uint64_t(c.z + kOffset);
}

/// Sides of lattice corners, asked for by coordinates. Corners that no brick holds count as outside.
class Sides {
public:
  Sides(const BrickLattice& lattice, const DifferingBricks& differing) : lattice_(lattice), differing_(differing) {}

  bool inside_mesh(const IVec3& c) const {
    const auto [brick, corner] = slot(c);
    if (brick == kNone) return false;
    const Index n = differing_.number[brick];
    if (n == kNone) return lattice_.value[std::size_t{brick} * BrickLattice::kValues + corner] > 0.0f;
    return differing_.winding[std::size_t{n} * BrickLattice::kValues + corner] > 0;
  }

private:
  /// A brick that has the corner, kNone if none does, and the corner's number in it.
  std::pair<Index, Index> slot(const IVec3& c) const {
    const IVec3 brick(c.x >> 3, c.y >> 3, c.z >> 3);
    // A corner on a brick's low side also belongs to the brick below, which may be the only one there.
    for (int shift = 0; shift < 8; ++shift) {
      const IVec3 step((shift >> 2) & 1, (shift >> 1) & 1, shift & 1);
      const IVec3 local = c - 8 * (brick - step);
      if (local.x > 8 || local.y > 8 || local.z > 8) continue;
      const Index b = lattice_.find(brick - step);
      if (b != kNone) return {b, Index((local.x * kCorners + local.y) * kCorners + local.z)};
    }
    return {kNone, 0};
  }

  const BrickLattice& lattice_;
  const DifferingBricks& differing_;
};

struct Corner {
  std::uint64_t key;
  IVec3 at;
  std::size_t slot;     // into lattice.value
  std::int8_t winding;  // of the mesh
  // Corners on bricks' faces come once for each brick, with what that brick knows of them: ties must not be open.
  bool operator<(const Corner& other) const { return std::pair(key, slot) < std::pair(other.key, other.slot); }
};

/// Lattice corners whose side differs between mesh and field, each once, sorted.
std::vector<Corner> differing_corners(const BrickLattice& lattice, const DifferingBricks& differing) {
  std::vector<std::vector<Corner>> of_brick(differing.brick.size());
  tbb::parallel_for(std::size_t(0), of_brick.size(), [&](std::size_t n) {
    const std::size_t b = differing.brick[n];
    for (int x = 0; x < kCorners; ++x)
      for (int y = 0; y < kCorners; ++y)
        for (int z = 0; z < kCorners; ++z) {
          const std::size_t i = (std::size_t(x) * kCorners + y) * kCorners + z, slot = b * BrickLattice::kValues + i;
          const std::int8_t winding = differing.winding[n * BrickLattice::kValues + i];
          if (winding == (lattice.value[slot] > 0.0f ? 1 : 0)) continue;
          const IVec3 at = 8 * lattice.coordinate[b] + IVec3(x, y, z);
          of_brick[n].push_back({key_of(at), at, slot, winding});
        }
  });
  std::vector<Corner> corners;
  for (const auto& list : of_brick) corners.insert(corners.end(), list.begin(), list.end());
  tbb::parallel_sort(corners);
  corners.erase(std::unique(corners.begin(), corners.end(), [](auto& a, auto& b) { return a.key == b.key; }),
                corners.end());
  return corners;
}

/// The corners' 26-connected clusters: the smallest member of each corner's cluster.
std::vector<Index> clusters_of(const std::vector<Corner>& corners) {
  DisjointSets sets(corners.size());
  // The 13 neighbours that sort before lie in four lattice columns and just below; one walker follows in each column.
  constexpr std::array<IVec3, 4> kColumn{IVec3(-1, -1, 0), IVec3(-1, 0, 0), IVec3(-1, 1, 0), IVec3(0, -1, 0)};
  std::array<Index, kColumn.size()> walker{};
  for (Index i = 0; i < corners.size(); ++i) {
    if (i > 0 && corners[i - 1].key + 1 == corners[i].key) sets.unite(i, i - 1);
    for (std::size_t n = 0; n < kColumn.size(); ++n) {
      const std::uint64_t middle = key_of(corners[i].at + kColumn[n]);
      while (corners[walker[n]].key + 1 < middle) ++walker[n];
      for (Index j = walker[n]; corners[j].key <= middle + 1; ++j) sets.unite(i, j);
    }
  }
  std::vector<Index> cluster(corners.size());
  for (Index i = 0; i < corners.size(); ++i) cluster[i] = sets.root(i);
  return cluster;
}

/// The mesh's sides in the box about a cluster, to be changed corner by corner.
class LocalSides {
public:
  LocalSides(const std::vector<IVec3>& cluster, const Sides& sides) : low_(cluster.front()), high_(cluster.front()) {
    for (const IVec3& c : cluster) {
      low_ = glm::min(low_, c);
      high_ = glm::max(high_, c);
    }
    low_ -= 1;
    size_ = high_ + 2 - low_;
    side_.assign(std::size_t(size_.x) * size_.y * size_.z, kUnread);
    changed_.assign(side_.size(), 1);
    for (int n = 0; n < 27; ++n) step_[n] = (std::ptrdiff_t(n / 9 - 1) * size_.y + n / 3 % 3 - 1) * size_.z + n % 3 - 1;
    for (const IVec3& c : cluster)
      for (int n = 0; n < 27; ++n)
        if (std::int8_t& side = side_[index(c) + step_[n]]; side == kUnread)
          side = sides.inside_mesh(c + IVec3(n / 9 - 1, n / 3 % 3 - 1, n % 3 - 1));
  }

  /// Flips the corner if that is simple in both connectivities; whether it did.
  bool peel(const IVec3& c) {
    const std::size_t at = index(c);
    if (!changed_[at]) return false;  // as it was when it was last looked at
    changed_[at] = 0;
    const Neighbourhood inside = around(at);
    if (!is_simple(inside, false) || !is_simple(inside, true)) return false;
    side_[at] ^= 1;
    for (const std::ptrdiff_t step : step_) changed_[at + step] = 1;
    return true;
  }

private:
  static constexpr std::int8_t kUnread = -1;

  Neighbourhood around(std::size_t at) const {
    Neighbourhood mask = 0;
    for (int n = 0; n < 27; ++n) mask |= Neighbourhood(side_[at + step_[n]] == 1) << n;
    return mask;
  }

  std::size_t index(const IVec3& c) const {
    const IVec3 d = c - low_;
    return (std::size_t(d.x) * size_.y + d.y) * size_.z + d.z;
  }

  IVec3 low_, high_, size_{0};
  std::vector<std::int8_t> side_;
  std::vector<std::uint8_t> changed_;  // since it was last looked at, something in the neighbourhood has
  std::array<std::ptrdiff_t, 27> step_{};
};

/// Flips the cluster's corners to the field's side as long as the flip is simple in both connectivities, in the given
/// order, again and again; returns those that are left: where the topology may have to change.
std::vector<Index> peel(const std::vector<IVec3>& cluster, const Sides& sides) {
  LocalSides local(cluster, sides);
  std::vector<Index> left(cluster.size());
  std::iota(left.begin(), left.end(), Index(0));
  for (std::size_t before = left.size() + 1; left.size() < before;) {
    before = left.size();
    std::erase_if(left, [&](Index i) { return local.peel(cluster[i]); });
  }
  return left;
}

/// Whether the mesh passes between the corner and one of those about it.
bool is_beside_mesh(const IVec3& c, const Sides& sides) {
  const bool inside = sides.inside_mesh(c);
  for (int n = 0; n < 27; ++n)
    if (sides.inside_mesh(c + IVec3(n / 9 - 1, n / 3 % 3 - 1, n % 3 - 1)) != inside) return true;
  return false;
}

/// F and |grad F| at points.
struct Samples {
  Samples(const std::vector<Vec3>& points, Backend& backend) : value(points.size()), slope(points.size()) {
    std::vector<Vec3> gradients(points.size());
    backend.evaluate(points, value, gradients);
    for_each_index(points.size(), [&](std::size_t i) { slope[i] = glm::length(gradients[i]); });
  }
  /// The slope kept above a tenth of what a distance has.
  double distance(std::size_t i) const {
    constexpr float kLeastSlope = 0.1f;
    return std::abs(value[i]) / std::max(slope[i], kLeastSlope);
  }

  std::vector<float> value, slope;
};

Vec3 centroid_of(const TriangleMesh& mesh, std::size_t t) {
  return (mesh.position(mesh.vertex[3 * t]) + mesh.position(mesh.vertex[3 * t + 1]) +
          mesh.position(mesh.vertex[3 * t + 2])) /
         3.0f;
}

std::vector<Vec3> centroids_of(const TriangleMesh& mesh) {
  std::vector<Vec3> centroids(mesh.triangle_count());
  for_each_index(centroids.size(), [&](std::size_t t) { centroids[t] = centroid_of(mesh, t); });
  return centroids;
}

/// Bad by the distance that the gradient tells, surely bad by the one the certificate goes by.
void add_strays(const std::vector<Vec3>& points, double share, const FarCorners& far, Backend& backend,
                const BadSiteOptions& options, BadSites& sites) {
  const Samples samples(points, backend);
  const std::vector<Index> strays =
      indices_where(points.size(), [&](Index i) { return !(samples.distance(i) <= share * options.tolerance); });
  for (const Index i : strays) sites.add(points[i], far.is_far(samples.value[i], samples.slope[i]), true);
}

}  // namespace

BadSites find_bad_sites(const TriangleMesh& mesh, const Field& field, const BrickLattice& lattice,
                        const DifferingBricks& differing, Backend& backend, const BadSiteOptions& options) {
  const Span span("bad sites");
  BadSites sites;
  const FarCorners far(field, lattice, options.tolerance);
  const std::vector<Corner> corners = differing_corners(lattice, differing);
  const std::vector<Index> cluster = clusters_of(corners);
  std::vector<Vec3> points;
  for (const Corner& c : corners) points.push_back(Vec3(lattice.point(c.at)));
  const Samples samples(points, backend);
  std::vector<double> distance(corners.size());
  for_each_index(distance.size(), [&](std::size_t i) { distance[i] = samples.distance(i); });

  // Clusters as runs, corners nearest to the surface first: they are the ones a coarse mesh cuts.
  std::vector<Index> order(corners.size());
  std::iota(order.begin(), order.end(), Index(0));
  tbb::parallel_sort(order, [&](Index a, Index b) {
    return std::tuple(cluster[a], distance[a], a) < std::tuple(cluster[b], distance[b], b);
  });
  std::vector<std::pair<std::size_t, std::size_t>> runs;
  for (std::size_t i = 0, j; i < order.size(); i = j) {
    for (j = i; j < order.size() && cluster[order[j]] == cluster[order[i]]; ++j) {
    }
    runs.emplace_back(i, j);
  }
  const Sides sides(lattice, differing);
  // At a cusp the slope between corners, which the certificate goes by, is far less than the gradient.
  const auto blamed = [&](const Corner& corner) {
    const std::size_t b = corner.slot / BrickLattice::kValues;
    const IVec3 local = corner.at - 8 * lattice.coordinate[b];
    return far(&lattice.value[b * BrickLattice::kValues], local.x, local.y, local.z);
  };
  std::vector<std::uint8_t> bad(corners.size(), 0), sure(corners.size(), 0), suspect(corners.size(), 0);
  tbb::parallel_for(std::size_t(0), runs.size(), [&](std::size_t r) {
    const auto [begin, end] = runs[r];
    std::vector<IVec3> members;
    for (std::size_t i = begin; i < end; ++i) members.push_back(corners[order[i]].at);
    for (const Index i : peel(members, sides)) suspect[order[begin + i]] = 1;
    for (std::size_t i = begin; i < end; ++i) {
      const Index c = order[i];
      const std::int8_t times = corners[c].winding;
      sure[c] = far.is_far(samples.value[c], samples.slope[c]) || blamed(corners[c]);
      bad[c] = suspect[c] || sure[c] || times < 0 || times > 1 || distance[c] > options.tolerance;
    }
    // A spike that was lost far from the mesh is to be found from where it leaves the mesh.
    bool any_sure = false, reached = false;
    for (std::size_t i = begin; i < end && !reached; ++i) {
      if (!sure[order[i]]) continue;
      any_sure = true;
      reached = is_beside_mesh(corners[order[i]].at, sides);
    }
    for (std::size_t i = begin; i < end && any_sure && !reached; ++i)
      if (is_beside_mesh(corners[order[i]].at, sides)) bad[order[i]] = suspect[order[i]] = 1;
  });
  for (const Index c : order)
    if (bad[c]) sites.add(points[c], sure[c] != 0, !suspect[c]);
  add_strays(mesh.vertices.position, options.stray_vertex, far, backend, options, sites);
  add_strays(centroids_of(mesh), options.stray_centre, far, backend, options, sites);
  return sites;
}

void add_astray(const TriangleMesh& mesh, const std::vector<std::uint8_t>& wanted, Backend& backend,
                ProjectOptions project, double reach, BadSites& sites) {
  const std::vector<Index> asked = indices_where(mesh.triangle_count(), [&](Index t) {
    return wanted[mesh.vertex[3 * t]] || wanted[mesh.vertex[3 * t + 1]] || wanted[mesh.vertex[3 * t + 2]];
  });
  std::vector<Vec3> centroids(asked.size());
  for_each_index(asked.size(), [&](std::size_t i) { centroids[i] = centroid_of(mesh, asked[i]); });
  std::vector<Vec3> projected = centroids;
  std::vector<ProjectStatus> status(asked.size());
  project.reach = float(reach);
  backend.project(projected, project, status);
  for (std::size_t i = 0; i < asked.size(); ++i)
    for (Index h = 3 * asked[i]; status[i] != ProjectStatus::converged && h < 3 * asked[i] + 3; ++h)
      sites.add(mesh.position(mesh.vertex[h]), false, true);
}

void add_tiles(const TriangleMesh& mesh, const std::vector<std::uint8_t>& wanted, const Tiles& tiles,
               double edge_length, BadSites& sites) {
  const double least = tiles.border / tiles.width;
  for (Index v = 0; v < mesh.vertex_count(); ++v) {
    if (!wanted[v]) continue;
    const DVec3 within = glm::fract(DVec3(mesh.position(v)) / (tiles.width * edge_length) + tiles.shift);
    if (glm::all(glm::greaterThan(within, DVec3(least))) && glm::all(glm::lessThan(within, DVec3(1.0 - least))))
      sites.add(mesh.position(v), false, true);
  }
}

}  // namespace isoskin
