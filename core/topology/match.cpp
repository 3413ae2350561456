#include "core/topology/match.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <set>
#include <tuple>
#include <utility>

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include "core/disjoint_sets.h"
#include "core/mesh/independent_edits.h"
#include "core/mesh/one_ring.h"

namespace isoskin {
namespace {

constexpr int kCells = BrickLattice::kCells;
constexpr std::size_t kChunk = 4096;  // vertices
constexpr std::size_t kFewVotes = 4;  // so many may be strays from another sheet
constexpr std::size_t kShare = 4;     // beyond its match a piece hangs together with those of one in so many votes
constexpr Index kSeveral = kNone - 1;

struct Votes {
  Index mesh, lattice;
  std::size_t count;
};

IVec3 around(int i) {
  return {i / 9 - 1, i / 3 % 3 - 1, i % 3 - 1};
}

IVec3 cell_of(const BrickLattice& lattice, const Vec3& position) {
  return IVec3(glm::floor((DVec3(position) - lattice.origin) / lattice.spacing));
}

/// Tells the pieces in one cell after another; most are in the brick of the one before.
class Cells {
public:
  Cells(const BrickLattice& lattice, const LatticeTopology& topology) : lattice_(lattice), topology_(topology) {}

  template <class Visit>
  void for_pieces_in(const IVec3& cell, const Visit& visit) {
    const IVec3 brick = cell >> 3;
    if (brick != last_) {
      last_ = brick;
      last_number_ = lattice_.find(brick);
    }
    if (last_number_ == kNone) return;
    topology_.for_pieces_in_cell(last_number_, ((cell.x & 7) * kCells + (cell.y & 7)) * kCells + (cell.z & 7), visit);
  }

  /// The one piece with patches in a cell; kNone without any, kSeveral with more than one.
  Index piece_in(const IVec3& cell) {
    Index found = kNone;
    for_pieces_in(cell, [&](Index p) { found = found == kNone || found == p ? p : kSeveral; });
    return found;
  }

  Index vote(const Vec3& position) {
    const IVec3 cell = cell_of(lattice_, position);
    const Index here = piece_in(cell);
    if (here != kNone) return here == kSeveral ? kNone : here;
    Index found = kNone;
    for (int i = 0; i < 27; ++i) {
      const Index near = piece_in(cell + around(i));
      if (near == kNone || near == found) continue;
      if (found != kNone || near == kSeveral) return kNone;
      found = near;
    }
    return found;
  }

private:
  const BrickLattice& lattice_;
  const LatticeTopology& topology_;
  IVec3 last_{std::numeric_limits<int>::min()};  // no brick
  Index last_number_ = kNone;
};

/// Where votes may ask for one of these bricks, or for one that is no more.
ChangeMask about_changes(const BrickLattice& lattice, const std::vector<Index>& bricks) {
  constexpr double kReach = 1.01;  // cells
  FieldChanges changes;
  for (const Index b : bricks) changes.box.push_back(lattice.box(lattice.coordinate[b]));
  for (const IVec3& brick : lattice.gone) changes.box.push_back(lattice.box(brick));
  return ChangeMask(changes, kReach * lattice.spacing);
}

/// Votes by pair of pieces, sorted by mesh piece, then by lattice piece.
std::vector<Votes> count_votes(const MeshPieces& pieces, const std::vector<Index>& vote) {
  std::vector<std::vector<Votes>> runs((vote.size() + kChunk - 1) / kChunk);
  tbb::parallel_for(std::size_t{0}, runs.size(), [&](std::size_t k) {
    for (std::size_t v = k * kChunk; v < std::min(vote.size(), (k + 1) * kChunk); ++v) {
      const Index to = vote[v];
      if (pieces.of_vertex[v] == kNone || to == kNone) continue;
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

/// Which piece is which, one to one; kNone where there is no such piece.
struct Matching {
  std::vector<Index> of_mesh, of_lattice;

  void add(Index mesh, Index lattice) {
    of_mesh[mesh] = lattice;
    of_lattice[lattice] = mesh;
  }
};

/// Pieces that vote for each other most.
Matching mutual_matches(const std::vector<Votes>& votes, std::size_t mesh_pieces, std::size_t lattice_pieces) {
  constexpr std::size_t kNoVote = static_cast<std::size_t>(-1);
  std::vector<std::size_t> best_of_mesh(mesh_pieces, kNoVote), best_of_lattice(lattice_pieces, kNoVote);
  for (std::size_t i = 0; i < votes.size(); ++i) {
    const auto better = [&](std::size_t than) { return than == kNoVote || votes[i].count > votes[than].count; };
    if (better(best_of_mesh[votes[i].mesh])) best_of_mesh[votes[i].mesh] = i;
    if (better(best_of_lattice[votes[i].lattice])) best_of_lattice[votes[i].lattice] = i;
  }
  Matching matching{std::vector<Index>(mesh_pieces, kNone), std::vector<Index>(lattice_pieces, kNone)};
  for (const std::size_t i : best_of_mesh)
    if (i != kNoVote && best_of_lattice[votes[i].lattice] == i) matching.add(votes[i].mesh, votes[i].lattice);
  return matching;
}

/// A mesh piece without a match takes the lattice piece without one that most of its vertices have near. Drops of a few
/// cells beside a sheet need it: their own cell votes are too few.
void match_leftovers(const TriangleMesh& mesh, const MeshPieces& pieces, const BrickLattice& lattice,
                     const LatticeTopology& topology, Matching& matching) {
  std::map<std::pair<Index, Index>, std::size_t> near;  // (mesh piece, lattice piece) to vertices
  const bool all_matched = std::find(matching.of_mesh.begin(), matching.of_mesh.end(), kNone) == matching.of_mesh.end();
  if (all_matched) return;
  Cells cells(lattice, topology);
  for (std::size_t v = 0; v < mesh.vertex_count(); ++v) {
    const Index m = pieces.of_vertex[v];
    if (m == kNone || matching.of_mesh[m] != kNone) continue;
    std::set<Index> seen;
    const IVec3 cell = cell_of(lattice, mesh.vertices.position[v]);
    for (int i = 0; i < 27; ++i)
      cells.for_pieces_in(cell + around(i), [&](Index l) {
        if (matching.of_lattice[l] == kNone) seen.insert(l);
      });
    for (const Index l : seen) ++near[{m, l}];
  }
  std::vector<std::pair<std::pair<Index, Index>, std::size_t>> order(near.begin(), near.end());
  std::stable_sort(order.begin(), order.end(), [](const auto& a, const auto& b) { return a.second > b.second; });
  for (const auto& [pair, count] : order)
    if (matching.of_mesh[pair.first] == kNone && matching.of_lattice[pair.second] == kNone)
      matching.add(pair.first, pair.second);
}

/// Pairs of pieces that are not matched but hang together: one covers a good part of the other.
std::vector<std::pair<Index, Index>> overlaps(const std::vector<Votes>& votes, const Matching& matching,
                                              const MeshPieces& pieces, const LatticeTopology& topology,
                                              double least_piece) {
  std::vector<std::size_t> from_mesh(matching.of_mesh.size(), 0), to_lattice(matching.of_lattice.size(), 0);
  for (const Votes& v : votes) {
    from_mesh[v.mesh] += v.count;
    to_lattice[v.lattice] += v.count;
  }
  std::vector<std::pair<Index, Index>> out;
  for (const Votes& v : votes) {
    if (matching.of_mesh[v.mesh] == v.lattice || v.count < kFewVotes) continue;
    const bool much_of_mesh = v.count * kShare >= from_mesh[v.mesh] && std::abs(pieces.volume[v.mesh]) >= least_piece;
    const bool much_of_lattice =
        v.count * kShare >= to_lattice[v.lattice] && std::abs(topology.volume[v.lattice]) >= least_piece;
    if (much_of_mesh || much_of_lattice) out.emplace_back(v.mesh, v.lattice);
  }
  return out;
}

}  // namespace

std::vector<Index> piece_votes(const TriangleMesh& mesh, const BrickLattice& lattice, const LatticeTopology& topology,
                               const std::vector<Index>& before, const MeshChanges* changes) {
  constexpr std::size_t kMostChanged = 4;  // one in so many bricks
  constexpr std::size_t kFew = 256;        // vertices
  std::vector<Index> vote(mesh.vertex_count()), asked;
  if (changes && !before.empty() && topology.changed &&
      topology.changed->size() * kMostChanged <= lattice.brick_count()) {
    const ChangeMask about = about_changes(lattice, *topology.changed);
    asked = indices_where(vote.size(), [&](Index v) {
      if (changes->moved[v] || about.contains(DVec3(mesh.position(v)))) return true;
      vote[v] = before[changes->vertex_before[v]];
      return false;
    });
  } else {
    asked = indices_where(vote.size(), [](Index) { return true; });
  }
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, asked.size(), kFew), [&](const auto& range) {
    Cells cells(lattice, topology);
    for (std::size_t i = range.begin(); i != range.end(); ++i) vote[asked[i]] = cells.vote(mesh.position(asked[i]));
  });
  return vote;
}

std::vector<Cluster> match_pieces(const TriangleMesh& mesh, const MeshPieces& pieces, const BrickLattice& lattice,
                                  const LatticeTopology& topology, double least_piece, const std::vector<Index>& vote) {
  const std::vector<Votes> votes = count_votes(pieces, vote);
  Matching matching = mutual_matches(votes, pieces.count(), topology.piece_count());
  match_leftovers(mesh, pieces, lattice, topology, matching);
  // Disjoint sets over mesh pieces, then lattice pieces; the representative is the smallest member.
  DisjointSets sets(pieces.count() + topology.piece_count());
  const auto join = [&](Index mesh_piece, Index lattice_piece) {
    sets.unite(mesh_piece, static_cast<Index>(pieces.count()) + lattice_piece);
  };
  for (Index m = 0; m < pieces.count(); ++m)
    if (matching.of_mesh[m] != kNone) join(m, matching.of_mesh[m]);
  for (const auto& [m, l] : overlaps(votes, matching, pieces, topology, least_piece)) join(m, l);
  std::vector<Cluster> clusters;
  std::vector<Index> cluster_of(pieces.count() + topology.piece_count(), kNone);
  for (Index p = 0; p < cluster_of.size(); ++p) {
    Index& c = cluster_of[sets.root(p)];
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

std::vector<Index> vertices_between_pieces(const TriangleMesh& mesh, const std::vector<std::uint8_t>& merged,
                                           const BrickLattice& lattice, const LatticeTopology& topology) {
  std::vector<Index> vote(mesh.vertex_count(), kNone);
  tbb::parallel_for(std::size_t{0}, (vote.size() + kChunk - 1) / kChunk, [&](std::size_t k) {
    Cells cells(lattice, topology);
    for (std::size_t v = k * kChunk; v < std::min(vote.size(), (k + 1) * kChunk); ++v)
      if (merged[v]) vote[v] = cells.vote(mesh.vertices.position[v]);
  });
  std::vector<Index> queue = indices_where(vote.size(), [&](Index v) { return vote[v] != kNone; });
  if (queue.empty()) return {};
  const std::vector<Index> outgoing = outgoing_halfedges(mesh);
  for (std::size_t i = 0; i < queue.size(); ++i)
    for_each_leaving(mesh, outgoing[queue[i]], [&](Index h) {
      if (vote[mesh.to(h)] != kNone) return;
      vote[mesh.to(h)] = vote[queue[i]];
      queue.push_back(mesh.to(h));
    });
  return indices_where(vote.size(), [&](Index v) {
    bool between = false;
    if (vote[v] != kNone) for_each_leaving(mesh, outgoing[v], [&](Index h) { between |= vote[mesh.to(h)] > vote[v]; });
    return between;
  });
}

}  // namespace isoskin
