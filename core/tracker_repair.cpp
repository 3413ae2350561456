// Tiers 2 and 3: bad sites, local re-skins and what is extracted anew (design 8).
#include <algorithm>
#include <chrono>
#include <utility>

#include "core/frame_step.h"
#include "core/parallel.h"
#include "core/topology/bad_sites.h"
#include "core/topology/inherit_ids.h"
#include "core/topology/piece_sites.h"
#include "core/trace.h"
#include "core/tracker.h"

namespace isoskin {
namespace {

using Clock = std::chrono::steady_clock;

/// Of the triangles with wanted(corners).
template <class Wanted>
double area_where(const TriangleMesh& mesh, const Wanted& wanted) {
  std::vector<float> area(mesh.triangle_count());
  for_each_index(area.size(), [&](std::size_t t) {
    const Index* corner = &mesh.vertex[3 * t];
    if (!wanted(corner)) return;
    const Vec3& a = mesh.position(corner[0]);
    area[t] = glm::length(glm::cross(mesh.position(corner[1]) - a, mesh.position(corner[2]) - a));
  });
  double sum = 0.0;
  for (const float doubled : area) sum += 0.5 * double(doubled);
  return sum;
}

std::vector<Box> boxes_of(const TriangleMesh& mesh, const MeshPieces& pieces) {
  std::vector<Box> boxes(pieces.count());
  for (Index v = 0; v < mesh.vertex_count(); ++v)
    if (pieces.of_vertex[v] != kNone) boxes[pieces.of_vertex[v]].add(DVec3(mesh.position(v)));
  return boxes;
}

/// As if their topology differed. Of small ones all would be taken out.
void doubt_large_pieces(const MeshPieces& pieces, std::size_t small, Certificate& certificate) {
  const std::vector<std::size_t> sizes = sizes_of(pieces);
  for (std::size_t p = 0; p < sizes.size(); ++p)
    if (sizes[p] > small) certificate.mesh_piece[p] = Fault::euler;
}

/// A line for every piece that failed: removed mesh pieces with their own fault, and lattice pieces without a mesh.
std::vector<LedgerEntry> ledger_of(const FieldFrame& frame, const TriangleMesh& mesh, const MeshPieces& pieces,
                                   const Certificate& certificate, const LatticeTopology& topology, double ms) {
  std::vector<LedgerEntry> entries;
  const std::vector<Box> boxes = boxes_of(mesh, pieces);
  const std::vector<std::size_t> sizes = sizes_of(pieces);
  for (std::size_t p = 0; p < certificate.mesh_piece.size(); ++p)
    if (certificate.mesh_piece[p] != Fault::none)
      entries.push_back({frame.frame, frame.time, name(certificate.mesh_piece[p]), 3, boxes[p].center(), sizes[p], ms});
  for (std::size_t p = 0; p < certificate.lattice_piece.size(); ++p)
    if (certificate.lattice_piece[p] == Fault::missing)
      entries.push_back({frame.frame, frame.time, name(Fault::missing), 3, topology.box[p].center(), 0, ms});
  return entries;
}

/// While new skin settles, the field stands still, and nothing has to wait for the next frame.
AlterOptions unlocked_and_still(AlterOptions options) {
  options.respect_locks = false;
  options.keep_older = true;
  options.dt = 0.0f;
  return options;
}

}  // namespace

void Tracker::handle_events(const FieldFrame& frame, Evidence& evidence, FrameReport& report) {
  report.certificate = evidence.certificate.summary();
  const auto extract_at = [&](float coarsening) {
    if (evidence.certificate.passed) return;
    reextract(frame, evidence, coarsening, report);
    certify(evidence, report);
  };
  if (!started_) extract_at(1.0f);
  const Index first_new = mesh_.next_id;
  inherited_.clear();
  GrowingFilling filling(evidence.lattice, evidence.topology, *backend_);
  repair(frame, evidence, filling, report);
  const bool may_tear = started_ && frame.field->resolution() > 0.0;  // critical points tell where skeletons do
  if (may_tear && reskin(frame, evidence, {.spare_sound = true, .widened = 0.6, .astray = true}, filling, report)) {
    certify(evidence, report);
    repair(frame, evidence, filling, report);
  }
  std::sort(inherited_.begin(), inherited_.end());
  if (report.repairs > 0) report.reextracted[1] = share_renewed(first_new);
  // e, then e / 2, then the extracted triangles as they are, which cannot fail.
  if (started_) extract_at(1.0f);
  extract_at(0.5f);
  extract_at(0.0f);
  report.certified = evidence.certificate.passed;
  report.events = ledger_.size();
  update_normals(evidence.sides.changes);
}

/// Local repairs, until the certificate passes.
void Tracker::repair(const FieldFrame& frame, Evidence& evidence, GrowingFilling& filling, FrameReport& report) {
  for (const ReskinTry& how : options_.repairs) {
    if (evidence.certificate.passed) return;
    if (reskin(frame, evidence, how, filling, report)) certify(evidence, report);
  }
}

/// Whether it changed the mesh.
bool Tracker::reskin(const FieldFrame& frame, Evidence& evidence, const ReskinTry& how, GrowingFilling& filling,
                     FrameReport& report) {
  Step step(report, "reskin");
  const auto begin = Clock::now();
  const BadSites sites = sites_of(frame, evidence, how);
  if (sites.point.empty()) return false;
  ReskinOptions reskin_options = options_.reskin;
  reskin_options.edge_length = options_.edge_length;
  reskin_options.replace_all = how.replace_all;
  reskin_options.suspects_only = how.suspects_only;
  reskin_options.spare_sound = how.spare_sound;
  reskin_options.radius *= how.widened;
  if (how.suspects_only) reskin_options.narrow.rounds = 0;
  reskin_options.alter = unlocked_and_still(options_.alter);
  if (how.as_extracted) reskin_options.collapse_passes = 0;
  const std::size_t before = mesh_.vertex_count();
  const Index first_new = mesh_.next_id;
  const VertexTable old = mesh_.vertices;
  Certificate certificate = evidence.certificate;
  if (how.astray) doubt_large_pieces(evidence.pieces, options_.small_piece, certificate);
  const ReskinReport done = isoskin::reskin(mesh_, evidence.pieces, certificate, sites, evidence.lattice,
                                            evidence.topology, *backend_, reskin_options, &filling);
  if (done.triangles_added == 0 && done.triangles_removed == 0) return false;
  report.repairs += 1;
  if (!how.as_extracted) settle_new_skin(first_new);
  const float reach = float(options_.inherit * options_.edge_length);
  const std::vector<Index> taken = inherit_ids(mesh_, first_new, old, *backend_, reach);
  inherited_.insert(inherited_.end(), taken.begin(), taken.end());
  Box box;
  for (const Vec3& p : sites.point) box.add(DVec3(p));
  ledger_.push_back({frame.frame, frame.time, "reskin", 2, box.center(), before - done.first_new_vertex,
                     std::chrono::duration<double, std::milli>(Clock::now() - begin).count()});
  return true;
}

/// Those that all tries but some ask for are found once, as long as the mesh stays as it is.
BadSites Tracker::sites_of(const FieldFrame& frame, Evidence& evidence, const ReskinTry& how) const {
  BadSites sites;
  if (how.astray) {
    std::vector<std::uint8_t> awake(mesh_.vertex_count(), 1);
    const std::vector<std::uint8_t> asleep = sleeping(mesh_.vertices, options_.sleep);
    for (std::size_t v = 0; v < asleep.size(); ++v) awake[v] = !asleep[v];
    add_astray(mesh_, awake, *backend_, options_.project, options_.astray * options_.edge_length, sites);
    return sites;
  }
  if (how.tiles) {
    add_tiles(mesh_, failed_vertices(evidence.pieces, evidence.certificate), *how.tiles, options_.edge_length, sites);
    return sites;
  }
  if (!evidence.sites) evidence.sites = all_sites(frame, evidence);
  return *evidence.sites;
}

BadSites Tracker::all_sites(const FieldFrame& frame, const Evidence& evidence) const {
  const std::vector<std::uint8_t> failed = failed_vertices(evidence.pieces, evidence.certificate);
  BadSiteOptions bad_options = options_.sites;
  bad_options.tolerance = options_.tolerance;
  BadSites sites =
      find_bad_sites(mesh_, *frame.field, evidence.lattice, evidence.topology.signs, *backend_, bad_options);
  add_small_pieces(mesh_, evidence.pieces, evidence.certificate, options_.small_piece, sites);
  add_necks(mesh_, failed, sites);
  add_bridges(mesh_, evidence.pieces, evidence.certificate, evidence.lattice, evidence.topology, sites);
  add_crumples(mesh_, options_.edge_length, *backend_, sites);
  return sites;
}

/// What reskin() made and its surroundings become near-equilateral; the rest of the mesh is not touched.
void Tracker::settle_new_skin(Index first_new) {
  const Span span("settle");
  const MeshPart part(mesh_, first_new, options_.reskin_rings);
  const AlterOptions alter_options = unlocked_and_still(options_.alter);
  for (int round = 0; round < options_.reskin_rounds; ++round) {
    const Relaxed relaxed = relax_but(OpenSet(mesh_, part.frozen(mesh_)), options_.relax);
    alter(mesh_, alter_options, relaxed.inverted, part.frozen(mesh_));
  }
  relax_but(OpenSet(mesh_, part.frozen(mesh_)), options_.relax);
}

void Tracker::reextract(const FieldFrame& frame, const Evidence& evidence, float coarsening, FrameReport& report) {
  Step step(report, "reextract");
  const auto begin = Clock::now();
  SettleOptions settle = options_.settle;
  settle.coarsening = coarsening;
  const TriangleMesh failed = mesh_;
  const RepairReport repaired =
      isoskin::reextract(mesh_, evidence.pieces, evidence.certificate, evidence.lattice, evidence.topology, *backend_,
                         options_.alter, options_.relax, options_.project, settle);
  report.repairs += repaired.pieces_extracted;
  report.reextracted[2] += share_of_area(repaired.area_reextracted);
  const double ms = std::chrono::duration<double, std::milli>(Clock::now() - begin).count();
  if (started_)
    for (LedgerEntry& entry : ledger_of(frame, failed, evidence.pieces, evidence.certificate, evidence.topology, ms))
      ledger_.push_back(std::move(entry));
}

/// The share of the area with a vertex that local re-skins made, whether it took over an id or has one from `first_new`
/// on.
double Tracker::share_renewed(Index first_new) const {
  const auto renewed = [&](Index v) {
    const Index id = mesh_.vertices.id[v];
    return id >= first_new || std::binary_search(inherited_.begin(), inherited_.end(), id);
  };
  return share_of_area(area_where(
      mesh_, [&](const Index* corner) { return renewed(corner[0]) || renewed(corner[1]) || renewed(corner[2]); }));
}

double Tracker::share_of_area(double part) const {
  const double whole = area_where(mesh_, [](const Index*) { return true; });
  return whole > 0.0 ? std::min(1.0, part / whole) : 0.0;
}

}  // namespace isoskin
