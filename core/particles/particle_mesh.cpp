#include "core/particles/particle_mesh.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "core/counter_random.h"
#include "core/particles/restricted_delaunay.h"
#include "core/topology/point_grid.h"

namespace isoskin {
namespace {

/// Random lines in space that run along the three axes with one line a square of side s meet a surface 3/2 times on an
/// area of s^2 on average.
double area_seen(const BrickLattice& lattice, const LatticeTopology& topology) {
  return double(topology.crossing_count) * lattice.spacing * lattice.spacing / 1.5;
}

/// Random points of the bricks that the surface crosses; one without a gradient to follow is drawn again.
std::vector<Vec3> random_starts(const BrickLattice& lattice, const LatticeTopology& topology, Backend& backend,
                                const ParticleMeshOptions& options) {
  std::vector<Index> bricks;
  for (Index b = 0; b < lattice.brick_count(); ++b)
    if (!topology.parts[b].part.empty()) bricks.push_back(b);
  const double area = area_seen(lattice, topology);
  std::vector<Vec3> starts(std::size_t(std::ceil(options.starts * area / (options.edge_length * options.edge_length))));
  const auto draw = [&](std::size_t i, std::uint64_t entry) {
    const std::size_t b = counter_random(options.seed, entry) % bricks.size();
    const DVec3 local = double(BrickLattice::kCells) * counter_point(options.seed + 1, entry);
    const DVec3 corner(BrickLattice::kCells * lattice.coordinate[bricks[b]]);
    starts[i] = Vec3(lattice.origin + lattice.spacing * (corner + local));
  };
  for_each_index(starts.size(), [&](std::size_t i) { draw(i, i); });
  std::vector<float> value(starts.size());
  std::vector<Vec3> gradient(starts.size());
  for (int again = 1; again <= options.most_draws; ++again) {
    backend.evaluate(starts, value, gradient);
    for_each_index(starts.size(), [&](std::size_t i) {
      if (gradient[i] == Vec3(0.0f)) draw(i, again * starts.size() + i);
    });
  }
  return starts;
}

/// What has arrived, on the surface to the projection's tolerance.
std::vector<Vec3> on_surface(std::vector<Vec3> points, std::vector<std::uint8_t> arrived, Backend& backend,
                             const ProjectOptions& project) {
  std::vector<ProjectStatus> status(points.size());
  backend.project(points, project, status);
  std::vector<Vec3> kept;
  for (std::size_t i = 0; i < points.size(); ++i)
    if (arrived[i] && status[i] == ProjectStatus::converged) kept.push_back(points[i]);
  return kept;
}

/// Where particles are missing: at the crossing of every starved dual edge, and about every sample without a disc at
/// the crossing that is farthest from it.
std::vector<Vec3> missing_samples(const RestrictedDelaunay& joined, const std::vector<Vec3>& samples,
                                  const Field& field, double gap) {
  struct Farthest {
    DVec3 point{0.0};
    double square = -1.0;
  };
  std::vector<Farthest> farthest(samples.size());
  for (const DualTriangle& t : joined.triangle) {
    const auto at_fault = [&](Index v) { return std::binary_search(joined.no_disc.begin(), joined.no_disc.end(), v); };
    if (std::none_of(t.corner.begin(), t.corner.end(), at_fault)) continue;
    const DVec3 crossing = dual_crossing(t, field), away = crossing - DVec3(samples[t.corner[0]]);
    for (const Index v : t.corner)
      if (const double square = glm::dot(away, away); square > farthest[v].square) farthest[v] = {crossing, square};
  }
  std::vector<Vec3> wanted;
  for (const DualTriangle& t : joined.starved) wanted.emplace_back(dual_crossing(t, field));
  for (const Index v : joined.no_disc)
    if (farthest[v].square > 0.0) wanted.emplace_back(farthest[v].point);

  std::vector<Vec3> all = samples, added;
  all.insert(all.end(), wanted.begin(), wanted.end());
  const PointGrid grid(all, float(gap));
  std::vector<std::uint8_t> there(all.size(), 0);
  std::fill_n(there.begin(), samples.size(), std::uint8_t{1});
  for (std::size_t i = samples.size(); i < all.size(); ++i) {
    bool near = false;
    grid.near(all[i], [&](Index j, float) { near |= there[j] != 0; });
    there[i] = !near;
    if (!near) added.push_back(all[i]);
  }
  return added;
}

/// The mesh of the triangles, without samples that none of them has.
TriangleMesh mesh_of(const std::vector<DualTriangle>& triangles, const std::vector<Vec3>& samples) {
  std::vector<Index> renumbered(samples.size(), kNone), corners;
  for (const DualTriangle& t : triangles)
    for (const Index v : t.corner) renumbered[v] = 0;
  std::vector<Vec3> positions;
  for (std::size_t v = 0; v < samples.size(); ++v) {
    if (renumbered[v] == kNone) continue;
    renumbered[v] = Index(positions.size());
    positions.push_back(samples[v]);
  }
  for (const DualTriangle& t : triangles)
    for (const Index v : t.corner) corners.push_back(renumbered[v]);
  return make_mesh(std::move(positions), std::move(corners));
}

}  // namespace

TriangleMesh particle_mesh(const Field& field, Backend& backend, const BrickLattice& lattice,
                           const LatticeTopology& topology, const ProjectOptions& project,
                           const ParticleMeshOptions& options, ParticleMeshReport* report) {
  ParticleMeshReport unwanted;
  ParticleMeshReport& r = report ? *report : unwanted;
  r = {};
  if (topology.piece_count() == 0) return {};
  std::vector<Vec3> samples = random_starts(lattice, topology, backend, options);
  r.starts = samples.size();
  std::vector<std::uint8_t> arrived(samples.size());
  r.fall = fall_to_surface(samples, arrived, backend, options.particles);
  samples = on_surface(std::move(samples), std::move(arrived), backend, project);

  SpreadOptions spread = options.spread;
  spread.spacing = options.edge_length;
  thin(samples, backend, spread);
  repel(samples, backend, project, spread);
  r.spread = samples.size();

  RestrictedOptions restricted;
  restricted.spacing = options.edge_length;
  for (;; ++r.insertions) {
    const RestrictedDelaunay joined =
        restricted_delaunay(samples, surface_normals(samples, backend), field, restricted);
    if (joined.closed_manifold()) return mesh_of(joined.triangle, samples);
    const std::vector<Vec3> added =
        missing_samples(joined, samples, field, options.insertion_gap * options.edge_length);
    if (r.insertions == options.most_insertions || added.empty())
      throw InputError(fmt::format(
          "particles {:.4g} apart do not join to a closed surface at {} places; expected a shorter edge length",
          options.edge_length, joined.starved.size() + joined.no_disc.size()));
    r.inserted += added.size();
    samples.insert(samples.end(), added.begin(), added.end());
  }
}

}  // namespace isoskin
