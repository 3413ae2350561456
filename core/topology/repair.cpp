#include "core/topology/repair.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "core/parallel.h"
#include "core/sampling/closest_point.h"

namespace isoskin {
namespace {

// An extracted vertex lies within a lattice edge of the surface; one that projection moves farther is going elsewhere.
constexpr float kFarthestProjection = 0.5f;  // of the lattice spacing
// A settled piece stays within the box of what was extracted, but for what the lattice does not see.
constexpr double kFarthestDrift = 2.0;  // lattice spacings
// A settled piece keeps its volume roughly: a tetrahedron fills 0.12 of the ball about it.
constexpr double kLeastVolume = 0.1, kMostVolume = 3.0;  // of the extracted piece's

std::vector<std::uint8_t> triangles_of_pieces(const TriangleMesh& mesh, const MeshPieces& pieces,
                                              const std::vector<std::uint8_t>& keep) {
  std::vector<std::uint8_t> out(mesh.triangle_count());
  for_each_index(out.size(), [&](std::size_t t) { out[t] = keep[pieces.of_vertex[mesh.vertex[3 * t]]]; });
  return out;
}

/// Moves vertices onto the surface where it is as near as extraction promises.
void project_extracted(TriangleMesh& mesh, double spacing, Backend& backend, const ProjectOptions& options) {
  std::vector<Vec3> projected = mesh.vertices.position;
  std::vector<ProjectStatus> status(projected.size());
  backend.project(projected, options, status);
  for_each_index(projected.size(), [&](std::size_t v) {
    Vec3& p = mesh.vertices.position[v];
    const bool near = glm::distance(projected[v], p) <= kFarthestProjection * static_cast<float>(spacing);
    if (status[v] == ProjectStatus::converged && near) p = projected[v];
  });
}

void settle(TriangleMesh& mesh, Backend& backend, AlterOptions alter_options, RelaxOptions relax,
            const ProjectOptions& project, const SettleOptions& options) {
  alter_options.edge_length *= options.coarsening;
  alter_options.respect_locks = false;
  relax.edge_length *= options.coarsening;
  for (int pass = 0; pass < options.collapse_passes; ++pass) {
    const AlterReport report = alter(mesh, alter_options);
    if (report.collapses == 0) break;
  }
  std::vector<std::uint8_t> inverted;
  for (int round = 0; round < options.rounds; ++round) {
    if (round > 0) alter(mesh, alter_options, inverted);
    backend.set_mesh(mesh);
    backend.relax(relax, project);
    const std::span<const Vec3> positions = backend.positions();
    mesh.vertices.position.assign(positions.begin(), positions.end());
    inverted.resize(mesh.triangle_count());
    backend.inverted_triangles(inverted);
  }
}

/// What is remembered of a freshly extracted surface, which settles in place: beside it, it would be the most memory
/// that a run takes. Ids of extracted vertices run from `first_id`.
struct Extracted {
  std::vector<Index> piece_of_vertex;  // the lattice piece
  std::vector<double> volume;          // what its triangles enclose, by lattice piece; 0 where none were extracted
  Index first_id = 0;
};

/// The lattice piece of each piece of the settled mesh, told by a vertex that was extracted and has survived.
std::vector<Index> origin_of_pieces(const TriangleMesh& settled, const MeshPieces& pieces, const Extracted& extracted) {
  std::vector<Index> origin(pieces.count(), kNone);
  for (std::size_t v = 0; v < settled.vertex_count(); ++v) {
    const Index extracted_vertex = settled.vertices.id[v] - extracted.first_id;
    if (extracted_vertex < extracted.piece_of_vertex.size() && pieces.of_vertex[v] != kNone)
      origin[pieces.of_vertex[v]] = extracted.piece_of_vertex[extracted_vertex];
  }
  return origin;
}

std::vector<Box> boxes_of_pieces(const TriangleMesh& mesh, const MeshPieces& pieces) {
  std::vector<Box> out(pieces.count());
  for (std::size_t v = 0; v < mesh.vertex_count(); ++v)
    if (pieces.of_vertex[v] != kNone) out[pieces.of_vertex[v]].add(DVec3(mesh.vertices.position[v]));
  return out;
}

/// Extracted::volume.
std::vector<double> extracted_volumes(const TriangleMesh& raw, const std::vector<Index>& piece_of_vertex,
                                      std::size_t lattice_pieces) {
  const MeshPieces pieces = mesh_pieces(raw);
  std::vector<double> volumes(lattice_pieces, 0.0);
  for (std::size_t v = 0; v < pieces.of_vertex.size(); ++v)
    if (pieces.of_vertex[v] != kNone) volumes[piece_of_vertex[v]] = pieces.volume[pieces.of_vertex[v]];
  return volumes;
}

bool contains(const Box& outer, const Box& inner) {
  return glm::all(glm::lessThanEqual(outer.low, inner.low)) && glm::all(glm::greaterThanEqual(outer.high, inner.high));
}

/// Settled pieces where settling went well, the extracted ones where it did not: where a drop folded over, or left its
/// place for another sheet. `extract` makes these once more.
template <class Extract>
TriangleMesh best_of_both(TriangleMesh settled, const Extracted& extracted, const LatticeTopology& topology,
                          double spacing, const Extract& extract) {
  const MeshPieces pieces = mesh_pieces(settled);
  const std::vector<Index> origin = origin_of_pieces(settled, pieces, extracted);
  const std::vector<Box> boxes = boxes_of_pieces(settled, pieces);
  std::vector<std::uint8_t> keep(pieces.count(), 0), taken(topology.piece_count(), 0);
  for (std::size_t p = 0; p < pieces.count(); ++p) {
    if (origin[p] == kNone || taken[origin[p]]) continue;
    const double share = pieces.volume[p] / extracted.volume[origin[p]];
    const bool same_size = share > kLeastVolume && share < kMostVolume;
    const bool same_place = contains(topology.box[origin[p]].grown(kFarthestDrift * spacing), boxes[p]);
    keep[p] = same_size && same_place && pieces.euler[p] == topology.euler[origin[p]];
    taken[origin[p]] |= keep[p];
  }
  const bool all = std::all_of(keep.begin(), keep.end(), [](std::uint8_t k) { return k != 0; });
  const auto is_taken = [&](Index piece) { return taken[piece] != 0; };
  if (all && std::all_of(extracted.piece_of_vertex.begin(), extracted.piece_of_vertex.end(), is_taken)) return settled;
  const TriangleMesh raw = extract();
  std::vector<std::uint8_t> raw_triangles(raw.triangle_count());
  for_each_index(raw_triangles.size(),
                 [&](std::size_t t) { raw_triangles[t] = !taken[extracted.piece_of_vertex[raw.vertex[3 * t]]]; });
  TriangleMesh out = submesh(settled, triangles_of_pieces(settled, pieces, keep));
  append(out, submesh(raw, raw_triangles));
  return out;
}

}  // namespace

RepairReport reextract(TriangleMesh& mesh, const MeshPieces& pieces, const Certificate& certificate,
                       const BrickLattice& lattice, const LatticeTopology& topology, Backend& backend,
                       const AlterOptions& alter, const RelaxOptions& relax, const ProjectOptions& project,
                       const SettleOptions& options) {
  RepairReport report;
  std::vector<std::uint8_t> stays(pieces.count()), wanted(topology.piece_count());
  for (std::size_t p = 0; p < stays.size(); ++p) stays[p] = certificate.mesh_piece[p] == Fault::none;
  for (std::size_t p = 0; p < wanted.size(); ++p)
    wanted[p] = mesh.empty() || certificate.lattice_piece[p] != Fault::none;
  report.pieces_removed = static_cast<std::size_t>(std::count(stays.begin(), stays.end(), 0));
  report.pieces_extracted = static_cast<std::size_t>(std::count(wanted.begin(), wanted.end(), 1));

  TriangleMesh fresh;
  if (report.pieces_extracted > 0) {
    Extracted extracted;
    extracted.first_id = mesh.next_id;
    fresh = marching_cubes(lattice, topology, wanted, mesh.next_id, &extracted.piece_of_vertex);
    extracted.volume = extracted_volumes(fresh, extracted.piece_of_vertex, topology.piece_count());
    project_extracted(fresh, lattice.spacing, backend, project);
    if (options.coarsening > 0.0f) settle(fresh, backend, alter, relax, project, options);
    const auto extract_again = [&] { return marching_cubes(lattice, topology, wanted, mesh.next_id); };
    fresh = best_of_both(std::move(fresh), extracted, topology, lattice.spacing, extract_again);
    fresh.vertices.rest = fresh.vertices.position;
    std::fill(fresh.vertices.velocity.begin(), fresh.vertices.velocity.end(), Vec3(0.0f));
    std::fill(fresh.vertices.age.begin(), fresh.vertices.age.end(), Index{0});
    carry_attributes(fresh, 0, mesh, backend);
    report.area_reextracted = shape_statistics(fresh).area;
  }
  TriangleMesh kept = mesh.empty() ? TriangleMesh{} : submesh(mesh, triangles_of_pieces(mesh, pieces, stays));
  kept.next_id = std::max(kept.next_id, mesh.next_id);
  append(kept, fresh);
  mesh = std::move(kept);
  return report;
}

}  // namespace isoskin
