#include "core/topology/critical_points.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>

#include "core/mesh/independent_edits.h"
#include "core/parallel.h"
#include "core/topology/places.h"

namespace isoskin {
namespace {

// Eigenvalues this much smaller than the largest are taken as this large in a Newton step: the step stays finite.
constexpr double kLeastCurvature = 1e-6;

// A determinant this large beside the cubed norm leaves no eigenvalue that small, so that the inverse will do.
constexpr double kRegular = 1e-4;

DVec3 newton_step(const DMat3& m, const DVec3& gradient) {
  const DVec3 cofactor[3] = {glm::cross(m[1], m[2]), glm::cross(m[2], m[0]), glm::cross(m[0], m[1])};
  const double determinant = glm::dot(m[0], cofactor[0]);
  const double norm = std::sqrt(glm::dot(m[0], m[0]) + glm::dot(m[1], m[1]) + glm::dot(m[2], m[2]));
  if (std::abs(determinant) > kRegular * norm * norm * norm)
    return -(gradient.x * cofactor[0] + gradient.y * cofactor[1] + gradient.z * cofactor[2]) / determinant;
  const SymmetricEigen hessian = symmetric_eigen(m);
  const double most = std::max(std::abs(hessian.values[0]), std::abs(hessian.values[2]));
  if (!(most > 0.0)) return DVec3(0.0);
  DVec3 step(0.0);
  for (int i = 0; i < 3; ++i) {
    const double size = std::max(std::abs(hessian.values[i]), kLeastCurvature * most);
    const DVec3& v = hessian.vectors[i];
    step -= glm::dot(v, gradient) / std::copysign(size, hessian.values[i]) * v;
  }
  return step;
}

/// What one Newton search remembers between evaluations; both precisions run the same steps.
class NewtonSearch {
public:
  enum class State : std::uint8_t { running, settled, failed };

  NewtonSearch(const DVec3& seed, const CriticalOptions& options)
      : seed_(seed), best_(seed), next_(seed), trust_(options.max_step * options.edge_length) {}

  const DVec3& next() const { return next_; }
  const DVec3& best() const { return best_; }
  State state() const { return state_; }

  /// Takes the gradient and Hessian at next(): goes on from there if the gradient has fallen, else retries shorter.
  void advance(const DVec3& gradient, const DMat3& hessian, const CriticalOptions& options, double settled) {
    const double e = options.edge_length;
    const double size = glm::length(gradient);
    if (!std::isfinite(size) || ++evaluations_ > options.iterations) return fail();
    if (size < best_gradient_) {
      best_ = next_;
      best_gradient_ = size;
      step_ = newton_step(hessian, gradient);
      if (size > 0.0 && step_ == DVec3(0.0)) return fail();     // a slope without curvature
      if (size == 0.0 && hessian == DMat3(0.0)) return fail();  // F is constant here
      trust_ = std::min(2.0 * trust_, options.max_step * e);
    } else {
      trust_ = 0.5 * std::min(trust_, glm::length(step_));
    }
    const double length = glm::length(step_);
    if (length <= settled * e) {
      state_ = State::settled;
      return;
    }
    if (trust_ <= settled * e) return fail();  // a least gradient that is not zero
    next_ = best_ + std::min(1.0, trust_ / length) * step_;
    if (glm::length(next_ - seed_) > options.reach * e) fail();
  }

private:
  void fail() { state_ = State::failed; }

  DVec3 seed_, best_, next_, step_{0.0};
  double best_gradient_ = std::numeric_limits<double>::infinity();
  double trust_;
  int evaluations_ = 0;
  State state_ = State::running;
};

/// Of the points (each an index), in order of place, the first of every group nearer than `distance` to it.
template <class Place>
std::vector<Index> one_of_each(std::vector<Index> points, double distance, const Place& place) {
  tbb::parallel_sort(points.begin(), points.end(), [&](Index a, Index b) {
    return before_in_space(place(a), place(b)) || (!before_in_space(place(b), place(a)) && a < b);
  });
  std::vector<Index> kept;
  Places known(distance);
  for (const Index point : points) {
    if (known.any_near(place(point))) continue;
    known.add(place(point));
    kept.push_back(point);
  }
  return kept;
}

/// Gradient and Hessian in float64, at most until it is `settled`.
void run(NewtonSearch& search, const Field& field, const CriticalOptions& options, double settled) {
  while (search.state() == NewtonSearch::State::running)
    search.advance(field.sample(search.next()).gradient, field.hessian(search.next()), options, settled);
}

/// Runs all searches in lockstep: one batch of evaluations a round.
void search_in_batches(Backend& backend, std::vector<NewtonSearch>& searches, const CriticalOptions& options) {
  std::vector<Index> running(searches.size());
  std::iota(running.begin(), running.end(), Index(0));
  std::vector<Vec3> points, gradients;
  std::vector<float> values, hessians;
  while (!running.empty()) {
    points.resize(running.size());
    for (std::size_t i = 0; i < running.size(); ++i) points[i] = Vec3(searches[running[i]].next());
    values.resize(points.size());
    gradients.resize(points.size());
    hessians.resize(6 * points.size());
    backend.evaluate(points, values, gradients);
    backend.evaluate_hessian(points, hessians);
    for_each_heavy(running.size(), [&](std::size_t i) {
      const float* h = &hessians[6 * i];
      const DMat3 hessian(h[0], h[3], h[4], h[3], h[1], h[5], h[4], h[5], h[2]);
      searches[running[i]].advance(DVec3(gradients[i]), hessian, options, options.settled);
    });
    std::erase_if(running, [&](Index i) { return searches[i].state() != NewtonSearch::State::running; });
  }
}

}  // namespace

const char* name(CriticalKind kind) {
  switch (kind) {
    case CriticalKind::maximum:
      return "maximum";
    case CriticalKind::two_saddle:
      return "two_saddle";
    case CriticalKind::one_saddle:
      return "one_saddle";
    case CriticalKind::minimum:
      return "minimum";
    case CriticalKind::degenerate:
      return "degenerate";
  }
  return "";
}

SymmetricEigen symmetric_eigen(const DMat3& m) {
  DMat3 a = m, v(1.0);
  constexpr int kSweeps = 32;         // converges quadratically: 5 or 6 are used
  constexpr double kNothing = 1e-20;  // of the diagonal: what is left turns no vector by as much as rounding does
  for (int sweep = 0; sweep < kSweeps; ++sweep) {
    const double off = std::abs(a[1][0]) + std::abs(a[2][0]) + std::abs(a[2][1]);
    if (off <= 1e-300 || off <= kNothing * (std::abs(a[0][0]) + std::abs(a[1][1]) + std::abs(a[2][2]))) break;
    for (const auto& [p, q] : {std::pair(0, 1), std::pair(0, 2), std::pair(1, 2)}) {
      if (a[q][p] == 0.0) continue;
      const double theta = (a[q][q] - a[p][p]) / (2.0 * a[q][p]);
      const double t = std::copysign(1.0, theta) / (std::abs(theta) + std::sqrt(theta * theta + 1.0));
      const double c = 1.0 / std::sqrt(t * t + 1.0), s = t * c;
      const int r = 3 - p - q;
      const double shift = t * a[q][p], rp = a[r][p], rq = a[r][q];
      a[p][p] -= shift;
      a[q][q] += shift;
      a[q][p] = a[p][q] = 0.0;
      a[r][p] = a[p][r] = c * rp - s * rq;
      a[r][q] = a[q][r] = s * rp + c * rq;
      const DVec3 vp = v[p], vq = v[q];
      v[p] = c * vp - s * vq;
      v[q] = s * vp + c * vq;
    }
  }
  int order[3] = {0, 1, 2};
  std::sort(order, order + 3, [&](int i, int j) { return a[i][i] != a[j][j] ? a[i][i] < a[j][j] : i < j; });
  SymmetricEigen eigen;
  for (int i = 0; i < 3; ++i) {
    eigen.values[i] = a[order[i]][order[i]];
    eigen.vectors[i] = glm::normalize(v[order[i]]);
  }
  if (glm::determinant(eigen.vectors) < 0.0) eigen.vectors[2] = -eigen.vectors[2];
  return eigen;
}

CriticalKind classify(const DVec3& eigenvalues, double ratio) {
  const DVec3 size = glm::abs(eigenvalues);
  const double most = std::max({size.x, size.y, size.z});
  if (!(std::min({size.x, size.y, size.z}) > ratio * most)) return CriticalKind::degenerate;
  const int positive = (eigenvalues.x > 0.0) + (eigenvalues.y > 0.0) + (eigenvalues.z > 0.0);
  constexpr CriticalKind kKinds[4] = {CriticalKind::maximum, CriticalKind::two_saddle, CriticalKind::one_saddle,
                                      CriticalKind::minimum};
  return kKinds[positive];
}

CriticalPoint describe_critical_point(const Field& field, const DVec3& p, const CriticalOptions& options) {
  CriticalPoint point;
  point.position = p;
  point.value = field.value(p);
  point.hessian = symmetric_eigen(field.hessian(p));
  point.kind = classify(point.hessian.values, options.degenerate_ratio);
  return point;
}

std::optional<CriticalPoint> refine_critical_point(const Field& field, const DVec3& seed,
                                                   const CriticalOptions& options) {
  NewtonSearch search(seed, options);
  run(search, field, options, options.exact);
  const CriticalPoint point = describe_critical_point(field, search.best(), options);
  if (search.state() == NewtonSearch::State::settled) return point;
  // Newton only creeps toward a degenerate point; near enough is all that can be said of it.
  if (point.kind != CriticalKind::degenerate || point.hessian.values == DVec3(0.0)) return std::nullopt;
  const double most = std::max(std::abs(point.hessian.values[0]), std::abs(point.hessian.values[2]));
  const double slope = glm::length(field.sample(point.position).gradient);
  const bool flat = slope <= most * options.degenerate_ratio * options.settled * options.edge_length;
  return flat ? std::optional(point) : std::nullopt;
}

CriticalSearch find_critical_points(const Field& field, Backend& backend, std::span<const DVec3> seeds,
                                    const CriticalOptions& options) {
  std::vector<NewtonSearch> searches;
  searches.reserve(seeds.size());
  for (const DVec3& seed : seeds) searches.emplace_back(seed, options);
  if (seeds.size() <= options.few_seeds)
    tbb::parallel_for(std::size_t(0), searches.size(),
                      [&](std::size_t i) { run(searches[i], field, options, options.settled); });
  else
    search_in_batches(backend, searches, options);
  // Many seeds lead to one point, and as near as this they are polished to the same.
  std::vector<Index> settled;
  for (Index i = 0; i < searches.size(); ++i)
    if (searches[i].state() == NewtonSearch::State::settled) settled.push_back(i);
  CriticalSearch found;
  found.seeds = seeds.size();
  found.rejected = seeds.size() - settled.size();
  settled = one_of_each(std::move(settled), options.settled * options.edge_length,
                        [&](Index i) { return searches[i].best(); });
  std::vector<std::optional<CriticalPoint>> polished(settled.size());
  tbb::parallel_for(std::size_t(0), settled.size(), [&](std::size_t i) {
    polished[i] = refine_critical_point(field, searches[settled[i]].best(), options);
  });
  for (const auto& point : polished)
    if (point)
      found.points.push_back(*point);
    else
      ++found.rejected;
  merge_critical_points(found.points, options.merge * options.edge_length);
  found.degenerate = std::size_t(std::count_if(found.points.begin(), found.points.end(), [](const CriticalPoint& p) {
    return p.kind == CriticalKind::degenerate;
  }));
  return found;
}

std::vector<DVec3> least_gradient_vertices(const TriangleMesh& mesh, Backend& backend, const ChangeMask& about) {
  if (about.empty()) return {};
  const std::vector<Index> near =
      indices_where(mesh.vertex_count(), [&](Index v) { return about.contains(DVec3(mesh.position(v))); });
  std::vector<std::uint8_t> least(mesh.vertex_count(), 0);
  for (const Index v : near) least[v] = 1;
  constexpr std::size_t kBlock = 4096;
  const std::vector<Index> leaving = collect(mesh.triangle_count(), kBlock, [&](Index t, std::vector<Index>& list) {
    const Index* const v = &mesh.vertex[3 * std::size_t{t}];
    if (!(least[v[0]] | least[v[1]] | least[v[2]])) return;
    for (Index k = 0; k < 3; ++k)
      if (least[v[k]]) list.push_back(3 * t + k);
  });
  std::vector<Index> asked(mesh.vertex_count(), kNone);  // its number among the points
  std::vector<Vec3> points;
  for (const Index h : leaving)
    for (const Index v : {mesh.from(h), mesh.to(h)}) {
      if (asked[v] != kNone) continue;
      asked[v] = Index(points.size());
      points.push_back(mesh.position(v));
    }
  std::vector<float> values(points.size()), slope(points.size());
  std::vector<Vec3> gradients(points.size());
  backend.evaluate(points, values, gradients);
  for_each_index(points.size(), [&](std::size_t i) { slope[i] = glm::length(gradients[i]); });
  for (const Index h : leaving)
    if (slope[asked[mesh.to(h)]] < slope[asked[mesh.from(h)]]) least[mesh.from(h)] = 0;
  std::vector<DVec3> seeds;
  for (const Index v : near)
    if (least[v] && asked[v] != kNone) seeds.emplace_back(mesh.position(v));
  return seeds;
}

bool before_in_space(const DVec3& a, const DVec3& b) {
  return a.x != b.x ? a.x < b.x : a.y != b.y ? a.y < b.y : a.z < b.z;
}

void merge_critical_points(std::vector<CriticalPoint>& points, double distance) {
  std::vector<Index> all(points.size());
  std::iota(all.begin(), all.end(), Index(0));
  const std::vector<Index> first = one_of_each(all, distance, [&](Index k) { return points[k].position; });
  if (first == all) return;
  std::vector<CriticalPoint> kept;
  kept.reserve(first.size());
  for (const Index i : first) kept.push_back(points[i]);
  points = std::move(kept);
}

}  // namespace isoskin
