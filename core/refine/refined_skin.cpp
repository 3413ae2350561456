#include "core/refine/refined_skin.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <iterator>
#include <limits>
#include <numeric>
#include <tuple>
#include <utility>

#include <tbb/parallel_for.h>

#include "core/mesh/independent_edits.h"
#include "core/parallel.h"
#include "core/refine/skin_match.h"
#include "core/trace.h"

namespace isoskin {
namespace {

constexpr double kMostAnew = 0.6;  // of a skin: with more to refine all of it is cheaper
constexpr int kTries = 6;
constexpr int kLeastRings = 4;        // about what has changed; the two outermost must come out as they were
constexpr int kHalo = 2;              // rings beyond, whose splits are known
constexpr std::size_t kBlock = 4096;  // triangles

bool same_bits(const Vec3& a, const Vec3& b) {
  return std::bit_cast<std::array<std::uint32_t, 3>>(a) == std::bit_cast<std::array<std::uint32_t, 3>>(b);
}

/// A column seldom grows, and then by little.
template <class T>
void make_room(std::vector<T>& column, std::size_t size) {
  constexpr std::size_t kSpare = 16;
  if (column.capacity() < size) column.reserve(size + size / kSpare);
  if (column.size() < size) column.resize(size);
}

}  // namespace

double distance_estimate(double value, double slope, double voxel) {
  const double estimate = slope > 0.0 ? std::abs(value) / slope : std::numeric_limits<double>::infinity();
  return voxel > 0.0 ? std::min(estimate, std::abs(value)) : estimate;
}

/// One update that keeps something. Distances are in steps from triangle to triangle, from what has changed.
class RefinedSkin::Update {
public:
  Update(RefinedSkin& last, const TriangleMesh& skin, Backend& backend, const RefinedSkinOptions& options)
      : last_(last), skin_(skin), backend_(backend), options_(options), match_(last.skin_.id, last.vertex_, skin) {}

  /// False when refining everything is cheaper; nothing has been done then.
  bool run(const FieldChanges& changes) {
    last_.carried_ = false;
    std::vector<Index> changed = changed_triangles(changes);
    if (changed.empty() && match_.is_identity()) {
      last_.changed_.emplace();
      last_.refined_triangles_ = 0;
      return true;
    }
    for (int attempt = 0; attempt < kTries; ++attempt) {
      rings_ = kLeastRings + 2 * std::max(0, attempt - 1);
      if (!grow(changed)) return false;
      std::vector<Index> otherwise = put_back_about();
      if (otherwise.empty()) {
        refine_part();
        otherwise = come_out_otherwise();
        if (otherwise.empty()) {
          put_in();
          return true;
        }
      } else {
        --attempt;  // nothing was refined; what is put back only grows
      }
      changed.insert(changed.end(), otherwise.begin(), otherwise.end());
    }
    return false;
  }

private:
  Index old_vertex(Index v) const { return match_.old_vertex(v); }
  Index old_triangle(Index t) const { return match_.old_triangle(t); }
  const Vec3& old_position(Index v) const { return last_.position(last_.corner_[v]); }
  const TriangleMesh& part_mesh() const { return part_.geometric.mesh; }
  bool inner(Index t) const { return distance_[t] <= rings_; }
  bool core(Index t) const { return distance_[t] <= rings_ - 2; }
  bool guard(Index t) const { return inner(t) && !core(t); }

  bool is_too_much(std::size_t triangles) const {
    return double(triangles) > kMostAnew * double(skin_.triangle_count());
  }

  std::vector<Index> changed_triangles(const FieldChanges& changes) const {
    std::vector<std::uint8_t> moved(skin_.vertex_count());
    for_each_index(moved.size(), [&](std::size_t v) {
      const Index old = old_vertex(Index(v));
      moved[v] = old == kNone || !same_bits(skin_.position(Index(v)), old_position(old));
    });
    std::vector<Index> changed = indices_where(skin_.triangle_count(), [&](Index t) {
      const Index* v = &skin_.vertex[3 * t];
      return old_triangle(t) == kNone || moved[v[0]] || moved[v[1]] || moved[v[2]];
    });
    if (is_too_much(changed.size())) return changed;
    const ChangeMask mask(changes, double(options_.project.reach));
    if (mask.empty()) return changed;
    for (const Index o : last_.triangles_reached([&](const Box& box) { return mask.overlaps(box); }))
      if (match_.new_triangle(o) != kNone) changed.push_back(match_.new_triangle(o));
    std::sort(changed.begin(), changed.end());
    changed.erase(std::unique(changed.begin(), changed.end()), changed.end());
    return changed;
  }

  /// Distances up to the halo's end; false when that is too much of the skin.
  bool grow(const std::vector<Index>& changed) {
    distance_.assign(skin_.triangle_count(), kFar);
    for (const Index t : changed) distance_[t] = 0;
    std::vector<Index> ring = changed;
    std::size_t reached = changed.size();
    if (is_too_much(reached)) return false;
    for (int d = 1; d <= rings_ + kHalo && !ring.empty(); ++d) {
      std::vector<Index> next;
      for (const Index t : ring)
        for (Index h = 3 * t; h < 3 * t + 3; ++h) {
          const Index other = skin_.twin[h] / 3;
          if (distance_[other] != kFar) continue;
          distance_[other] = std::uint8_t(d);
          next.push_back(other);
        }
      reached += next.size();
      if (is_too_much(reached)) return false;
      ring = std::move(next);
    }
    triangle_ = indices_where(distance_.size(), [&](Index t) { return distance_[t] != kFar; });
    return true;
  }

  /// New vertices that an old triangle and its neighbours have in common are not all its own.
  template <class Wanted>
  bool any_old_vertex(Index t, const Wanted& wanted) const {
    const Rows child = last_.child(old_triangle(t));
    for (Index h = 3 * child.first; h < 3 * (child.first + child.count); ++h) {
      const Index row = last_.geometric_.mesh.vertex[h];
      if (last_.is_new(row) && wanted(row)) return true;
    }
    return false;
  }

  /// Of the guard and beyond: triangles with points that were put back. When that happens depends on more than what
  /// comes of it.
  std::vector<Index> put_back_about() const {
    return among_triangles([&](Index i) {
      const Index t = triangle_[i];
      return distance_[t] > rings_ - 2 && any_old_vertex(t, [&](Index row) { return last_.birth_[row].put_back != 0; });
    });
  }

  void refine_part() {
    local_triangle_.assign(skin_.triangle_count(), kNone);
    std::vector<Index> local_vertex(skin_.vertex_count(), kNone);
    for (std::size_t i = 0; i < triangle_.size(); ++i) local_triangle_[triangle_[i]] = Index(i);
    vertex_.clear();
    TriangleMesh part;
    KnownSplits known;
    for (const Index t : triangle_) {
      for (Index h = 3 * t; h < 3 * t + 3; ++h) {
        const Index v = skin_.vertex[h], other = local_triangle_[skin_.twin[h] / 3];
        if (local_vertex[v] == kNone) {
          local_vertex[v] = Index(vertex_.size());
          vertex_.push_back(v);
          known.name.push_back(old_vertex(v) == kNone ? kNone : last_.corner_[old_vertex(v)]);
        }
        part.vertex.push_back(local_vertex[v]);
        part.twin.push_back(other == kNone ? kNone : 3 * other + skin_.twin[h] % 3);
      }
      known.triangle.push_back(!inner(t));
      if (!inner(t)) add_splits(t, known.split);
    }
    part.vertices = skin_.vertices.select(vertex_);
    Refiner refiner(part, known, backend_, options_.refine, options_.project);
    for (int pass = 0; pass < options_.refine.passes; ++pass) refiner.pass();
    part_ = refiner.finish();
    owner_of_part_.resize(part_.birth.size());
    for (Index t = 0; t < triangle_.size(); ++t)
      std::fill(owner_of_part_.begin() + part_.first_vertex[t], owner_of_part_.begin() + part_.first_vertex[t + 1], t);
  }

  void add_splits(Index t, SplitTable& splits) const {
    any_old_vertex(t, [&](Index row) {
      const auto [a, b] = last_.geometric_.parent_edge[row];
      splits.add({std::min(a, b), std::max(a, b), row, int(last_.birth_[row].pass)});
      return false;
    });
  }

  /// The row of a vertex of the part, were its owner as it had been; kNone where it has no counterpart.
  Index old_row(Index v) const {
    if (v < vertex_.size()) return old_vertex(vertex_[v]) == kNone ? kNone : last_.corner_[old_vertex(vertex_[v])];
    const Index fresh = v - Index(vertex_.size()), owner = owner_of_part_[fresh];
    const Index o = old_triangle(triangle_[owner]);
    if (o == kNone) return kNone;
    const Index k = fresh - part_.first_vertex[owner];
    return k < last_.fresh(o).count ? last_.fresh(o).first + k : kNone;
  }

  /// Is it where the old one is, and came as that did, without having been put back?
  bool same_vertex(Index v, Index row) const {
    if (old_row(v) != row || !same_bits(part_mesh().position(v), last_.position(row))) return false;
    if (v < vertex_.size()) return true;
    const Birth birth = part_.birth[v - vertex_.size()];
    return birth == last_.birth_[row] && !birth.put_back;
  }

  Index part_children(Index i) const { return part_.first_child[i + 1] - part_.first_child[i]; }
  Index part_vertices(Index i) const { return part_.first_vertex[i + 1] - part_.first_vertex[i]; }

  /// Triangles of the guard.
  std::vector<Index> come_out_otherwise() const {
    return among_triangles([&](Index i) {
      if (!guard(triangle_[i])) return false;
      const Index o = old_triangle(triangle_[i]);
      const Rows child = last_.child(o);
      bool same = part_children(i) == child.count && part_vertices(i) == last_.fresh(o).count;
      for (Index k = 0; same && k < 3 * child.count; ++k)
        same = same_vertex(part_mesh().vertex[3 * part_.first_child[i] + k],
                           last_.geometric_.mesh.vertex[3 * child.first + k]);
      return !same;
    });
  }

  /// Triangles of the part for which wanted(number in the part).
  template <class Wanted>
  std::vector<Index> among_triangles(const Wanted& wanted) const {
    std::vector<Index> found = indices_where(triangle_.size(), wanted);
    for (Index& i : found) i = triangle_[i];
    return found;
  }

  /// The core's children and new vertices come in place of what was there; the guard's, which are as they were, refer
  /// to them.
  void put_in() {
    const Span span("put in");
    for (const Index row : last_.without_normal_) last_.geometric_.normal[row] = Vec3(0.0f);
    last_.without_normal_.clear();
    last_.normals_replaced_ = false;
    last_.changed_.emplace();
    take_out();
    list_strays();
    same_rows_ = keeps_numbers();
    renumber_all();
    find_rows();
    for_each_index(triangle_.size(), [&](std::size_t i) {
      if (inner(triangle_[i])) write(Index(i));
    });
    for (Index i = 0; i < vertex_.size(); ++i) {
      const Index row = last_.corner_[vertex_[i]];
      last_.geometric_.normal[row] = part_.geometric.normal[i];
      last_.geometric_.mesh.vertices.position[row] = skin_.position(vertex_[i]);
      last_.geometric_.parent_edge[row] = {row, row};
      last_.birth_[row] = {};
    }
    for_each_index(triangle_.size(), [&](std::size_t i) {
      if (core(triangle_[i])) last_.bounds_[last_.slot_[triangle_[i]]] = last_.find_bounds(triangle_[i]);
    });
    for (const Index t : triangle_)
      if (core(t)) {
        last_.changed_->push_back(last_.bounds(t).box());
        blocks_.push_back(last_.slot_[t] / kBlockSlots);
        if (!last_.counted_.empty()) last_.uncounted_.push_back(last_.slot_[t]);
      }
    last_.update_blocks(std::move(blocks_));
    list_crossings();
    last_.ordered_ = last_.ordered_ && same_rows_;
    last_.refined_triangles_ = triangle_.size();
  }

  /// Triangles that go or are of the core.
  void take_out() {
    std::vector<Index> out, slots;
    if (match_.is_identity())
      std::copy_if(triangle_.begin(), triangle_.end(), std::back_inserter(out), [&](Index t) { return core(t); });
    else
      out = indices_where(match_.old_triangles(), [&](Index o) {
        const Index t = match_.new_triangle(o);
        return t == kNone || core(t);
      });
    for (const Index o : out) slots.push_back(last_.slot_[o]);
    last_.count_shapes(slots, -1);
    for (const Index o : out) {
      last_.changed_->push_back(last_.bounds(o).box());
      last_.triangles_ -= last_.child(o).count;
      if (match_.new_triangle(o) == kNone) gone_.push_back(o);
    }
  }

  /// Are all triangles and vertices of the skin that stay what they were by number, and as many?
  bool keeps_numbers() const {
    if (match_.is_identity()) return true;
    if (match_.old_vertices() != match_.vertices() || match_.old_triangles() != match_.triangles()) return false;
    for (Index v = 0; v < match_.vertices(); ++v)
      if (old_vertex(v) != v) return false;
    for (Index t = 0; t < match_.triangles(); ++t)
      if (old_triangle(t) != t && old_triangle(t) != kNone) return false;
    return true;
  }

  void renumber_all() {
    if (match_.is_identity()) return;
    for (const Index o : gone_) {
      last_.free_children_.give_back(std::exchange(last_.child_[last_.slot_[o]], {}));
      last_.free_vertices_.give_back(std::exchange(last_.fresh_[last_.slot_[o]], {}));
      last_.free_slots_.push_back(last_.slot_[o]);
      last_.bounds_[last_.slot_[o]] = {};
      last_.triangle_[last_.slot_[o]] = kNone;
      blocks_.push_back(last_.slot_[o] / kBlockSlots);
    }
    std::vector<Index> slot(match_.triangles()), corner(match_.vertices());
    for_each_index(slot.size(), [&](std::size_t t) {
      const Index o = old_triangle(Index(t));
      slot[t] = o == kNone ? kNone : last_.slot_[o];
    });
    for_each_index(corner.size(), [&](std::size_t v) {
      const Index o = old_vertex(Index(v));
      corner[v] = o == kNone ? kNone : last_.corner_[o];
    });
    for (Index o = 0; o < match_.old_vertices(); ++o)
      if (match_.new_vertex(o) == kNone) last_.free_vertices_.give_back({last_.corner_[o], 1});
    last_.slot_ = std::move(slot);
    last_.corner_ = std::move(corner);
    for (const Index t : triangle_)
      if (last_.slot_[t] == kNone) last_.slot_[t] = last_.new_slot();
    for_each_index(match_.triangles(), [&](std::size_t t) { last_.triangle_[last_.slot_[t]] = Index(t); });
  }

  /// For what came in the core, where what was there does not have as many.
  void find_rows() {
    GeometricMesh& out = last_.geometric_;
    Index child_end = Index(out.mesh.triangle_count()), vertex_end = Index(out.mesh.vertex_count());
    const auto fit = [&](Rows& rows, Index count, RowPool& free, Index& end) {
      if (rows.count == count) return;
      same_rows_ = false;
      free.give_back(rows);
      rows = free.take(count, end);
    };
    for (Index i = 0; i < triangle_.size(); ++i) {
      if (!core(triangle_[i])) continue;
      const Index slot = last_.slot_[triangle_[i]];
      fit(last_.child_[slot], part_children(i), last_.free_children_, child_end);
      fit(last_.fresh_[slot], part_vertices(i), last_.free_vertices_, vertex_end);
      last_.triangles_ += part_children(i);
    }
    for (const Index v : indices_where(last_.corner_.size(), [&](Index v) { return last_.corner_[v] == kNone; }))
      last_.corner_[v] = last_.free_vertices_.take(1, vertex_end).first;
    make_room(out.mesh.vertex, 3 * std::size_t(child_end));
    make_room(out.mesh.twin, 3 * std::size_t(child_end));
    make_room(out.parent_triangle, child_end);
    make_room(out.mesh.vertices.position, vertex_end);
    make_room(out.normal, vertex_end);
    make_room(out.parent_edge, vertex_end);
    make_room(last_.birth_, vertex_end);
  }

  Index new_row(Index v) const {
    if (v < vertex_.size()) return last_.corner_[vertex_[v]];
    const Index fresh = v - Index(vertex_.size()), owner = owner_of_part_[fresh];
    return last_.fresh(triangle_[owner]).first + fresh - part_.first_vertex[owner];
  }

  Index new_child_row(Index c) const {
    const Index owner = part_.geometric.parent_triangle[c];
    return last_.child(triangle_[owner]).first + c - part_.first_child[owner];
  }

  /// Triangle i of the part.
  void write(Index i) {
    GeometricMesh& out = last_.geometric_;
    const Index t = triangle_[i];
    for (Index k = 0; k < part_vertices(i); ++k) {
      const Index fresh = part_.first_vertex[i] + k, source = Index(vertex_.size()) + fresh;
      const Index row = last_.fresh(t).first + k;
      const auto [a, b] = part_.geometric.parent_edge[source];
      out.mesh.vertices.position[row] = part_mesh().position(source);
      out.normal[row] = part_.geometric.normal[source];
      out.parent_edge[row] = {new_row(a), new_row(b)};
      last_.birth_[row] = part_.birth[fresh];
    }
    for (Index c = part_.first_child[i]; c < part_.first_child[i + 1]; ++c) {
      const Index row = new_child_row(c);
      out.parent_triangle[row] = t;
      for (Index h = 0; h < 3; ++h) {
        const Index v = part_mesh().vertex[3 * c + h], twin = part_mesh().twin[3 * c + h];
        out.mesh.vertex[3 * row + h] = new_row(v);
        out.mesh.twin[3 * row + h] = 3 * new_child_row(twin / 3) + twin % 3;
      }
    }
  }

  void list_strays() {
    std::vector<Stray> kept, fresh, all;
    for (Stray stray : last_.stray_) {
      stray.triangle = match_.new_triangle(stray.triangle);
      if (stray.triangle != kNone && !inner(stray.triangle)) kept.push_back(stray);
    }
    for (Index i = 0; i < triangle_.size(); ++i)
      if (inner(triangle_[i])) last_.find_strays(part_, i, triangle_[i], options_, fresh);
    const auto sooner = [](const Stray& p, const Stray& q) {
      return std::tie(p.triangle, p.child) < std::tie(q.triangle, q.child);
    };
    std::sort(kept.begin(), kept.end(), sooner);
    std::merge(kept.begin(), kept.end(), fresh.begin(), fresh.end(), std::back_inserter(all), sooner);
    last_.stray_ = std::move(all);
  }

  void list_crossings() {
    std::vector<Crossing> kept;
    for (Crossing crossing : last_.crossing_) {
      crossing.a = match_.new_triangle(crossing.a);
      crossing.b = match_.new_triangle(crossing.b);
      if (crossing.a == kNone || crossing.b == kNone || core(crossing.a) || core(crossing.b)) continue;
      if (crossing.a > crossing.b) {
        std::swap(crossing.a, crossing.b);
        std::swap(crossing.child_a, crossing.child_b);
      }
      kept.push_back(crossing);
    }
    std::sort(kept.begin(), kept.end());
    last_.crossing_ = std::move(kept);
    std::vector<std::uint8_t> unlooked(skin_.triangle_count());
    if (!last_.unlooked_.empty())
      for_each_index(unlooked.size(), [&](std::size_t t) {
        const Index o = old_triangle(Index(t));
        unlooked[t] = o != kNone && last_.unlooked_[o];
      });
    for (const Index t : triangle_) unlooked[t] |= core(t);
    last_.unlooked_ = std::move(unlooked);
  }

  static constexpr std::uint8_t kFar = 255;

  RefinedSkin& last_;
  const TriangleMesh& skin_;
  Backend& backend_;
  const RefinedSkinOptions& options_;
  int rings_ = kLeastRings;
  const SkinMatch match_;
  std::vector<std::uint8_t> distance_;    // per triangle
  std::vector<Index> triangle_, vertex_;  // of the part, in the skin
  std::vector<Index> local_triangle_;     // of the skin, in the part
  std::vector<Index> owner_of_part_;      // per new vertex of the part: a triangle of it
  Refinement part_;
  std::vector<Index> gone_;    // triangles of the skin as it was
  std::vector<Index> blocks_;  // whose bounds have changed
  bool same_rows_ = false;     // everything lies where it lay
};

/// These, perhaps repeating.
void RefinedSkin::update_blocks(std::vector<Index> blocks) {
  std::sort(blocks.begin(), blocks.end());
  blocks.erase(std::unique(blocks.begin(), blocks.end()), blocks.end());
  block_.resize((bounds_.size() + kBlockSlots - 1) / kBlockSlots);
  for_each_index(blocks.size(), [&](std::size_t i) {
    Bounds all;
    const Index first = kBlockSlots * blocks[i], end = std::min(first + kBlockSlots, Index(bounds_.size()));
    for (Index s = first; s < end; ++s) {
      all.low = glm::min(all.low, bounds_[s].low);
      all.high = glm::max(all.high, bounds_[s].high);
    }
    block_[blocks[i]] = all.box();
  });
}

Index RefinedSkin::new_slot() {
  if (!free_slots_.empty()) {
    const Index slot = free_slots_.back();
    free_slots_.pop_back();
    return slot;
  }
  child_.emplace_back();
  fresh_.emplace_back();
  bounds_.emplace_back();
  triangle_.push_back(kNone);
  if (!counted_.empty()) counted_.emplace_back();
  return Index(child_.size() - 1);
}

void RefinedSkin::find_strays(const Refinement& refined, Index at, Index triangle, const RefinedSkinOptions& options,
                              std::vector<Stray>& found) {
  const TriangleMesh& mesh = refined.geometric.mesh;
  for (Index c = refined.first_child[at]; c < refined.first_child[at + 1]; ++c) {
    const auto [value, slope] = refined.centroid[c];
    if (!(distance_estimate(value, slope, options.voxel) > options.stray)) continue;
    const Index* v = &mesh.vertex[3 * c];
    found.push_back({triangle, c - refined.first_child[at],
                     (mesh.position(v[0]) + mesh.position(v[1]) + mesh.position(v[2])) / 3.0f});
  }
}

void RefinedSkin::update(const TriangleMesh& skin, const FieldChanges* changes, Backend& backend,
                         const RefinedSkinOptions& options) {
  if (!lifted_.empty()) {
    geometric_.mesh.vertices.position = std::exchange(lifted_, {});
    counted_.clear();
  }
  unit_ = options.unit;
  const std::optional<std::vector<Box>> changed_before = std::move(changed_);
  const bool goes_on = changes && !changes->everywhere && !changes->rounded_anew && !slot_.empty() &&
                       std::isfinite(options.project.reach);
  if (!goes_on || !Update(*this, skin, backend, options).run(*changes)) refine_whole(skin, backend, options);
  if (options.adds_changes && changed_ && changed_before)
    changed_->insert(changed_->end(), changed_before->begin(), changed_before->end());
  else if (options.adds_changes)
    changed_.reset();
  remember(skin);
}

void RefinedSkin::remember(const TriangleMesh& skin) {
  copy_column(skin.vertices.rest, skin_.rest);
  copy_column(skin.vertices.velocity, skin_.velocity);
  copy_column(skin.vertices.age, skin_.age);
  copy_column(skin.vertices.id, skin_.id);
  copy_column(skin.vertex, vertex_);
  skin_next_id_ = skin.next_id;
}

void RefinedSkin::refine_whole(const TriangleMesh& skin, Backend& backend, const RefinedSkinOptions& options) {
  Refiner refiner(skin, backend, options.refine, options.project);
  while (refiner.report().passes < options.refine.passes && refiner.pass()) {
  }
  Refinement refined = refiner.finish();
  std::vector<std::vector<Stray>> strays((skin.triangle_count() + kBlock - 1) / kBlock);
  tbb::parallel_for(std::size_t{0}, strays.size(), [&](std::size_t b) {
    for (std::size_t t = b * kBlock; t < std::min(skin.triangle_count(), (b + 1) * kBlock); ++t)
      find_strays(refined, Index(t), Index(t), options, strays[b]);
  });
  stray_.clear();
  for (const auto& some : strays) stray_.insert(stray_.end(), some.begin(), some.end());
  const Index corners = Index(skin.vertex_count());
  slot_.resize(skin.triangle_count());
  std::iota(slot_.begin(), slot_.end(), Index{0});
  free_slots_.clear();
  child_.resize(slot_.size());
  fresh_.resize(slot_.size());
  for_each_index(skin.triangle_count(), [&](std::size_t t) {
    child_[t] = {refined.first_child[t], refined.first_child[t + 1] - refined.first_child[t]};
    fresh_[t] = {corners + refined.first_vertex[t], refined.first_vertex[t + 1] - refined.first_vertex[t]};
  });
  corner_.resize(corners);
  std::iota(corner_.begin(), corner_.end(), Index{0});
  birth_.assign(corners, {});
  birth_.insert(birth_.end(), refined.birth.begin(), refined.birth.end());
  geometric_ = std::move(refined.geometric);
  triangles_ = geometric_.mesh.triangle_count();
  bounds_.resize(slot_.size());
  for_each_index(bounds_.size(), [&](std::size_t t) { bounds_[t] = find_bounds(Index(t)); });
  triangle_ = slot_;
  std::vector<Index> blocks((slot_.size() + kBlockSlots - 1) / kBlockSlots);
  std::iota(blocks.begin(), blocks.end(), Index{0});
  update_blocks(std::move(blocks));
  crossing_.clear();
  unlooked_.assign(skin.triangle_count(), 1);
  free_children_ = free_vertices_ = {};
  counted_.clear();
  without_normal_.clear();
  ordered_ = carried_ = true;
  normals_replaced_ = false;
  changed_.reset();
  refined_triangles_ = skin.triangle_count();
}

}  // namespace isoskin
