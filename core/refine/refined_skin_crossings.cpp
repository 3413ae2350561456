// Self-intersections of a refined skin: its triangles tell where to look, their children which.
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <iterator>
#include <limits>
#include <utility>

#include <tbb/enumerable_thread_specific.h>

#include "core/mesh/independent_edits.h"
#include "core/mesh/one_ring.h"
#include "core/parallel.h"
#include "core/refine/refined_skin.h"
#include "core/topology/triangle_pairs.h"
#include "core/trace.h"

namespace isoskin {
namespace {

// Normals nearer than this to a common axis: their triangles look down on it from one side, with room for rounding.
constexpr float kOneSide = 1.4f;  // radians

/// A unit vector across one.
Vec3 across(const Vec3& axis) {
  const Vec3 other = std::abs(axis.x) < 0.6f ? Vec3(1.0f, 0.0f, 0.0f) : Vec3(0.0f, 1.0f, 0.0f);
  return glm::normalize(glm::cross(axis, other));
}

bool overlap(const FlatBox& a, const FlatBox& b) {
  return glm::all(glm::lessThanEqual(a.low, b.high)) && glm::all(glm::lessThanEqual(b.low, a.high));
}

/// Some cells of a grid, by hash: what is not marked has no box in it.
class MarkedCells {
public:
  template <class BoxOf>
  MarkedCells(const BoxOf& box_of, const std::vector<Index>& marking) {
    constexpr std::size_t kCellsABox = 64;  // so that few others share a hash
    constexpr float kFinest = 1e-6f;        // of the coordinates: finer cells cannot be counted
    float widest = std::numeric_limits<float>::min();
    for (const Index t : marking) {
      const FlatBox box = box_of(t);
      all_ = {glm::min(all_.low, box.low), glm::max(all_.high, box.high)};
      const Vec3 size = box.high - box.low;
      widest = std::max({widest, size.x, size.y, size.z});
      for (int k = 0; k < 3; ++k)
        widest = std::max({widest, kFinest * std::abs(box.low[k]), kFinest * std::abs(box.high[k])});
    }
    width_ = widest;
    marked_.assign(std::bit_ceil(kCellsABox * (marking.size() + 1)), 0);
    for (const Index t : marking)
      any_cell(box_of(t), [&](std::uint8_t& cell) {
        cell = 1;
        return false;
      });
  }

  /// Most of what is reached by none.
  bool beyond(const FlatBox& box) const { return !overlap(box, all_); }
  bool reach(const FlatBox& box) {
    return !beyond(box) && any_cell(box, [](std::uint8_t cell) { return cell != 0; });
  }

private:
  template <class Test>
  bool any_cell(const FlatBox& box, const Test& test) {
    const DVec3 low = glm::floor(DVec3(box.low) / width_), high = glm::floor(DVec3(box.high) / width_);
    for (double x = low.x; x <= high.x; ++x)
      for (double y = low.y; y <= high.y; ++y)
        for (double z = low.z; z <= high.z; ++z)
          if (test(marked_[hash(x, y, z) & (marked_.size() - 1)])) return true;
    return false;
  }

  static std::size_t hash(double x, double y, double z) {
    const auto part = [](double c) { return std::uint64_t(std::int64_t(c)); };
    const std::uint64_t mixed = (part(x) * 0x9e3779b97f4a7c15u ^ part(y)) * 0x9e3779b97f4a7c15u ^ part(z);
    return std::size_t(mixed * 0x9e3779b97f4a7c15u >> 32);
  }

  double width_;
  FlatBox all_{Vec3(std::numeric_limits<float>::infinity()), Vec3(-std::numeric_limits<float>::infinity())};
  std::vector<std::uint8_t> marked_;
};

}  // namespace

/// Those whose boxes may touch that of a fresh one, fresh ones too; ascending.
std::vector<Index> RefinedSkin::near_fresh(const std::vector<std::uint8_t>& fresh) const {
  const std::vector<Index> list = indices_where(fresh.size(), [&](Index t) { return fresh[t] != 0; });
  if (2 * list.size() > fresh.size()) return indices_where(fresh.size(), [](Index) { return true; });
  const auto box_of = [&](Index t) { return FlatBox{bounds(t).low, bounds(t).high}; };
  MarkedCells cells(box_of, list);
  const std::vector<Index> about = triangles_reached([&](const Box& box) {
    return !cells.beyond({Vec3(box.low), Vec3(box.high)});
  });
  std::vector<Index> near =
      indices_where(about.size(), [&](Index i) { return fresh[about[i]] || cells.reach(box_of(about[i])); });
  for (Index& i : near) i = about[i];
  return near;
}

RefinedSkin::Bounds RefinedSkin::find_bounds(Index triangle) const {
  Bounds bounds;
  const Rows child = this->child(triangle);
  const auto normal = [&](Index c) {
    const auto [p, q, r] = corners(c);
    return glm::cross(q - p, r - p);
  };
  Vec3 sum(0.0f);
  for (Index c = child.first; c < child.first + child.count; ++c) {
    for (const Vec3& p : corners(c)) {
      bounds.low = glm::min(bounds.low, p);
      bounds.high = glm::max(bounds.high, p);
    }
    sum += normal(c);
  }
  const float length = glm::length(sum);
  if (!(length > 0.0f)) return bounds;
  bounds.axis = sum / length;
  float least = 1.0f;  // cosine of the angle between the axis and a normal
  for (Index c = child.first; c < child.first + child.count; ++c) {
    const Vec3 n = normal(c);
    if (n == Vec3(0.0f)) return bounds.axis = Vec3(0.0f), bounds;
    least = std::min(least, glm::dot(bounds.axis, n) / glm::length(n));
  }
  const float spread = std::acos(std::clamp(least, -1.0f, 1.0f));
  if (spread < kOneSide) bounds.one_side = std::cos(kOneSide - spread);
  return bounds;
}

/// Of some triangles, those of their corners about which nothing can overlap (else kNone): all triangles about one,
/// refined, look to one side, and go round it once (after Volino and Magnenat-Thalmann 1994).
std::vector<std::array<Index, 3>> RefinedSkin::plain_corners(const TriangleMesh& skin,
                                                             const std::vector<Index>& some) const {
  std::vector<std::uint8_t> plain(skin.vertex_count());
  std::vector<Index> outgoing(plain.size(), kNone);
  for (const Index t : some)
    for (Index h = 3 * t; h < 3 * t + 3; ++h) outgoing[skin.from(h)] = h;
  const auto is_plain = [&](Index v) {
    Vec3 sum(0.0f);
    for_each_leaving(skin, outgoing[v], [&](Index h) { sum += bounds(h / 3).axis; });
    const float length = glm::length(sum);
    if (!(length > 0.0f)) return false;
    const Vec3 axis = sum / length;
    bool looks = true;
    int rounds = 0;
    // Seen along the axis, all go round in one sense: how often they pass a direction is how often they go round.
    const Vec3 ahead = across(axis), left = glm::cross(axis, ahead);
    const auto seen = [&](Index to) {
      const Vec3 d = skin.position(to) - skin.position(v);
      return glm::vec2(glm::dot(d, ahead), glm::dot(d, left));
    };
    for_each_leaving(skin, outgoing[v], [&](Index h) {
      const Bounds& b = bounds(h / 3);
      const glm::vec2 p = seen(skin.to(h)), q = seen(skin.from(TriangleMesh::prev(h)));
      const float turn = p.x * q.y - p.y * q.x;
      looks = looks && glm::dot(axis, b.axis) > b.one_side && turn > 0.0f;
      rounds += p.y < 0.0f && q.y >= 0.0f;
    });
    return looks && rounds == 1;
  };
  for_each_index(plain.size(), [&](std::size_t v) { plain[v] = outgoing[v] != kNone && is_plain(Index(v)); });
  std::vector<std::array<Index, 3>> corners(some.size());
  for_each_index(some.size(), [&](std::size_t i) {
    for (Index k = 0; k < 3; ++k) {
      const Index v = skin.vertex[3 * some[i] + k];
      corners[i][k] = plain[v] ? v : kNone;
    }
  });
  return corners;
}

const std::vector<Crossing>& RefinedSkin::crossings(const TriangleMesh& skin) {
  if (unlooked_.empty()) return crossing_;
  const std::vector<Crossing> found = find_crossings(skin, std::exchange(unlooked_, {}));
  std::vector<Crossing> all;
  std::merge(crossing_.begin(), crossing_.end(), found.begin(), found.end(), std::back_inserter(all));
  return crossing_ = std::move(all);
}

/// Those of the triangles that are fresh, with all others.
std::vector<Crossing> RefinedSkin::find_crossings(const TriangleMesh& skin,
                                                  const std::vector<std::uint8_t>& fresh) const {
  const Span span("crossings");
  if (std::find(fresh.begin(), fresh.end(), 1) == fresh.end()) return {};
  const auto flat = [&](Index t) { return FlatBox{bounds(t).low, bounds(t).high}; };
  const std::vector<Index> some = near_fresh(fresh);
  const auto vertex = [&](Index c, int k) { return geometric_.mesh.vertex[3 * c + Index(k)]; };
  const auto share = [&](Index c, Index d) {
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j)
        if (vertex(c, i) == vertex(d, j)) return true;
    return false;
  };
  const std::vector<std::array<Index, 3>> plain = plain_corners(skin, some);
  // Of rows of `some`.
  const auto plain_about = [&](Index i, Index j) {
    bool shared = false;
    for (const Index v : plain[i])
      for (const Index w : plain[j]) shared |= v == w && v != kNone;
    return shared;
  };
  struct Child {
    Index row;
    std::array<Vec3, 3> corners;
    FlatBox box;
  };
  struct Found {
    std::vector<Crossing> crossings;
    std::vector<Child> some, others;
  };
  const auto reaching = [&](Index t, const FlatBox& where, std::vector<Child>& out) {
    out.clear();
    for (Index c = child(t).first; c < child(t).first + child(t).count; ++c) {
      const std::array<Vec3, 3> p = corners(c);
      const FlatBox box = box_of(p);
      if (overlap(box, where)) out.push_back({c, p, box});
    }
  };
  const auto compare = [&](Index a, const Child& c, Index b, const Child& d, Found& own) {
    if (!overlap(c.box, d.box) || share(c.row, d.row) || !triangles_overlap(c.corners, d.corners)) return;
    own.crossings.push_back({a, c.row - child(a).first, b, d.row - child(b).first});
  };
  tbb::enumerable_thread_specific<Found> found;
  const auto look = [&](Index a, Index b) {
    Found& own = found.local();
    reaching(a, flat(b), own.some);
    if (own.some.empty()) return;
    reaching(b, flat(a), own.others);
    for (const Child& c : own.some)
      for (const Child& d : own.others) compare(a, c, b, d, own);
  };
  const auto look_at = [&](Index t) {
    Found& own = found.local();
    reaching(t, flat(t), own.some);
    const Vec3 size = bounds(t).high - bounds(t).low;
    const int axis = size.x >= size.y && size.x >= size.z ? 0 : size.y >= size.z ? 1 : 2;
    std::sort(own.some.begin(), own.some.end(), [&](const Child& c, const Child& d) {
      return std::pair(c.box.low[axis], c.row) < std::pair(d.box.low[axis], d.row);
    });
    for (auto c = own.some.begin(); c != own.some.end(); ++c)
      for (auto d = c + 1; d != own.some.end() && d->box.low[axis] <= c->box.high[axis]; ++d)
        c->row < d->row ? compare(t, *c, t, *d, own) : compare(t, *d, t, *c, own);
  };
  for_each_index(some.size(), [&](std::size_t i) {
    const Index t = some[i];
    if (fresh[t] && child(t).count > 1 && !plain_about(Index(i), Index(i))) look_at(t);
  });
  const auto box = [&](Index i) { return flat(some[i]); };
  near_boxes(some.size(), box, 0.0, [&](const TrianglePair& pair) {
    const Index a = some[pair.a], b = some[pair.b];
    if (!plain_about(pair.a, pair.b) && (fresh[a] || fresh[b])) look(a, b);
    return false;
  });
  std::vector<Crossing> all;
  for (const Found& own : found) all.insert(all.end(), own.crossings.begin(), own.crossings.end());
  std::sort(all.begin(), all.end());
  return all;
}

}  // namespace isoskin
