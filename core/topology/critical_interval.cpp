#include "core/topology/critical_interval.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>

#include <tbb/parallel_for.h>
#include <boost/numeric/interval.hpp>

namespace isoskin {
namespace {

namespace bn = boost::numeric;
namespace policy = boost::numeric::interval_lib;
// Operations assume that the processor rounds upward, which Upward arranges for a scope; lower bounds are negated upper
// ones. So the rounding mode is not switched for every operation (this file is compiled with -frounding-math).
using Rounding = policy::rounded_arith_opp<double>;
using Upward = policy::save_state<Rounding>;
using Real =
    bn::interval<double, policy::policies<policy::save_state_nothing<Rounding>, policy::checking_base<double>>>;
using RealBox = std::array<Real, 3>;
using RealMatrix = std::array<Real, 6>;  // xx yy zz xy xz yz

constexpr int kRow[6] = {0, 1, 2, 0, 0, 1};
constexpr int kColumn[6] = {0, 1, 2, 1, 2, 2};
constexpr int kPacked[3][3] = {{0, 3, 4}, {3, 1, 5}, {4, 5, 2}};

/// The library's exp would leave the processor rounding downward. libm's is right to an ulp or two in any mode.
Real exponential(const Real& x) {
  constexpr double kUlps = 1e-15;
  return {std::exp(x.lower()) * (1.0 - kUlps), std::exp(x.upper()) * (1.0 + kUlps)};
}

Real power(const Real& x, int n) {
  return bn::pow(x, n);
}

/// The library's median would leave the processor rounding upward, also outside the scope of an Upward.
double middle(const Real& x) {
  return 0.5 * (x.lower() + x.upper());
}

struct Slopes {  // first and second derivative of a potential by s = d^2
  Real first, second;
};

Slopes slopes(const SkeletonElement& e, const Real& s) {
  const Real r2 = Real(e.radius) * Real(e.radius);
  const Real q = s / r2;
  switch (e.potential) {
    case Potential::inverse_square: {
      // Held constant nearer than 1e-6 R, where nothing is known but that derivatives are no steeper than there.
      constexpr double kSingularity = 1e-12;
      const Real far = bn::max(q, Real(kSingularity));
      Slopes out{-r2 / power(r2 * far, 2), Real(2.0) * r2 / power(r2 * far, 3)};
      if (q.lower() < kSingularity) out = {bn::hull(out.first, 0.0), bn::hull(out.second, 0.0)};
      return out;
    }
    case Potential::cauchy: {
      const Real c = Real(1.0) / (Real(1.0) + s);
      return {-Real(e.radius) * power(c, 2), Real(2.0) * Real(e.radius) * power(c, 3)};
    }
    case Potential::metaball: {
      const Real c = bn::max(Real(1.0) - q, Real(0.0));
      return {Real(-3.0) * power(c, 2) / r2, Real(6.0) * c / (r2 * r2)};
    }
    case Potential::blinn: {
      const Real c = exponential(-q);
      return {-c / r2, c / (r2 * r2)};
    }
    case Potential::wyvill: {
      if (q.lower() >= 1.0) return {Real(0.0), Real(0.0)};
      const Real near = bn::min(q, Real(1.0));
      const Real nine = Real(9.0) * r2;
      Slopes out{(Real(-22.0) + near * (Real(34.0) - Real(12.0) * near)) / nine,
                 (Real(34.0) - Real(24.0) * near) / (nine * r2)};
      if (q.upper() >= 1.0) out = {bn::hull(out.first, 0.0), bn::hull(out.second, 0.0)};
      return out;
    }
  }
  throw std::logic_error("unknown potential");
}

struct Bounds {
  RealBox gradient{Real(0.0), Real(0.0), Real(0.0)};
  RealMatrix hessian{Real(0.0), Real(0.0), Real(0.0), Real(0.0), Real(0.0), Real(0.0)};
};

/// True when the element's potential ends before the box begins.
bool is_out_of_reach(const SkeletonElement& e, const RealBox& box) {
  if (!is_compact(e)) return false;
  constexpr double kRounding = 1e-12;
  double near = 0.0;
  for (int i = 0; i < 3; ++i) {
    const double gap = std::max({box[i].lower() - e.a[i], e.a[i] - box[i].upper(), 0.0});
    near += gap * gap;
  }
  return near > e.radius * e.radius * (1.0 + kRounding);
}

/// grad = 2 f' x, H = 2 f' I + 4 f'' x x^T, summed over elements.
Bounds bounds_over(const SkeletonField& field, const RealBox& box) {
  const Upward upward;
  Bounds sum;
  for (const SkeletonElement& e : field.elements()) {
    if (is_out_of_reach(e, box)) continue;
    RealBox x;
    for (int i = 0; i < 3; ++i) x[i] = box[i] - Real(e.a[i]);
    const Slopes f = slopes(e, bn::square(x[0]) + bn::square(x[1]) + bn::square(x[2]));
    const Real first = Real(2.0 * e.weight) * f.first, second = Real(4.0 * e.weight) * f.second;
    for (int i = 0; i < 3; ++i) sum.gradient[i] += first * x[i];
    for (int k = 0; k < 6; ++k) {
      const int i = kRow[k], j = kColumn[k];
      sum.hessian[k] += i == j ? first + second * bn::square(x[i]) : second * (x[i] * x[j]);
    }
  }
  return sum;
}

RealBox real_box(const Box& b) {
  return {Real(b.low.x, b.high.x), Real(b.low.y, b.high.y), Real(b.low.z, b.high.z)};
}

Box plain_box(const RealBox& b) {
  return {DVec3(b[0].lower(), b[1].lower(), b[2].lower()), DVec3(b[0].upper(), b[1].upper(), b[2].upper())};
}

enum class Verdict { empty, alone, unknown };

/// Krawczyk's operator K = c - Y g(c) + (I - Y H(X)) (X - c) on X, the box grown a little so that a zero on its border
/// is not looked for in vain from both sides: no zero when K misses the box, exactly one in X when K lies inside X.
/// Sets `box` to K when there is one, else to the part of it that K leaves.
Verdict krawczyk(const SkeletonField& field, RealBox& box) {
  constexpr double kGrow = 0.1;  // share of each side's length, at both ends
  RealBox grown;
  for (int i = 0; i < 3; ++i) grown[i] = bn::widen(box[i], kGrow * bn::width(box[i]));
  const RealMatrix h = bounds_over(field, grown).hessian;
  DMat3 center_hessian(0.0);
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) center_hessian[j][i] = middle(h[kPacked[i][j]]);
  const DMat3 inverse = glm::inverse(center_hessian);
  for (int i = 0; i < 3; ++i)
    if (!std::isfinite(inverse[i][0] + inverse[i][1] + inverse[i][2])) return Verdict::unknown;
  const Upward upward;
  RealBox center, offset, k;
  for (int i = 0; i < 3; ++i) {
    center[i] = Real(middle(grown[i]));
    offset[i] = grown[i] - center[i];
  }
  const RealBox g = bounds_over(field, center).gradient;
  bool inside = true;
  for (int i = 0; i < 3; ++i) {
    k[i] = center[i];
    for (int j = 0; j < 3; ++j) k[i] -= Real(inverse[j][i]) * g[j];
    for (int j = 0; j < 3; ++j) {
      Real left(i == j ? 1.0 : 0.0);
      for (int l = 0; l < 3; ++l) left -= Real(inverse[l][i]) * h[kPacked[l][j]];
      k[i] += left * offset[j];
    }
    if (!bn::overlap(k[i], box[i])) return Verdict::empty;
    inside = inside && bn::proper_subset(k[i], grown[i]);
  }
  for (int i = 0; i < 3; ++i) box[i] = inside ? k[i] : bn::intersect(k[i], box[i]);
  return inside ? Verdict::alone : Verdict::unknown;
}

bool overlaps(const Interval& a, const Interval& b) {
  return a.low <= b.high && b.low <= a.high;
}

class Search {
public:
  Search(const SkeletonField& field, const CriticalOptions& options, const IntervalSearchOptions& search)
      : field_(field), options_(options), search_(search) {}

  IntervalSearch run(const Box& root, std::size_t max_boxes) const {
    IntervalSearch found;
    std::vector<RealBox> stack{real_box(root)};
    while (!stack.empty()) {
      if (++found.boxes > max_boxes) {
        found.complete = false;
        break;
      }
      RealBox box = stack.back();
      stack.pop_back();
      look_at(box, stack, found);
    }
    return found;
  }

private:
  void look_at(RealBox box, std::vector<RealBox>& stack, IntervalSearch& found) const {
    if (!overlaps(field_.range(plain_box(box)), search_.values)) return;
    for (const Real& g : bounds_over(field_, box).gradient)
      if (!bn::zero_in(g)) return;
    const Verdict verdict = krawczyk(field_, box);
    if (verdict == Verdict::empty) return;
    if (verdict == Verdict::alone && settle(box, found)) return;
    int widest = 0;
    for (int i = 1; i < 3; ++i)
      if (bn::width(box[i]) > bn::width(box[widest])) widest = i;
    if (bn::width(box[widest]) < search_.least_box) {
      found.unresolved.push_back(plain_box(box));
      return;
    }
    const Real side = box[widest];
    box[widest] = Real(middle(side), side.upper());
    stack.push_back(box);
    box[widest] = Real(side.lower(), middle(side));
    stack.push_back(box);
  }

  /// Newton in a box that holds exactly one zero, which the Krawczyk test has shrunk. Its neighbour may find it as
  /// well.
  bool settle(const RealBox& box, IntervalSearch& found) const {
    const Box plain = plain_box(box);
    CriticalOptions near = options_;
    near.reach = 2.0 * plain.diagonal() / options_.edge_length + options_.exact;
    const auto point = refine_critical_point(field_, plain.center(), near);
    if (!point) return false;
    if (search_.values.contains(point->value)) found.points.push_back(*point);
    return true;
  }

  const SkeletonField& field_;
  const CriticalOptions& options_;
  const IntervalSearchOptions& search_;
};

void check(const SkeletonField& field) {
  for (const SkeletonElement& e : field.elements())
    if (!is_point(e) || e.norm != 2.0)
      throw std::invalid_argument("interval search: bounds of derivatives are known for points of norm 2 only");
}

}  // namespace

DerivativeBounds derivative_bounds(const SkeletonField& field, const Box& box) {
  check(field);
  const Bounds bounds = bounds_over(field, real_box(box));
  DerivativeBounds out;
  for (int i = 0; i < 3; ++i) out.gradient[i] = {bounds.gradient[i].lower(), bounds.gradient[i].upper()};
  for (int k = 0; k < 6; ++k) out.hessian[k] = {bounds.hessian[k].lower(), bounds.hessian[k].upper()};
  return out;
}

IntervalSearch find_all_critical_points(const SkeletonField& field, const Box& box, const CriticalOptions& options,
                                        const IntervalSearchOptions& search) {
  check(field);
  if (box.empty()) return {};
  constexpr int kParts = 4;  // each axis is cut into as many parts, searched in parallel
  constexpr int kCells = kParts * kParts * kParts;
  std::vector<IntervalSearch> part(kCells);
  const Search job(field, options, search);
  tbb::parallel_for(0, kCells, [&](int cell) {
    const IVec3 at(cell / (kParts * kParts), cell / kParts % kParts, cell % kParts);
    const auto corner = [&](const IVec3& c) { return box.low + box.size() * (DVec3(c) / double(kParts)); };
    part[cell] = job.run({corner(at), corner(at + 1)}, search.max_boxes / kCells);
  });
  IntervalSearch whole;
  for (const IntervalSearch& p : part) {
    whole.points.insert(whole.points.end(), p.points.begin(), p.points.end());
    whole.unresolved.insert(whole.unresolved.end(), p.unresolved.begin(), p.unresolved.end());
    whole.boxes += p.boxes;
    whole.complete = whole.complete && p.complete;
  }
  const Box room = box.grown(options.exact * options.edge_length);
  std::erase_if(whole.points,
                [&](const CriticalPoint& p) { return p.position != glm::clamp(p.position, room.low, room.high); });
  merge_critical_points(whole.points, options.merge * options.edge_length);
  return whole;
}

}  // namespace isoskin
