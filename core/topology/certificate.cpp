#include "core/topology/certificate.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include <fmt/format.h>
#include <tbb/parallel_invoke.h>

#include "core/topology/match.h"

namespace isoskin {
namespace {

constexpr std::array kFaults{Fault::none,  Fault::wrong_side, Fault::euler,  Fault::merged,
                             Fault::split, Fault::spurious,   Fault::missing};

/// A film so thin that no lattice corner lies deep in it can lose most of its volume without any side telling.
bool shrunk(double mesh, double lattice, const CertifyOptions& options) {
  return std::abs(lattice) >= options.volume_from && (std::abs(mesh) < options.volume_share * std::abs(lattice) ||
                                                      std::abs(lattice) < options.volume_share * std::abs(mesh));
}

Fault judge(const Cluster& cluster, const MeshPieces& pieces, const LatticeTopology& topology, bool wrong_side,
            const CertifyOptions& options) {
  if (cluster.lattice.empty()) return Fault::spurious;
  if (cluster.mesh.empty()) {
    const bool small = std::abs(topology.volume[cluster.lattice.front()]) < options.least_piece;
    return small && !wrong_side ? Fault::none : Fault::missing;
  }
  if (cluster.lattice.size() > 1) return Fault::merged;
  if (cluster.mesh.size() > 1) return Fault::split;
  const Index m = cluster.mesh.front(), l = cluster.lattice.front();
  if (pieces.euler[m] != topology.euler[l]) return Fault::euler;
  const bool inside_out = (pieces.volume[m] > 0) != (topology.volume[l] > 0);
  return wrong_side || inside_out || shrunk(pieces.volume[m], topology.volume[l], options) ? Fault::wrong_side
                                                                                           : Fault::none;
}

}  // namespace

const char* name(Fault fault) {
  switch (fault) {
    case Fault::none:
      return "none";
    case Fault::wrong_side:
      return "wrong_side";
    case Fault::euler:
      return "euler";
    case Fault::merged:
      return "merged";
    case Fault::split:
      return "split";
    case Fault::spurious:
      return "spurious";
    case Fault::missing:
      return "missing";
  }
  return "unknown";
}

std::string Certificate::summary() const {
  if (passed) return fmt::format("passed, {} corners checked", corners_checked);
  std::string out = fmt::format("failed, {} of {} corners on the wrong side", wrong_side, corners_checked);
  for (const Fault fault : kFaults) {
    const auto in_mesh = std::count(mesh_piece.begin(), mesh_piece.end(), fault);
    const auto in_lattice = std::count(lattice_piece.begin(), lattice_piece.end(), fault);
    if (fault != Fault::none && in_mesh + in_lattice > 0)
      out += fmt::format("; {}: {} mesh and {} lattice pieces", name(fault), in_mesh, in_lattice);
  }
  return out;
}

Certificate certify(const TriangleMesh& mesh, const MeshPieces& pieces, const Field& field, const BrickLattice& lattice,
                    const LatticeTopology& topology, const CertifyOptions& options, SideMemory* memory,
                    std::optional<MeshChanges> changes) {
  std::vector<Index> vote =
      piece_votes(mesh, lattice, topology, memory ? std::exchange(memory->vote, {}) : std::vector<Index>{},
                  memory && changes ? &*changes : nullptr);
  SideReport sides;
  std::vector<Cluster> clusters;
  tbb::parallel_invoke(
      [&] {
        sides = check_sides(mesh, pieces, field, lattice, topology, options.tolerance, memory, std::move(changes));
      },
      [&] { clusters = match_pieces(mesh, pieces, lattice, topology, options.least_piece, vote); });
  if (memory) memory->vote = std::move(vote);
  Certificate certificate;
  certificate.corners_checked = sides.checked;
  certificate.wrong_side = sides.wrong;
  certificate.mesh_piece.assign(pieces.count(), Fault::none);
  certificate.lattice_piece.assign(topology.piece_count(), Fault::none);
  certificate.passed = sides.wrong == 0;
  for (const Cluster& cluster : clusters) {
    const bool wrong_side =
        std::any_of(cluster.mesh.begin(), cluster.mesh.end(), [&](Index p) { return sides.mesh_piece[p]; }) ||
        std::any_of(cluster.lattice.begin(), cluster.lattice.end(), [&](Index p) { return sides.lattice_piece[p]; });
    const Fault fault = judge(cluster, pieces, topology, wrong_side, options);
    for (const Index p : cluster.mesh) certificate.mesh_piece[p] = fault;
    for (const Index p : cluster.lattice) certificate.lattice_piece[p] = fault;
    certificate.passed &= fault == Fault::none;
  }
  return certificate;
}

std::vector<std::uint8_t> failed_vertices(const MeshPieces& pieces, const Certificate& certificate) {
  std::vector<std::uint8_t> failed(pieces.of_vertex.size());
  for_each_index(failed.size(), [&](std::size_t v) {
    const Fault fault = pieces.of_vertex[v] == kNone ? Fault::none : certificate.mesh_piece[pieces.of_vertex[v]];
    failed[v] = fault != Fault::none && fault != Fault::wrong_side;
  });
  return failed;
}

}  // namespace isoskin
