#include "core/lattice_springs/spring_lattice.h"

#include <algorithm>
#include <cmath>

#include "core/parallel.h"

namespace isoskin {
namespace {

double six_volumes(const FreudenthalComplex& complex, const std::array<Index, 4>& t) {
  const DVec3 a(complex.node[t[0]]);
  const DVec3 b = DVec3(complex.node[t[1]]) - a, c = DVec3(complex.node[t[2]]) - a, d = DVec3(complex.node[t[3]]) - a;
  return glm::dot(b, glm::cross(c, d));
}

/// The nodes at the other ends of each node's springs, and the tetrahedra it belongs to, as lists in one array.
struct Lists {
  std::vector<Index> first, item;

  template <class ForEachPair>  // calls its argument with (node, item) in ascending order of items
  Lists(std::size_t nodes, const ForEachPair& for_each_pair) : first(nodes + 1, 0) {
    for_each_pair([&](Index node, Index) { ++first[node + 1]; });
    for (std::size_t i = 0; i < nodes; ++i) first[i + 1] += first[i];
    item.resize(first.back());
    std::vector<Index> next(first.begin(), first.end() - 1);
    for_each_pair([&](Index node, Index i) { item[next[node]++] = i; });
  }
  std::span<const Index> of(std::size_t node) const {
    return {item.data() + first[node], item.data() + first[node + 1]};
  }
};

/// One run of the dynamics, everything in spacings but positions.
class Dynamics {
public:
  Dynamics(FreudenthalComplex& complex, Backend& backend, const SpringLatticeOptions& options)
      : complex_(complex),
        backend_(backend),
        options_(options),
        spacing_(float(complex.spacing)),
        neighbours_(complex.node.size(),
                    [&](const auto& add) {
                      for (const auto& [a, b] : complex.edge) add(a, b), add(b, a);
                    }),
        velocity_(complex.node.size(), Vec3(0.0f)),
        value_(complex.node.size()),
        gradient_(complex.node.size()) {
    backend_.evaluate(complex_.node, value_, gradient_);
  }

  SpringLatticeReport run() {
    SpringLatticeReport report;
    std::vector<Vec3> before;
    for (; report.steps < options_.steps; ++report.steps) {
      before = complex_.node;
      move();
      report.refused += refuse(before);
      report.last_move = 0.0;
      for (std::size_t i = 0; i < before.size(); ++i)
        report.last_move = std::max(report.last_move, double(glm::distance(before[i], complex_.node[i]) / spacing_));
    }
    return report;
  }

private:
  /// How far a node is on its own side of the surface, to first order; negative on the other. No gradient: 0.
  float depth(std::size_t i) const {
    const float slope = glm::length(gradient_[i]);
    return slope > 0.0f ? (complex_.inside[i] ? 1.0f : -1.0f) * value_[i] / (slope * spacing_) : 0.0f;
  }

  Vec3 force(std::size_t i) const {
    Vec3 sum(0.0f);
    for (const Index j : neighbours_.of(i)) {
      const Vec3 d = (complex_.node[j] - complex_.node[i]) / spacing_;
      const float length = glm::length(d);
      if (length > 0.0f) sum += (length - float(options_.rest)) / length * d;
    }
    const float slope = glm::length(gradient_[i]);
    if (slope > 0.0f) {
      const Vec3 deeper = (complex_.inside[i] ? 1.0f : -1.0f) / slope * gradient_[i];
      sum += float(options_.pull) * std::clamp(float(options_.band) - depth(i), -1.0f, 1.0f) * deeper;
    }
    return sum;
  }

  void move() {
    const float dt = float(options_.step);
    std::vector<Vec3> moved(complex_.node.size());
    for_each_index(moved.size(), [&](std::size_t i) {
      velocity_[i] += dt * (force(i) - float(options_.friction) * velocity_[i]);
      for (int a = 0; a < 3; ++a)
        if (complex_.fixed[i] >> a & 1) velocity_[i][a] = 0.0f;
      moved[i] = complex_.node[i] + dt * spacing_ * velocity_[i];
    });
    complex_.node = std::move(moved);
  }

  /// Takes back the moves of nodes that left their side, and of those of tetrahedra that were turned or flattened,
  /// until there is none. Ends: with every move taken back all is as it was.
  std::size_t refuse(const std::vector<Vec3>& before) {
    const std::vector<float> depth_before = depths();
    backend_.evaluate(complex_.node, value_, gradient_);
    std::vector<std::uint8_t> back(before.size());
    for_each_index(before.size(), [&](std::size_t i) { back[i] = depth(i) <= 0.0f && depth_before[i] > 0.0f; });
    std::size_t refused = take_back(before, back);
    const double least = options_.least_volume * std::pow(complex_.spacing, 3.0);
    std::vector<std::uint8_t> flat(complex_.tetrahedron.size());
    for (bool more = true; more;) {
      for_each_index(flat.size(),
                     [&](std::size_t t) { flat[t] = six_volumes(complex_, complex_.tetrahedron[t]) < least; });
      std::fill(back.begin(), back.end(), std::uint8_t{0});
      for (std::size_t t = 0; t < flat.size(); ++t)
        if (flat[t])
          for (const Index v : complex_.tetrahedron[t]) back[v] = complex_.node[v] != before[v];
      const std::size_t taken = take_back(before, back);
      refused += taken;
      more = taken > 0;
    }
    if (refused > 0) backend_.evaluate(complex_.node, value_, gradient_);
    return refused;
  }

  std::vector<float> depths() const {
    std::vector<float> out(complex_.node.size());
    for_each_index(out.size(), [&](std::size_t i) { out[i] = depth(i); });
    return out;
  }

  std::size_t take_back(const std::vector<Vec3>& before, const std::vector<std::uint8_t>& back) {
    for_each_index(before.size(), [&](std::size_t i) {
      if (!back[i]) return;
      complex_.node[i] = before[i];
      velocity_[i] = Vec3(0.0f);
    });
    return std::size_t(std::count(back.begin(), back.end(), 1));
  }

  FreudenthalComplex& complex_;
  Backend& backend_;
  const SpringLatticeOptions& options_;
  float spacing_;
  Lists neighbours_;
  std::vector<Vec3> velocity_;  // spacings a unit of time
  std::vector<float> value_;
  std::vector<Vec3> gradient_;
};

}  // namespace

SpringLatticeReport deform(FreudenthalComplex& complex, Backend& backend, const SpringLatticeOptions& options) {
  return Dynamics(complex, backend, options).run();
}

std::vector<double> relative_volumes(const FreudenthalComplex& complex) {
  std::vector<double> out(complex.tetrahedron.size());
  const double cube = std::pow(complex.spacing, 3.0);
  for_each_index(out.size(), [&](std::size_t t) { out[t] = six_volumes(complex, complex.tetrahedron[t]) / cube; });
  return out;
}

TriangleMesh spring_lattice_mesh(const Field& field, Backend& backend, const SpringMeshOptions& options,
                                 SpringLatticeReport* report) {
  FreudenthalComplex complex =
      intersecting_complex(sample_lattice(field, backend, options.spacing * options.edge_length));
  const SpringLatticeReport done = deform(complex, backend, options.springs);
  if (report) *report = done;
  SimplexSurface surface = march_simplices(complex, backend);
  return make_mesh(std::move(surface.position), std::move(surface.triangle));
}

}  // namespace isoskin
