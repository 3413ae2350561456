#include "core/refine/geometric_mesh.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>
#include <utility>

#include <tbb/parallel_invoke.h>

#include "core/refine/place_filling.h"
#include "core/refine/untangle.h"
#include "core/topology/triangle_pairs.h"
#include "core/trace.h"

namespace isoskin {
namespace {

/// How far an equilateral triangle lies beside a sphere whose normals turn by the wanted angle along its edges, or the
/// wanted sagitta where that is less, world units: what refinement leaves as it is.
double left_coarse(const GeometricOptions& options) {
  const double e = options.edge_length, angle = glm::radians(double(options.refine.angle));
  const double radius = 0.5 * e / std::sin(0.5 * std::min(angle, std::numbers::pi));
  const double beside = radius - std::sqrt(std::max(0.0, radius * radius - e * e / 3.0));
  return options.refine.sagitta > 0.0f ? std::min(beside, double(options.refine.sagitta)) : beside;
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
        tolerance_(options.certify.tolerance),
        hidden_corner_(std::max(options.hidden_corner * tolerance_, left_coarse(options))) {
    const double stray = std::max(options.hidden_centre * tolerance_, left_coarse(options));
    refining_ = {options.refine, options.project, field.resolution(), stray, options.edge_length};
    refining_.project.reach = float(options.edge_length);
    kept.refined_triangles_ = 0;
  }

  /// Everything that `changes` leave open, and what a new skin does.
  void refine(const FieldChanges* changes) {
    refine_only(changes);
    look_at_sides(changes);
  }

  /// The same where little has changed, beside a look for self-intersections: both are short, and one thread's for much
  /// of the time.
  void refine_and_look(const FieldChanges* changes) {
    refine_only(changes);
    bool little = kept_.refined_.changed().has_value();
    if (little) {
      const Span span("look");
      tbb::parallel_invoke([&] { little = look_about(changes); }, [&] { find_crossings(); });
    }
    if (!little) look_at_sides(changes);
  }

  void refine_only(const FieldChanges* changes) {
    refining_.adds_changes = !std::exchange(looked_, false);
    kept_.refined_.update(skin(), changes, backend_, refining_);
    kept_.refined_triangles_ += kept_.refined_.refined_triangles();
  }

  void look_at_sides(const FieldChanges* changes) {
    const Span span("look");
    looked_ = true;
    kept_.wrong_.update(kept_.refined_, field_, changes, lattice_, topology_, least_wrong());
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
      const PlaceFillingReport done = fill_about(hidden, options_.radius / double(1 << report_.fillings));
      if (done.filled == 0) return;
      left_out = done.left_out > 0;
    }
  }

  /// Smooths what is folded until no triangles overlap or it does not help any more.
  void untangle() {
    const Span span("untangle");
    std::vector<Crossing> crossings = find_crossings();
    if (crossings.empty()) return;
    copy_skin();
    const FieldChanges none;
    const std::vector<Vec3> wrong = kept_.wrong_.farther_than(options_.smoothed_away * tolerance_);
    Tangles tangles(*skin_);
    for (int round = 0; round < options_.untanglings; ++round) {
      if (!tangles.smooth(*skin_, crossings, backend_, options_.project)) break;
      refine(&none);
      crossings = tangles.take_back(*skin_, find_crossings(), newly_wrong(wrong), lattice_.spacing);
    }
    if (tangles.took_back()) refine(&none);
  }

  /// Fills what smoothing has not taken apart, with its surroundings, where that leaves fewer crossings once seams are
  /// smoothed: a droplet may have folded as a whole, and a sheet about more than smoothing may move.
  void fill_crossings() {
    const Span span("fill crossings");
    for (const double radius : {options_.radius, 2.0 * options_.radius}) {
      const std::size_t before = find_crossings().size();
      if (before == 0 || options_.fillings == 0) return;
      const GeometricReport report = report_;
      TriangleMesh kept;
      copy_mesh(*skin_, kept);
      if (fill_about(crossing_places(), radius).filled == 0) continue;
      untangle();
      if (find_crossings().size() < before) continue;
      *skin_ = std::move(kept);
      report_ = report;
      const FieldChanges none;
      refine(&none);
    }
  }

  const std::vector<Crossing>& find_crossings() { return kept_.refined_.crossings(skin()); }

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
    done.update(kept_.mesh().mesh, nullptr, backend_,
                {as_it_is, refining_.project, refining_.voxel, refining_.stray, refining_.unit});
    report = report_;
    report.still_hidden = look(hidden_corner_).size() + done.strays().size();
  }

private:
  double least_wrong() const { return std::min(tolerance_, hidden_corner_); }
  bool look_about(const FieldChanges* changes) {
    return looked_ = kept_.wrong_.update_part(kept_.refined_, field_, changes, lattice_, topology_, least_wrong());
  }

  /// Before it is changed.
  void copy_skin() {
    if (!skin_) copy_mesh(mechanical_, skin_.emplace());
  }

  /// A large hole that was left out may fall apart when it is tried again with a smaller radius (units of e).
  PlaceFillingReport fill_about(const std::vector<Vec3>& places, double radius) {
    copy_skin();
    if (!far_) far_.emplace(field_, lattice_, tolerance_);
    if (!filling_) filling_.emplace(lattice_, topology_, backend_);
    const Index first_new = skin_->next_id;
    const PlaceFillingReport done =
        fill_places(*skin_, places, field_, lattice_, topology_, *far_, *filling_, backend_, filling(radius));
    if (done.filled == 0) return done;
    ++report_.fillings;
    mend_seams(*skin_, first_new, lattice_.spacing, backend_, options_.project);
    const FieldChanges none;
    refine(&none);
    return done;
  }

  std::vector<Vec3> crossing_places() {
    std::vector<Vec3> places;
    for (const Crossing& crossing : find_crossings())
      for (const Index t : {crossing.a, crossing.b}) {
        const auto [p, q, r] = corners_of(skin(), t);
        places.push_back((p + q + r) / 3.0f);
      }
    return places;
  }

  std::vector<Vec3> hidden_places() const {
    std::vector<Vec3> hidden = kept_.wrong_.farther_than(hidden_corner_);
    const std::vector<Vec3> strays = kept_.refined_.strays();
    hidden.insert(hidden.end(), strays.begin(), strays.end());
    return hidden;
  }

  /// Places that smoothing has put on the wrong side, where they were not `before`.
  std::vector<Vec3> newly_wrong(const std::vector<Vec3>& before) const {
    std::vector<Vec3> now = kept_.wrong_.farther_than(options_.smoothed_away * tolerance_);
    std::erase_if(now, [&](const Vec3& p) { return std::find(before.begin(), before.end(), p) != before.end(); });
    return now;
  }

  /// At the mesh as it is, wherever it differs from what was kept.
  std::vector<Vec3> look(double distance) const {
    WrongCorners wrong;
    wrong.look(kept_.mesh().mesh, field_, lattice_, topology_, distance);
    return wrong.farther_than(distance);
  }

  PlaceFillingOptions filling(double radius) const {
    PlaceFillingOptions filling;
    filling.edge_length = options_.edge_length;
    filling.radius = radius;
    filling.small_piece = options_.small_piece;
    filling.least_piece = options_.certify.least_piece;
    filling.project = options_.project;
    return filling;
  }

  const TriangleMesh& skin() const { return skin_ ? *skin_ : mechanical_; }

  GeometricSkin& kept_;
  const TriangleMesh& mechanical_;
  const Field& field_;
  const BrickLattice& lattice_;
  const LatticeTopology& topology_;
  Backend& backend_;
  const GeometricOptions& options_;
  const double tolerance_, hidden_corner_;
  RefinedSkinOptions refining_;
  std::optional<FarCorners> far_;
  std::optional<GrowingFilling> filling_;
  std::optional<TriangleMesh> skin_;  // the mechanical mesh with what was filled anew
  GeometricReport report_;
  bool looked_ = true;  // since the last update of the refined skin
};

void GeometricSkin::update(const TriangleMesh& mechanical, const Field& field, const FieldChanges* changes,
                           const BrickLattice& lattice, const LatticeTopology& topology, Backend& backend,
                           const GeometricOptions& options, GeometricReport* report) {
  Making making(*this, mechanical, field, lattice, topology, backend, options);
  making.refine_and_look(changes);
  if (options.refine.passes > 0) {
    making.fill();
    making.untangle();
    making.fill_crossings();
  }
  making.find_crossings();
  making.take_back();
  if (report) making.report(*report);
}

std::size_t GeometricSkin::self_intersections() const {
  return refined_.is_flattened() ? count_self_intersections(mesh().mesh) : refined_.crossing_count();
}

GeometricMesh geometric_mesh(const TriangleMesh& mechanical, const Field& field, const BrickLattice& lattice,
                             const LatticeTopology& topology, Backend& backend, const GeometricOptions& options,
                             GeometricReport* report) {
  GeometricSkin skin;
  skin.update(mechanical, field, nullptr, lattice, topology, backend, options, report);
  return skin.mesh();
}

}  // namespace isoskin
