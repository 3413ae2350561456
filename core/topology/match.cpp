#include "core/topology/match.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <tuple>

#include <tbb/parallel_for.h>

namespace isoskin {
namespace {

constexpr int kCells = BrickLattice::kCells;
constexpr std::size_t kChunk = 4096;  // vertices
constexpr std::size_t kShare = 10;    // a link needs at least one in so many votes of either piece
constexpr Index kSeveral = kNone - 1;

struct Votes {
  Index mesh, lattice;
  std::size_t count;
};

/// The one piece with patches in a cell; kNone without any, kSeveral with more than one.
Index piece_in_cell(const BrickLattice& lattice, const LatticeTopology& topology, const IVec3& cell) {
  const Index brick = lattice.find({cell.x >> 3, cell.y >> 3, cell.z >> 3});
  if (brick == kNone) return kNone;
  const auto [first, last] = topology.patches(brick, ((cell.x & 7) * kCells + (cell.y & 7)) * kCells + (cell.z & 7));
  if (first == last) return kNone;
  for (Index p = first + 1; p < last; ++p)
    if (topology.piece[p] != topology.piece[first]) return kSeveral;
  return topology.piece[first];
}

Index vote(const BrickLattice& lattice, const LatticeTopology& topology, const Vec3& position) {
  const IVec3 cell(glm::floor((DVec3(position) - lattice.origin) / lattice.spacing));
  const Index here = piece_in_cell(lattice, topology, cell);
  if (here != kNone) return here == kSeveral ? kNone : here;
  Index found = kNone;
  for (int i = 0; i < 27; ++i) {
    const Index near = piece_in_cell(lattice, topology, cell + IVec3(i / 9 - 1, i / 3 % 3 - 1, i % 3 - 1));
    if (near == kNone || near == found) continue;
    if (found != kNone || near == kSeveral) return kNone;
    found = near;
  }
  return found;
}

/// Votes by pair of pieces, sorted by mesh piece, then by lattice piece.
std::vector<Votes> count_votes(const TriangleMesh& mesh, const MeshPieces& pieces, const BrickLattice& lattice,
                               const LatticeTopology& topology) {
  std::vector<std::vector<Votes>> runs((mesh.vertex_count() + kChunk - 1) / kChunk);
  tbb::parallel_for(std::size_t{0}, runs.size(), [&](std::size_t k) {
    for (std::size_t v = k * kChunk; v < std::min(mesh.vertex_count(), (k + 1) * kChunk); ++v) {
      if (pieces.of_vertex[v] == kNone) continue;
      const Index to = vote(lattice, topology, mesh.vertices.position[v]);
      if (to == kNone) continue;
      if (!runs[k].empty() && runs[k].back().mesh == pieces.of_vertex[v] && runs[k].back().lattice == to)
        ++runs[k].back().count;
      else
        runs[k].push_back({pieces.of_vertex[v], to, 1});
    }
  });
  std::vector<Votes> all;
  for (const auto& r : runs) all.insert(all.end(), r.begin(), r.end());
  std::sort(all.begin(), all.end(),
            [](const Votes& a, const Votes& b) { return std::tie(a.mesh, a.lattice) < std::tie(b.mesh, b.lattice); });
  std::vector<Votes> out;
  for (const Votes& v : all)
    if (!out.empty() && out.back().mesh == v.mesh && out.back().lattice == v.lattice)
      out.back().count += v.count;
    else
      out.push_back(v);
  return out;
}

/// Pairs that hang together, as indices into `votes`.
std::vector<std::size_t> strong_links(const std::vector<Votes>& votes, std::size_t mesh_pieces,
                                      const LatticeTopology& topology, double least_piece) {
  constexpr std::size_t kNoVote = static_cast<std::size_t>(-1);
  std::vector<std::size_t> best_of_mesh(mesh_pieces, kNoVote), best_of_lattice(topology.piece_count(), kNoVote);
  std::vector<std::size_t> from_mesh(mesh_pieces, 0), to_lattice(topology.piece_count(), 0);
  for (std::size_t i = 0; i < votes.size(); ++i) {
    const auto better = [&](std::size_t than) { return than == kNoVote || votes[i].count > votes[than].count; };
    if (better(best_of_mesh[votes[i].mesh])) best_of_mesh[votes[i].mesh] = i;
    if (better(best_of_lattice[votes[i].lattice])) best_of_lattice[votes[i].lattice] = i;
    from_mesh[votes[i].mesh] += votes[i].count;
    to_lattice[votes[i].lattice] += votes[i].count;
  }
  std::vector<std::size_t> out;
  for (std::size_t i = 0; i < votes.size(); ++i) {
    const Votes& v = votes[i];
    const bool small = std::abs(topology.volume[v.lattice]) < least_piece;
    const bool share = v.count * kShare >= from_mesh[v.mesh] || v.count * kShare >= to_lattice[v.lattice];
    if (best_of_mesh[v.mesh] == i || (!small && (best_of_lattice[v.lattice] == i || share))) out.push_back(i);
  }
  return out;
}

}  // namespace

std::vector<Cluster> match_pieces(const TriangleMesh& mesh, const MeshPieces& pieces, const BrickLattice& lattice,
                                  const LatticeTopology& topology, double least_piece) {
  const std::vector<Votes> votes = count_votes(mesh, pieces, lattice, topology);
  // Disjoint sets over mesh pieces, then lattice pieces; the representative is the smallest member.
  std::vector<Index> parent(pieces.count() + topology.piece_count());
  std::iota(parent.begin(), parent.end(), Index{0});
  const auto find = [&](Index a) {
    while (parent[a] != a) a = parent[a] = parent[parent[a]];
    return a;
  };
  for (const std::size_t i : strong_links(votes, pieces.count(), topology, least_piece)) {
    const Index a = find(votes[i].mesh), b = find(static_cast<Index>(pieces.count()) + votes[i].lattice);
    parent[std::max(a, b)] = std::min(a, b);
  }
  std::vector<Cluster> clusters;
  std::vector<Index> cluster_of(parent.size(), kNone);
  for (Index p = 0; p < parent.size(); ++p) {
    Index& c = cluster_of[find(p)];
    if (c == kNone) {
      c = static_cast<Index>(clusters.size());
      clusters.emplace_back();
    }
    if (p < pieces.count())
      clusters[c].mesh.push_back(p);
    else
      clusters[c].lattice.push_back(p - static_cast<Index>(pieces.count()));
  }
  return clusters;
}

}  // namespace isoskin
