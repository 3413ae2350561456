// Tier 1 at critical points, between two frames.
#include <chrono>
#include <tuple>
#include <utility>

#include "core/frame_step.h"
#include "core/refine/untangle.h"
#include "core/topology/clear_of_zero.h"
#include "core/topology/collisions.h"
#include "core/topology/droplets.h"
#include "core/topology/flaps.h"
#include "core/topology/sides.h"
#include "core/topology/thin_motion.h"
#include "core/tracker.h"

namespace isoskin {

/// What follow_in_parts() goes back to.
void Tracker::note_start(const FieldFrame& frame) {
  critical_at_start_ = {};
  const bool in_parts = started_ && options_.topology != Topology::collision && has_critical_points(*frame.field);
  const bool changes = changes_.everywhere || !changes_.box.empty();
  if (!in_parts || !changes || critical_.field != last_field_) return;
  copy_mesh(mesh_, start_);
  critical_at_start_ = critical_;
}

/// Where the skin did not keep up with the surface, it starts once more and follows the field in more and more parts.
void Tracker::follow_in_parts(const FieldFrame& frame, Evidence& evidence, FrameReport& report) {
  for (const int parts : options_.parts) {
    if (evidence.certificate.passed || !critical_at_start_.field) return;
    copy_mesh(start_, mesh_);
    critical_ = critical_at_start_;
    report.reextracted[0] = 0.0;
    operate(frame, report, parts);
    if (evidence.field != frame.field) look_at(frame.field, evidence, report);
    OpenSet open = move(frame, evidence, report);
    relax(std::move(open), report, &predicted_);
    certify(evidence, report);
    look_closer(frame, evidence, report);
    if (!evidence.certificate.passed) fold_in_flaps(predicted_, frame, evidence, report);
  }
}

/// Tier 1, while the mesh still lies on the last frame's surface. Events too near to each other are kept apart: the
/// skin follows the field to a moment between them first. And it does so for each of `parts` of the frame.
void Tracker::operate(const FieldFrame& frame, FrameReport& report, int parts) {
  ledger_.clear();
  tracking_ = {};
  const bool wanted = options_.topology != Topology::collision;
  if (!wanted || !last_field_ || !has_critical_points(*last_field_) || !has_critical_points(*frame.field)) {
    critical_ = {};
    return;
  }
  const EventOptions options = event_options(options_.edge_length);
  if (critical_.field != last_field_) {  // the second frame
    Step step(report, "surgery");
    backend_->set_field(last_field_);
    critical_ = start_critical_points(mesh_, last_field_, *backend_, options);
    backend_->set_field(frame.field);
  }
  const int most_parts = parts > 1 ? options_.most_parts + parts : options_.most_parts;
  double reached = 0.0;  // of the frame
  for (int part = 1;; ++part) {
    EventPlan plan = plan_events(frame.field, report);
    std::optional<double> cut = time_between_events(plan, options);
    const double left = (1.0 - reached) * parts;
    if (left > 1.0 + options.shortest_part) cut = std::min(cut.value_or(1.0), 1.0 / left);
    Operated operated;
    if (!cut) {
      operated = operated_on(plan, report);
      cut = time_before_refusal(plan, operated.report, options);
    } else if (part == most_parts) {
      operated = operated_on(plan, report);
    }
    const auto between = cut && part < most_parts ? field_between(*critical_.field, *frame.field, *cut) : nullptr;
    if (!between) return take_over(std::move(operated), std::move(plan), frame, report);
    reached += *cut * (1.0 - reached);
    backend_->set_field(between);
    wake(mesh_.vertices, ChangeMask({true, {}}, 0.0));  // between two moments a field may be anything
    EventPlan first = plan_events(between, report);
    Operated operated_first = operated_on(first, report);
    take_over(std::move(operated_first), std::move(first), frame, report);
    const ThinMotion thin = thin_motion(*between);
    backend_->project(mesh_.vertices.position, options_.project, {});
    thin.apply(mesh_, *between, 0.0);
    grow_small_pieces(mesh_, *backend_, options_.project, options_.edge_length);
    relax(awake(), report);
    backend_->set_field(frame.field);
  }
}

EventPlan Tracker::plan_events(const std::shared_ptr<const Field>& field, FrameReport& report) {
  Step step(report, "surgery");
  return plan_critical_events(mesh_, critical_, field, *backend_, event_options(options_.edge_length));
}

/// What the plan's events make of the mesh and the critical points.
Tracker::Operated Tracker::operated_on(const EventPlan& plan, FrameReport& report) {
  Step step(report, "surgery");
  const auto begin = std::chrono::steady_clock::now();
  Operated operated{std::nullopt, critical_, {}, 0.0};
  if (!plan.crossings.empty()) operated.mesh = mesh_;
  operated.report = operate_on_critical_events(operated.mesh ? *operated.mesh : mesh_, operated.critical, plan,
                                               event_options(options_.edge_length));
  operated.ms = std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - begin).count();
  return operated;
}

/// With the ledger of what was done.
void Tracker::take_over(Operated operated, EventPlan plan, const FieldFrame& frame, FrameReport& report) {
  if (operated.mesh) mesh_ = *std::move(operated.mesh);
  critical_before_ = std::exchange(critical_, std::move(operated.critical));
  tracking_ = std::move(plan.tracking);
  const EventReport& done = operated.report;
  for (const CriticalEvent& event : done.events)
    if (event.done) {
      ledger_.push_back({frame.frame, frame.time, event.kind, 1, event.position, event.vertices, operated.ms});
      report.reextracted[0] += share_of_area(event.area);
    }
}

/// Of necks and tunnels whose waists projection would leave: wider than those that are held.
ThinMotion Tracker::thin_motion(const Field& field) const {
  constexpr double kThin = 1.2;  // of e
  ThinOptions options = thin_options();
  options.thin = kThin;
  const std::shared_ptr<const Field>& lies_on = critical_before_.field;
  return ThinMotion(mesh_, tracking_, critical_before_.points, lies_on ? *lies_on : field, field, options);
}

/// On grids collisions save a fifth of what local re-skins replace and take longer than that saves (perf/results.md).
bool Tracker::collides(const Field& field) const {
  return options_.topology == Topology::collision ||
         (options_.topology == Topology::automatic && !has_critical_points(field) && field.resolution() == 0.0);
}

/// Operates on the pieces that fail the certificate, as they were before they were predicted; true when that changed
/// the mesh.
bool Tracker::collide(const FieldFrame& frame, Evidence& evidence, const VertexTable& before, std::vector<Ball>& split,
                      FrameReport& report) {
  certify(evidence, report);
  if (evidence.certificate.passed) return false;
  Step step(report, "collide");
  const auto begin = std::chrono::steady_clock::now();
  VertexTable predicted = std::exchange(mesh_.vertices, before);
  CollisionOptions options;
  options.edge_length = options_.edge_length;
  const CollisionReport done =
      handle_collisions(mesh_, predicted.position, *backend_, *frame.field,
                        failed_vertices(evidence.pieces, evidence.certificate), split, options);
  if (done.events.empty()) {
    mesh_.vertices = std::move(predicted);
    return false;
  }
  split.insert(split.end(), done.split.begin(), done.split.end());
  const double ms = std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - begin).count();
  for (const CollisionEvent& event : done.events) {
    ledger_.push_back({frame.frame, frame.time, event.kind, 1, event.position, event.vertices, ms});
    report.reextracted[0] += share_of_area(event.area);
  }
  return true;
}

/// Once more from the prediction, its flaps folded in; kept where that passes.
void Tracker::fold_in_flaps(TriangleMesh predicted, const FieldFrame& frame, Evidence& evidence, FrameReport& report) {
  constexpr double kShare = 0.5;  // of the tolerance
  const FarCorners far(*evidence.field, evidence.lattice, options_.tolerance);
  {
    Step step(report, "predict");
    const std::vector<std::uint8_t> asleep = sleeping(predicted.vertices, options_.sleep);
    if (collapse_flaps(predicted, *frame.field, *backend_, asleep,
                       [&](double value, double slope) { return far.is_far(value, slope, kShare); }) == 0)
      return;
  }
  TriangleMesh with_flaps = std::exchange(mesh_, std::move(predicted));
  const auto left_undone = std::pair(report.inverted, report.quasi_critical);
  relax(awake(), report);
  certify(evidence, report);
  look_closer(frame, evidence, report);
  if (evidence.certificate.passed) return;
  mesh_ = std::move(with_flaps);
  std::tie(report.inverted, report.quasi_critical) = left_undone;
  certify(evidence, report);
}

/// Where necks and gaps are too thin for the lattice, the mesh that critical points tell of them is right, and not the
/// lattice: a field is looked at on which they are wider.
void Tracker::look_closer(const FieldFrame& frame, Evidence& evidence, FrameReport& report) {
  const bool looked = evidence.field != frame.field;
  if (evidence.certificate.passed || looked || critical_.field != frame.field) return;
  ClearOptions clear;
  clear.length = options_.lattice_spacing;
  const std::shared_ptr<const Field> wider = clear_of_zero(*frame.field, critical_.points, clear);
  if (!wider) return;
  backend_->set_field(wider);
  look_at(wider, evidence, report);
  backend_->set_field(frame.field);
  certify(evidence, report);
}

/// The backend holds the field.
void Tracker::look_at(std::shared_ptr<const Field> field, Evidence& evidence, FrameReport& report) {
  Step step(report, "certify");
  evidence.lattice = sample_lattice(*field, *backend_, options_.lattice_spacing);
  evidence.topology = lattice_topology(evidence.lattice);
  evidence.field = std::move(field);
}

/// Skin of skeletons that has folded while it was relaxed; grids leave folds to the repairs.
void Tracker::unfold_skin(const OpenSet& open, Relaxed& relaxed, FrameReport& report) {
  Step step(report, "relax");
  if (!last_field_ || last_field_->resolution() != 0.0) return;
  if (!unfold(mesh_, open, *backend_, options_.project)) return;
  const OpenPart part = open_part(mesh_, open.all() ? std::vector<std::uint8_t>(mesh_.vertex_count()) : open.frozen);
  std::vector<std::uint8_t> inverted(part.triangle.size());
  backend_->set_mesh(part.mesh);
  backend_->inverted_triangles(inverted);
  for (std::size_t i = 0; i < inverted.size(); ++i) relaxed.inverted[part.triangle[i]] = inverted[i];
}

}  // namespace isoskin
