#include "core/topology/events.h"

#include <algorithm>
#include <cmath>

#include "core/field/skeleton_field.h"
#include "core/parallel.h"
#include "core/topology/critical_interval.h"
#include "core/topology/places.h"

namespace isoskin {
namespace {

using Operation = SurgeryReport (*)(TriangleMesh&, const SurgerySite&, const Field&, const SurgeryOptions&);

struct NamedOperation {
  const char* name;
  Operation operation;
};

/// By kind, and whether the value falls or rises.
constexpr NamedOperation kOperations[4][2] = {
    {{"destroy", destroy_component}, {"create", create_component}},
    {{"cut", cut}, {"connect", connect}},
    {{"pierce", pierce}, {"spackle", spackle}},
    {{"open_bubble", open_bubble}, {"burst_bubble", burst_bubble}},
};

bool before(const CriticalPath& a, const CriticalPath& b) {
  if (a.crossing_time != b.crossing_time) return a.crossing_time < b.crossing_time;
  return before_in_space(a.crossing->position, b.crossing->position);
}

std::vector<CriticalPath> crossings_of(const CriticalTracking& tracking) {
  std::vector<CriticalPath> crossings;
  for (const CriticalPath& path : tracking.paths)
    if (path.crossing) crossings.push_back(path);
  std::sort(crossings.begin(), crossings.end(), before);
  return crossings;
}

CriticalEvent operate(TriangleMesh& mesh, const CriticalPath& path, const Field& field, const SurgeryOptions& options) {
  const NamedOperation& chosen = kOperations[int(path.first.kind)][path.rising];
  const std::size_t vertices = mesh.vertex_count();
  const SurgeryReport report = chosen.operation(mesh, {path.first, path.last}, field, options);
  CriticalEvent event;
  event.kind = chosen.name;
  event.position = path.crossing->position;
  event.crossing = path.crossing_time;
  event.done = report.done;
  event.reason = report.reason;
  event.area = report.area;
  event.vertices = std::max(report.vertices_added, vertices - std::min(vertices, mesh.vertex_count()));
  return event;
}

/// Middles of the pairs of elements whose radii overlap, by a sweep along x; those out of `about` may be left out.
void add_middles(const std::vector<SkeletonElement>& elements, const ChangeMask& about, std::vector<DVec3>& seeds) {
  std::vector<std::pair<DVec3, double>> ball;
  double widest = 0.0;
  for (const SkeletonElement& e : elements) widest = std::max(widest, e.radius);
  for (const SkeletonElement& e : elements) {
    const Box middles = Box{center(e), center(e)}.grown(0.5 * (e.radius + widest));
    if (about.overlaps(middles)) ball.emplace_back(center(e), e.radius);
  }
  std::stable_sort(ball.begin(), ball.end(), [](const auto& a, const auto& b) { return a.first.x < b.first.x; });
  for (std::size_t i = 0; i < ball.size(); ++i)
    for (std::size_t j = i + 1; j < ball.size() && ball[j].first.x - ball[i].first.x < ball[i].second + widest; ++j)
      if (glm::distance(ball[i].first, ball[j].first) < ball[i].second + ball[j].second)
        seeds.push_back(0.5 * (ball[i].first + ball[j].first));
}

/// The points merged. They must be described by nothing but where they are.
CriticalState state_of(std::vector<CriticalPoint> points, std::shared_ptr<const Field> field,
                       const EventOptions& options) {
  merge_critical_points(points, options.critical.merge * options.critical.edge_length);
  return {std::move(field), std::move(points)};
}

/// Where the paths lead.
std::vector<CriticalPoint> points_after(const std::vector<CriticalPath>& paths, const Field& field,
                                        const CriticalOptions& options) {
  std::vector<CriticalPoint> points;
  for (const CriticalPath& path : paths)
    if (path.exists_after()) points.push_back(path.last);
  for_each_heavy(points.size(),
                 [&](std::size_t i) { points[i] = describe_critical_point(field, points[i].position, options); });
  return points;
}

/// The points of `before` that are still, with those that paths lead to. Both are in order, and what is still has been
/// merged: only what has come near others is merged with them.
std::vector<CriticalPoint> with_still(const std::vector<CriticalPoint>& before, const std::vector<Index>& still,
                                      std::vector<CriticalPoint> others, const CriticalOptions& options) {
  const double distance = options.merge * options.edge_length;
  Places near(distance);
  Box about;
  for (const CriticalPoint& point : others) near.add(point.position), about.add(point.position);
  about = about.grown(2.0 * distance);
  std::vector<Index> apart;
  apart.reserve(still.size());
  for (const Index i : still) {
    const DVec3& p = before[i].position;
    if (glm::all(glm::lessThan(about.low, p)) && glm::all(glm::lessThan(p, about.high)) && near.any_near(p))
      others.push_back(before[i]);
    else
      apart.push_back(i);
  }
  merge_critical_points(others, distance);
  std::vector<CriticalPoint> all;
  all.reserve(apart.size() + others.size());
  auto other = others.begin();
  for (const Index i : apart) {
    while (other != others.end() && before_in_space(other->position, before[i].position)) all.push_back(*other++);
    all.push_back(before[i]);
  }
  all.insert(all.end(), other, others.end());
  return all;
}

bool can_be_searched_completely(const SkeletonField& field, const EventOptions& options) {
  return field.elements().size() <= options.complete_elements &&
         std::all_of(field.elements().begin(), field.elements().end(),
                     [](const SkeletonElement& e) { return is_point(e) && e.norm == 2.0; });
}

}  // namespace

EventOptions event_options(double edge_length) {
  EventOptions options;
  options.critical.edge_length = edge_length;
  options.surgery.edge_length = edge_length;
  return options;
}

bool has_critical_points(const Field& field) {
  return field.is_c2() && field.resolution() == 0.0;
}

std::vector<DVec3> critical_seeds(const TriangleMesh& mesh, const Field& field, Backend& backend,
                                  const ChangeMask& about) {
  std::vector<DVec3> seeds = least_gradient_vertices(mesh, backend, about);
  if (const auto* skeleton = dynamic_cast<const SkeletonField*>(&field)) {
    for (const SkeletonElement& e : skeleton->elements()) seeds.push_back(center(e));
    add_middles(skeleton->elements(), about, seeds);
    std::erase_if(seeds, [&](const DVec3& seed) { return !about.contains(seed); });
  }
  return seeds;
}

CriticalState restore_critical_points(std::span<const DVec3> positions, std::shared_ptr<const Field> field,
                                      const EventOptions& options) {
  CriticalState state;
  for (const DVec3& p : positions) state.points.push_back(describe_critical_point(*field, p, options.critical));
  state.field = std::move(field);
  return state;
}

CriticalState start_critical_points(const TriangleMesh& mesh, std::shared_ptr<const Field> field, Backend& backend,
                                    const EventOptions& options) {
  std::vector<CriticalPoint> points =
      find_critical_points(*field, backend, critical_seeds(mesh, *field, backend), options.critical).points;
  const auto* skeleton = dynamic_cast<const SkeletonField*>(field.get());
  if (skeleton && can_be_searched_completely(*skeleton, options)) {
    // Farther below zero than this share of the level F is next to constant, and the next frames' searches will do.
    constexpr double kShare = 0.9;
    IntervalSearchOptions search;
    search.values.low = -kShare * std::abs(skeleton->iso());
    search.max_boxes = options.complete_boxes;
    search.least_box = options.critical.settled * options.critical.edge_length;
    const Box box = field->bounds().grown(options.critical.reach * options.critical.edge_length);
    const IntervalSearch all = find_all_critical_points(*skeleton, box, options.critical, search);
    points.insert(points.end(), all.points.begin(), all.points.end());
  }
  for (CriticalPoint& point : points) point = describe_critical_point(*field, point.position, options.critical);
  return state_of(std::move(points), std::move(field), options);
}

EventPlan plan_critical_events(const TriangleMesh& mesh, const CriticalState& state, std::shared_ptr<const Field> field,
                               Backend& backend, const EventOptions& options) {
  // A search that begins farther off stays where the fields are the same, and finds what the last one found.
  const ChangeMask changed(changes_between(*state.field, *field),
                           options.critical.reach * options.critical.edge_length);
  const CriticalSearch found =
      find_critical_points(*field, backend, critical_seeds(mesh, *field, backend, changed), options.critical);
  EventPlan plan;
  plan.tracking = track(state.points, found.points, *state.field, *field, options.critical, options.tracking, changed);
  plan.crossings = crossings_of(plan.tracking);
  plan.degenerate = found.degenerate;
  plan.field = std::move(field);
  return plan;
}

std::optional<double> time_between_events(const EventPlan& plan, const EventOptions& options) {
  const double separation = options.separation * options.critical.edge_length;
  for (std::size_t later = 1; later < plan.crossings.size(); ++later) {
    const CriticalPath &event = plan.crossings[later], &last = plan.crossings[later - 1];
    const bool meets = std::any_of(
        plan.crossings.begin(), plan.crossings.begin() + std::ptrdiff_t(later), [&](const CriticalPath& earlier) {
          return glm::distance(earlier.crossing->position, event.crossing->position) < separation;
        });
    if (!meets) continue;
    const double between = 0.5 * (last.crossing_time + event.crossing_time);
    const bool possible = event.crossing_time - last.crossing_time > 2.0 * options.shortest_part &&
                          between > options.shortest_part && between < 1.0 - options.shortest_part;
    if (possible) return between;
  }
  return std::nullopt;
}

std::optional<double> time_before_refusal(const EventPlan& plan, const EventReport& done, const EventOptions& options) {
  const double narrow = options.narrow * options.critical.edge_length;
  for (std::size_t i = 0; i < plan.crossings.size(); ++i) {
    const CriticalPath& path = plan.crossings[i];
    const bool passage = path.first.kind == CriticalKind::two_saddle || path.first.kind == CriticalKind::one_saddle;
    if (done.events[i].done || !passage || !path.existed_before()) continue;
    const double value = 0.5 * std::abs(path.first.hessian.values[1]) * narrow * narrow;
    const double left = value / std::abs(path.first.value);
    const double time = path.crossing_time * (1.0 - left);
    constexpr double kWorthwhile = 0.7;
    if (left < kWorthwhile && time > options.shortest_part) return time;
  }
  return std::nullopt;
}

std::shared_ptr<const Field> field_between(const Field& before, const Field& after, double s) {
  const auto* a = dynamic_cast<const SkeletonField*>(&before);
  const auto* b = dynamic_cast<const SkeletonField*>(&after);
  if (!a || !b) return nullptr;
  std::vector<SkeletonElement> elements = a->elements();
  for (SkeletonElement& e : elements) e.weight *= 1.0 - s;
  for (SkeletonElement e : b->elements()) {
    e.weight *= s;
    elements.push_back(e);
  }
  return std::make_shared<SkeletonField>(std::move(elements), (1.0 - s) * a->iso() + s * b->iso());
}

EventReport operate_on_critical_events(TriangleMesh& mesh, CriticalState& state, const EventPlan& plan,
                                       const EventOptions& options) {
  EventReport report;
  for (const CriticalPath& path : plan.crossings) {
    report.events.push_back(operate(mesh, path, *plan.field, options.surgery));
    ++(report.events.back().done ? report.done : report.left_over);
  }
  const CriticalTracking& tracking = plan.tracking;
  state.field = plan.field;
  if (!tracking.paths.empty() || tracking.still.size() != state.points.size())
    state.points = with_still(state.points, tracking.still, points_after(tracking.paths, *plan.field, options.critical),
                              options.critical);
  report.critical_points = state.points.size();
  report.degenerate = plan.degenerate;
  report.born = plan.tracking.born;
  report.died = plan.tracking.died;
  return report;
}

EventReport handle_critical_events(TriangleMesh& mesh, CriticalState& state, std::shared_ptr<const Field> field,
                                   Backend& backend, const EventOptions& options) {
  if (!state.field) return {};
  return operate_on_critical_events(mesh, state, plan_critical_events(mesh, state, std::move(field), backend, options),
                                    options);
}

}  // namespace isoskin
