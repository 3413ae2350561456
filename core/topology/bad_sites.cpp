#include "core/topology/bad_sites.h"

#include <algorithm>
#include <numeric>

#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>

namespace isoskin {
namespace {

constexpr int kCorners = BrickLattice::kCorners;

/// A lattice corner by its coordinates, packed so that sorting goes x, y, z.
std::uint64_t key_of(const IVec3& c) {
  constexpr int kOffset = 1 << 20;
  return (std::uint64_t(c.x + kOffset) << 42) | (std::uint64_t(c.y + kOffset) << 21) | std::uint64_t(c.z + kOffset);
}

/// Sides of lattice corners, asked for by coordinates. Corners that no brick holds are `unknown`.
class Sides {
public:
  enum Side : std::int8_t { outside = 0, inside = 1, unknown = -1 };

  Sides(const BrickLattice& lattice, const std::vector<std::int8_t>& winding) : lattice_(lattice), winding_(winding) {}

  Side of_mesh(const IVec3& c) const {
    const std::size_t i = slot(c);
    return i == std::size_t(-1) ? unknown : winding_[i] > 0 ? inside : outside;
  }

private:
  std::size_t slot(const IVec3& c) const {
    const IVec3 brick(c.x >> 3, c.y >> 3, c.z >> 3);
    // A corner on a brick's low side also belongs to the brick below, which may be the only one there.
    for (int shift = 0; shift < 8; ++shift) {
      const IVec3 step((shift >> 2) & 1, (shift >> 1) & 1, shift & 1);
      const IVec3 local = c - 8 * (brick - step);
      if (local.x > 8 || local.y > 8 || local.z > 8) continue;
      const Index b = lattice_.find(brick - step);
      if (b != kNone)
        return std::size_t(b) * BrickLattice::kValues + (std::size_t(local.x) * kCorners + local.y) * kCorners +
               local.z;
    }
    return std::size_t(-1);
  }

  const BrickLattice& lattice_;
  const std::vector<std::int8_t>& winding_;
};

struct Corner {
  std::uint64_t key;
  IVec3 at;
  std::size_t slot;  // into lattice.value
  bool operator<(const Corner& other) const { return key < other.key; }
};

/// Lattice corners whose side differs between mesh and field, each once, sorted.
std::vector<Corner> differing_corners(const BrickLattice& lattice, const std::vector<std::int8_t>& winding) {
  std::vector<std::vector<Corner>> of_brick(lattice.brick_count());
  tbb::parallel_for(std::size_t(0), lattice.brick_count(), [&](std::size_t b) {
    for (int x = 0; x < kCorners; ++x)
      for (int y = 0; y < kCorners; ++y)
        for (int z = 0; z < kCorners; ++z) {
          const std::size_t i = b * BrickLattice::kValues + (std::size_t(x) * kCorners + y) * kCorners + z;
          if (winding[i] == (lattice.value[i] > 0.0f ? 1 : 0)) continue;
          const IVec3 at = 8 * lattice.coordinate[b] + IVec3(x, y, z);
          of_brick[b].push_back({key_of(at), at, i});
        }
  });
  std::vector<Corner> corners;
  for (const auto& list : of_brick) corners.insert(corners.end(), list.begin(), list.end());
  tbb::parallel_sort(corners);
  corners.erase(std::unique(corners.begin(), corners.end(), [](auto& a, auto& b) { return a.key == b.key; }),
                corners.end());
  return corners;
}

Index find_corner(const std::vector<Corner>& corners, const IVec3& at) {
  const std::uint64_t key = key_of(at);
  const auto it =
      std::lower_bound(corners.begin(), corners.end(), key, [](const Corner& c, std::uint64_t k) { return c.key < k; });
  return it != corners.end() && it->key == key ? Index(it - corners.begin()) : kNone;
}

Index root_of(std::vector<Index>& parent, Index i) {
  while (parent[i] != i) i = parent[i] = parent[parent[i]];
  return i;
}

/// The corners' 26-connected clusters: the smallest member of each corner's cluster.
std::vector<Index> clusters_of(const std::vector<Corner>& corners) {
  std::vector<Index> parent(corners.size());
  std::iota(parent.begin(), parent.end(), Index(0));
  for (Index i = 0; i < corners.size(); ++i)
    for (int n = 0; n < 13; ++n) {  // the 13 neighbours that sort before
      const IVec3 d(n / 9 - 1, (n / 3) % 3 - 1, n % 3 - 1);
      const Index j = find_corner(corners, corners[i].at + d);
      if (j == kNone) continue;
      const Index a = root_of(parent, i), b = root_of(parent, j);
      parent[std::max(a, b)] = std::min(a, b);
    }
  for (Index i = 0; i < corners.size(); ++i) parent[i] = root_of(parent, i);
  return parent;
}

/// Change of the Euler characteristics of the mesh's inside set when the cluster's corners change sides.
/// `joined`: voxels that touch at a corner hang together, else only across faces (both as cubical complexes).
struct EulerChange {
  int joined = 0, apart = 0;
};

EulerChange change_of(const std::vector<IVec3>& cluster, const Sides& sides) {
  std::vector<std::uint64_t> flipped;
  for (const IVec3& c : cluster) flipped.push_back(key_of(c));
  const auto side_after = [&](const IVec3& c) {
    const Sides::Side before = sides.of_mesh(c);
    const bool flips = std::binary_search(flipped.begin(), flipped.end(), key_of(c));
    return !flips || before == Sides::unknown ? before : before == Sides::inside ? Sides::outside : Sides::inside;
  };
  // Cells of the dual complex: blocks of 1 or 2 corners on each axis. In the joined complex a block of corners stands
  // for a cell that is present when any of them is inside; in the other when all are. A block's dimension there is 3 -
  // (number of doubled axes), here the number of doubled axes.
  EulerChange change;
  std::vector<std::pair<std::uint64_t, int>> blocks;
  for (const IVec3& c : cluster)
    for (int axes = 0; axes < 8; ++axes) {
      const IVec3 wide(axes & 1, (axes >> 1) & 1, (axes >> 2) & 1);
      for (int low = 0; low < 8; ++low) {
        const IVec3 back(low & 1, (low >> 1) & 1, (low >> 2) & 1);
        if (glm::any(glm::greaterThan(back, wide))) continue;
        blocks.emplace_back(key_of(c - back), axes);
      }
    }
  std::sort(blocks.begin(), blocks.end());
  blocks.erase(std::unique(blocks.begin(), blocks.end()), blocks.end());
  for (const auto& [key, axes] : blocks) {
    constexpr int kMask = (1 << 21) - 1, kOffset = 1 << 20;
    const IVec3 low(int(key >> 42) - kOffset, int((key >> 21) & kMask) - kOffset, int(key & kMask) - kOffset);
    int any_before = 0, any_after = 0, all_before = 1, all_after = 1;
    bool known = true;
    for (int corner = 0; corner < 8; ++corner) {
      if ((corner & ~axes) != 0) continue;
      const IVec3 at = low + IVec3(corner & 1, (corner >> 1) & 1, (corner >> 2) & 1);
      const Sides::Side before = sides.of_mesh(at), after = side_after(at);
      if (before == Sides::unknown) {
        known = false;
        break;
      }
      any_before |= before, any_after |= after;
      all_before &= before, all_after &= after;
    }
    if (!known) continue;
    const int sign = __builtin_popcount(unsigned(axes)) % 2 ? -1 : 1;
    change.apart += sign * (all_after - all_before);
    change.joined -= sign * (any_after - any_before);  // (-1)^(3-d) = -(-1)^d
  }
  return change;
}

/// Distance estimates |F| / |grad F| at points, the slope kept above a tenth of what a distance has.
std::vector<float> distances(const std::vector<Vec3>& points, Backend& backend) {
  constexpr float kLeastSlope = 0.1f;
  std::vector<float> values(points.size());
  std::vector<Vec3> gradients(points.size());
  backend.evaluate(points, values, gradients);
  for (std::size_t i = 0; i < points.size(); ++i)
    values[i] = std::abs(values[i]) / std::max(glm::length(gradients[i]), kLeastSlope);
  return values;
}

std::vector<Vec3> centroids_of(const TriangleMesh& mesh) {
  std::vector<Vec3> centroids(mesh.triangle_count());
  tbb::parallel_for(std::size_t(0), centroids.size(), [&](std::size_t t) {
    centroids[t] = (mesh.position(mesh.vertex[3 * t]) + mesh.position(mesh.vertex[3 * t + 1]) +
                    mesh.position(mesh.vertex[3 * t + 2])) /
                   3.0f;
  });
  return centroids;
}

void add_strays(const std::vector<Vec3>& points, double farthest, Backend& backend, BadSites& sites) {
  const std::vector<float> distance = distances(points, backend);
  for (std::size_t i = 0; i < points.size(); ++i)
    if (!(distance[i] <= farthest)) {
      sites.point.push_back(points[i]);
      ++sites.strays;
    }
}

}  // namespace

BadSites find_bad_sites(const TriangleMesh& mesh, const BrickLattice& lattice, const std::vector<std::int8_t>& winding,
                        Backend& backend, const BadSiteOptions& options) {
  BadSites sites;
  const std::vector<Corner> corners = differing_corners(lattice, winding);
  const std::vector<Index> cluster = clusters_of(corners);
  std::vector<Vec3> points;
  for (const Corner& c : corners) points.push_back(Vec3(lattice.point(c.at)));
  const std::vector<float> distance = distances(points, backend);

  std::vector<Index> order(corners.size());
  std::iota(order.begin(), order.end(), Index(0));
  std::stable_sort(order.begin(), order.end(), [&](Index a, Index b) { return cluster[a] < cluster[b]; });
  std::vector<std::pair<std::size_t, std::size_t>> runs;
  for (std::size_t i = 0, j; i < order.size(); i = j) {
    for (j = i; j < order.size() && cluster[order[j]] == cluster[order[i]]; ++j) {
    }
    runs.emplace_back(i, j);
  }
  const Sides sides(lattice, winding);
  std::vector<std::uint8_t> bad(runs.size(), 0);
  tbb::parallel_for(std::size_t(0), runs.size(), [&](std::size_t r) {
    std::vector<IVec3> members;
    for (std::size_t i = runs[r].first; i < runs[r].second; ++i) {
      const Corner& c = corners[order[i]];
      members.push_back(c.at);
      bad[r] |= distance[order[i]] > options.tolerance || winding[c.slot] < 0 || winding[c.slot] > 1;
    }
    if (bad[r]) return;
    const EulerChange change = change_of(members, sides);
    bad[r] = change.joined != 0 || change.apart != 0;
  });
  for (std::size_t r = 0; r < runs.size(); ++r) {
    if (!bad[r]) continue;
    ++sites.clusters;
    for (std::size_t i = runs[r].first; i < runs[r].second; ++i) sites.point.push_back(points[order[i]]);
  }
  add_strays(mesh.vertices.position, options.stray_vertex * options.tolerance, backend, sites);
  add_strays(centroids_of(mesh), options.stray_centre * options.tolerance, backend, sites);
  return sites;
}

}  // namespace isoskin
