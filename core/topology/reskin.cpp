#include "core/topology/reskin.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <optional>

#include "core/mesh/one_ring.h"
#include "core/parallel.h"
#include "core/sampling/closest_point.h"
#include "core/topology/point_grid.h"
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
  const LatticeTopology& topology;
  Backend& backend;
  const ReskinOptions& options;
  const std::vector<std::uint8_t> folded;  // per vertex
};

/// One byte a vertex: 1 where a triangle about it faces away from where the field's surface does.
std::vector<std::uint8_t> folded_vertices(const TriangleMesh& mesh, Backend& backend) {
  const std::vector<Vec3> normals = field_normals(mesh.vertices.position, backend);
  const VertexCorners corners = vertex_corners(mesh);
  std::vector<std::uint8_t> folded(mesh.vertex_count());
  for_each_index(folded.size(), [&](std::size_t v) {
    const Vec3& p = mesh.position(Index(v));
    for (Index i = corners.first[v]; i < corners.first[v + 1] && !folded[v]; ++i) {
      const Index a = mesh.to(corners.corner[i]), b = mesh.from(TriangleMesh::prev(corners.corner[i]));
      const Vec3 faces = glm::cross(mesh.position(a) - p, mesh.position(b) - p);
      folded[v] = !(glm::dot(faces, normals[v] + normals[a] + normals[b]) > 0.0f);
    }
  });
  return folded;
}

std::vector<std::uint8_t> near_points(const std::vector<Vec3>& position, const PointGrid& points) {
  std::vector<std::uint8_t> near(position.size());
  for_each_index(near.size(), [&](std::size_t v) { near[v] = points.any_near(position[v]); });
  return near;
}

/// Vertices of failed pieces near a point.
std::vector<std::uint8_t> hot_vertices(const Scene& scene, const PointGrid& points) {
  std::vector<std::uint8_t> hot(scene.mesh.vertex_count());
  for_each_index(hot.size(), [&](std::size_t v) {
    hot[v] = scene.certificate.mesh_piece[scene.pieces.of_vertex[v]] != Fault::none &&
             points.any_near(scene.mesh.position(Index(v)));
  });
  return hot;
}

/// Skin that is folded makes borders that no seam fits: what is hot reaches on to the fold's end.
void reach_over_folds(const Scene& scene, std::vector<std::uint8_t>& hot) {
  const TriangleMesh& mesh = scene.mesh;
  const std::vector<Index> outgoing = outgoing_halfedges(mesh);
  std::vector<Index> front;
  for (Index v = 0; v < hot.size(); ++v)
    if (hot[v]) front.push_back(v);
  while (!front.empty()) {
    const Index start = outgoing[front.back()];
    front.pop_back();
    for_each_leaving(mesh, start, [&](Index h) {
      const Index to = mesh.to(h);
      if (scene.folded[to] && !hot[to]) front.push_back(to);
      hot[to] |= scene.folded[to];
    });
  }
}

/// The lattice's surface as far as `reach` about the points.
Filling filling_about(const Scene& scene, const std::vector<Vec3>& points, float reach) {
  const float half_brick = 0.5f * BrickLattice::kCells * float(scene.lattice.spacing);
  const PointGrid coarse(points, reach + std::sqrt(3.0f) * half_brick);
  std::vector<std::uint8_t> wanted(scene.lattice.brick_count());
  for_each_index(wanted.size(), [&](std::size_t b) {
    const DVec3 corner = scene.lattice.point(BrickLattice::kCells * scene.lattice.coordinate[b]);
    wanted[b] = coarse.any_near(Vec3(corner) + half_brick);
  });
  return make_filling(marching_cubes_open(scene.lattice, scene.topology, wanted), scene.backend);
}

/// Closed pieces of the filling that failed and that no seam has reached: those without a mesh, and those whose mesh
/// was emptied.
std::vector<std::uint8_t> whole_pieces(const Filling& filling, const Certificate& certificate,
                                       const std::vector<std::uint8_t>& hot, const std::vector<std::uint8_t>& inside) {
  const auto& triangle = filling.surface.triangle;
  std::vector<std::uint8_t> seen = inside, whole_piece(inside.size(), 0);
  for (Index start = 0; start < inside.size(); ++start) {
    if (seen[start]) continue;
    std::vector<Index> piece(1, start);
    seen[start] = 1;
    bool whole = true, emptied = false;
    for (std::size_t i = 0; i < piece.size(); ++i)
      for (Index h = 3 * piece[i]; h < 3 * piece[i] + 3; ++h) {
        const Index a = triangle[h], b = triangle[TriangleMesh::next(h)];
        const Index t = filling.triangle(b, a);
        emptied |= hot[a];
        whole &= t != kNone && !inside[t];
        if (t == kNone || seen[t]) continue;
        seen[t] = 1;
        piece.push_back(t);
      }
    const Fault fault = certificate.lattice_piece[filling.surface.piece[triangle[3 * start]]];
    if (whole && (fault == Fault::missing || (fault != Fault::none && emptied)))
      for (const Index t : piece) whole_piece[t] = 1;
  }
  return whole_piece;
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

  /// Not where what comes is what goes: one patch like the one hole.
  bool replaced(Index hole) const { return replaced_group(root(hole)); }
  bool replaces(Index patch) const { return replaced_group(root(holes_ + patch)); }

private:
  bool replaced_group(Index g) const {
    const bool alike = holes_in_[g] == 1 && patches_in_[g] == 1 && euler_gained_[g] == 0;
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

/// One try with the given bad points.
struct Attempt {
  std::vector<Vec3> grow_at;  // border points of seams that failed
  std::optional<Weld> weld;   // nothing where seams failed, or nothing had to be replaced
  ReskinReport report;
};

void grow(const Scene& scene, const Seam& seam, Attempt& result) {
  std::vector<Index> at = seam.failed_at;
  if (at.empty()) at = seam.halfedge;
  for (const Index h : at) result.grow_at.push_back(scene.mesh.position(scene.mesh.from(h)));
}

/// `last`: holes whose seams fail are left as they were.
Attempt attempt(const Scene& scene, const std::vector<Vec3>& bad, const std::vector<Vec3>& sure, bool last) {
  const float radius = float(scene.options.radius * scene.options.edge_length);
  const PointGrid near_bad(bad, radius), near_sure(sure, radius);
  Holes holes = traced("cut holes", [&] {
    std::vector<std::uint8_t> hot = hot_vertices(scene, near_bad);
    reach_over_folds(scene, hot);
    return cut_holes(scene.mesh, hot);
  });
  const float reach = radius + float(scene.options.margin * scene.options.edge_length);
  const Filling filling = traced("filling", [&] { return filling_about(scene, bad, reach); });
  const std::vector<Index> snapped =
      traced("seams", [&] { return lay_seams(scene.mesh, holes, filling, scene.lattice.spacing, scene.backend); });
  const Patches patches = traced("patches", [&] { return find_patches(holes, filling); });

  Attempt result;
  for (const Seam& seam : holes.seams)
    if (seam.failed) grow(scene, seam, result);
  if (!result.grow_at.empty() && !last) return result;

  Groups groups(holes, patches, scene.options.alike_only);
  const std::vector<std::uint8_t> surely_hot = hot_vertices(scene, near_sure);
  for (Index t = 0; t < holes.of_triangle.size(); ++t)
    for (Index h = 3 * t; h < 3 * t + 3 && holes.of_triangle[t] != kNone; ++h)
      if (surely_hot[scene.mesh.vertex[h]]) groups.make_sure(holes.of_triangle[t]);

  std::vector<std::uint8_t> inside(filling.triangle_count());
  for (Index t = 0; t < inside.size(); ++t) inside[t] = patches.of_triangle[t] != kNone;
  const std::vector<std::uint8_t> whole =
      whole_pieces(filling, scene.certificate, near_points(filling.surface.position, near_bad), inside);
  for (Index t = 0; t < inside.size(); ++t)
    inside[t] = (whole[t] && !scene.options.alike_only) ||
                (patches.of_triangle[t] != kNone && groups.replaces(patches.of_triangle[t]));
  std::vector<std::uint8_t> removed(scene.mesh.triangle_count());
  for (Index t = 0; t < removed.size(); ++t)
    removed[t] = holes.of_triangle[t] != kNone && groups.replaced(holes.of_triangle[t]);
  for (Index h = 0; h < holes.count(); ++h) {
    result.report.holes_given_up += groups.failed(h);
    result.report.holes_alike += !groups.failed(h) && !groups.replaced(h);
  }
  std::erase_if(holes.seams, [&](const Seam& seam) { return !groups.replaced(seam.hole); });

  result.report.seams = holes.seams.size();
  result.report.triangles_removed = std::size_t(std::count(removed.begin(), removed.end(), 1));
  if (result.report.triangles_removed + std::size_t(std::count(inside.begin(), inside.end(), 1)) == 0) return result;
  result.weld = traced("weld", [&] { return weld(scene.mesh, removed, holes.seams, filling, inside, snapped); });
  if (!result.weld)
    for (const Seam& seam : holes.seams) grow(scene, seam, result);
  return result;
}

/// Moves the points nearer than `radius` to one of `places` from one list to the other.
void take_near(const std::vector<Vec3>& places, float radius, std::vector<Vec3>& from, std::vector<Vec3>& to) {
  const PointGrid near(places, radius);
  std::erase_if(from, [&](const Vec3& p) {
    const bool taken = near.any_near(p);
    if (taken) to.push_back(p);
    return taken;
  });
}

/// The lattice has several times as many triangles as wanted.
void coarsen(TriangleMesh& mesh, Index first_new, const ReskinOptions& options) {
  const std::vector<std::uint8_t> frozen(first_new, 1);
  for (int pass = 0; pass < options.collapse_passes; ++pass) alter(mesh, options.alter, {}, frozen);
}

std::size_t count_new(const TriangleMesh& mesh, Index first_new) {
  std::size_t triangles = 0;
  for (Index h = 0; h < mesh.vertex.size(); h += 3)
    triangles += mesh.vertex[h] >= first_new || mesh.vertex[h + 1] >= first_new || mesh.vertex[h + 2] >= first_new;
  return triangles;
}

}  // namespace

ReskinReport reskin(TriangleMesh& mesh, const MeshPieces& pieces, const Certificate& certificate, const BadSites& sites,
                    const BrickLattice& lattice, const LatticeTopology& topology, Backend& backend,
                    const ReskinOptions& options) {
  const Scene scene{mesh, pieces, certificate, lattice, topology, backend, options, folded_vertices(mesh, backend)};
  std::vector<Vec3> bad, sure, left_alone;
  for (std::size_t i = 0; i < sites.point.size(); ++i) {
    (options.suspects_only && sites.odd[i] ? left_alone : bad).push_back(sites.point[i]);
    if (options.replace_all || sites.sure[i]) sure.push_back(sites.point[i]);
  }
  Attempt tried;
  for (int growth = 0; growth <= options.growths && !bad.empty(); ++growth) {
    tried = attempt(scene, bad, sure, growth == options.growths);
    if (tried.weld || tried.grow_at.empty()) break;
    bad.insert(bad.end(), tried.grow_at.begin(), tried.grow_at.end());
    take_near(tried.grow_at, float(options.spread * options.edge_length), left_alone, bad);
  }
  if (!tried.weld)
    return {.holes_given_up = tried.report.holes_given_up, .first_new_vertex = Index(mesh.vertex_count())};
  ReskinReport report = tried.report;
  report.first_new_vertex = tried.weld->first_new_vertex;
  const TriangleMesh old = std::move(mesh);
  mesh = std::move(tried.weld->mesh);
  report.triangles_added += count_new(mesh, report.first_new_vertex);
  traced("coarsen", [&] { coarsen(mesh, report.first_new_vertex, options); });
  if (options.carry) traced("carry", [&] { carry_attributes(mesh, report.first_new_vertex, old, backend); });
  return report;
}

}  // namespace isoskin
