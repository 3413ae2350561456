#include "core/tracker.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <numeric>
#include <utility>

#include <fmt/format.h>
#include <tbb/parallel_invoke.h>

#include "core/field/skeleton_field.h"
#include "core/frame_step.h"
#include "core/mechanics/motion.h"
#include "core/mesh/folds.h"
#include "core/mesh/id_set.h"
#include "core/mesh/independent_edits.h"
#include "core/mesh/small_pieces.h"
#include "core/mesh/validate.h"
#include "core/parallel.h"
#include "core/sampling/grid_lattice.h"
#include "core/sampling/plain_grid.h"
#include "core/sampling/sampling_steps.h"
#include "core/topology/droplets.h"
#include "core/topology/thin_features.h"
#include "core/topology/triangle_pairs.h"
#include "core/trace.h"

namespace isoskin {
namespace {

/// How many are in all three; `some` ascending, perhaps repeating.
std::size_t count_in_all(const IdSet& a, const IdSet& b, std::vector<Index> some) {
  some.erase(std::unique(some.begin(), some.end()), some.end());
  return std::size_t(
      std::count_if(some.begin(), some.end(), [&](Index id) { return a.contains(id) && b.contains(id); }));
}

}  // namespace

Tracker::Tracker(std::unique_ptr<Backend> backend, const TrackOptions& options)
    : backend_(std::move(backend)), options_(options) {
#ifndef NDEBUG
  options_.validate = true;
#endif
}

void Tracker::resume(TriangleMesh mechanical, const FieldFrame& last,
                     const std::optional<std::vector<DVec3>>& critical_points) {
  mesh_ = std::move(mechanical);
  geometric_ = {};
  before_ = {};
  last_field_ = last.field;
  time_ = last.time;
  started_ = true;
  critical_ = {};
  if (critical_points)
    critical_ = restore_critical_points(*critical_points, last.field, event_options(options_.edge_length));
}

std::optional<std::vector<DVec3>> Tracker::critical_points() const {
  if (!last_field_ || critical_.field != last_field_) return std::nullopt;
  std::vector<DVec3> positions;
  for (const CriticalPoint& point : critical_.points) positions.push_back(point.position);
  return positions;
}

FrameReport Tracker::advance(const FieldFrame& frame, const FieldFrame* next) {
  FrameReport report;
  report.frame = frame.frame;
  report.time = frame.time;
  const std::shared_ptr<const MeshCopy> before =
      before_.sides.mesh ? before_.sides.mesh : std::make_shared<const MeshCopy>(mesh_);
  const Index first_new = mesh_.next_id;
  options_.alter.dt = float(seconds_to(frame));
  material_is_known_ = frame.velocity != nullptr;
  {
    Step step(report, "advance");
    take_up(frame);
  }
  operate(frame, report);
  Evidence evidence = sample(frame, report);
  OpenSet open = move(frame, evidence, report);
  const bool may_have_flaps = started_ && frame.field->resolution() == 0.0;  // grids leave flaps to the repairs
  // What sleeps whole is as it was predicted.
  const bool moves = may_have_flaps && !open.none();
  relax(std::move(open), report, moves ? &predicted_ : nullptr);
  certify(evidence, report);
  look_closer(frame, evidence, report);
  if (may_have_flaps && !evidence.certificate.passed)
    fold_in_flaps(moves ? predicted_ : mesh_, frame, evidence, report);
  follow_in_parts(frame, evidence, report);
  handle_events(frame, evidence, report);
  {
    Step step(report, "predict");
    if (frame.velocity)
      sample_velocities(mesh_, *frame.velocity);
    else if (!started_ && next)
      estimate_velocities(mesh_, *next->field, next->time - frame.time, *backend_);
  }
  {
    Step step(report, "refine");
    const bool goes_on = goes_on_ && evidence.field == frame.field;
    geometric_.update(mesh_, *frame.field, goes_on ? &changes_ : nullptr, evidence.lattice, evidence.topology,
                      *backend_, {options_.refine, options_.project, options_.edge_length, certify_options()});
  }
  report.geometric_intersections = geometric_.self_intersections();
  if (options_.self_intersections) {
    Step step(report, "intersect");
    report.mechanical_intersections = count_self_intersections(mesh_);
  }
  report_survivors(before->id, first_new, evidence.sides.changes, report);
  report.mechanical_triangles = mesh_.triangle_count();
  report.geometric_triangles = geometric_.triangle_count();
  if (evidence.sides.changes)
    shape_.update(*before_.sides.mesh, mesh_, *evidence.sides.changes);
  else
    shape_ = ShapeSums(mesh_, options_.edge_length);
  report.mechanical = shape_.statistics();
  report.geometric = geometric_.statistics();
  if (options_.validate)
    for (const TriangleMesh* mesh : {&std::as_const(mesh_), &geometric().mesh})
      if (const ValidateReport valid = validate(*mesh); !valid)
        throw std::logic_error(fmt::format("frame {}: {}", frame.frame, valid.reason));
  last_field_ = frame.field;
  before_ = std::move(evidence);
  before_.sides.changes.reset();
  time_ = frame.time;
  started_ = true;
  return report;
}

/// Of the vertices `before`; ids from `first_new` on are not among them.
void Tracker::report_survivors(const std::vector<Index>& before, Index first_new,
                               const std::optional<MeshChanges>& changes, FrameReport& report) const {
  if (before.empty()) return;
  const std::vector<Index>& after = mesh_.vertices.id;
  const bool told =
      changes && inherited_.empty() &&
      std::all_of(changes->added.begin(), changes->added.end(), [&](Index v) { return after[v] >= first_new; });
  if (told) {
    report.survived = double(after.size() - changes->added.size()) / double(before.size());
    return;
  }
  const IdSet then(before), now(after);
  report.survived = double(then.count_shared(now)) / double(before.size());
  report.inherited = double(count_in_all(then, now, inherited_)) / double(before.size());
}

/// The backend, the field's bounds and the skin are seen to side by side.
void Tracker::take_up(const FieldFrame& frame) {
  const auto set_field = [&] { backend_->set_field(frame.field); };
  if (!started_) return set_field();
  changes_ = changes_between(*last_field_, *frame.field);
  const auto follow_bounds = [&] {
    const auto *before = dynamic_cast<const SkeletonField*>(last_field_.get()),
               *now = dynamic_cast<const SkeletonField*>(frame.field.get());
    if (before && now) now->follow_bounds(*before, ChangeMask(changes_, 0.0));
  };
  tbb::parallel_invoke(set_field, follow_bounds, [&] {
    wake_up(frame);
    note_start(frame);
  });
}

/// A velocity grid may move material within a surface that stands still.
void Tracker::wake_up(const FieldFrame& frame) {
  const FieldChanges moves = frame.velocity ? FieldChanges{true, {}} : changes_;
  wake(mesh_.vertices, ChangeMask(moves, options_.sleep.margin * options_.edge_length));
}

OpenSet Tracker::awake() const {
  return OpenSet(mesh_, sleeping(mesh_.vertices, options_.sleep));
}

/// Predicts; where the new surface has another topology than the mesh that was to follow it, the mesh as it was is
/// operated on and predicted again. Returns what is awake.
OpenSet Tracker::move(const FieldFrame& frame, Evidence& evidence, FrameReport& report) {
  constexpr double kHalfSheet = 1.5;  // voxels; fields without voxels have no sheets to be outrun by
  constexpr int kRounds = 3;          // three sheets that meet need two
  for (Index& age : mesh_.vertices.age) ++age;
  FlowOptions flow;
  flow.half_sheet = float(kHalfSheet * frame.field->resolution());
  flow.facing = flow.half_sheet > 0.0f;
  // What has fallen asleep in this frame has moved since small pieces were last looked for.
  SleepOptions longer = options_.sleep;
  ++longer.rest_frames;
  OpenSet still_moved, open;
  std::vector<Ball> split;
  for (int round = 0;; ++round) {
    const bool may_collide = round < kRounds && started_ && collides(*frame.field);
    VertexTable before;
    {
      Step step(report, "predict");
      if (may_collide) before = mesh_.vertices;
      const ThinMotion thin = thin_motion(*frame.field);
      still_moved = OpenSet(mesh_, sleeping(mesh_.vertices, longer));
      open = OpenSet(mesh_, sleeping(mesh_.vertices, options_.sleep), still_moved);
      predict(mesh_, frame.velocity.get(), seconds_to(frame), *frame.field, *backend_, options_.project, open, flow);
      thin.apply(mesh_, *frame.field, seconds_to(frame));
    }
    if (!may_collide || !collide(frame, evidence, before, split, report)) break;
  }
  Step step(report, "predict");
  const bool grown = grow_small_pieces(mesh_, *backend_, options_.project, options_.edge_length, still_moved) > 0;
  return grown ? awake() : open;
}

/// `predicted`, if given, becomes the mesh as it was.
void Tracker::relax(OpenSet open, FrameReport& report, TriangleMesh* predicted) {
  RelaxOptions follow = options_.relax;
  follow.steps = options_.follow_steps;
  follow.cg_iterations = options_.follow_iterations;
  Relaxed relaxed;
  for (int round = 0; round < options_.rounds; ++round) {
    {
      Step step(report, "alter");
      std::vector<std::uint8_t> left_alone;
      tbb::parallel_invoke(
          [&] {
            if (round == 0 && predicted) copy_mesh(mesh_, *predicted);
          },
          [&] {
            left_alone = held_vertices(open);
            if (round == 0) relaxed.inverted = folded_in(open);
          });
      std::transform(open.frozen.begin(), open.frozen.end(), left_alone.begin(), left_alone.begin(), std::bit_or());
      alter(mesh_, options_.alter, relaxed.inverted, left_alone, &open);
    }
    Step step(report, "relax");
    relaxed = relax_but(open, follow);
  }
  unfold_skin(open, relaxed, report);
  report.inverted = std::size_t(std::count(relaxed.inverted.begin(), relaxed.inverted.end(), 1));
  report.quasi_critical = std::size_t(std::count(relaxed.quasi_critical.begin(), relaxed.quasi_critical.end(), 1));
  keep_awake(relaxed);
}

/// What the prediction has folded over, as Relaxed::inverted: split there, edges make more of it.
std::vector<std::uint8_t> Tracker::folded_in(const OpenSet& open) {
  if (open.all()) return folded_triangles(mesh_, outward_normals(mesh_.vertices.position, *backend_));
  const OpenPart part = open_part(mesh_, open);
  const std::vector<std::uint8_t> of_part =
      folded_triangles(part.mesh, outward_normals(part.mesh.vertices.position, *backend_));
  std::vector<std::uint8_t> folded(mesh_.triangle_count());
  for (std::size_t i = 0; i < of_part.size(); ++i) folded[part.triangle[i]] = of_part[i];
  return folded;
}

/// What is not right yet does not fall asleep.
void Tracker::keep_awake(const Relaxed& relaxed) {
  const auto disturb = [&](Index v) { mesh_.vertices.age[v] = std::min<Index>(mesh_.vertices.age[v], 1); };
  for (const Index t : indices_where(mesh_.triangle_count(), [&](Index t) { return relaxed.inverted[t] != 0; }))
    for (Index h = 3 * t; h < 3 * t + 3; ++h) disturb(mesh_.vertex[h]);
  for (const Index v : indices_where(mesh_.vertex_count(), [&](Index v) { return relaxed.quasi_critical[v] != 0; }))
    disturb(v);
}

/// What is frozen does not move at all, and costs nothing.
Tracker::Relaxed Tracker::relax_but(const OpenSet& what, const RelaxOptions& how) {
  if (what.all()) return relax_whole(how);
  const std::vector<std::uint8_t>& frozen = what.frozen;
  const OpenPart open = open_part(mesh_, what);
  const std::vector<std::uint8_t> held = held_vertices(what);
  std::vector<std::uint8_t> pinned, inverted(open.triangle.size());
  for (const Index v : open.vertex) pinned.push_back(frozen[v] | held[v]);
  Relaxed relaxed{std::vector<std::uint8_t>(mesh_.triangle_count()), std::vector<std::uint8_t>(mesh_.vertex_count())};
  if (open.triangle.empty()) return relaxed;
  backend_->set_mesh(open.mesh, pinned);
  backend_->relax(how, options_.project);
  const std::vector<Vec3> before = material_is_known_ ? mesh_.vertices.position : std::vector<Vec3>{};
  const auto positions = backend_->positions();
  for (std::size_t i = 0; i < open.vertex.size(); ++i)
    if (!frozen[open.vertex[i]]) mesh_.vertices.position[open.vertex[i]] = positions[i];
  if (material_is_known_) slide_rest(mesh_, before);
  const auto status = backend_->status();
  for (std::size_t i = 0; i < open.vertex.size(); ++i)
    relaxed.quasi_critical[open.vertex[i]] = !frozen[open.vertex[i]] && status[i] != ProjectStatus::converged;
  backend_->inverted_triangles(inverted);
  for (std::size_t i = 0; i < open.triangle.size(); ++i) relaxed.inverted[open.triangle[i]] = inverted[i];
  return relaxed;
}

Tracker::Relaxed Tracker::relax_whole(const RelaxOptions& how) {
  backend_->set_mesh(mesh_, held_vertices({}));
  backend_->relax(how, options_.project);
  const auto positions = backend_->positions();
  const std::vector<Vec3> before = std::exchange(mesh_.vertices.position, {positions.begin(), positions.end()});
  if (material_is_known_) slide_rest(mesh_, before);
  Relaxed relaxed{std::vector<std::uint8_t>(mesh_.triangle_count()), {}};
  for (const ProjectStatus status : backend_->status())
    relaxed.quasi_critical.push_back(status != ProjectStatus::converged);
  backend_->inverted_triangles(relaxed.inverted);
  return relaxed;
}

/// One byte a vertex: 1 where it is only projected, since elements of edge e do not fit. Only what is not frozen, and
/// so in the open triangles, is asked for.
std::vector<std::uint8_t> Tracker::held_vertices(const OpenSet& open) const {
  std::vector<std::uint8_t> held(mesh_.vertex_count());
  for (const Index v : open.all() ? small_piece_vertices(mesh_) : small_piece_vertices(mesh_, open.triangle))
    held[v] = 1;
  for (const Index v : thin_feature_vertices(mesh_, critical_.points, thin_options(), open.frozen)) held[v] = 1;
  return held;
}

ThinOptions Tracker::thin_options() const {
  ThinOptions options;
  options.edge_length = options_.edge_length;
  return options;
}

Tracker::Evidence Tracker::sample(const FieldFrame& frame, FrameReport& report) {
  Step step(report, "certify");
  Evidence evidence;
  evidence.field = frame.field;
  goes_on_ = started_ && before_.field == last_field_;
  before_.field = nullptr;
  if (!has_critical_points(*frame.field)) last_field_ = nullptr;  // a grid is large, and changes_ says what is needed
  const double spacing = lattice_spacing(*frame.field, goes_on_);
  const bool same_spacing = std::abs(before_.lattice.spacing - spacing) < 0.25 * spacing;
  stands_still_ = goes_on_ && same_spacing && changes_.none() && !before_.lattice.extended;
  if (stands_still_) {
    evidence.lattice = std::move(before_.lattice);
    evidence.lattice.same_as.resize(evidence.lattice.brick_count());
    std::iota(evidence.lattice.same_as.begin(), evidence.lattice.same_as.end(), Index(0));
    evidence.lattice.gone.clear();
    evidence.topology = std::move(before_.topology);
    evidence.topology.changed.emplace();
    return evidence;
  }
  evidence.lattice = goes_on_ && same_spacing
                         ? resample_lattice(std::move(before_.lattice), changes_, *frame.field, *backend_)
                         : sampling::sample_anew(std::move(before_.lattice), *frame.field, *backend_, spacing);
  evidence.topology = lattice_topology(evidence.lattice, std::move(before_.topology));
  return evidence;
}

/// Half voxels, but whole ones where those show all that there is. What does not change need not be asked again.
double Tracker::lattice_spacing(const Field& field, bool goes_on) {
  const auto* grid = dynamic_cast<const GridField*>(&field);
  if (!grid || grid_parts(*grid->grid(), options_.lattice_spacing) != 2) return options_.lattice_spacing;
  const BrickGrid& bricks = *grid->grid();
  if (!goes_on || !rough_ || !is_rough(bricks, *rough_)) {
    const bool little = changes_.box.size() < bricks.brick_coordinate.size() && !changes_.everywhere;
    std::optional<ChangeMask> changed;
    if (goes_on && !rough_ && little) changed.emplace(changes_, 0.0);
    rough_ = find_rough(bricks, changed ? &*changed : nullptr);
  }
  return rough_ ? options_.lattice_spacing : grid->resolution();
}

/// Only where vertices or the field have changed.
void Tracker::update_normals(const std::optional<MeshChanges>& changes) {
  if (!changes || changes_.everywhere || changes_.rounded_anew) {
    normals_ = outward_normals(mesh_.vertices.position, *backend_);
    return;
  }
  const ChangeMask changed(changes_, 0.0);
  const std::vector<Index> stale = indices_where(mesh_.vertex_count(), [&](Index v) {
    return changes->moved[v] || (!changed.empty() && changed.contains(DVec3(mesh_.position(v))));
  });
  if (!changes->lost.empty() || !changes->added.empty()) {
    std::vector<Vec3> normals(mesh_.vertex_count());
    for_each_index(normals.size(), [&](std::size_t v) {
      if (!changes->moved[v]) normals[v] = normals_[changes->vertex_before[v]];
    });
    normals_ = std::move(normals);
  }
  std::vector<Vec3> position;
  for (const Index v : stale) position.push_back(mesh_.position(v));
  const std::vector<Vec3> fresh = outward_normals(position, *backend_);
  for (std::size_t i = 0; i < stale.size(); ++i) normals_[stale[i]] = fresh[i];
}

void Tracker::certify(Evidence& evidence, FrameReport& report) {
  Step step(report, "certify");
  evidence.sites.reset();
  const MeshCopy* const before = before_.sides.mesh.get();
  std::optional<MeshChanges> changes;
  if (before) changes = mesh_changes(*before, mesh_);
  if (stands_still_ && before_.certificate.passed && changes && changes->none()) {
    evidence.pieces = before_.pieces;
    evidence.sides = before_.sides;
    evidence.sides.changes = std::move(changes);
    evidence.certificate = before_.certificate;
    return;
  }
  evidence.pieces = before ? mesh_pieces(mesh_, *before, before_.pieces, *changes) : mesh_pieces(mesh_);
  evidence.sides = before_.sides;
  evidence.certificate = isoskin::certify(mesh_, evidence.pieces, *evidence.field, evidence.lattice, evidence.topology,
                                          certify_options(), &evidence.sides, std::move(changes));
}

CertifyOptions Tracker::certify_options() const {
  CertifyOptions options;
  options.tolerance = options_.tolerance;
  constexpr double kFromVolume = 16.0;  // in tolerances cubed: smaller droplets have no volume to speak of
  options.volume_from = kFromVolume * std::pow(options_.tolerance, 3.0);
  return options;
}

}  // namespace isoskin
