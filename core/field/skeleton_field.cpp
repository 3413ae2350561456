#include "core/field/skeleton_field.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <mutex>
#include <string>

#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include "core/field/field_changes.h"

namespace isoskin {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
// Inverse square is constant nearer than this share of the radius: F stays finite (at most 1e12 times the weight).
constexpr double kSingularity = 1e-6;
// A p-norm's derivatives are taken as if no coordinate were smaller than this share of the distance: for p < 2 they
// have no bound on the coordinate planes.
constexpr double kLeastShare = 1e-6;
// Farther than this every potential is zero; its square would leave the range of a double.
constexpr double kFar = 1e100;
constexpr double kRounding = 1e-14;  // relative error of one element's term, with room to spare

struct Profile {  // a potential and its derivatives by s = d^2
  double value = 0.0, first = 0.0, second = 0.0;
};

Profile profile(const SkeletonElement& e, double s) {
  if (!(s < kFar * kFar)) return {};
  const double r2 = e.radius * e.radius;
  const double q = s / r2;
  switch (e.potential) {
    case Potential::inverse_square:
      if (q < kSingularity * kSingularity) return {1.0 / (kSingularity * kSingularity), 0.0, 0.0};
      return {1.0 / q, -1.0 / (q * s), 2.0 / (q * s * s)};
    case Potential::cauchy: {
      const double c = 1.0 / (1.0 + s);
      return {e.radius * c, -e.radius * c * c, 2.0 * e.radius * c * c * c};
    }
    case Potential::metaball: {
      if (q >= 1.0) return {};
      const double c = 1.0 - q;
      return {c * c * c, -3.0 * c * c / r2, 6.0 * c / (r2 * r2)};
    }
    case Potential::blinn: {
      const double c = std::exp(-q);
      return {c, -c / r2, c / (r2 * r2)};
    }
    case Potential::wyvill:
      if (q >= 1.0) return {};
      return {1.0 + q * (-22.0 + q * (17.0 - 4.0 * q)) / 9.0, (-22.0 + q * (34.0 - 12.0 * q)) / (9.0 * r2),
              (34.0 - 24.0 * q) / (9.0 * r2 * r2)};
  }
  return {};
}

double norm_of(const DVec3& x, double p) {
  if (p == 2.0) return glm::length(x);
  const DVec3 size = glm::abs(x);
  const double most = std::max({size.x, size.y, size.z});
  if (!(most > 0.0) || most > kFar) return most;
  const DVec3 u = size / most;
  return most * std::pow(std::pow(u.x, p) + std::pow(u.y, p) + std::pow(u.z, p), 1.0 / p);
}

struct NormShape {  // s = d^2 and what its derivatives by x are made of
  double s = 0.0;
  DVec3 w{0.0};         // d grad d = grad s / 2
  DVec3 v{0.0};         // grad d
  DVec3 diagonal{0.0};  // (|x_i| / d)^(p-2)
};

NormShape norm_shape(const DVec3& x, double p) {
  if (p == 2.0) return {glm::dot(x, x), x, DVec3(0.0), DVec3(1.0)};
  NormShape n;
  const double d = norm_of(x, p);
  n.s = d * d;
  if (!(d > 0.0) || d > kFar) return n;
  for (int i = 0; i < 3; ++i) {
    const double share = std::max(std::abs(x[i]) / d, kLeastShare);
    n.diagonal[i] = std::pow(share, p - 2.0);
    n.v[i] = x[i] == 0.0 ? 0.0 : std::copysign(n.diagonal[i] * share, x[i]);
  }
  n.w = d * n.v;
  return n;
}

DVec3 across(DVec3 g, const ElementOffset& offset) {
  for (int i = 0; i < offset.slides; ++i) g -= glm::dot(g, offset.slide[i]) * offset.slide[i];
  return g;
}

/// As element_sample() of a Euclidean point.
FieldSample ball_sample(const SkeletonElement& e, const DVec3& p) {
  const DVec3 x = p - e.a;
  const Profile f = profile(e, glm::dot(x, x));
  if (f.first == 0.0) return {e.weight * f.value, DVec3(0.0)};
  return {e.weight * f.value, (2.0 * e.weight * f.first) * x};
}

FieldSample element_sample(const SkeletonElement& e, const DVec3& p) {
  const ElementOffset offset = offset_from(e, p);
  const NormShape n = norm_shape(offset.x, e.norm);
  const Profile f = profile(e, n.s);
  if (f.first == 0.0) return {e.weight * f.value, DVec3(0.0)};
  return {e.weight * f.value, across((2.0 * e.weight * f.first) * n.w, offset)};
}

/// As element_hessian() of a Euclidean point.
DMat3 ball_hessian(const SkeletonElement& e, const DVec3& p) {
  const DVec3 x = p - e.a;
  const Profile f = profile(e, glm::dot(x, x));
  if (f.first == 0.0 && f.second == 0.0) return DMat3(0.0);
  DMat3 h = 4.0 * f.second * glm::outerProduct(x, x);
  for (int i = 0; i < 3; ++i) h[i][i] += 2.0 * f.first;
  return e.weight * h;
}

DMat3 element_hessian(const SkeletonElement& e, const DVec3& p) {
  const ElementOffset offset = offset_from(e, p);
  const NormShape n = norm_shape(offset.x, e.norm);
  const Profile f = profile(e, n.s);
  if (f.first == 0.0 && f.second == 0.0) return DMat3(0.0);
  DMat3 bend = (2.0 - e.norm) * glm::outerProduct(n.v, n.v);
  for (int i = 0; i < 3; ++i) bend[i][i] += (e.norm - 1.0) * n.diagonal[i];
  const DMat3 h = 4.0 * f.second * glm::outerProduct(n.w, n.w) + 2.0 * f.first * bend;
  DMat3 keep(1.0);
  for (int i = 0; i < offset.slides; ++i) keep -= glm::outerProduct(offset.slide[i], offset.slide[i]);
  return e.weight * (keep * h * keep);
}

Interval norm_interval(const DVec3& low, const DVec3& high, double p) {
  DVec3 nearest(0.0), farthest(0.0);
  for (int i = 0; i < 3; ++i) {
    nearest[i] = std::max({low[i], -high[i], 0.0});
    farthest[i] = std::max(std::abs(low[i]), std::abs(high[i]));
  }
  return {norm_of(nearest, p), norm_of(farthest, p)};
}

Interval shape_distance(const SkeletonElement& e, const Box& box) {
  const Interval euclidean = euclidean_distance(e, box);
  if (e.norm == 2.0) return euclidean;
  const double ratio = std::pow(3.0, 1.0 / e.norm - 0.5);  // p-norm of the diagonal over its Euclidean length
  Interval d{euclidean.low * std::min(ratio, 1.0), euclidean.high * std::max(ratio, 1.0)};
  const double half = 0.5 * box.diagonal();
  if (std::isfinite(half)) {  // p minus its nearest point moves no faster than p
    const DVec3 x = offset_from(e, box.center()).x;
    const Interval local = norm_interval(x - half, x + half, e.norm);
    d = {std::max(d.low, local.low), std::min(d.high, local.high)};
  }
  return d;
}

/// The farthest of its corners from the origin.
double size_of(const SkeletonElement& e) {
  const Corners8 corners = corners_of(e);
  double most = 0.0;
  for (int i = 0; i < corners.count; ++i) most = std::max(most, glm::length(corners.at[i]));
  return most;
}

// Bounds of the element's distance over the box, widened by what rounding may take; `size`: size_of() it.
Interval distance_interval(const SkeletonElement& e, double size, const Box& box) {
  const Interval d = is_point(e) ? norm_interval(box.low - e.a, box.high - e.a, e.norm) : shape_distance(e, box);
  constexpr double kRelative = 1e-13;
  const double absolute = kRelative * std::max(size, std::isfinite(d.low) ? d.low : 0.0);
  return {std::max(0.0, d.low - absolute), d.high + absolute + kRelative * d.high};
}

/// Where the element's potential is not zero, with room for rounding.
Box support_of(const SkeletonElement& e, double size) {
  if (!is_compact(e)) return {DVec3(-kInfinity), DVec3(kInfinity)};
  constexpr double kRelative = 1e-9;  // a p-norm is at least the largest coordinate, up to rounding
  return extent(e).grown(e.radius + kRelative * (e.radius + 2.0 * size));
}

/// Without branches: most elements are far from a point, but there is no telling which.
bool contains(const Box& box, const DVec3& p) {
  return bool((p.x >= box.low.x) & (p.x <= box.high.x) & (p.y >= box.low.y) & (p.y <= box.high.y) & (p.z >= box.low.z) &
              (p.z <= box.high.z));
}

bool overlap(const Box& a, const Box& b) {
  return a.low.x <= b.high.x && b.low.x <= a.high.x && a.low.y <= b.high.y && b.low.y <= a.high.y &&
         a.low.z <= b.high.z && b.low.z <= a.high.z;
}

bool may_be_zero(const Interval& range) {
  return range.low <= 0.0 && range.high >= 0.0;
}

// How far the surface may reach beyond `from` in direction `side` of `axis`: grows until the half space beyond has
// none.
double reach(const Field& field, int axis, int side, double from, double size) {
  const auto free_beyond = [&](double distance) {
    Box beyond{DVec3(-kInfinity), DVec3(kInfinity)};
    (side > 0 ? beyond.low : beyond.high)[axis] = from + side * distance;
    return !may_be_zero(field.range(beyond));
  };
  constexpr int kDoublings = 10;  // a surface that reaches beyond 1000 times the skeleton is cut off there
  double outside = 0.0, inside = 0.0, step = size;
  while (!free_beyond(outside)) {
    inside = outside;
    outside += step;
    step *= 2.0;
    if (step > size * (1 << kDoublings)) return from + side * outside;
  }
  constexpr int kHalvings = 8;
  for (int i = 0; i < kHalvings && inside < outside; ++i) {
    const double middle = 0.5 * (inside + outside);
    (free_beyond(middle) ? outside : inside) = middle;
  }
  return from + side * outside;
}

/// Branch and bound: the coordinate farthest to `side` of `axis` of the cells of a box that may hold surface, times
/// `side`. Cells that cannot beat what has been found so far are passed over, which only saves time. Parallel.
class FarthestCell {
public:
  /// `only`: cells elsewhere are known not to beat start_at()'s.
  FarthestCell(const Field& field, int axis, int side, const ChangeMask* only = nullptr)
      : field_(field), axis_(axis), side_(side), only_(only) {}

  void start_at(const Box& cell) { take(cell, end_of(cell)); }
  /// With the box's cell at a point, if it may hold surface.
  void start_near(Box box, const DVec3& point, int depth) {
    for (; may_be_zero(field_.range(box)); --depth) {
      if (depth == 0) return start_at(box);
      const DVec3 c = box.center();
      for (int i = 0; i < 3; ++i) (point[i] > c[i] ? box.low : box.high)[i] = c[i];
    }
  }

  void search(const Box& box, int depth) {
    const double end = end_of(box);
    if (end <= end_ || (only_ && !only_->overlaps(box)) || !may_be_zero(field_.range(box))) return;
    if (depth == 0) return take(box, end);
    // Where all that would beat the farthest so far is free, none of the cells it is made of has to be asked.
    constexpr int kSmall = 3;  // larger boxes hardly ever are
    const double so_far = end_;
    if (depth <= kSmall && begin_of(box) < so_far && !may_be_zero(field_.range(beyond(box, so_far)))) return;
    const DVec3 c = box.center();
    for (const bool far_half : {true, false}) {
      tbb::parallel_for(0, 4, [&](int quarter) {
        Box child = box;
        const bool up[3] = {far_half == (side_ > 0), (quarter & 1) != 0, (quarter & 2) != 0};
        for (int i = 0; i < 3; ++i) (up[i] ? child.low : child.high)[(axis_ + i) % 3] = c[(axis_ + i) % 3];
        search(child, depth - 1);
      });
    }
  }

  double end() const { return end_; }  // minus infinity: there is none
  const Box& cell() const { return cell_; }

private:
  double end_of(const Box& box) const { return side_ * (side_ > 0 ? box.high : box.low)[axis_]; }
  double begin_of(const Box& box) const { return side_ * (side_ > 0 ? box.low : box.high)[axis_]; }
  Box beyond(Box box, double end) const {
    (side_ > 0 ? box.low : box.high)[axis_] = side_ * end;
    return box;
  }

  void take(const Box& cell, double end) {
    const std::lock_guard lock(guard_);
    if (end <= end_) return;
    end_ = end;
    cell_ = cell;
  }

  const Field& field_;
  const int axis_, side_;
  const ChangeMask* only_;
  std::mutex guard_;
  std::atomic<double> end_{-kInfinity};
  Box cell_;
};

bool same(const Box& a, const Box& b) {
  return a.low == b.low && a.high == b.high;
}

}  // namespace

SkeletonField::SkeletonField(std::vector<SkeletonElement> elements, double iso)
    : elements_(std::move(elements)), iso_(iso) {
  if (!std::isfinite(iso_)) throw InputError("skeleton: iso must be finite");
  for (std::size_t i = 0; i < elements_.size(); ++i) {
    check(elements_[i], i);
    size_.push_back(size_of(elements_[i]));
    support_.push_back(support_of(elements_[i], size_[i]));
    is_ball_.push_back(is_point(elements_[i]) && elements_[i].norm == 2.0);
  }
  near_ = ElementGrid(support_);
}

DVec3 SkeletonField::origin() const {
  constexpr double kRaster = 1.0 / 16.0;  // of the skeleton's size
  Box box;
  for (const SkeletonElement& e : elements_) box.add(extent(e));
  if (box.empty()) return DVec3(0.0);
  const double size = box.diagonal();
  const double raster = size > 0.0 ? std::exp2(std::ceil(std::log2(kRaster * size))) : 1.0;
  return raster * glm::round(box.center() / raster);
}

FieldSample SkeletonField::sample(const DVec3& p) const {
  FieldSample sum{-iso_, DVec3(0.0)};
  near_.for_each_at(p, [&](Index i) {
    if (!contains(support_[i], p)) return;
    const FieldSample s = is_ball_[i] ? ball_sample(elements_[i], p) : element_sample(elements_[i], p);
    sum.value += s.value;
    sum.gradient += s.gradient;
  });
  return sum;
}

double SkeletonField::value(const DVec3& p) const {
  double sum = -iso_;
  near_.for_each_at(p, [&](Index i) {
    if (!contains(support_[i], p)) return;
    const SkeletonElement& e = elements_[i];
    const DVec3 x = is_ball_[i] ? p - e.a : offset_from(e, p).x;
    const double d = e.norm == 2.0 ? 0.0 : norm_of(x, e.norm);
    sum += e.weight * profile(e, e.norm == 2.0 ? glm::dot(x, x) : d * d).value;
  });
  return sum;
}

DMat3 SkeletonField::hessian(const DVec3& p) const {
  DMat3 sum(0.0);
  near_.for_each_at(p, [&](Index i) {
    if (contains(support_[i], p)) sum += is_ball_[i] ? ball_hessian(elements_[i], p) : element_hessian(elements_[i], p);
  });
  return sum;
}

Interval SkeletonField::range(const Box& box) const {
  Interval sum{-iso_, -iso_};
  double low_size = std::abs(iso_), high_size = low_size;
  near_.for_each_in(box, [&](Index i) {
    if (!overlap(support_[i], box)) return;
    const SkeletonElement& e = elements_[i];
    const Interval d = distance_interval(e, size_[i], box);
    const double near = e.weight * profile(e, d.low * d.low).value;
    const double far = e.weight * profile(e, d.high * d.high).value;
    const auto [low, high] = std::minmax(near, far);
    sum.low += low;
    sum.high += high;
    low_size += std::abs(low);
    high_size += std::abs(high);
  });
  const double rounding = kRounding * static_cast<double>(elements_.size() + 1);
  return {sum.low - rounding * low_size, sum.high + rounding * high_size};
}

void SkeletonField::follow_bounds(const SkeletonField& before, const ChangeMask& changed) const {
  if (changed.everywhere()) return;
  before.bounds();
  std::call_once(bounds_->once, [&] { bounds_->box = find_bounds(before.bounds_.get(), &changed); });
}

Box SkeletonField::find_bounds(const Bounds* before, const ChangeMask* changed) const {
  Box core, support;
  bool compact = true;
  for (const SkeletonElement& e : elements_) {
    const Box own = extent(e);
    core.add(own.grown(e.radius));
    // Where one coordinate is R away no p-norm is less than R.
    support.add(own.grown(e.radius));
    compact = compact && is_compact(e);
  }
  if (elements_.empty()) return {};
  Box box = support;
  if (!compact) {
    const DVec3 size = core.size();
    const double step = std::max({size.x, size.y, size.z});
    for (int axis = 0; axis < 3; ++axis) {
      box.low[axis] = reach(*this, axis, -1, core.low[axis], step);
      box.high[axis] = reach(*this, axis, +1, core.high[axis], step);
    }
  }
  constexpr int kDepth = 6;  // the box is tight to within 1/64 of the first guess
  for (int axis = 0; axis < 3; ++axis) {
    for (const int side : {-1, 1}) {
      const BoundsSide* const was =
          before && bounds_->side.size() < before->side.size() ? &before->side[bounds_->side.size()] : nullptr;
      const bool goes_on = was && same(was->searched, box) && may_be_zero(range(was->cell));
      FarthestCell farthest(*this, axis, side, goes_on ? changed : nullptr);
      if (goes_on)
        farthest.start_at(was->cell);
      else if (was)
        farthest.start_near(box, was->cell.center(), kDepth);
      // No thread may take up a task meanwhile that asks for these bounds.
      tbb::this_task_arena::isolate([&] { farthest.search(box, kDepth); });
      if (farthest.end() == -kInfinity) return {};
      bounds_->side.push_back({box, farthest.cell()});
      (side > 0 ? box.high : box.low)[axis] = side * farthest.end();
    }
  }
  return box;
}

bool SkeletonField::is_c2() const {
  return std::all_of(elements_.begin(), elements_.end(), [](const SkeletonElement& e) {
    if (!is_point(e) || e.potential == Potential::wyvill) return false;
    return e.norm == 2.0 || (e.norm > 2.0 && e.potential == Potential::inverse_square);
  });
}

}  // namespace isoskin
