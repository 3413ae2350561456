#include "core/topology/thin_motion.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/parallel.h"
#include "core/topology/point_grid.h"

namespace isoskin {
namespace {

constexpr double kStep = 0.1;  // of e: gaps thinner than this along a ray from an axis may not be seen

bool is_solid(const CriticalPoint& p) {
  return p.kind == CriticalKind::two_saddle;
}

/// A neck inside, or a tunnel outside.
bool is_passage(const CriticalPoint& p) {
  return (is_solid(p) && p.value > 0.0) || (p.kind == CriticalKind::one_saddle && p.value < 0.0);
}

/// The two curvatures across the axis and the one along it, by size.
struct Curvatures {
  double sharper, blunter, along;

  explicit Curvatures(const CriticalPoint& p) {
    const DVec3 size = glm::abs(p.hessian.values);
    const int axis = is_solid(p) ? 2 : 0;
    sharper = std::max(size[1], size[2 - axis]);
    blunter = std::min(size[1], size[2 - axis]);
    along = size[axis];
  }
};

DVec3 axis_of(const CriticalPoint& p) {
  return p.hessian.vectors[is_solid(p) ? 2 : 0];
}

/// Where f, positive at `low` and not at `high`, is zero: regula falsi with the Illinois rule.
template <class Function>
double root_between(const Function& f, double low, double high, double exact) {
  constexpr int kRounds = 24;
  double at_low = f(low), at_high = f(high), middle = high;
  int last = 0;  // the end that was kept
  for (int round = 0; round < kRounds && high - low > exact && at_high < 0.0; ++round) {
    middle = low + at_low / (at_low - at_high) * (high - low);
    const double value = f(middle);
    const int kept = value > 0.0 ? 1 : -1;
    (kept > 0 ? low : high) = middle;
    (kept > 0 ? at_low : at_high) = value;
    if (kept == last) (kept > 0 ? at_high : at_low) *= 0.5;
    last = kept;
  }
  return middle;
}

/// p, turned the shortest way that takes unit vector a to b; these are less than a half turn apart.
DVec3 turned(const DVec3& p, const DVec3& a, const DVec3& b) {
  const DVec3 v = glm::cross(a, b), w = glm::cross(v, p);
  return p + w + glm::cross(v, w) / (1.0 + glm::dot(a, b));
}

}  // namespace

ThinMotion::ThinMotion(const TriangleMesh& mesh, const CriticalTracking& tracking,
                       std::span<const CriticalPoint> previous, const Field& before, const Field& after,
                       const ThinOptions& options)
    : options_(options) {
  const double thin2 = std::pow(options.thin * options.edge_length, 2.0);
  std::vector<const Field*> lies_on;
  const auto add = [&](const CriticalPoint& first, const CriticalPoint& last, const Field& on) {
    const Curvatures curved_before(first), curved_after(last);
    const double waist2_before = 2.0 * std::abs(first.value) / curved_before.sharper;
    const double waist2_after = 2.0 * std::abs(last.value) / curved_after.sharper;
    const double spare = thin2 - std::min(waist2_before, waist2_after);
    if (spare <= 0.0) return;
    const double radius = std::sqrt((waist2_before + spare) * curved_before.sharper / curved_before.blunter);
    const double half = std::sqrt(spare * curved_before.sharper / curved_before.along);
    DVec3 axis = axis_of(last);
    if (glm::dot(axis, axis_of(first)) < 0.0) axis = -axis;
    parts_.push_back({{first.position, axis_of(first), is_solid(first)},
                      {last.position, axis, is_solid(first)},
                      std::min(half, options.longest * options.edge_length),
                      radius});
    lies_on.push_back(&on);
  };
  for (const CriticalPath& path : tracking.paths) {
    if (!path.exists_after() || !is_passage(path.last)) continue;
    const bool stays = path.existed_before() && is_passage(path.first);
    add(stays ? path.first : path.last, path.last, stays ? before : after);  // new tubes are made where they are going
  }
  for (const Index i : tracking.still)
    if (is_passage(previous[i])) add(previous[i], previous[i], before);
  if (parts_.empty()) return;
  constexpr double kOnIt = 0.02, kSlack = 0.01;  // of e
  std::vector<Vec3> center;
  double reach = 0.0;
  for (const Part& p : parts_) {
    center.emplace_back(p.before.center);
    reach = std::max(reach, std::hypot(p.half_length, p.radius));
  }
  const PointGrid centers(center, float(reach + kSlack * options.edge_length));
  std::vector<Index> part(mesh.vertex_count(), kNone);
  for_each_heavy(part.size(), [&](std::size_t v) {
    double least = std::numeric_limits<double>::infinity();
    centers.near(mesh.position(Index(v)), [&](Index i, float) {
      const Passage& passage = parts_[i].before;
      const DVec3 d = DVec3(mesh.position(Index(v))) - passage.center;
      const double along = glm::dot(d, passage.axis), off = glm::length(d);
      const bool in =
          std::abs(along) <= parts_[i].half_length && glm::length(d - along * passage.axis) <= parts_[i].radius;
      const bool nearer = off < least || (off == least && i < part[v]);
      if (!in || !nearer) return;
      const auto wall = settled(passage, d, *lies_on[i]);
      if (!wall || glm::distance(*wall, d) > kOnIt * options.edge_length) return;  // of another wall
      least = off;
      part[v] = i;
    });
  });
  for (Index v = 0; v < part.size(); ++v) {
    if (part[v] == kNone) continue;
    const Part& p = parts_[part[v]];
    const DVec3 offset = turned(DVec3(mesh.position(v)) - p.before.center, p.before.axis, p.after.axis);
    noted_.push_back({v, part[v], offset, mesh.position(v)});
  }
}

/// From the axis through `offset`: positive within the passage, at a distance from the axis.
class ThinMotion::Ray {
public:
  Ray(const Passage& passage, const DVec3& offset, const Field& field) : field_(field), sign_(passage.solid ? 1 : -1) {
    const DVec3 along = glm::dot(offset, passage.axis) * passage.axis;
    length_ = glm::length(offset - along);
    start_ = passage.center + along;
    if (length_ > 0.0) direction_ = (offset - along) / length_;
  }

  double length() const { return length_; }
  double operator()(double distance) const { return sign_ * field_.value(start_ + distance * direction_); }
  DVec3 point(double distance) const { return start_ + distance * direction_; }

private:
  const Field& field_;
  double sign_, length_;
  DVec3 start_, direction_{0.0};
};

/// Whether the wall in the direction of `offset` from the axis is no farther than `slack` from there.
bool ThinMotion::on_wall(const Passage& passage, const DVec3& offset, const Field& field, double slack) const {
  const Ray inside(passage, offset, field);
  const double nearest = std::max(0.0, inside.length() - slack);
  if (!(inside(nearest) > 0.0) || inside(inside.length() + slack) > 0.0) return false;
  for (double r = 0.0; r < nearest; r += kStep * options_.edge_length)
    if (!(inside(r) > 0.0)) return false;
  return true;
}

/// Where the wall is in the direction of `offset` from the axis; nothing when it is far.
std::optional<DVec3> ThinMotion::settled(const Passage& passage, const DVec3& offset, const Field& field) const {
  constexpr double kFarthest = 4.0, kExact = 1e-7;  // of e
  const double e = options_.edge_length, step = kStep * e;
  const Ray inside(passage, offset, field);
  if (!(inside.length() > 0.0) || !(inside(0.0) > 0.0)) return std::nullopt;
  for (double high = step; high <= kFarthest * e; high += step)
    if (!(inside(high) > 0.0))
      return inside.point(root_between(inside, high - step, high, kExact * e)) - passage.center;
  return std::nullopt;
}

void ThinMotion::apply(TriangleMesh& mesh, const Field& after, double dt) const {
  constexpr double kFarthest = 1.5;  // of e
  for_each_heavy(noted_.size(), [&](std::size_t i) {
    const Noted& noted = noted_[i];
    const Passage& passage = parts_[noted.part].after;
    const auto offset = settled(passage, noted.offset, after);
    if (!offset || glm::distance(*offset, noted.offset) > kFarthest * options_.edge_length) return;
    Vec3& position = mesh.vertices.position[noted.vertex];
    position = Vec3(passage.center + *offset);
    if (dt > 0.0) mesh.vertices.velocity[noted.vertex] = (position - noted.old) / float(dt);
  });
}

}  // namespace isoskin
