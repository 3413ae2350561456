#include "core/seeds/seeds.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>

#include "core/field/blend_graph.h"
#include "core/mechanics/element.h"
#include "core/parallel.h"
#include "core/sampling/segment_roots.h"

namespace isoskin {
namespace {

/// An element's own frame: `a` and three axes, the first along the segment or the first edge, the second in the
/// triangle's plane or along the box's second edge.
struct Frame {
  DVec3 origin, x, y, z;

  explicit Frame(const SkeletonElement& e) : origin(e.a), x(1, 0, 0), y(0, 1, 0), z(0, 0, 1) {
    if (is_point(e)) return;
    if (e.a != e.b) x = glm::normalize(e.b - e.a);
    y = any_normal(x);
    if (e.shape != Shape::segment) {
      const DVec3 other = e.c - e.a, across = other - glm::dot(other, x) * x;
      constexpr double kFlat = 1e-12;  // of its length: no direction at all
      if (glm::length(across) > kFlat * glm::length(other)) y = glm::normalize(across);
    }
    z = glm::cross(x, y);
  }
  DVec3 to_world(const DVec3& p) const { return origin + p.x * x + p.y * y + p.z * z; }
  DVec3 to_local(const DVec3& p) const {
    return {glm::dot(p - origin, x), glm::dot(p - origin, y), glm::dot(p - origin, z)};
  }
};

/// The lengths that a rigid motion keeps.
std::array<double, 3> sides_of(const SkeletonElement& e) {
  const double ab = glm::distance(e.a, e.b);
  if (e.shape == Shape::segment) return {ab, 0.0, 0.0};
  return {ab, glm::distance(e.a, e.c), e.shape == Shape::box ? glm::distance(e.a, e.d) : glm::distance(e.b, e.c)};
}

bool same_shape(const SkeletonElement& a, const SkeletonElement& b) {
  constexpr double kSame = 1e-9;
  const std::array<double, 3> side = sides_of(a), other = sides_of(b);
  for (int i = 0; i < 3; ++i)
    if (std::abs(side[i] - other[i]) > kSame * (side[i] + other[i])) return false;
  return a.shape == b.shape && a.radius == b.radius && a.weight == b.weight && a.norm == b.norm &&
         a.potential == b.potential;
}

bool meet(const Box& a, const Box& b) {
  return !a.empty() && !b.empty() && glm::all(glm::lessThanEqual(a.low, b.high)) &&
         glm::all(glm::lessThanEqual(b.low, a.high));
}

/// Where the element alone has its surface, e = f^-1(iso), measured across it; half its radius where it has none.
double thickness_of(const SkeletonElement& element, double iso) {
  const SkeletonField alone({element}, iso);
  const Frame frame(element);
  const DVec3 outward = glm::dot(frame.z, center(element) - element.a) > 0.0 ? -frame.z : frame.z;
  const auto inside = [&](double r) { return alone.value(element.a + r * outward) > 0.0; };
  double low = 1e-4 * element.radius, high = element.radius;
  if (!inside(low)) return 0.5 * element.radius;
  constexpr int kDoublings = 20, kHalvings = 40;
  for (int k = 0; k < kDoublings && inside(high); ++k) high *= 2.0;
  for (int k = 0; k < kHalvings; ++k) {
    const double middle = 0.5 * (low + high);
    (inside(middle) ? low : high) = middle;
  }
  return low;
}

}  // namespace

SkeletonParts skeleton_parts(const Field& field, const std::string& name) {
  if (const auto* skeleton = dynamic_cast<const SkeletonField*>(&field))
    return {&skeleton->elements(), skeleton->iso()};
  if (const auto* blend = dynamic_cast<const BlendGraphField*>(&field))
    return {&blend->elements(), blend->groups().front().iso()};
  throw InputError(name + ": not made of skeleton elements; expected a scene with [[element]]");
}

/// A regular grid on the surface of the element's box, inflated by its thickness: closed, outward.
Seeds::Grid Seeds::make_grid(const SkeletonElement& element, double iso) const {
  Grid grid;
  grid.shape = element;
  grid.thickness = thickness_of(element, iso);
  const Frame frame(element);
  const Corners8 corners = corners_of(element);
  Box own;
  for (int i = 0; i < corners.count; ++i) own.add(frame.to_local(corners.at[i]));
  const DVec3 low = own.low - grid.thickness, high = own.high + grid.thickness;
  const IVec3 n = glm::max(IVec3(glm::round((high - low) / options_.spacing)), IVec3(1));
  std::map<std::array<int, 3>, Index> index;
  const auto point = [&](const std::array<int, 3>& c) {
    const auto [it, fresh] = index.try_emplace(c, Index(grid.box_point.size()));
    if (fresh) grid.box_point.push_back(low + (high - low) * DVec3(c[0], c[1], c[2]) / DVec3(n));
    return it->second;
  };
  for (int axis = 0; axis < 3; ++axis) {
    const int u = (axis + 1) % 3, v = (axis + 2) % 3;
    for (const int side : {0, n[axis]})
      for (int i = 0; i < n[u]; ++i)
        for (int j = 0; j < n[v]; ++j) {
          const auto corner = [&](int di, int dj) {
            std::array<int, 3> c{};
            c[axis] = side, c[u] = i + di, c[v] = j + dj;
            return point(c);
          };
          std::array<Index, 4> q{corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)};
          if (side == 0) std::swap(q[1], q[3]);
          grid.triangle.insert(grid.triangle.end(), {q[0], q[1], q[2], q[0], q[2], q[3]});
        }
  }
  return grid;
}

Vec3 Seeds::at(std::size_t seed, double distance) const {
  return Vec3(axis_[seed].start + distance * axis_[seed].direction);
}

/// Axes where the elements are now: each grid point's direction from the nearest point of the element.
void Seeds::pose(const std::vector<SkeletonElement>& elements) {
  first_.assign(1, 0);
  for (const Grid& grid : grid_) first_.push_back(first_.back() + Index(grid.box_point.size()));
  axis_.resize(first_.back());
  element_.resize(first_.back());
  for (std::size_t i = 0; i < elements.size(); ++i) {
    const Frame frame(elements[i]);
    for_each_index(grid_[i].box_point.size(), [&](std::size_t k) {
      const DVec3 p = frame.to_world(grid_[i].box_point[k]);
      const DVec3 out = offset_from(elements[i], p).x;
      axis_[first_[i] + k] = {p - out, glm::normalize(out)};
      element_[first_[i] + k] = Index(i);
    });
  }
}

SeedReport Seeds::move_to(const SkeletonParts& parts, Backend& backend) {
  const std::vector<SkeletonElement>& elements = *parts.elements;
  std::vector<double> distance;
  std::vector<Grid> grids;
  for (std::size_t i = 0; i < elements.size(); ++i) {
    const bool kept = i < grid_.size() && same_shape(grid_[i].shape, elements[i]);
    grids.push_back(kept ? grid_[i] : make_grid(elements[i], parts.iso));
    if (kept)
      distance.insert(distance.end(), distance_.begin() + first_[i], distance_.begin() + first_[i + 1]);
    else
      distance.insert(distance.end(), grids.back().box_point.size(), grids.back().thickness);
  }
  grid_ = std::move(grids);
  distance_ = std::move(distance);
  single_.clear();
  for (const SkeletonElement& e : elements) single_.emplace_back(std::vector<SkeletonElement>{e}, 0.0);
  pose(elements);

  position_.resize(axis_.size());
  for_each_index(axis_.size(), [&](std::size_t s) { position_[s] = at(s, distance_[s]); });
  valid_.assign(axis_.size(), 1);
  find_neighbours(elements);
  validate();
  SeedReport report = migrate(backend);
  find_neighbours(elements);
  validate();
  report.seeds = axis_.size();
  report.valid = std::size_t(std::count(valid_.begin(), valid_.end(), 1));
  update_boxes();
  return report;
}

/// The paper's current neighbour lists: elements out of whose influence all seeds of an element are need not be asked.
void Seeds::find_neighbours(const std::vector<SkeletonElement>& elements) {
  neighbours_.assign(elements.size(), {});
  for_each_index(elements.size(), [&](std::size_t i) {
    Box seeds = extent(elements[i]);
    for (Index s = first_[i]; s < first_[i + 1]; ++s) seeds.add(DVec3(position_[s]));
    for (Index j = 0; j < elements.size(); ++j) {
      const SkeletonElement& e = elements[j];
      // Where one coordinate is a radius away no p-norm is less. An element that takes away contributes less than one
      // that is not felt at all.
      if (j != i && (!is_compact(e) || elements[i].weight <= 0.0 || meet(extent(e).grown(e.radius), seeds)))
        neighbours_[i].push_back(j);
    }
  });
}

/// A seed at which another element contributes more than its own is not valid.
void Seeds::validate() {
  for_each_index(valid_.size(), [&](std::size_t s) {
    if (!valid_[s]) return;
    const DVec3 p(position_[s]);
    const double own = single_[element_[s]].value(p);
    for (const Index other : neighbours_[element_[s]])
      if (single_[other].value(p) > own) {
        valid_[s] = 0;
        return;
      }
  });
}

/// Valid seeds go to the surface; one that finds none becomes invalid where it is.
SeedReport Seeds::migrate(Backend& backend) {
  SeedReport report;
  struct Search {
    Index seed;
    double near, far;  // near: where it was; far: the end of the search so far
    bool outward = false, done = false;
  };
  std::vector<Search> search;
  for (Index s = 0; s < axis_.size(); ++s)
    if (valid_[s]) search.push_back({s, distance_[s], distance_[s]});
  std::vector<Vec3> points(search.size());
  std::vector<float> values(search.size());
  const auto evaluate = [&](std::size_t count) {
    backend.evaluate(std::span(points).first(count), std::span(values).first(count), {});
    report.evaluations += count;
  };
  for_each_index(search.size(), [&](std::size_t i) { points[i] = at(search[i].seed, search[i].near); });
  evaluate(search.size());
  for_each_index(search.size(), [&](std::size_t i) { search[i].outward = values[i] > 0.0f; });

  std::vector<Index> open(search.size());
  for (Index i = 0; i < open.size(); ++i) open[i] = i;
  double step = 0.1 * options_.spacing;  // frames move little
  for (int k = 0; k < options_.most_steps && !open.empty(); ++k, step *= 2.0) {
    for_each_index(open.size(), [&](std::size_t i) {
      Search& s = search[open[i]];
      s.near = s.far;
      s.far = std::max(0.0, s.far + (s.outward ? step : -step));
      points[i] = at(s.seed, s.far);
    });
    evaluate(open.size());
    for_each_index(open.size(), [&](std::size_t i) {
      Search& s = search[open[i]];
      s.done = (values[i] > 0.0f) != s.outward;
    });
    std::erase_if(open, [&](Index i) { return search[i].done; });
  }

  std::vector<SegmentRoot> roots;
  std::vector<Index> rooted;
  for (Index i = 0; i < search.size(); ++i) {
    if (!search[i].done) continue;
    rooted.push_back(i);
    roots.push_back({at(search[i].seed, search[i].near), at(search[i].seed, search[i].far)});
  }
  find_roots(roots, backend, options_.root_rounds);
  report.evaluations += roots.size() * std::size_t(options_.root_rounds + 2);
  for (const Search& s : search) valid_[s.seed] = 0;
  for (std::size_t r = 0; r < roots.size(); ++r) {
    const Search& s = search[rooted[r]];
    if (!roots[r].found) continue;
    valid_[s.seed] = 1;
    distance_[s.seed] = s.near + double(roots[r].t) * (s.far - s.near);
    position_[s.seed] = at(s.seed, distance_[s.seed]);
  }
  for (const Search& s : search) report.lost += !valid_[s.seed];
  return report;
}

void Seeds::update_boxes() {
  boxes_.assign(grid_.size(), {});
  for (std::size_t s = 0; s < position_.size(); ++s)
    if (valid_[s]) boxes_[element_[s]].add(DVec3(position_[s]));
  for (std::size_t i = 0; i < grid_.size(); ++i) {
    if (boxes_[i].empty()) continue;
    double farthest = 0.0;
    const std::vector<Index>& t = grid_[i].triangle;
    for (Index h = 0; h < t.size(); ++h) {
      const Index a = first_[i] + t[h], b = first_[i] + t[TriangleMesh::next(h)];
      if (valid_[a] && valid_[b]) farthest = std::max(farthest, double(glm::distance(position_[a], position_[b])));
    }
    boxes_[i] = boxes_[i].grown(std::max(farthest, options_.spacing));
  }
}

TriangleMesh Seeds::scales(Backend& backend) const {
  constexpr int kSides = 6;
  std::vector<Vec3> centers;
  for (std::size_t s = 0; s < position_.size(); ++s)
    if (valid_[s]) centers.push_back(position_[s]);
  std::vector<float> values(centers.size());
  std::vector<Vec3> gradients(centers.size());
  backend.evaluate(centers, values, gradients);
  TriangleMesh mesh;
  mesh.vertices.resize(kSides * centers.size());
  for (std::size_t c = 0; c < centers.size(); ++c) {
    const DVec3 normal = outward_normal(DVec3(gradients[c]));
    const DVec3 u = normal == DVec3(0.0) ? DVec3(0.0) : any_normal(normal), v = glm::cross(normal, u);
    const Index first = Index(kSides * c);
    for (int k = 0; k < kSides; ++k) {
      const double turn = 2.0 * M_PI * k / kSides;
      const DVec3 p = DVec3(centers[c]) + 0.45 * options_.spacing * (std::cos(turn) * u + std::sin(turn) * v);
      mesh.vertices.position[first + Index(k)] = mesh.vertices.rest[first + Index(k)] = Vec3(p);
      if (k > 1) mesh.vertex.insert(mesh.vertex.end(), {first, first + Index(k) - 1, first + Index(k)});
    }
  }
  for (Index v = 0; v < mesh.vertex_count(); ++v) mesh.vertices.id[v] = v;
  mesh.next_id = Index(mesh.vertex_count());
  return mesh;
}

TriangleMesh Seeds::pieces() const {
  std::vector<Vec3> positions = position_;
  for_each_index(positions.size(), [&](std::size_t s) {
    if (valid_[s]) return;
    const auto preponderant = [&](double distance) {
      const DVec3 p(at(s, distance));
      const double own = single_[element_[s]].value(p);
      const std::vector<Index>& others = neighbours_[element_[s]];
      return std::none_of(others.begin(), others.end(), [&](Index j) { return single_[j].value(p) > own; });
    };
    constexpr int kHalvings = 20;
    double low = 0.0, high = distance_[s];
    for (int k = 0; k < kHalvings; ++k) {
      const double middle = 0.5 * (low + high);
      (preponderant(middle) ? low : high) = middle;
    }
    positions[s] = at(s, low);
  });
  std::vector<Index> triangles;
  for (std::size_t i = 0; i < grid_.size(); ++i)
    for (const Index v : grid_[i].triangle) triangles.push_back(first_[i] + v);
  return make_mesh(std::move(positions), std::move(triangles));
}

namespace {

Box whole(const Seeds& seeds) {
  Box box;
  for (const Box& b : seeds.boxes())
    if (!b.empty()) box.add(b);
  return box;
}

/// Valid seeds of `seeds` inside the other object's field, element by element.
std::vector<Index> seeds_inside(const Seeds& seeds, const Seeds& other, Backend& field, bool all,
                                Penetration& penetration) {
  std::vector<Index> found;
  const Box bounds = whole(other);
  std::vector<std::vector<Index>> of_element(seeds.boxes().size());
  for (Index s = 0; s < seeds.position().size(); ++s)
    if (seeds.valid()[s]) of_element[seeds.element()[s]].push_back(s);
  for (std::size_t i = 0; i < of_element.size(); ++i) {
    penetration.without_boxes += of_element[i].size();
    const Box& box = seeds.boxes()[i];
    const auto meets = [&](const Box& b) { return meet(box, b); };
    if (!meet(box, bounds) || std::none_of(other.boxes().begin(), other.boxes().end(), meets)) continue;
    if (!all && !found.empty()) continue;
    std::vector<Vec3> points;
    for (const Index s : of_element[i]) points.push_back(seeds.position()[s]);
    std::vector<float> values(points.size());
    field.evaluate(points, values, {});
    penetration.evaluations += points.size();
    for (std::size_t k = 0; k < values.size(); ++k)
      if (values[k] > 0.0f) found.push_back(of_element[i][k]);
  }
  return found;
}

}  // namespace

Penetration find_penetration(const Seeds& first, Backend& first_backend, const Seeds& second, Backend& second_backend,
                             bool all) {
  Penetration penetration;
  penetration.of_first = seeds_inside(first, second, second_backend, all, penetration);
  if (all || penetration.of_first.empty())
    penetration.of_second = seeds_inside(second, first, first_backend, all, penetration);
  return penetration;
}

}  // namespace isoskin
