#include "core/topology/bad_sites.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <tuple>

#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>

#include "core/disjoint_sets.h"
#include "core/mesh/independent_edits.h"
#include "core/parallel.h"
#include "core/topology/columns.h"
#include "core/topology/sides.h"
#include "core/topology/simple_point.h"
#include "core/trace.h"

namespace isoskin {
namespace {

constexpr int kCells = BrickLattice::kCells;
constexpr int kCorners = BrickLattice::kCorners;

/// A lattice corner by its coordinates, packed so that sorting goes x, y, z. Offsets of corners are differences of
/// keys.
constexpr std::uint64_t key_of(const IVec3& c) {
  constexpr int kOffset = 1 << 20;
  return (std::uint64_t(c.x + kOffset) << 42) | (std::uint64_t(c.y + kOffset) << 21) | std::uint64_t(c.z + kOffset);
}

/// Rows of bricks' corners, as BrickSigns has them: bits where they are inside the mesh.
class MeshSides {
public:
  MeshSides(const DifferingBricks& differing, const std::vector<BrickSigns>& signs)
      : differing_(differing), signs_(signs), wound_(differing.brick.size()) {
    for_each_index(wound_.size(), [&](std::size_t n) {
      const std::int8_t* winding = &differing.winding[n * BrickLattice::kValues];
      for (std::uint16_t& row : wound_[n].row)
        for (int z = 0; z < kCorners; ++z) row |= std::uint16_t(*winding++ > 0) << z;
    });
  }
  unsigned row(Index brick, int x, int y) const {
    const Index n = differing_.number[brick];
    return (n == kNone ? signs_[brick] : wound_[n]).at(x, y);
  }

private:
  const DifferingBricks& differing_;
  const std::vector<BrickSigns>& signs_;
  std::vector<BrickSigns> wound_;
};

/// Sides of the mesh at a brick's corners and at those about it; corners that no brick holds count as outside.
class SidesAbout {
public:
  SidesAbout(const BrickLattice& lattice, const MeshSides& sides, Index brick) {
    for (int n = 0; n < 27; ++n) {
      const IVec3 to(n / 9 - 1, n / 3 % 3 - 1, n % 3 - 1);
      const Index other = lattice.find(lattice.coordinate[brick] + to);
      if (other == kNone) continue;
      for (int x = first(to.x); x <= last(to.x); ++x)
        for (int y = first(to.y); y <= last(to.y); ++y) {
          const unsigned row = sides.row(other, x, y);
          row_[(x + kCells * to.x + 1) * kWide + y + kCells * to.y + 1] |= to.z < 0   ? row >> (kCells - 1)
                                                                           : to.z > 0 ? (row & 3) << kCorners
                                                                                      : row << 1;
        }
    }
  }
  Neighbourhood about(int x, int y, int z) const {
    Neighbourhood inside = 0;
    for (int n = 0; n < 9; ++n) inside |= (row_[(x + n / 3) * kWide + y + n % 3] >> z & 7u) << (3 * n);
    return inside;
  }

private:
  static constexpr int kWide = kCorners + 2;
  // Of a neighbour's corners those within one of the brick's.
  static int first(int to) { return to < 0 ? kCells - 1 : 0; }
  static int last(int to) { return to > 0 ? 1 : kCells; }

  std::array<unsigned, kWide * kWide> row_{};
};

bool is_simple_both_ways(Neighbourhood inside) {
  return is_simple(inside, false) && is_simple(inside, true);
}

struct Corner {
  std::uint64_t key;
  IVec3 at;
  Neighbourhood inside;  // of the mesh
  std::size_t slot;      // into lattice.value
  std::int8_t winding;   // of the mesh
  // Corners on bricks' faces come once for each brick, with what that brick knows of them: ties must not be open.
  bool operator<(const Corner& other) const { return std::pair(key, slot) < std::pair(other.key, other.slot); }

  /// Whether the mesh passes between the corner and one of those about it.
  bool is_beside_mesh() const {
    constexpr Neighbourhood kAll = (1u << 27) - 1;
    return inside != 0 && inside != kAll;
  }
};

/// Lattice corners whose side differs between mesh and field, each once, sorted. Left out are those with |F| up to
/// `zero`, on the surface, whose side means nothing to the topology of the mesh.
std::vector<Corner> differing_corners(const BrickLattice& lattice, const DifferingBricks& differing,
                                      const std::vector<BrickSigns>& signs, double zero) {
  const MeshSides sides(differing, signs);
  std::vector<std::vector<Corner>> of_brick(differing.brick.size());
  tbb::parallel_for(std::size_t(0), of_brick.size(), [&](std::size_t n) {
    const Index b = differing.brick[n];
    const SidesAbout about(lattice, sides, b);
    for (int x = 0; x < kCorners; ++x)
      for (int y = 0; y < kCorners; ++y)
        for (int z = 0; z < kCorners; ++z) {
          const std::size_t i = (std::size_t(x) * kCorners + y) * kCorners + z;
          const std::size_t slot = std::size_t{b} * BrickLattice::kValues + i;
          const std::int8_t winding = differing.winding[n * BrickLattice::kValues + i];
          if (winding == (lattice.value[slot] > 0.0f ? 1 : 0)) continue;
          const Neighbourhood inside = about.about(x, y, z);
          const bool once = winding == 0 || winding == 1;
          if (once && std::abs(lattice.value[slot]) <= zero && is_simple_both_ways(inside)) continue;
          const IVec3 at = kCells * lattice.coordinate[b] + IVec3(x, y, z);
          of_brick[n].push_back({key_of(at), at, inside, slot, winding});
        }
  });
  std::vector<Corner> corners;
  for (const auto& list : of_brick) corners.insert(corners.end(), list.begin(), list.end());
  tbb::parallel_sort(corners);
  corners.erase(std::unique(corners.begin(), corners.end(), [](auto& a, auto& b) { return a.key == b.key; }),
                corners.end());
  return corners;
}

/// Which corners of a sorted list are within one of each other.
class CornerNeighbours {
public:
  explicit CornerNeighbours(const std::vector<Corner>& corners) : corners_(corners), first_(corners.size()) {
    // One walker goes up each of the nine lattice columns about a corner.
    constexpr std::size_t kRun = 2048;
    tbb::parallel_for(std::size_t(0), (corners.size() + kRun - 1) / kRun, [&](std::size_t run) {
      std::array<Index, 9> walker{};
      for (int n = 0; n < 9; ++n) {
        const auto before = [](const Corner& c, std::uint64_t key) { return c.key < key; };
        walker[n] = Index(std::lower_bound(corners.begin(), corners.end(), lowest(corners[run * kRun], n), before) -
                          corners.begin());
      }
      for (std::size_t i = run * kRun; i < std::min(corners.size(), (run + 1) * kRun); ++i) {
        for (int n = 0; n < 9; ++n)
          while (walker[n] < corners.size() && corners[walker[n]].key < lowest(corners[i], n)) ++walker[n];
        first_[i] = walker;
      }
    });
  }

  /// visit(j, bit) for those about corner i: the bit of j in i's neighbourhood.
  template <class Visit>
  void for_each(Index i, const Visit& visit) const {
    for (int n = 0; n < 9; ++n) {
      const std::uint64_t low = lowest(corners_[i], n);
      for (Index j = first_[i][n]; j < corners_.size() && corners_[j].key <= low + 2; ++j)
        if (j != i) visit(j, 3 * n + int(corners_[j].key - low));
    }
  }

private:
  /// The lowest corner about another in a column.
  static std::uint64_t lowest(const Corner& corner, int n) {
    return corner.key + key_of(IVec3(n / 3 - 1, n % 3 - 1, -1)) - key_of(IVec3(0));
  }

  const std::vector<Corner>& corners_;
  std::vector<std::array<Index, 9>> first_;
};

/// The corners' 26-connected clusters: the smallest member of each corner's cluster.
std::vector<Index> clusters_of(std::size_t corners, const CornerNeighbours& neighbours) {
  DisjointSets sets(corners);
  std::vector<Index> cluster(corners);
  for_each_index(corners, [&](std::size_t i) {
    neighbours.for_each(Index(i), [&](Index j, int) {
      if (j < i) sets.unite(Index(i), j);
    });
  });
  for_each_index(corners, [&](std::size_t i) { cluster[i] = sets.root(Index(i)); });
  return cluster;
}

/// Flips corners to the field's side; the corners of different clusters at once.
class Peeling {
public:
  Peeling(const std::vector<Corner>& corners, const CornerNeighbours& neighbours)
      : neighbours_(neighbours), inside_(corners.size()), changed_(corners.size(), 1) {
    for_each_index(corners.size(), [&](std::size_t i) { inside_[i] = corners[i].inside; });
  }

  /// Flips a cluster's corners as long as the flip is simple in both connectivities, in the given order, again and
  /// again; returns those that are left: where the topology may have to change.
  std::vector<Index> peel(std::vector<Index> cluster) {
    for (std::size_t before = cluster.size() + 1; cluster.size() < before;) {
      before = cluster.size();
      std::erase_if(cluster, [&](Index i) { return flip(i); });
    }
    return cluster;
  }

private:
  /// Whether the corner's flip was simple.
  bool flip(Index i) {
    if (!changed_[i]) return false;  // as it was when it was last looked at
    changed_[i] = 0;
    if (!is_simple_both_ways(inside_[i])) return false;
    neighbours_.for_each(i, [&](Index j, int bit) {
      inside_[j] ^= 1u << (26 - bit);
      changed_[j] = 1;
    });
    return true;
  }

  const CornerNeighbours& neighbours_;
  std::vector<Neighbourhood> inside_;
  std::vector<std::uint8_t> changed_;  // since it was last looked at, something in the neighbourhood has
};

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
                        const std::vector<BrickSigns>& signs, Backend& backend, const BadSiteOptions& options) {
  constexpr double kZero = 1e-6;  // of the tolerance: F is zero but for rounding
  const Span span("bad sites");
  BadSites sites;
  const FarCorners far(field, lattice, options.tolerance);
  const std::vector<Corner> corners =
      differing_corners(lattice, differing_bricks(mesh, lattice, signs), signs, kZero * far.threshold());
  const CornerNeighbours neighbours(corners);
  const std::vector<Index> cluster = clusters_of(corners.size(), neighbours);
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
  Peeling peeling(corners, neighbours);
  // At a cusp the slope between corners, which the certificate goes by, is far less than the gradient.
  const auto blamed = [&](const Corner& corner) {
    const std::size_t b = corner.slot / BrickLattice::kValues;
    const IVec3 local = corner.at - 8 * lattice.coordinate[b];
    return far(&lattice.value[b * BrickLattice::kValues], local.x, local.y, local.z);
  };
  std::vector<std::uint8_t> bad(corners.size(), 0), sure(corners.size(), 0), suspect(corners.size(), 0);
  tbb::parallel_for(std::size_t(0), runs.size(), [&](std::size_t r) {
    const auto [begin, end] = runs[r];
    const auto run = order.begin() + std::ptrdiff_t(begin);
    for (const Index c : peeling.peel({run, run + std::ptrdiff_t(end - begin)})) suspect[c] = 1;
    for (std::size_t i = begin; i < end; ++i) {
      const Index c = order[i];
      const std::int8_t times = corners[c].winding;
      sure[c] = far.is_far(samples.value[c], samples.slope[c]) || blamed(corners[c]);
      bad[c] = suspect[c] || sure[c] || times < 0 || times > 1 || distance[c] > options.tolerance;
    }
    // A spike that was lost far from the mesh is surely wrong where it leaves the mesh: nothing else tells, and what is
    // opened there has the topology of what comes.
    bool any_sure = false, reached = false;
    for (std::size_t i = begin; i < end && !reached; ++i) {
      if (!sure[order[i]]) continue;
      any_sure = true;
      reached = corners[order[i]].is_beside_mesh();
    }
    for (std::size_t i = begin; i < end && any_sure && !reached; ++i)
      if (corners[order[i]].is_beside_mesh()) bad[order[i]] = suspect[order[i]] = sure[order[i]] = 1;
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
