#include "core/refine/geometric_mesh.h"

#include <algorithm>
#include <limits>
#include <optional>

#include "core/mesh/independent_edits.h"
#include "core/parallel.h"
#include "core/sampling/closest_point.h"
#include "core/topology/bad_sites.h"
#include "core/topology/match.h"
#include "core/topology/point_grid.h"
#include "core/topology/reskin.h"
#include "core/trace.h"

namespace isoskin {
namespace {

/// Orders points along the longest axis of their bounds; returns the middle one.
std::vector<Vec3>::iterator halve(std::vector<Vec3>& points) {
  Box box;
  for (const Vec3& p : points) box.add(DVec3(p));
  const DVec3 size = box.size();
  const int axis = size.x >= size.y && size.x >= size.z ? 0 : size.y >= size.z ? 1 : 2;
  std::stable_sort(points.begin(), points.end(), [&](const Vec3& a, const Vec3& b) { return a[axis] < b[axis]; });
  return points.begin() + std::ptrdiff_t(points.size() / 2);
}

}  // namespace

/// The geometric mesh of a frame in the making.
class Making {
public:
  Making(GeometricSkin& kept, const TriangleMesh& mechanical, const Field& field, const BrickLattice& lattice,
         const LatticeTopology& topology, Backend& backend, const GeometricOptions& options)
      : kept_(kept),
        mechanical_(mechanical),
        field_(field),
        lattice_(lattice),
        topology_(topology),
        backend_(backend),
        options_(options),
        tolerance_(options.certify.tolerance) {
    refining_ = {options.refine, options.project, field.resolution(), options.hidden_centre * tolerance_};
    refining_.project.reach = float(options.edge_length);
    kept.refined_triangles_ = 0;
  }

  /// Everything that `changes` leave open, and what a new skin does.
  void refine(const FieldChanges* changes) {
    kept_.refined_.update(skin(), changes, backend_, refining_);
    kept_.refined_triangles_ += kept_.refined_.refined_triangles();
    const Span span("look");
    const double least = tolerance_ * std::min(1.0, options_.hidden_corner);
    kept_.wrong_.update(kept_.refined_, field_, changes, lattice_, topology_, least);
  }

  /// Fills hidden places anew until none is left out, or it has been done often enough; twice where many stay hidden.
  void fill() {
    const Span span("fill");
    constexpr std::size_t kFew = 50;  // one in so many of the places that were hidden at first
    for (bool left_out = true; report_.fillings < options_.fillings;) {
      const std::vector<Vec3> hidden = hidden_places();
      if (report_.fillings == 0) report_.hidden = hidden.size();
      const bool many = report_.fillings < 2 && kFew * hidden.size() > report_.hidden;
      if (hidden.empty() || (!left_out && !many)) return;
      left_out = !fill(hidden, report_.fillings);
      ++report_.fillings;
      const FieldChanges none;
      refine(&none);
    }
  }

  void take_back() {
    constexpr float kEverywhere = std::numeric_limits<float>::infinity();
    const float e = float(options_.edge_length);
    std::vector<Vec3> wrong = kept_.wrong_.farther_than(tolerance_);
    for (const float radius : {2.0f * e, 4.0f * e, 8.0f * e, kEverywhere}) {
      if (wrong.empty()) break;
      kept_.refined_.flatten(wrong, radius);
      wrong = look(tolerance_);
    }
  }

  /// Of the finished mesh.
  void report(GeometricReport& report) const {
    RefineOptions as_it_is = options_.refine;
    as_it_is.passes = 0;
    RefinedSkin done;
    done.update(kept_.mesh().mesh, nullptr, backend_, {as_it_is, refining_.project, refining_.voxel, refining_.stray});
    report = report_;
    report.still_hidden = look(options_.hidden_corner * tolerance_).size() + done.strays().size();
  }

private:
  struct Filled {
    TriangleMesh skin;
    bool complete = false;  // no place was left out
  };

  std::vector<Vec3> hidden_places() const {
    std::vector<Vec3> hidden = kept_.wrong_.farther_than(options_.hidden_corner * tolerance_);
    const std::vector<Vec3> strays = kept_.refined_.strays();
    hidden.insert(hidden.end(), strays.begin(), strays.end());
    return hidden;
  }

  /// At the mesh as it is, wherever it differs from what was kept.
  std::vector<Vec3> look(double distance) const {
    WrongCorners wrong;
    wrong.look(kept_.mesh().mesh, field_, lattice_, topology_, distance);
    return wrong.farther_than(distance);
  }

  /// Fills the places, halved so many times, part after part. Whether no place was left out.
  bool fill(std::vector<Vec3> hidden, int halvings) {
    if (halvings > 0 && hidden.size() > 1) {
      const auto middle = halve(hidden);
      const bool first = fill({hidden.begin(), middle}, halvings - 1);
      const bool second = fill({middle, hidden.end()}, halvings - 1);
      return first && second;
    }
    std::optional<Filled> filled = filled_anew(hidden, false);
    // A handle may hide in a fold elsewhere; then the right one must not come in its place.
    if (!filled) filled = filled_anew(hidden, true);
    if (!filled) return false;
    skin_ = std::move(filled->skin);
    return filled->complete;
  }

  std::optional<Filled> filled_anew(const std::vector<Vec3>& hidden, bool alike_only) const {
    TriangleMesh skin = this->skin();
    BadSites sites;
    for (const Vec3& place : hidden) sites.add(place, true);
    const MeshPieces pieces = mesh_pieces(skin);
    const Certificate to_be_filled = judge(skin, pieces, sites);
    ReskinOptions options;
    options.edge_length = options_.edge_length;
    options.radius = options_.radius;
    options.replace_all = true;
    options.alike_only = alike_only;
    options.collapse_passes = 0;  // as fine as the lattice: coarser triangles would cut short what they are here for
    options.carry = false;
    const ReskinReport done = reskin(skin, pieces, to_be_filled, sites, lattice_, topology_, backend_, options);
    if (done.triangles_added == 0 && done.triangles_removed == 0) return std::nullopt;
    backend_.project(std::span(skin.vertices.position).subspan(done.first_new_vertex), options_.project, {});
    if (!certify(skin, mesh_pieces(skin), field_, lattice_, topology_, options_.certify).passed) return std::nullopt;
    carry_attributes(skin, done.first_new_vertex, part_about(sites.point), backend_);
    return Filled{std::move(skin), !alike_only && done.holes_given_up == 0};
  }

  /// Which pieces may be touched. A small one near a site is replaced whole, and so is one that would be emptied but
  /// for scraps: all of it becomes one.
  Certificate judge(const TriangleMesh& skin, const MeshPieces& pieces, BadSites& sites) const {
    std::vector<std::vector<Index>> vertices(pieces.count());
    for (Index v = 0; v < skin.vertex_count(); ++v)
      if (pieces.of_vertex[v] != kNone) vertices[pieces.of_vertex[v]].push_back(v);
    const PointGrid near(sites.point, float(options_.radius * options_.edge_length));
    const auto is_small = [&](Index piece) { return vertices[piece].size() <= options_.small_piece; };
    const auto is_near = [&](Index v) { return near.any_near(skin.position(v)); };
    const auto is_emptied = [&](const std::vector<Index>& piece) {
      constexpr double kMostly = 0.75;
      return double(std::count_if(piece.begin(), piece.end(), is_near)) >= kMostly * double(piece.size());
    };
    Certificate certificate;
    certificate.mesh_piece.assign(pieces.count(), Fault::wrong_side);
    certificate.lattice_piece.assign(topology_.piece_count(), Fault::none);
    std::vector<Index> replaced;
    for (const Cluster& cluster : match_pieces(skin, pieces, lattice_, topology_, options_.certify.least_piece)) {
      if (cluster.mesh.size() != 1 || cluster.lattice.size() != 1) continue;
      const std::vector<Index>& piece = vertices[cluster.mesh.front()];
      const bool small = is_small(cluster.mesh.front());
      if (small ? std::any_of(piece.begin(), piece.end(), is_near) : is_emptied(piece)) {
        certificate.lattice_piece[cluster.lattice.front()] = Fault::wrong_side;
        replaced.insert(replaced.end(), piece.begin(), piece.end());
      } else if (small) {
        certificate.mesh_piece[cluster.mesh.front()] = Fault::none;
      }
    }
    for (const Index v : replaced) sites.add(skin.position(v), true);
    return certificate;
  }

  /// The triangles of the skin near the points, open, with all its vertices: enough to carry attributes over from.
  TriangleMesh part_about(const std::vector<Vec3>& points) const {
    constexpr double kBeyond = 3.0;  // e: what is emptied, and around it
    const TriangleMesh& whole = skin();
    const PointGrid near(points, float((options_.radius + kBeyond) * options_.edge_length));
    const std::vector<Index> triangles = indices_where(
        whole.triangle_count(), [&](Index t) { return near.any_near(whole.position(whole.vertex[3 * t])); });
    TriangleMesh part;
    part.vertices = whole.vertices;
    for (const Index t : triangles)
      part.vertex.insert(part.vertex.end(), &whole.vertex[3 * t], &whole.vertex[3 * t] + 3);
    return part;
  }

  const TriangleMesh& skin() const { return skin_ ? *skin_ : mechanical_; }

  GeometricSkin& kept_;
  const TriangleMesh& mechanical_;
  const Field& field_;
  const BrickLattice& lattice_;
  const LatticeTopology& topology_;
  Backend& backend_;
  const GeometricOptions& options_;
  const double tolerance_;
  RefinedSkinOptions refining_;
  std::optional<TriangleMesh> skin_;  // the mechanical mesh with what was filled anew
  GeometricReport report_;
};

void GeometricSkin::update(const TriangleMesh& mechanical, const Field& field, const FieldChanges* changes,
                           const BrickLattice& lattice, const LatticeTopology& topology, Backend& backend,
                           const GeometricOptions& options, GeometricReport* report) {
  Making making(*this, mechanical, field, lattice, topology, backend, options);
  making.refine(changes);
  if (options.refine.passes > 0) making.fill();
  making.take_back();
  if (report) making.report(*report);
}

GeometricMesh geometric_mesh(const TriangleMesh& mechanical, const Field& field, const BrickLattice& lattice,
                             const LatticeTopology& topology, Backend& backend, const GeometricOptions& options,
                             GeometricReport* report) {
  GeometricSkin skin;
  skin.update(mechanical, field, nullptr, lattice, topology, backend, options, report);
  return skin.mesh();
}

}  // namespace isoskin
