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

#include "core/mesh/independent_edits.h"
#include "core/parallel.h"
#include "core/trace.h"

namespace isoskin {
namespace {

constexpr double kMostAnew = 0.4;  // of a skin: with more to refine all of it is cheaper
constexpr int kTries = 6;
constexpr int kLeastRings = 4;  // about what has changed; the two outermost must come out as they were
constexpr int kHalo = 2;        // rings beyond, whose splits are known
constexpr int kAhead = 64;      // triangles looked through for one that lies farther on than it did

bool same_bits(const Vec3& a, const Vec3& b) {
  return std::bit_cast<std::array<std::uint32_t, 3>>(a) == std::bit_cast<std::array<std::uint32_t, 3>>(b);
}

/// Rows of the old columns that are still there: for each new one the old, kNone without one. Both lie in about the
/// same order, since edits append and drop; what does not is taken for new.
std::vector<Index> match_ids(const std::vector<Index>& before, std::size_t old_count, const std::vector<Index>& after) {
  std::vector<Index> old(after.size(), kNone);
  std::size_t at = 0;
  for (std::size_t v = 0; v < after.size(); ++v) {
    while (at < old_count && before[at] < after[v]) ++at;
    if (at < old_count && before[at] == after[v]) old[v] = Index(at++);
  }
  return old;
}

Box children_box(const Refinement& refined, Index triangle) {
  Box box;
  const TriangleMesh& mesh = refined.geometric.mesh;
  for (Index h = 3 * refined.first_child[triangle]; h < 3 * refined.first_child[triangle + 1]; ++h)
    box.add(DVec3(mesh.position(mesh.vertex[h])));
  return box;
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
      : last_(last), old_(last.refined_), skin_(skin), backend_(backend), options_(options) {}

  /// False when refining everything is cheaper; nothing has been done then.
  bool run(const FieldChanges& changes) {
    match_triangles();
    std::vector<Index> changed = changed_triangles(changes);
    for (int attempt = 0; attempt < kTries; ++attempt) {
      rings_ = kLeastRings + 2 * std::max(0, attempt - 1);
      if (!grow(changed)) return false;
      std::vector<Index> otherwise = put_back_about();
      if (otherwise.empty()) {
        refine_part();
        otherwise = come_out_otherwise();
        if (otherwise.empty()) {
          assemble();
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
  std::size_t old_skin_vertices() const { return old_.geometric.mesh.vertex_count() - old_.birth.size(); }
  const TriangleMesh& old_mesh() const { return old_.geometric.mesh; }
  const TriangleMesh& part_mesh() const { return part_.geometric.mesh; }
  bool inner(Index t) const { return distance_[t] <= rings_; }
  bool guard(Index t) const { return inner(t) && distance_[t] > rings_ - 2; }

  /// Triangles of the old skin with the same corners by id, first corner first.
  void match_triangles() {
    old_vertex_ = match_ids(old_mesh().vertices.id, old_skin_vertices(), skin_.vertices.id);
    new_vertex_.assign(old_skin_vertices(), kNone);
    for (Index v = 0; v < old_vertex_.size(); ++v)
      if (old_vertex_[v] != kNone) new_vertex_[old_vertex_[v]] = v;
    const std::size_t old_count = last_.vertex_.size() / 3;
    old_triangle_.assign(skin_.triangle_count(), kNone);
    const auto gone = [&](std::size_t t) {
      const Index* v = &last_.vertex_[3 * t];
      return new_vertex_[v[0]] == kNone || new_vertex_[v[1]] == kNone || new_vertex_[v[2]] == kNone;
    };
    std::size_t at = 0;
    for (std::size_t t = 0; t < old_triangle_.size(); ++t) {
      const Index* v = &skin_.vertex[3 * t];
      const std::array<Index, 3> wanted{old_vertex_[v[0]], old_vertex_[v[1]], old_vertex_[v[2]]};
      if (wanted[0] == kNone || wanted[1] == kNone || wanted[2] == kNone) continue;
      while (at < old_count && gone(at)) ++at;
      for (std::size_t ahead = at; ahead < std::min(old_count, at + kAhead); ++ahead)
        if (std::equal(wanted.begin(), wanted.end(), &last_.vertex_[3 * ahead])) {
          old_triangle_[t] = Index(ahead);
          at = ahead + 1;
          break;
        }
    }
  }

  std::vector<Index> changed_triangles(const FieldChanges& changes) const {
    std::vector<std::uint8_t> moved(skin_.vertex_count());
    for_each_index(moved.size(), [&](std::size_t v) {
      moved[v] = old_vertex_[v] == kNone || !same_bits(skin_.position(Index(v)), old_mesh().position(old_vertex_[v]));
    });
    const ChangeMask mask(changes, double(options_.project.reach));
    return indices_where(skin_.triangle_count(), [&](Index t) {
      const Index* v = &skin_.vertex[3 * t];
      return old_triangle_[t] == kNone || moved[v[0]] || moved[v[1]] || moved[v[2]] ||
             (!mask.empty() && mask.overlaps(children_box(old_, old_triangle_[t])));
    });
  }

  /// Distances up to the halo's end; false when that is too much of the skin.
  bool grow(const std::vector<Index>& changed) {
    distance_.assign(skin_.triangle_count(), kFar);
    for (const Index t : changed) distance_[t] = 0;
    std::vector<Index> ring = changed;
    std::size_t reached = changed.size();
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
      if (double(reached) > kMostAnew * double(skin_.triangle_count())) return false;
      ring = std::move(next);
    }
    triangle_ = indices_where(distance_.size(), [&](Index t) { return distance_[t] != kFar; });
    return true;
  }

  /// New vertices that an old triangle and its neighbours have in common are not all its own.
  template <class Wanted>
  bool any_old_vertex(Index t, const Wanted& wanted) const {
    const Index o = old_triangle_[t];
    for (Index h = 3 * old_.first_child[o]; h < 3 * old_.first_child[o + 1]; ++h) {
      const Index v = old_mesh().vertex[h];
      if (v >= old_skin_vertices() && wanted(v)) return true;
    }
    return false;
  }

  /// Of the guard and beyond: triangles with points that were put back. When that happens depends on more than what
  /// comes of it.
  std::vector<Index> put_back_about() const {
    std::vector<Index> found;
    for (const Index t : triangle_)
      if (distance_[t] > rings_ - 2 &&
          any_old_vertex(t, [&](Index v) { return old_.birth[v - old_skin_vertices()].put_back != 0; }))
        found.push_back(t);
    return found;
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
          known.name.push_back(old_vertex_[v]);
        }
        part.vertex.push_back(local_vertex[v]);
        part.twin.push_back(other == kNone ? kNone : 3 * other + skin_.twin[h] % 3);
      }
      known.triangle.push_back(!inner(t));
      if (!inner(t)) add_splits(t, known.split);
    }
    part.vertices = skin_.vertices.select(vertex_);
    const auto sooner = [](const auto& p, const auto& q) { return std::tie(p.a, p.b) < std::tie(q.a, q.b); };
    std::sort(known.split.begin(), known.split.end(), sooner);
    Refiner refiner(part, known, backend_, options_.refine, options_.project);
    for (int pass = 0; pass < options_.refine.passes; ++pass) refiner.pass();
    part_ = refiner.finish();
    owner_of_part_.resize(part_.birth.size());
    for (Index t = 0; t < triangle_.size(); ++t)
      std::fill(owner_of_part_.begin() + part_.first_vertex[t], owner_of_part_.begin() + part_.first_vertex[t + 1], t);
  }

  void add_splits(Index t, std::vector<KnownSplits::Split>& splits) const {
    any_old_vertex(t, [&](Index v) {
      const auto [a, b] = old_.geometric.parent_edge[v];
      splits.push_back({std::min(a, b), std::max(a, b), v, int(old_.birth[v - old_skin_vertices()].pass)});
      return false;
    });
  }

  /// What a vertex of the part was, were its owner as it had been; kNone where it has no counterpart.
  Index old_name(Index v) const {
    if (v < vertex_.size()) return old_vertex_[vertex_[v]];
    const Index fresh = v - Index(vertex_.size()), owner = owner_of_part_[fresh];
    const Index o = old_triangle_[triangle_[owner]];
    if (o == kNone) return kNone;
    const Index k = fresh - part_.first_vertex[owner];
    if (k >= old_.first_vertex[o + 1] - old_.first_vertex[o]) return kNone;
    return Index(old_skin_vertices()) + old_.first_vertex[o] + k;
  }

  /// Is it where the old one is, and came as that did, without having been put back?
  bool same_vertex(Index v, Index old) const {
    if (old_name(v) != old || !same_bits(part_mesh().position(v), old_mesh().position(old))) return false;
    if (v < vertex_.size()) return true;
    const Birth birth = part_.birth[v - vertex_.size()];
    return birth == old_.birth[old - old_skin_vertices()] && !birth.put_back;
  }

  /// Triangles of the guard.
  std::vector<Index> come_out_otherwise() const {
    std::vector<Index> found;
    for (Index i = 0; i < triangle_.size(); ++i) {
      if (!guard(triangle_[i])) continue;
      const Index o = old_triangle_[triangle_[i]];
      const auto counts_agree = [&](const std::vector<Index>& now, const std::vector<Index>& before) {
        return now[i + 1] - now[i] == before[o + 1] - before[o];
      };
      bool same =
          counts_agree(part_.first_child, old_.first_child) && counts_agree(part_.first_vertex, old_.first_vertex);
      for (Index k = 0; same && k < 3 * (old_.first_child[o + 1] - old_.first_child[o]); ++k)
        same = same_vertex(part_mesh().vertex[3 * part_.first_child[i] + k],
                           old_mesh().vertex[3 * old_.first_child[o] + k]);
      if (!same) found.push_back(triangle_[i]);
    }
    return found;
  }

  /// Children and new vertices of all triangles, from the part up to the guard, else from before.
  void assemble() {
    const Span span("assemble");
    const std::size_t triangles = skin_.triangle_count(), corners = skin_.vertex_count();
    Refinement next;
    next.first_child.assign(triangles + 1, 0);
    next.first_vertex.assign(triangles + 1, 0);
    for_each_index(triangles, [&](std::size_t t) {
      const Refinement& from = inner(Index(t)) ? part_ : old_;
      const Index at = inner(Index(t)) ? local_triangle_[t] : old_triangle_[t];
      next.first_child[t + 1] = from.first_child[at + 1] - from.first_child[at];
      next.first_vertex[t + 1] = from.first_vertex[at + 1] - from.first_vertex[at];
    });
    std::partial_sum(next.first_child.begin(), next.first_child.end(), next.first_child.begin());
    std::partial_sum(next.first_vertex.begin(), next.first_vertex.end(), next.first_vertex.begin());

    // Where old and part's vertices and children are now.
    std::vector<Index> from_old(old_mesh().vertex_count(), kNone), from_part(part_mesh().vertex_count(), kNone);
    std::vector<Index> child_from_old(old_mesh().triangle_count(), kNone);
    std::copy(new_vertex_.begin(), new_vertex_.end(), from_old.begin());
    std::copy(vertex_.begin(), vertex_.end(), from_part.begin());
    for_each_index(triangles, [&](std::size_t t) {
      const Index o = old_triangle_[t];
      if (o == kNone || distance_[t] <= rings_ - 2) return;
      for (Index k = 0; k < old_.first_vertex[o + 1] - old_.first_vertex[o]; ++k)
        from_old[old_skin_vertices() + old_.first_vertex[o] + k] = Index(corners) + next.first_vertex[t] + k;
      for (Index k = 0; k < old_.first_child[o + 1] - old_.first_child[o]; ++k)
        child_from_old[old_.first_child[o] + k] = next.first_child[t] + k;
    });
    for (Index v = Index(vertex_.size()); v < from_part.size(); ++v) {
      const Index fresh = v - Index(vertex_.size()), owner = owner_of_part_[fresh];
      from_part[v] = Index(corners) + next.first_vertex[triangle_[owner]] + fresh - part_.first_vertex[owner];
    }
    const auto child_from_part = [&](Index c) {
      const Index t = part_.geometric.parent_triangle[c];
      return next.first_child[triangle_[t]] + c - part_.first_child[t];
    };

    GeometricMesh& out = next.geometric;
    const std::size_t all = corners + next.first_vertex.back(), children = next.first_child.back();
    out.mesh.vertex.resize(3 * children);
    out.mesh.twin.resize(3 * children);
    out.parent_triangle.resize(children);
    out.normal.resize(all);
    out.parent_edge.resize(all);
    next.birth.resize(all - corners);
    out.mesh.next_id = skin_.next_id;
    out.mesh.vertices = skin_.vertices;
    out.mesh.vertices.resize(all);
    for_each_index(corners, [&](std::size_t v) {
      out.parent_edge[v] = {Index(v), Index(v)};
      if (old_vertex_[v] != kNone) out.normal[v] = old_.geometric.normal[old_vertex_[v]];
    });
    for_each_index(triangles, [&](std::size_t t) {
      const bool anew = inner(Index(t));
      const Refinement& from = anew ? part_ : old_;
      const Index at = anew ? local_triangle_[t] : old_triangle_[t];
      const std::vector<Index>& vertex = anew ? from_part : from_old;
      const Index own = Index(from.geometric.mesh.vertex_count() - from.birth.size());
      for (Index k = 0; k < next.first_vertex[t + 1] - next.first_vertex[t]; ++k) {
        const Index v = Index(corners) + next.first_vertex[t] + k, source = own + from.first_vertex[at] + k;
        const auto [a, b] = from.geometric.parent_edge[source];
        out.mesh.vertices.position[v] = from.geometric.mesh.position(source);
        out.normal[v] = from.geometric.normal[source];
        out.parent_edge[v] = {vertex[a], vertex[b]};
        next.birth[v - corners] = from.birth[source - own];
      }
      for (Index k = 0; k < next.first_child[t + 1] - next.first_child[t]; ++k) {
        const Index child = next.first_child[t] + k, source = from.first_child[at] + k;
        out.parent_triangle[child] = Index(t);
        for (Index h = 0; h < 3; ++h) {
          const Index twin = from.geometric.mesh.twin[3 * source + h];
          out.mesh.vertex[3 * child + h] = vertex[from.geometric.mesh.vertex[3 * source + h]];
          out.mesh.twin[3 * child + h] = 3 * (anew ? child_from_part(twin / 3) : child_from_old[twin / 3]) + twin % 3;
        }
      }
    });
    number_and_carry(out, corners);
    replace_normals(out, from_old, from_part);
    list_changes(next);
    list_strays();
    last_.refined_ = std::move(next);
    last_.vertex_ = skin_.vertex;
    last_.refined_triangles_ = triangle_.size();
  }

  /// Ages at least change everywhere.
  static void number_and_carry(GeometricMesh& out, std::size_t corners) {
    VertexTable& table = out.mesh.vertices;
    for (std::size_t v = corners; v < table.size(); ++v) {
      const auto [a, b] = out.parent_edge[v];
      table.rest[v] = 0.5f * (table.rest[a] + table.rest[b]);
      table.velocity[v] = 0.5f * (table.velocity[a] + table.velocity[b]);
      table.age[v] = std::min(table.age[a], table.age[b]);
    }
    std::iota(table.id.begin() + std::ptrdiff_t(corners), table.id.end(), out.mesh.next_id);
    out.mesh.next_id += Index(table.size() - corners);
  }

  /// Of the skin's vertices in the part; and where the gradient vanishes, which triangles anywhere about have a say in.
  void replace_normals(GeometricMesh& out, const std::vector<Index>& from_old, const std::vector<Index>& from_part) {
    std::vector<Index> perhaps;
    for (const Index v : last_.without_normal_)
      if (from_old[v] != kNone) perhaps.push_back(from_old[v]);
    for (const Index v : perhaps) out.normal[v] = Vec3(0.0f);
    for (Index i = 0; i < triangle_.size(); ++i) {
      if (!inner(triangle_[i])) continue;
      for (Index h = 3 * part_.first_child[i]; h < 3 * part_.first_child[i + 1]; ++h) {
        const Index v = part_mesh().vertex[h];
        out.normal[from_part[v]] = part_.geometric.normal[v];
        perhaps.push_back(from_part[v]);
      }
    }
    std::sort(perhaps.begin(), perhaps.end());
    perhaps.erase(std::unique(perhaps.begin(), perhaps.end()), perhaps.end());
    std::erase_if(perhaps, [&](Index v) { return out.normal[v] != Vec3(0.0f); });
    if (!perhaps.empty()) replace_zero_normals(out);
    last_.without_normal_ = std::move(perhaps);
  }

  /// Boxes of the children that came and went; sets new_triangle_.
  void list_changes(const Refinement& next) {
    std::vector<Box>& boxes = last_.changed_.emplace();
    new_triangle_.assign(last_.vertex_.size() / 3, kNone);
    for (Index t = 0; t < old_triangle_.size(); ++t) {
      if (old_triangle_[t] != kNone) new_triangle_[old_triangle_[t]] = t;
      if (distance_[t] <= rings_ - 2) boxes.push_back(children_box(next, t));
    }
    for (Index o = 0; o < new_triangle_.size(); ++o)
      if (new_triangle_[o] == kNone || distance_[new_triangle_[o]] <= rings_ - 2)
        boxes.push_back(children_box(old_, o));
  }

  void list_strays() {
    std::vector<Stray> kept, fresh, all;
    for (Stray stray : last_.stray_) {
      stray.triangle = new_triangle_[stray.triangle];
      if (stray.triangle != kNone && !inner(stray.triangle)) kept.push_back(stray);
    }
    for (Index i = 0; i < triangle_.size(); ++i)
      if (inner(triangle_[i])) last_.find_strays(part_, i, triangle_[i], options_, fresh);
    std::merge(
        kept.begin(), kept.end(), fresh.begin(), fresh.end(), std::back_inserter(all),
        [](const Stray& p, const Stray& q) { return std::tie(p.triangle, p.child) < std::tie(q.triangle, q.child); });
    last_.stray_ = std::move(all);
  }

  static constexpr std::uint8_t kFar = 255;

  RefinedSkin& last_;
  const Refinement& old_;
  const TriangleMesh& skin_;
  Backend& backend_;
  const RefinedSkinOptions& options_;
  int rings_ = kLeastRings;
  std::vector<Index> old_vertex_, new_vertex_;      // of the skin as it was, as it is; kNone without counterpart
  std::vector<Index> old_triangle_, new_triangle_;  // the same
  std::vector<std::uint8_t> distance_;              // per triangle
  std::vector<Index> triangle_, vertex_;            // of the part, in the skin
  std::vector<Index> local_triangle_;               // of the skin, in the part
  std::vector<Index> owner_of_part_;                // per new vertex of the part: a triangle of it
  Refinement part_;
};

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
  if (!lifted_.empty()) refined_.geometric.mesh.vertices.position = std::exchange(lifted_, {});
  const bool goes_on = changes && !changes->everywhere && !changes->rounded_anew && !refined_.first_child.empty() &&
                       std::isfinite(options.project.reach);
  if (!goes_on || !Update(*this, skin, backend, options).run(*changes)) refine_whole(skin, backend, options);
}

void RefinedSkin::refine_whole(const TriangleMesh& skin, Backend& backend, const RefinedSkinOptions& options) {
  Refiner refiner(skin, backend, options.refine, options.project);
  while (refiner.report().passes < options.refine.passes && refiner.pass()) {
  }
  refined_ = refiner.finish();
  vertex_ = skin.vertex;
  stray_.clear();
  for (Index t = 0; t < skin.triangle_count(); ++t) find_strays(refined_, t, t, options, stray_);
  refined_.centroid = {};
  const std::vector<Vec3>& normal = refined_.geometric.normal;
  without_normal_ = indices_where(normal.size(), [&](Index v) { return normal[v] == Vec3(0.0f); });
  if (!without_normal_.empty()) replace_zero_normals(refined_.geometric);
  changed_.reset();
  refined_triangles_ = skin.triangle_count();
}

std::vector<Vec3> RefinedSkin::strays() const {
  std::vector<Vec3> points;
  for (const Stray& stray : stray_) points.push_back(stray.point);
  return points;
}

void RefinedSkin::flatten(const std::vector<Vec3>& bad, float radius) {
  if (lifted_.empty()) lifted_ = refined_.geometric.mesh.vertices.position;
  isoskin::flatten(refined_.geometric, bad, radius);
}

}  // namespace isoskin
