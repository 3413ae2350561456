#include "core/refine/place_filling.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numeric>
#include <set>
#include <tuple>
#include <utility>

#include "core/disjoint_sets.h"
#include "core/mesh/independent_edits.h"
#include "core/parallel.h"
#include "core/sampling/closest_point.h"
#include "core/topology/bad_sites.h"
#include "core/topology/capped_part.h"
#include "core/topology/changed_sides.h"
#include "core/topology/match.h"
#include "core/topology/point_grid.h"
#include "core/topology/reskin.h"
#include "core/trace.h"

namespace isoskin {
namespace {

constexpr double kMostly = 0.75;  // of a piece's vertices near places: it is emptied
constexpr int kRings = 3;         // of a part about its borders, which have to stay

/// One of those in each cube of this width.
std::vector<Vec3> thinned(const std::vector<Vec3>& points, double width) {
  std::set<std::array<int, 3>> seen;
  std::vector<Vec3> some;
  for (const Vec3& p : points) {
    const IVec3 cube(glm::floor(DVec3(p) / width));
    if (seen.insert({cube.x, cube.y, cube.z}).second) some.push_back(p);
  }
  return some;
}

/// Some triangles of a mesh, in sheets that hang together by their edges.
struct Sheets {
  std::vector<Index> of;             // per triangle: its sheet
  std::vector<int> euler;            // per sheet, with its border
  std::vector<std::uint8_t> border;  // per sheet: whether it has one

  Index count() const { return Index(euler.size()); }
};

Sheets sheets_of(const TriangleMesh& mesh, const std::vector<Index>& triangles) {
  Sheets sheets;
  sheets.of.assign(triangles.size(), kNone);
  std::vector<Index> at(mesh.triangle_count(), kNone), counted_in(mesh.vertex_count(), kNone);
  for (Index i = 0; i < triangles.size(); ++i) at[triangles[i]] = i;
  for (Index start = 0; start < triangles.size(); ++start) {
    if (sheets.of[start] != kNone) continue;
    const Index sheet = sheets.of[start] = sheets.count();
    int euler = 0;
    bool border = false;
    std::vector<Index> stack(1, start);
    while (!stack.empty()) {
      const Index t = triangles[stack.back()];
      stack.pop_back();
      ++euler;
      for (Index h = 3 * t; h < 3 * t + 3; ++h) {
        euler += std::exchange(counted_in[mesh.vertex[h]], sheet) != sheet;
        const Index next = at[mesh.twin[h] / 3];
        border |= next == kNone;
        euler -= next == kNone || h < mesh.twin[h];
        if (next == kNone || sheets.of[next] != kNone) continue;
        sheets.of[next] = sheet;
        stack.push_back(next);
      }
    }
    sheets.euler.push_back(euler);
    sheets.border.push_back(border);
  }
  return sheets;
}

/// What goes and comes together.
struct Groups {
  std::vector<Index> gone, fresh;   // per triangle of PartChanges: its group
  std::vector<std::uint8_t> alike;  // per group: one sheet becomes one like it, with the same border
  std::vector<int> lost;            // per group: by how much its Euler number falls

  Index count() const { return Index(alike.size()); }
};

class PlaceFiller {
public:
  PlaceFiller(const std::vector<Vec3>& places, const Field& field, const BrickLattice& lattice,
              const LatticeTopology& topology, const FarCorners& far, GrowingFilling& filling, Backend& backend,
              const PlaceFillingOptions& options)
      : places_(places),
        field_(field),
        lattice_(lattice),
        topology_(topology),
        far_(far),
        filling_(filling),
        backend_(backend),
        options_(options),
        near_(places, float(options.radius * options.edge_length)) {}

  PlaceFillingReport fill(TriangleMesh& skin) {
    for (double about = options_.about;; about *= 2.0) {
      const CappedPart part = cut_out(skin, triangles_about(skin, about), kRings);
      const bool whole = part.triangle.size() == skin.triangle_count();
      TriangleMesh now = part.mesh;
      const Replaced replaced = replaced_pieces(part);
      const ReskinReport done = reskin_part(replaced, now);
      const PartChanges changes = changes_of(part, now, done.first_new_vertex);
      if (changes.at_edge && !whole) continue;
      PlaceFillingReport report;
      report.left_out = done.holes_given_up;
      if (changes.gone.empty() && changes.fresh.empty()) return report;
      const PartChanges kept = certified(skin, part, now, changes, replaced, report);
      if (kept.gone.empty() && kept.fresh.empty()) return report;
      carry_attributes(now, done.first_new_vertex, without_fans(part), backend_);
      put_back(part, now, kept, skin);
      return report;
    }
  }

private:
  /// Pieces of a part that become pieces of the lattice.
  struct Replaced {
    MeshPieces pieces;
    Certificate certificate;       // what reskin() may touch
    std::map<Index, Index> piece;  // of the lattice, by that of the part
    std::vector<Vec3> site;        // their vertices
  };

  std::vector<Index> triangles_about(const TriangleMesh& skin, double about) const {
    const double e = options_.edge_length;
    const std::vector<Vec3> some = thinned(places_, 0.5 * e);
    // A cube's points lie no farther than its diagonal from the one that stands for them.
    const PointGrid grid(some, float((options_.radius + about + 0.9) * e));
    std::vector<std::uint8_t> close(skin.vertex_count());
    for_each_index(close.size(), [&](std::size_t v) { close[v] = grid.any_near(skin.position(Index(v))); });
    std::vector<Index> triangles = indices_where(skin.triangle_count(), [&](Index t) {
      const Index* v = &skin.vertex[3 * t];
      return close[v[0]] || close[v[1]] || close[v[2]];
    });
    add_small_pieces(skin, triangles);
    return triangles;
  }

  /// Where only some of a piece is among the triangles, and it is small or may be emptied, all of it comes.
  void add_small_pieces(const TriangleMesh& skin, std::vector<Index>& triangles) const {
    std::vector<std::uint8_t> seen(skin.triangle_count(), 0), among(skin.triangle_count(), 0);
    std::vector<std::uint8_t> is_near(skin.vertex_count());
    std::vector<Index> met(skin.triangle_count(), kNone);  // beyond what hangs together with triangle number ...
    for_each_index(is_near.size(), [&](std::size_t v) { is_near[v] = near_.any_near(skin.position(Index(v))); });
    for (const Index t : triangles) among[t] = 1;
    const std::size_t count = triangles.size();
    for (std::size_t i = 0; i < count; ++i) {
      if (seen[triangles[i]]) continue;
      std::vector<Index> piece(1, triangles[i]), beyond;
      seen[triangles[i]] = 1;
      std::size_t near = 0;  // corners
      const auto most = [&] { return std::max(2 * options_.small_piece, std::size_t(double(near) / 3.0 / kMostly)); };
      // First what is among them and hangs together, then what lies beyond.
      std::vector<Index> outside;
      for (std::size_t k = 0; k < piece.size(); ++k)
        for (Index h = 3 * piece[k]; h < 3 * piece[k] + 3; ++h) {
          near += is_near[skin.vertex[h]];
          const Index next = skin.twin[h] / 3;
          if (!among[next])
            outside.push_back(next);
          else if (!std::exchange(seen[next], 1))
            piece.push_back(next);
        }
      for (std::size_t k = 0; k < outside.size() && piece.size() + beyond.size() <= most(); ++k) {
        if (among[outside[k]] || std::exchange(met[outside[k]], Index(i)) == i) continue;
        beyond.push_back(outside[k]);
        for (Index h = 3 * outside[k]; h < 3 * outside[k] + 3; ++h) outside.push_back(skin.twin[h] / 3);
      }
      if (piece.size() + beyond.size() <= most()) triangles.insert(triangles.end(), beyond.begin(), beyond.end());
    }
    std::sort(triangles.begin(), triangles.end());
    triangles.erase(std::unique(triangles.begin(), triangles.end()), triangles.end());
  }

  Replaced replaced_pieces(const CappedPart& part) const {
    Replaced out;
    out.pieces = mesh_pieces(part.mesh);
    std::vector<std::vector<Index>> vertices(out.pieces.count());
    std::vector<std::uint8_t> goes_on(out.pieces.count(), 0);
    for (Index v = 0; v < part.mesh.vertex_count(); ++v) {
      vertices[out.pieces.of_vertex[v]].push_back(v);
      goes_on[out.pieces.of_vertex[v]] |= part.is_centre(v);
    }
    out.certificate.mesh_piece.assign(out.pieces.count(), Fault::wrong_side);
    out.certificate.lattice_piece.assign(topology_.piece_count(), Fault::none);
    for (const Cluster& cluster : match_pieces(part.mesh, out.pieces, lattice_, topology_, options_.least_piece)) {
      if (cluster.mesh.size() != 1 || cluster.lattice.size() != 1 || goes_on[cluster.mesh.front()]) continue;
      const Index piece = cluster.mesh.front(), lattice_piece = cluster.lattice.front();
      const std::vector<Index>& all = vertices[piece];
      const auto near =
          std::count_if(all.begin(), all.end(), [&](Index v) { return near_.any_near(part.mesh.position(v)); });
      const bool small = all.size() <= options_.small_piece;
      const bool alike = out.pieces.euler[piece] == topology_.euler[lattice_piece];
      if (alike && (small ? near > 0 : double(near) >= kMostly * double(all.size()))) {
        out.certificate.lattice_piece[lattice_piece] = Fault::wrong_side;
        out.piece[piece] = lattice_piece;
        for (const Index v : all) out.site.push_back(part.mesh.position(v));
      } else if (small) {
        out.certificate.mesh_piece[piece] = Fault::none;
      }
    }
    return out;
  }

  ReskinReport reskin_part(const Replaced& replaced, TriangleMesh& now) const {
    BadSites sites;
    for (const Vec3& place : places_) sites.add(place, true);
    for (const Vec3& place : replaced.site) sites.add(place, true);
    ReskinOptions options;
    options.edge_length = options_.edge_length;
    options.radius = options_.radius;
    options.replace_all = true;
    options.collapse_passes = 0;  // as fine as the lattice: coarser triangles would cut short what they are here for
    options.carry = false;
    const ReskinReport done =
        reskin(now, replaced.pieces, replaced.certificate, sites, lattice_, topology_, backend_, options, &filling_);
    backend_.project(std::span(now.vertices.position).subspan(done.first_new_vertex), options_.project, {});
    return done;
  }

  /// Of the changes those that leave the certificate as it is.
  PartChanges certified(const TriangleMesh& skin, const CappedPart& part, const TriangleMesh& now,
                        const PartChanges& changes, const Replaced& replaced, PlaceFillingReport& report) const {
    const Groups groups = gather(part, now, changes, replaced);
    const std::vector<std::uint8_t> wrong =
        sets_gone_wrong(difference(part, now, changes, groups), skin, field_, lattice_, far_);
    std::vector<std::uint8_t> right = groups.alike;
    for (Index g = 0; g < groups.count(); ++g) right[g] = right[g] && !wrong[g];
    add_even_ones(skin, part, now, changes, groups, wrong, right);
    for (Index g = 0; g < groups.count(); ++g) ++(right[g] ? report.filled : report.left_out);
    return of_groups(changes, groups, right);
  }

  static PartChanges of_groups(const PartChanges& changes, const Groups& groups,
                               const std::vector<std::uint8_t>& wanted) {
    PartChanges kept = changes;
    kept.gone.clear();
    kept.fresh.clear();
    for (std::size_t i = 0; i < changes.gone.size(); ++i)
      if (wanted[groups.gone[i]]) kept.gone.push_back(changes.gone[i]);
    for (std::size_t i = 0; i < changes.fresh.size(); ++i)
      if (wanted[groups.fresh[i]]) kept.fresh.push_back(changes.fresh[i]);
    return kept;
  }

  /// A gap in a sheet, or a thread, that has come where none was, and gone where one was, changes the topology of two
  /// groups and not that of their piece: all of a piece come in together, or else pairs of them, the largest first.
  static void add_even_ones(const TriangleMesh& skin, const CappedPart& part, const TriangleMesh& now,
                            const PartChanges& changes, const Groups& groups, const std::vector<std::uint8_t>& wrong,
                            std::vector<std::uint8_t>& right) {
    const auto odd = [&](Index g) { return !groups.alike[g] && !wrong[g]; };
    bool any = false;
    for (Index g = 0; g < groups.count(); ++g) any |= odd(g);
    if (!any) return;
    const MeshPieces pieces = mesh_pieces(skin);
    std::vector<std::set<Index>> pieces_of_group(groups.count());
    std::vector<std::size_t> size(groups.count(), 0);
    for (const Index g : groups.fresh) ++size[g];
    for (std::size_t i = 0; i < changes.gone.size(); ++i)
      if (odd(groups.gone[i])) {
        const Index v = part.mesh.vertex[3 * changes.gone[i]];
        if (!part.is_centre(v)) pieces_of_group[groups.gone[i]].insert(pieces.of_vertex[part.vertex[v]]);
      }
    std::map<Index, std::vector<Index>> of_piece;
    for (Index g = 0; g < groups.count(); ++g)
      if (odd(g) && pieces_of_group[g].size() == 1) of_piece[*pieces_of_group[g].begin()].push_back(g);
    for (auto& [piece, some] : of_piece) {
      const auto come_together = [&](std::vector<std::uint8_t> together) {
        TriangleMesh after = skin;
        put_back(part, now, of_groups(changes, groups, together), after);
        if (!same_pieces(skin, pieces, after)) return false;
        for (const Index g : some) right[g] = together[g];
        return true;
      };
      std::vector<std::uint8_t> all(groups.count(), 0), pairs = all;
      for (const Index g : some) all[g] = 1;
      if (std::accumulate(some.begin(), some.end(), 0, [&](int sum, Index g) { return sum + groups.lost[g]; }) == 0 &&
          come_together(all))
        continue;
      std::stable_sort(some.begin(), some.end(), [&](Index g, Index h) { return size[g] > size[h]; });
      for (std::size_t i = 0; i < some.size(); ++i)
        for (std::size_t k = i + 1; k < some.size() && !pairs[some[i]]; ++k) {
          if (pairs[some[k]] || groups.lost[some[i]] == 0 || groups.lost[some[i]] != -groups.lost[some[k]]) continue;
          pairs[some[i]] = pairs[some[k]] = 1;
          if (!come_together(pairs)) pairs[some[i]] = pairs[some[k]] = 0;
        }
    }
  }

  /// Do the vertices that stay hang together as they did, in pieces of the same Euler numbers, and are there no others?
  static bool same_pieces(const TriangleMesh& before, const MeshPieces& pieces, const TriangleMesh& after) {
    const MeshPieces pieces_after = mesh_pieces(after);
    if (pieces.count() != pieces_after.count()) return false;
    std::vector<Index> piece_of_id(before.next_id, kNone);
    for (Index v = 0; v < before.vertex_count(); ++v) piece_of_id[before.vertices.id[v]] = pieces.of_vertex[v];
    std::vector<Index> becomes(pieces.count(), kNone);
    for (Index v = 0; v < after.vertex_count(); ++v) {
      if (after.vertices.id[v] >= before.next_id) continue;
      const Index was = piece_of_id[after.vertices.id[v]], is = pieces_after.of_vertex[v];
      if (becomes[was] == kNone) becomes[was] = is;
      if (becomes[was] != is || pieces.euler[was] != pieces_after.euler[is]) return false;
    }
    std::sort(becomes.begin(), becomes.end());
    return becomes.back() != kNone && std::adjacent_find(becomes.begin(), becomes.end()) == becomes.end();
  }

  /// Sheets that have a border in common, and pieces that become each other.
  Groups gather(const CappedPart& part, const TriangleMesh& now, const PartChanges& changes,
                const Replaced& replaced) const {
    const Sheets gone = sheets_of(part.mesh, changes.gone), fresh = sheets_of(now, changes.fresh);
    // Nodes: sheets that are gone, fresh sheets, pieces of the lattice.
    const Index first_piece = gone.count() + fresh.count();
    const std::size_t nodes = first_piece + topology_.piece_count();
    DisjointSets sets(nodes);
    std::vector<Index> looks_at(part.mesh.vertex.size(), kNone);  // per halfedge that stays: a sheet that is gone
    for (std::size_t i = 0; i < changes.gone.size(); ++i)
      for (Index h = 3 * changes.gone[i]; h < 3 * changes.gone[i] + 3; ++h) looks_at[part.mesh.twin[h]] = gone.of[i];
    for (std::size_t i = 0; i < changes.fresh.size(); ++i)
      for (Index h = 3 * changes.fresh[i]; h < 3 * changes.fresh[i] + 3; ++h)
        if (const Index was = changes.was[now.twin[h] / 3]; was != kNone)
          sets.unite(looks_at[3 * was + now.twin[h] % 3], gone.count() + fresh.of[i]);
    for (std::size_t i = 0; i < changes.gone.size(); ++i) {
      const auto becomes = replaced.piece.find(replaced.pieces.of_vertex[part.mesh.vertex[3 * changes.gone[i]]]);
      if (becomes != replaced.piece.end() && !gone.border[gone.of[i]])
        sets.unite(gone.of[i], first_piece + becomes->second);
    }
    for (const auto& [sheet, piece] : pieces_of(now, changes, fresh, replaced))
      sets.unite(gone.count() + sheet, first_piece + piece);
    std::vector<Index> number(nodes, kNone);
    Groups groups;
    std::vector<std::array<int, 3>>
        tally;  // sheets that are gone, fresh sheets, by how much their Euler numbers differ
    for (Index i = 0; i < first_piece; ++i) {
      Index& g = number[sets.root(i)];
      if (g == kNone) {
        g = Index(tally.size());
        tally.emplace_back();
      }
      const bool goes = i < gone.count();
      ++tally[g][goes ? 0 : 1];
      tally[g][2] += goes ? gone.euler[i] : -fresh.euler[i - gone.count()];
    }
    for (const auto& [goes, comes, lost] : tally) {
      groups.alike.push_back(goes == 1 && comes == 1 && lost == 0);
      groups.lost.push_back(lost);
    }
    for (const Index sheet : gone.of) groups.gone.push_back(number[sets.root(sheet)]);
    for (const Index sheet : fresh.of) groups.fresh.push_back(number[sets.root(gone.count() + sheet)]);
    return groups;
  }

  /// Sheets without a border, with the pieces of the lattice that they are, as told by where they lie.
  std::vector<std::pair<Index, Index>> pieces_of(const TriangleMesh& now, const PartChanges& changes,
                                                 const Sheets& fresh, const Replaced& replaced) const {
    std::vector<Box> box(fresh.count());
    for (std::size_t i = 0; i < changes.fresh.size(); ++i)
      for (Index h = 3 * changes.fresh[i]; h < 3 * changes.fresh[i] + 3; ++h)
        box[fresh.of[i]].add(DVec3(now.position(now.vertex[h])));
    std::set<Index> wanted;
    for (const auto& [piece, lattice_piece] : replaced.piece) wanted.insert(lattice_piece);
    std::vector<std::pair<Index, Index>> found;
    for (Index sheet = 0; sheet < fresh.count(); ++sheet) {
      if (fresh.border[sheet] || wanted.empty()) continue;
      const auto beside = [&](Index piece) {
        const Box& there = topology_.box[piece];
        return glm::length(there.low - box[sheet].low) + glm::length(there.high - box[sheet].high);
      };
      const auto nearest =
          std::min_element(wanted.begin(), wanted.end(), [&](Index p, Index q) { return beside(p) < beside(q); });
      found.emplace_back(sheet, *nearest);
      wanted.erase(nearest);
    }
    return found;
  }

  static Difference difference(const CappedPart& part, const TriangleMesh& now, const PartChanges& changes,
                               const Groups& groups) {
    Difference out;
    out.sets = groups.count();
    const auto add = [&](const TriangleMesh& mesh, Index t, std::array<Index, 3> order) {
      for (const Index k : order) {
        out.mesh.vertex.push_back(Index(out.mesh.vertices.position.size()));
        out.mesh.vertices.position.push_back(mesh.position(mesh.vertex[3 * t + k]));
      }
    };
    for (const Index t : changes.fresh) add(now, t, {0, 1, 2});
    for (const Index t : changes.gone) add(part.mesh, t, {0, 2, 1});
    out.set = groups.fresh;
    out.set.insert(out.set.end(), groups.gone.begin(), groups.gone.end());
    return out;
  }

  static TriangleMesh without_fans(const CappedPart& part) {
    TriangleMesh open;
    open.vertices = part.mesh.vertices;
    open.vertex.assign(part.mesh.vertex.begin(), part.mesh.vertex.begin() + std::ptrdiff_t(3 * part.triangle.size()));
    return open;
  }

  const std::vector<Vec3>& places_;
  const Field& field_;
  const BrickLattice& lattice_;
  const LatticeTopology& topology_;
  const FarCorners& far_;
  GrowingFilling& filling_;
  Backend& backend_;
  const PlaceFillingOptions& options_;
  const PointGrid near_;
};

}  // namespace

PlaceFillingReport fill_places(TriangleMesh& skin, const std::vector<Vec3>& places, const Field& field,
                               const BrickLattice& lattice, const LatticeTopology& topology, const FarCorners& far,
                               GrowingFilling& filling, Backend& backend, const PlaceFillingOptions& options) {
  return PlaceFiller(places, field, lattice, topology, far, filling, backend, options).fill(skin);
}

}  // namespace isoskin
