#include "core/topology/critical_tracking.h"

#include <algorithm>
#include <cmath>

#include <tbb/parallel_for.h>

#include "core/topology/places.h"

namespace isoskin {
namespace {

bool inside(const CriticalPoint& point) {
  return point.value > 0.0;
}

/// dp/ds = -H^-1 (grad after - grad before) along which grad F stays zero.
DVec3 velocity(const Field& before, const Field& after, const CriticalPoint& point) {
  const DVec3 change = after.sample(point.position).gradient - before.sample(point.position).gradient;
  DVec3 v(0.0);
  for (int i = 0; i < 3; ++i) {
    const DVec3& axis = point.hessian.vectors[i];
    v -= glm::dot(axis, change) / point.hessian.values[i] * axis;
  }
  return v;
}

class Continuation {
public:
  Continuation(const Field& before, const Field& after, const CriticalOptions& options, const TrackingOptions& tracking)
      : before_(before), after_(after), options_(options), tracking_(tracking) {}

  /// From s = 0 to 1, or from 1 to 0.
  CriticalPath follow(const CriticalPoint& start, bool forward) const {
    CriticalPath path;
    path.first = path.last = start;
    double& s = forward ? path.end : path.begin;
    CriticalPoint& point = forward ? path.last : path.first;
    const double goal = forward ? 1.0 : 0.0;
    s = 1.0 - goal;
    double step = 1.0;
    while (s != goal) {
      const DVec3 v = velocity(before_, after_, point);
      const double speed = glm::length(v);
      const double longest = tracking_.longest_move * options_.edge_length;
      if (!std::isfinite(speed)) break;
      if (speed * step > longest) step = longest / speed;
      if (step < tracking_.shortest_step) break;
      const double next = forward ? std::min(goal, s + step) : std::max(goal, s - step);
      const auto moved = confirm(point, point.position + (next - s) * v, next, std::abs(next - s) * speed);
      if (!moved) {
        step = 0.5 * std::abs(next - s);
        continue;
      }
      note_crossing(path, point, s, *moved, next);
      point = *moved;
      s = next;
      step *= 2.0;
    }
    return path;
  }

private:
  /// The critical point of the blend at `s` near `predicted`, if it is plausibly `from` moved there.
  std::optional<CriticalPoint> confirm(const CriticalPoint& from, const DVec3& predicted, double s, double move) const {
    constexpr double kMargin = 0.05;  // of e: how far the prediction may be off however small the move
    CriticalOptions near = options_;
    near.reach = 0.5 * move / options_.edge_length + kMargin;
    const auto point = refine_critical_point(BlendField(before_, after_, s), predicted, near);
    return point && point->kind == from.kind ? point : std::nullopt;
  }

  void note_crossing(CriticalPath& path, const CriticalPoint& a, double sa, const CriticalPoint& b, double sb) const {
    if (inside(a) == inside(b)) return;
    if (path.crossing) return path.crossing.reset();  // there and back
    const double share = a.value / (a.value - b.value);
    const double s = sa + share * (sb - sa);
    const DVec3 between = a.position + share * (b.position - a.position);
    path.crossing = confirm(a, between, s, glm::distance(a.position, b.position)).value_or(inside(a) ? b : a);
    path.crossing_time = s;
    path.rising = inside(b) == (sb > sa);
  }

  const Field& before_;
  const Field& after_;
  const CriticalOptions& options_;
  const TrackingOptions& tracking_;
};

std::vector<CriticalPath> follow_all(const std::vector<CriticalPoint>& points, const Continuation& continuation,
                                     bool forward) {
  std::vector<CriticalPath> paths(points.size());
  tbb::parallel_for(std::size_t(0), points.size(),
                    [&](std::size_t i) { paths[i] = continuation.follow(points[i], forward); });
  return paths;
}

std::vector<CriticalPoint> without_degenerate(std::vector<CriticalPoint> points) {
  std::erase_if(points, [](const CriticalPoint& p) { return p.kind == CriticalKind::degenerate; });
  return points;
}

bool begins_before(const CriticalPath& a, const CriticalPath& b) {
  return before_in_space(a.first.position, b.first.position);
}

}  // namespace

FieldSample BlendField::sample(const DVec3& p) const {
  const FieldSample a = before_.sample(p), b = after_.sample(p);
  return {(1.0 - s_) * a.value + s_ * b.value, (1.0 - s_) * a.gradient + s_ * b.gradient};
}

Box BlendField::bounds() const {
  // Where both have one sign, so has the blend: its surface lies between theirs, hence in the solid of either.
  Box box = before_.bounds();
  box.add(after_.bounds());
  return box;
}

Interval BlendField::range(const Box& box) const {
  const Interval a = before_.range(box), b = after_.range(box);
  return {(1.0 - s_) * a.low + s_ * b.low, (1.0 - s_) * a.high + s_ * b.high};
}

CriticalTracking track(const std::vector<CriticalPoint>& previous, const std::vector<CriticalPoint>& found,
                       const Field& before, const Field& after, const CriticalOptions& options,
                       const TrackingOptions& tracking, const ChangeMask& changed) {
  const Continuation continuation(before, after, options, tracking);
  CriticalTracking result;
  std::vector<CriticalPoint> moving;
  for (Index i = 0; i < previous.size(); ++i) {
    if (previous[i].kind == CriticalKind::degenerate) continue;
    if (changed.contains(previous[i].position))
      moving.push_back(previous[i]);
    else
      result.still.push_back(i);
  }
  result.paths = follow_all(moving, continuation, true);

  const double same = options.merge * options.edge_length;
  std::vector<CriticalPoint> fresh = without_degenerate(found);
  Box about;
  for (const CriticalPoint& point : fresh) about.add(point.position);
  about = about.grown(2.0 * same);
  Places known(same);
  const auto know = [&](const DVec3& p) {
    if (glm::all(glm::lessThan(about.low, p)) && glm::all(glm::lessThan(p, about.high))) known.add(p);
  };
  for (const CriticalPath& path : result.paths)
    if (path.exists_after()) know(path.last.position);
  for (const Index i : result.still) know(previous[i].position);
  std::erase_if(fresh, [&](const CriticalPoint& point) { return known.any_near(point.position); });
  const auto sort_from = [&](std::size_t first) {
    const auto begin = result.paths.begin() + std::ptrdiff_t(first);
    if (!std::is_sorted(begin, result.paths.end(), begins_before)) std::sort(begin, result.paths.end(), begins_before);
  };
  const std::size_t followed = result.paths.size();
  sort_from(0);
  for (CriticalPath& path : follow_all(fresh, continuation, false)) result.paths.push_back(std::move(path));
  sort_from(followed);
  std::inplace_merge(result.paths.begin(), result.paths.begin() + std::ptrdiff_t(followed), result.paths.end(),
                     begins_before);
  for (const CriticalPath& path : result.paths) {
    result.matched += path.existed_before() && path.exists_after();
    result.born += !path.existed_before();
    result.died += !path.exists_after();
  }
  result.matched += result.still.size();
  return result;
}

}  // namespace isoskin
