#include "core/topology/reskin.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <numeric>
#include <optional>

#include <tbb/parallel_for.h>

#include "core/mesh/folds.h"
#include "core/mesh/independent_edits.h"
#include "core/mesh/one_ring.h"
#include "core/parallel.h"
#include "core/sampling/closest_point.h"
#include "core/topology/point_grid.h"
#include "core/topology/sound_skin.h"
#include "core/topology/weld.h"
#include "core/trace.h"

namespace isoskin {
namespace {

template <class Work>
auto traced(const char* name, const Work& work) {
  const Span span(name);
  return work();
}

/// Everything an attempt reads.
struct Scene {
  const TriangleMesh& mesh;
  const MeshPieces& pieces;
  const Certificate& certificate;
  const BrickLattice& lattice;
  const ReskinOptions& options;
  const std::vector<Vec3> normals;          // per vertex, of the field
  const std::vector<std::uint8_t> folded;   // per vertex
  const std::vector<std::uint8_t> failed;   // per vertex: its piece failed
  const std::vector<std::uint8_t> differs;  // per vertex: its piece may have to change topology
  const std::vector<Index> outgoing;        // per vertex: a halfedge that leaves it
  Backend& backend;
};

/// One byte a vertex: 1 where a triangle about it faces away from where the field's surface does.
std::vector<std::uint8_t> folded_vertices(const TriangleMesh& mesh, const std::vector<Vec3>& normals) {
  const std::vector<std::uint8_t> triangles = folded_triangles(mesh, normals);
  std::vector<std::uint8_t> folded(mesh.vertex_count());
  for (Index t = 0; t < triangles.size(); ++t)
    for (Index h = 3 * t; h < 3 * t + 3 && triangles[t]; ++h) folded[mesh.vertex[h]] = 1;
  return folded;
}

/// One byte a vertex: those with of != 0 near a point.
std::vector<std::uint8_t> vertices_near(const TriangleMesh& mesh, const std::vector<std::uint8_t>& of,
                                        const PointGrid& points) {
  std::vector<std::uint8_t> near(mesh.vertex_count());
  for_each_index(near.size(), [&](std::size_t v) { near[v] = of[v] && points.any_near(mesh.position(Index(v))); });
  return near;
}

std::vector<std::uint8_t> vertices_of_failed(const MeshPieces& pieces, const Certificate& certificate) {
  std::vector<std::uint8_t> failed(pieces.of_vertex.size());
  for_each_index(failed.size(),
                 [&](std::size_t v) { failed[v] = certificate.mesh_piece[pieces.of_vertex[v]] != Fault::none; });
  return failed;
}

/// Skin that is folded makes borders that no seam fits: what is hot reaches on from the front to the fold's end.
void reach_over_folds(const Scene& scene, std::vector<Index> front, std::vector<std::uint8_t>& hot) {
  const TriangleMesh& mesh = scene.mesh;
  while (!front.empty()) {
    const Index start = scene.outgoing[front.back()];
    front.pop_back();
    for_each_leaving(mesh, start, [&](Index h) {
      const Index to = mesh.to(h);
      if (scene.folded[to] && !hot[to]) front.push_back(to);
      hot[to] |= scene.folded[to];
    });
  }
}

/// Closed pieces of the filling that failed and that no seam has reached: those without a mesh, and those whose mesh
/// was emptied, near `bad` points, so that none of it stays on them (`skin`: the mesh's vertices). One byte a triangle.
std::vector<std::uint8_t> whole_pieces(const Scene& scene, const Holes& holes, const Filling& filling,
                                       const PointGrid& bad, const PointGrid& skin,
                                       const std::vector<std::uint8_t>& inside) {
  constexpr float kAgree = 0.3f;  // cosine between normals
  const Certificate& certificate = scene.certificate;
  const auto& triangle = filling.surface.triangle;
  const auto piece_of = [&](std::size_t t) { return filling.surface.piece[triangle[3 * t]]; };
  const auto mark = [](std::uint8_t& flag) { std::atomic_ref<std::uint8_t>(flag).store(1, std::memory_order_relaxed); };
  std::vector<std::uint8_t> broken(certificate.lattice_piece.size()), emptied(broken.size()), covered(broken.size());
  const std::vector<std::uint8_t> stays = staying_vertices(scene.mesh, holes);
  const float reach = seam_reach(scene.lattice.spacing);
  const auto is_covered = [&](std::size_t f) {
    bool found = false;
    skin.near(filling.surface.position[f], [&](Index v, float square) {
      found |= stays[v] && square <= reach * reach && glm::dot(scene.normals[v], filling.normal[f]) > kAgree;
    });
    return found;
  };
  for_each_index(inside.size(), [&](std::size_t t) {
    const Index* const twin = &filling.twin[3 * t];
    if (inside[t] || twin[0] == kNone || twin[1] == kNone || twin[2] == kNone) mark(broken[piece_of(t)]);
  });
  for_each_index(filling.surface.position.size(), [&](std::size_t v) {
    const Index piece = filling.surface.piece[v];
    const bool open = !broken[piece] && certificate.lattice_piece[piece] != Fault::none;
    if (open && bad.any_near(filling.surface.position[v])) mark(emptied[piece]);
    if (open && is_covered(v)) mark(covered[piece]);
  });
  std::vector<std::uint8_t> whole(inside.size());
  for_each_index(inside.size(), [&](std::size_t t) {
    const Index piece = piece_of(t);
    const Fault fault = certificate.lattice_piece[piece];
    whole[t] =
        !broken[piece] && (fault == Fault::missing || (fault != Fault::none && emptied[piece] && !covered[piece]));
  });
  return whole;
}

/// Holes and patches that hang together by their seams, and what is to be done with them.
class Groups {
public:
  Groups(const Holes& holes, const Patches& patches, bool alike_only)
      : holes_(holes.count()), alike_only_(alike_only), parent_(holes.count() + patches.count()) {
    std::iota(parent_.begin(), parent_.end(), Index(0));
    for (Index p = 0; p < patches.count(); ++p)
      for (const Index s : patches.seams[p])
        if (!patches.leaks[p]) unite(holes.seams[s].hole, holes_ + p);
    holes_in_.assign(parent_.size(), 0);
    patches_in_.assign(parent_.size(), 0);
    euler_gained_.assign(parent_.size(), 0);
    failed_.assign(parent_.size(), 0);
    sure_.assign(parent_.size(), 0);
    for (Index h = 0; h < holes_; ++h) {
      ++holes_in_[root(h)];
      euler_gained_[root(h)] -= holes.euler[h];
    }
    for (Index p = 0; p < patches.count(); ++p) {
      ++patches_in_[root(holes_ + p)];
      euler_gained_[root(holes_ + p)] += patches.euler[p];
    }
    for (const Seam& seam : holes.seams) failed_[root(seam.hole)] |= seam.failed;
    for (Index p = 0; p < patches.count(); ++p) failed_[root(holes_ + p)] |= patches.leaks[p];
  }

  void make_sure(Index hole) { sure_[root(hole)] = 1; }
  bool failed(Index hole) const { return failed_[root(hole)]; }
  /// The hole that stands for its group.
  Index first(Index hole) const { return root(hole); }
  bool alike(Index hole) const { return alike_group(root(hole)); }
  /// By how much filling the hole's group changes the Euler characteristic.
  int euler_gained(Index hole) const { return euler_gained_[root(hole)]; }

  /// Not where what comes is what goes: one patch like the one hole.
  bool replaced(Index hole) const { return replaced_group(root(hole)); }
  bool replaces(Index patch) const { return replaced_group(root(holes_ + patch)); }

private:
  bool alike_group(Index g) const { return holes_in_[g] == 1 && patches_in_[g] == 1 && euler_gained_[g] == 0; }
  bool replaced_group(Index g) const {
    const bool alike = alike_group(g);
    return !failed_[g] && (alike_only_ ? alike && sure_[g] : sure_[g] || !alike);
  }
  Index root(Index i) const {
    while (parent_[i] != i) i = parent_[i];
    return i;
  }
  void unite(Index a, Index b) {
    a = root(a), b = root(b);
    parent_[std::max(a, b)] = std::min(a, b);
  }

  Index holes_;
  bool alike_only_;
  std::vector<Index> parent_;  // holes, then patches
  std::vector<int> holes_in_, patches_in_, euler_gained_;
  std::vector<std::uint8_t> failed_, sure_;
};

/// Holes, and the filling's patches that close them.
struct Cut {
  Holes holes;
  std::vector<Index> snapped;
  Patches patches;
};

/// Moves the points nearer than `radius` to one of `places` from one list to the other.
void take_near(const std::vector<Vec3>& places, float radius, std::vector<Vec3>& from, std::vector<Vec3>& to) {
  const PointGrid near(places, radius);
  std::erase_if(from, [&](const Vec3& p) {
    const bool taken = near.any_near(p);
    if (taken) to.push_back(p);
    return taken;
  });
}

/// What is emptied: the vertices of failed pieces about bad points, of those with the right topology only about what is
/// surely bad, and where holes had to grow.
class Emptied {
public:
  Emptied(const Scene& scene, const BadSites& sites)
      : scene_(&scene), radius_(float(scene.options.radius * scene.options.edge_length)) {
    std::vector<Vec3> sure;
    for (std::size_t i = 0; i < sites.point.size(); ++i) {
      (scene.options.suspects_only && sites.odd[i] ? left_alone_ : bad_).push_back(sites.point[i]);
      if (sites.sure[i]) sure.push_back(sites.point[i]);
    }
    hot_ = vertices_near(scene.mesh, scene.failed, PointGrid(sure, radius_));
    heat(bad_);
    reach_over_folds(*scene_, all_hot(), hot_);
    spare_sound();
  }

  bool any() const { return !bad_.empty(); }
  /// At these vertices, and about the odd sites near them that were left alone.
  void grow(const std::vector<Index>& vertices) {
    std::vector<Vec3> places;
    for (const Index v : vertices) {
      hot_[v] = 1;
      places.push_back(scene_->mesh.position(v));
    }
    spare_no_more(vertices);
    std::vector<Vec3> odd;
    take_near(places, float(scene_->options.spread * scene_->options.edge_length), left_alone_, odd);
    std::vector<Index> front = odd.empty() ? std::vector<Index>{} : heat(odd);
    front.insert(front.end(), vertices.begin(), vertices.end());
    reach_over_folds(*scene_, over_folds_ ? std::move(front) : all_hot(), hot_);
    over_folds_ = true;
    bad_.insert(bad_.end(), places.begin(), places.end());
    bad_.insert(bad_.end(), odd.begin(), odd.end());
  }

  /// Nothing but these vertices, and the bad points about them.
  void keep_only(std::vector<std::uint8_t> hot) {
    hot_ = std::move(hot);
    over_folds_ = false;
    std::vector<Vec3> places, kept;
    for (Index v = 0; v < hot_.size(); ++v)
      if (hot_[v]) places.push_back(scene_->mesh.position(v));
    take_near(places, radius_, bad_, kept);
    bad_ = std::move(kept);
  }

  const std::vector<std::uint8_t>& hot() const { return hot_; }
  /// One byte a triangle: those that stay though they have a hot vertex. May be empty.
  const std::vector<std::uint8_t>& spared() const { return spared_; }
  PointGrid near_bad() const { return {bad_, radius_}; }
  /// Bad points and hot vertices.
  std::vector<Vec3> points() const {
    std::vector<Vec3> points = bad_;
    for (const Index v : all_hot()) points.push_back(scene_->mesh.position(v));
    return points;
  }

private:
  std::vector<Index> all_hot() const {
    return indices_where(hot_.size(), [&](Index v) { return hot_[v] != 0; });
  }
  void spare_sound() {
    const ReskinOptions& options = scene_->options;
    if (!options.spare_sound) return;
    SoundOptions sound;
    sound.reach = float(options.off_surface * scene_->lattice.spacing);
    sound.layers = 2.0f * sound.reach;
    sound.longest = 1.5f * options.alter.longest * float(options.edge_length);
    spared_ = traced("sound skin", [&] { return sound_triangles(scene_->mesh, hot_, scene_->backend, sound); });
  }
  void spare_no_more(const std::vector<Index>& vertices) {
    if (spared_.empty()) return;
    std::vector<std::uint8_t> about(scene_->mesh.vertex_count());
    for (const Index v : vertices) about[v] = 1;
    for_each_index(spared_.size(), [&](std::size_t t) {
      const Index* const corner = &scene_->mesh.vertex[3 * t];
      if (about[corner[0]] || about[corner[1]] || about[corner[2]]) spared_[t] = 0;
    });
  }
  /// Returns the vertices about the points.
  std::vector<Index> heat(const std::vector<Vec3>& points) {
    const PointGrid about(points, radius_);
    const std::vector<Index> heated = indices_where(
        hot_.size(), [&](Index v) { return scene_->differs[v] && about.any_near(scene_->mesh.position(v)); });
    for (const Index v : heated) hot_[v] = 1;
    return heated;
  }

  const Scene* scene_;
  float radius_;
  std::vector<Vec3> bad_, left_alone_;
  std::vector<std::uint8_t> hot_, spared_;
  bool over_folds_ = true;  // what is hot reaches over the folds about it
};

/// Patches are found once all seams are laid, or when it is the `last` try.
Cut cut(const Scene& scene, const std::vector<std::uint8_t>& hot, const std::vector<std::uint8_t>& spared,
        const GrowingFilling& filling, bool last) {
  Cut result;
  result.holes = traced("cut holes", [&] { return cut_holes(scene.mesh, hot, spared); });
  result.snapped = traced(
      "seams", [&] { return lay_seams(scene.mesh, scene.normals, result.holes, filling, scene.lattice.spacing); });
  const auto& seams = result.holes.seams;
  if (last || std::none_of(seams.begin(), seams.end(), [](const Seam& seam) { return seam.failed; }))
    result.patches = traced("patches", [&] { return find_patches(result.holes, *filling); });
  return result;
}

/// Where holes have to be wider for their seams to fit: at edges that cannot be joined on the filling; where all can,
/// at skin that patches run into, else at seams whose backs they run into, else at the seams that leak. `ends`: where
/// the filling has to reach farther.
struct Misfit {
  std::vector<Index> vertices;
  std::vector<Vec3> ends;
};

Misfit misfit(const Scene& scene, const Cut& cut, const Filling& filling, const PointGrid& skin) {
  const TriangleMesh& mesh = scene.mesh;
  std::vector<Index> misjoined, leaking;
  for (const Seam& seam : cut.holes.seams) {
    for (const Index h : seam.failed_at) misjoined.insert(misjoined.end(), {mesh.from(h), mesh.to(h)});
    if (seam.failed)
      for (const Index h : seam.halfedge) leaking.push_back(mesh.from(h));
  }
  if (!misjoined.empty()) return {misjoined, {}};
  if (leaking.empty()) return {};
  Leaks leaks = follow_leaks(mesh, scene.normals, skin, cut.holes, filling);
  if (!leaks.skin.empty() || !leaks.ends.empty()) return {std::move(leaks.skin), std::move(leaks.ends)};
  return {leaks.seams.empty() ? leaking : std::move(leaks.seams), {}};
}

/// What holes that fit become: nothing where their seams failed, or nothing had to be replaced.
std::optional<Weld> fill(const Scene& scene, Cut& cut, const Filling& filling, const PointGrid& near_bad,
                         const PointGrid& near_sure, const PointGrid& skin, ReskinReport& report) {
  report = {};
  auto& [holes, snapped, patches] = cut;
  Groups groups(holes, patches, scene.options.alike_only);
  const std::vector<std::uint8_t> surely_hot = vertices_near(scene.mesh, scene.failed, near_sure);
  const std::vector<Index> sure = indices_where(holes.of_triangle.size(), [&](Index t) {
    const Index* const corner = &scene.mesh.vertex[3 * std::size_t{t}];
    return holes.of_triangle[t] != kNone && (surely_hot[corner[0]] || surely_hot[corner[1]] || surely_hot[corner[2]]);
  });
  for (const Index t : sure) groups.make_sure(holes.of_triangle[t]);

  std::vector<std::uint8_t> inside(filling.triangle_count());
  for_each_index(inside.size(), [&](std::size_t t) { inside[t] = patches.of_triangle[t] != kNone; });
  const std::vector<std::uint8_t> whole = whole_pieces(scene, holes, filling, near_bad, skin, inside);
  for_each_index(inside.size(), [&](std::size_t t) {
    inside[t] = (whole[t] && !scene.options.alike_only) ||
                (patches.of_triangle[t] != kNone && groups.replaces(patches.of_triangle[t]));
  });
  std::vector<std::uint8_t> removed(scene.mesh.triangle_count());
  for_each_index(removed.size(), [&](std::size_t t) {
    removed[t] = holes.of_triangle[t] != kNone && groups.replaced(holes.of_triangle[t]);
  });
  for (Index h = 0; h < holes.count(); ++h) {
    report.holes_given_up += groups.failed(h);
    report.holes_alike += !groups.failed(h) && !groups.replaced(h);
  }
  std::erase_if(holes.seams, [&](const Seam& seam) { return !groups.replaced(seam.hole); });

  report.seams = holes.seams.size();
  report.triangles_removed = std::size_t(std::count(removed.begin(), removed.end(), 1));
  if (report.triangles_removed + std::size_t(std::count(inside.begin(), inside.end(), 1)) == 0) return std::nullopt;
  return traced("weld", [&] { return weld(scene.mesh, removed, holes.seams, filling, inside, snapped); });
}

/// Holes and what is needed to cut them anew elsewhere.
struct Fitting {
  const Scene& scene;
  GrowingFilling& filling;
  const PointGrid& skin;  // the mesh's vertices
};

/// Grows holes until all seams fit, `growths` times at most; whether they do. The filling is built on where it ends,
/// unless it has to stay as it is.
bool fit(const Fitting& with, Emptied& emptied, Cut& result, int growths, bool filling_stays = false) {
  const ReskinOptions& options = with.scene.options;
  const float e = float(options.edge_length);
  for (int growth = 0;; ++growth) {
    const bool last = growth == growths;
    result = cut(with.scene, emptied.hot(), emptied.spared(), with.filling, last);
    const Misfit where = misfit(with.scene, result, *with.filling, with.skin);
    if (where.vertices.empty() && where.ends.empty()) return true;
    if (last) return false;
    emptied.grow(where.vertices);
    if (filling_stays) continue;
    std::vector<Vec3> about = emptied.points();
    about.insert(about.end(), where.ends.begin(), where.ends.end());
    with.filling.extend(about, float(options.least_margin) * e, float(options.margin) * e);
  }
}

/// The change of the Euler characteristic when all holes that fit are filled.
int euler_gained(const Cut& cut) {
  const Groups groups(cut.holes, cut.patches, false);
  int gained = 0;
  for (Index hole = 0; hole < cut.holes.count(); ++hole)
    if (groups.first(hole) == hole && !groups.failed(hole)) gained += groups.euler_gained(hole);
  return gained;
}

/// Which of the hot vertices are needed when what lies in each cube of space is asked for itself: those whose filling
/// does not have the topology of what it fills, or that must be replaced anyway. Cubes overlap; those asked at once do
/// not.
std::vector<std::uint8_t> needed(const Fitting& with, const std::vector<std::uint8_t>& hot,
                                 const std::vector<std::uint8_t>& sure, double shift) {
  const TriangleMesh& mesh = with.scene.mesh;
  const NarrowOptions& how = with.scene.options.narrow;
  const double apart = how.apart * with.scene.options.edge_length, share = how.width / how.apart;
  std::vector<std::uint8_t> kept(hot.size());
  tbb::parallel_for(0, 8, [&](int turn) {
    const DVec3 offset = DVec3(turn >> 2 & 1, turn >> 1 & 1, turn & 1) * 0.5 + shift;
    std::vector<std::uint8_t> asked(hot.size());
    for_each_index(hot.size(), [&](std::size_t v) {
      asked[v] =
          hot[v] && glm::all(glm::lessThan(glm::fract(DVec3(mesh.position(Index(v))) / apart + offset), DVec3(share)));
    });
    const Cut tried = cut(with.scene, asked, {}, with.filling, true);
    const Groups groups(tried.holes, tried.patches, false);
    std::vector<std::uint8_t> needs(tried.holes.count());
    for (Index hole = 0; hole < needs.size(); ++hole) needs[hole] = groups.failed(hole) || !groups.alike(hole);
    const auto for_each_asked = [&](const auto& visit) {
      for (Index h = 0; h < mesh.vertex.size(); ++h)
        if (tried.holes.of_triangle[h / 3] != kNone && asked[mesh.vertex[h]])
          visit(mesh.vertex[h], tried.holes.of_triangle[h / 3]);
    };
    for_each_asked([&](Index v, Index hole) { needs[hole] |= sure[v]; });
    for_each_asked([&](Index v, Index hole) {
      if (needs[hole]) std::atomic_ref(kept[v]).store(1, std::memory_order_relaxed);
    });
  });
  return kept;
}

/// What holes that fit are made of: vertices of large ones that change the topology, and those of others that are
/// replaced.
struct Worth {
  std::vector<std::uint8_t> asking, keeping;
};

Worth worth_asking(const Scene& scene, const std::vector<std::uint8_t>& hot, const std::vector<std::uint8_t>& sure,
                   const Cut& fitted) {
  const TriangleMesh& mesh = scene.mesh;
  Groups groups(fitted.holes, fitted.patches, false);
  std::vector<Index> hole(hot.size(), kNone);
  for (Index h = 0; h < mesh.vertex.size(); ++h)
    if (hot[mesh.vertex[h]] && fitted.holes.of_triangle[h / 3] != kNone)
      hole[mesh.vertex[h]] = fitted.holes.of_triangle[h / 3];
  std::vector<std::size_t> size(fitted.holes.count(), 0);
  for (Index v = 0; v < hole.size(); ++v) {
    if (hole[v] == kNone) continue;
    ++size[groups.first(hole[v])];
    if (sure[v]) groups.make_sure(hole[v]);
  }
  Worth worth{std::vector<std::uint8_t>(hot.size()), std::vector<std::uint8_t>(hot.size())};
  for (Index v = 0; v < hole.size(); ++v) {
    if (hole[v] == kNone || !groups.replaced(hole[v])) continue;
    const bool large = size[groups.first(hole[v])] >= scene.options.narrow.from && !groups.alike(hole[v]);
    (large ? worth.asking : worth.keeping)[v] = 1;
  }
  return worth;
}

/// Cuts holes that fit down to where they are needed, as long as those change the topology as much.
void narrow(const Fitting& with, const std::vector<std::uint8_t>& sure, Emptied& emptied, Cut& fitted) {
  const Span span("narrow");
  const NarrowOptions& how = with.scene.options.narrow;
  const int wanted = euler_gained(fitted);
  for (int round = 0; round < how.rounds; ++round) {
    const Worth worth = worth_asking(with.scene, emptied.hot(), sure, fitted);
    if (std::count(worth.asking.begin(), worth.asking.end(), 1) == 0) return;
    std::vector<std::uint8_t> kept = needed(with, worth.asking, sure, round * how.shift);
    for (std::size_t v = 0; v < kept.size(); ++v) kept[v] |= worth.keeping[v];
    Emptied fewer = emptied;
    fewer.keep_only(std::move(kept));
    Cut cut;
    if (!fit(with, fewer, cut, how.growths, true) || euler_gained(cut) != wanted) continue;
    emptied = std::move(fewer);
    fitted = std::move(cut);
  }
}

/// Holes grow until all seams fit, or no more: then those that fit are filled.
std::optional<Weld> replace(const Scene& scene, Emptied& emptied, const PointGrid& near_sure, GrowingFilling& filling,
                            ReskinReport& report) {
  const ReskinOptions& options = scene.options;
  const float e = float(options.edge_length);
  filling.extend(emptied.points(), float(options.least_margin) * e, float(options.margin) * e);
  const PointGrid skin(scene.mesh.vertices.position, float(options.spread) * e);
  const Fitting with{scene, filling, skin};
  for (int attempt = 0; attempt <= options.growths; ++attempt) {
    Cut tried;
    const bool fits = fit(with, emptied, tried, options.growths - attempt);
    if (fits && options.narrow.rounds > 0 && !options.replace_all && !options.alike_only)
      narrow(with, vertices_near(scene.mesh, scene.failed, near_sure), emptied, tried);
    if (auto welded = fill(scene, tried, *filling, emptied.near_bad(), near_sure, skin, report)) return welded;
    if (!fits || report.seams == 0) break;
    std::vector<Index> beside;
    for (const Seam& seam : tried.holes.seams)
      for (const Index h : seam.halfedge) beside.push_back(scene.mesh.from(h));
    emptied.grow(beside);
    filling.extend(emptied.points(), float(options.least_margin) * e, float(options.margin) * e);
  }
  return std::nullopt;
}

/// The lattice has several times as many triangles as wanted. Seams lose the vertices between those of the border
/// first, so that the triangles beyond become what they were.
void coarsen(TriangleMesh& mesh, Index first_new, const ReskinOptions& options) {
  const std::vector<std::uint8_t> frozen(first_new, 1);
  for (int pass = 0; pass < options.collapse_passes; ++pass) alter(mesh, options.alter, {}, frozen);
}

std::size_t count_new(const TriangleMesh& mesh, Index first_new) {
  const auto is_new = [&](Index t) {
    const Index* const corner = &mesh.vertex[3 * std::size_t{t}];
    return corner[0] >= first_new || corner[1] >= first_new || corner[2] >= first_new;
  };
  return indices_where(mesh.triangle_count(), is_new).size();
}

}  // namespace

ReskinReport reskin(TriangleMesh& mesh, const MeshPieces& pieces, const Certificate& certificate, const BadSites& sites,
                    const BrickLattice& lattice, const LatticeTopology& topology, Backend& backend,
                    const ReskinOptions& options, GrowingFilling* shared) {
  const std::vector<Vec3> normals = field_normals(mesh.vertices.position, backend);
  const Scene scene{
      mesh,
      pieces,
      certificate,
      lattice,
      options,
      normals,
      folded_vertices(mesh, normals),
      vertices_of_failed(pieces, certificate),
      options.replace_all ? vertices_of_failed(pieces, certificate) : failed_vertices(pieces, certificate),
      outgoing_halfedges(mesh),
      backend};
  std::vector<Vec3> sure;
  for (std::size_t i = 0; i < sites.point.size(); ++i)
    if (options.replace_all || sites.sure[i]) sure.push_back(sites.point[i]);
  ReskinReport report;
  std::optional<Weld> welded;
  if (Emptied emptied(scene, sites); emptied.any()) {
    std::optional<GrowingFilling> own;
    GrowingFilling& filling = shared ? *shared : own.emplace(lattice, topology, backend);
    welded = replace(scene, emptied, PointGrid(sure, float(options.radius * options.edge_length)), filling, report);
  }
  if (!welded) return {.holes_given_up = report.holes_given_up, .first_new_vertex = Index(mesh.vertex_count())};
  report.first_new_vertex = welded->first_new_vertex;
  const TriangleMesh old = std::move(mesh);
  mesh = std::move(welded->mesh);
  report.triangles_added += count_new(mesh, report.first_new_vertex);
  traced("coarsen", [&] { coarsen(mesh, report.first_new_vertex, options); });
  if (options.carry) traced("carry", [&] { carry_attributes(mesh, report.first_new_vertex, old, backend); });
  return report;
}

}  // namespace isoskin
