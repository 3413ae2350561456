// isoskin-sticking: does a texture stick? Material points moved exactly with a sequence's velocity grid, beside what
// the rest positions of the skin say where those points are; the same for independently extracted meshes whose rest
// positions are copied from the nearest point of the mesh before. And where `p + v dt` of every vertex lands.
//   isoskin-sticking [--first FRAME] [--frames N] [--velocity NAME] SEQUENCE...
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <random>
#include <string>
#include <vector>

#include <fmt/format.h>

#include "core/io/sequence.h"
#include "core/sampling/closest_point.h"
#include "core/sampling/marching_cubes.h"
#include "core/tracker.h"
#include "kernels/opencl_backend.h"
#include "perf/median.h"

using namespace isoskin;
using perf::median;

namespace {

constexpr int kPoints = 1000;
constexpr int kSubsteps = 8;  // Runge-Kutta steps a frame

struct MaterialPoint {
  DVec3 seed, now;
};

/// Area-weighted random points of the mesh.
std::vector<MaterialPoint> seed_points(const TriangleMesh& mesh) {
  std::vector<double> area{0.0};
  const auto corner = [&](Index t, int k) { return DVec3(mesh.position(mesh.vertex[3 * t + Index(k)])); };
  for (Index t = 0; t < mesh.triangle_count(); ++t)
    area.push_back(area.back() + glm::length(glm::cross(corner(t, 1) - corner(t, 0), corner(t, 2) - corner(t, 0))));
  std::mt19937_64 random(1);
  std::uniform_real_distribution<double> unit(0.0, 1.0);
  std::vector<MaterialPoint> points;
  while (points.size() < kPoints) {
    const auto at = std::upper_bound(area.begin(), area.end(), unit(random) * area.back());
    const Index t = std::min(Index(at - area.begin()) - 1, Index(mesh.triangle_count() - 1));
    double u = unit(random), v = unit(random);
    if (u + v > 1.0) u = 1.0 - u, v = 1.0 - v;
    const DVec3 p = (1.0 - u - v) * corner(t, 0) + u * corner(t, 1) + v * corner(t, 2);
    points.push_back({p, p});
  }
  return points;
}

/// Runge-Kutta 4 in a velocity that runs linearly in time from one frame's grid to the next's.
void advect(std::vector<MaterialPoint>& points, const FieldFrame& from, const FieldFrame& to) {
  const double dt = (to.time - from.time) / kSubsteps;
  for (MaterialPoint& point : points)
    for (int step = 0; step < kSubsteps; ++step) {
      const auto velocity = [&](const DVec3& p, double part) {
        const double t = (step + part) / kSubsteps;
        return (1.0 - t) * from.velocity->velocity(p) + t * to.velocity->velocity(p);
      };
      const DVec3 a = velocity(point.now, 0.0), b = velocity(point.now + 0.5 * dt * a, 0.5);
      const DVec3 c = velocity(point.now + 0.5 * dt * b, 0.5), d = velocity(point.now + dt * c, 1.0);
      point.now += dt / 6.0 * (a + 2.0 * b + 2.0 * c + d);
    }
}

/// How far from its seed the mesh says that each point's material came from.
std::vector<double> rest_errors(const std::vector<MaterialPoint>& points, const TriangleMesh& mesh) {
  const ClosestPoint closest(mesh);
  std::vector<double> errors;
  for (const MaterialPoint& point : points) {
    const SurfacePoint at = closest.nearest(Vec3(point.now));
    if (at.triangle == kNone) continue;
    DVec3 rest(0.0);
    for (int k = 0; k < 3; ++k)
      rest += double(at.weight[k]) * DVec3(mesh.vertices.rest[mesh.vertex[3 * at.triangle + Index(k)]]);
    errors.push_back(glm::distance(rest, point.seed));
  }
  return errors;
}

/// Share of the vertices that p + v dt puts within a voxel of the surface of `next`.
double share_landing(const TriangleMesh& mesh, double dt, const Field& next) {
  std::size_t near = 0;
  for (Index v = 0; v < mesh.vertex_count(); ++v) {
    const DVec3 p = DVec3(mesh.position(v)) + dt * DVec3(mesh.vertices.velocity[v]);
    const double value = std::abs(next.value(p));
    near += std::min(value, next.distance_estimate(p)) < next.resolution();
  }
  return mesh.vertex_count() ? double(near) / double(mesh.vertex_count()) : 1.0;
}

/// A mesh of the frame alone, its rest positions from the nearest points of the mesh before.
void extract_and_transfer(const FieldFrame& frame, Backend& backend, TriangleMesh& mesh) {
  backend.set_field(frame.field);
  const BrickLattice lattice = sample_lattice(*frame.field, backend, frame.field->resolution());
  TriangleMesh fresh = marching_cubes(lattice, lattice_topology(lattice));
  if (!mesh.empty()) carry_attributes(fresh, 0, mesh, backend);
  mesh = std::move(fresh);
}

struct Row {
  std::vector<double> errors, landing;
};

/// The first frames of a sequence, all in memory.
std::vector<FieldFrame> load_frames(FieldSource& source, int frames) {
  std::vector<FieldFrame> loaded;
  const int last = std::min(source.last_frame(), source.first_frame() + frames);
  for (int frame = source.first_frame(); frame <= last; ++frame) loaded.push_back(source.load(frame));
  return loaded;
}

Row follow(const std::vector<FieldFrame>& frames, bool with_velocity) {
  Row row;
  Tracker tracker(make_opencl_backend(), resolved({}, *frames.front().field));
  std::vector<MaterialPoint> points;
  for (std::size_t i = 0; i < frames.size(); ++i) {
    FieldFrame given = frames[i];
    if (!with_velocity) given.velocity = nullptr;
    tracker.advance(given, i + 1 < frames.size() ? &frames[i + 1] : nullptr);
    if (i == 0) points = seed_points(tracker.mechanical());
    if (i + 1 == frames.size()) break;
    row.landing.push_back(
        share_landing(tracker.mechanical(), frames[i + 1].time - frames[i].time, *frames[i + 1].field));
    advect(points, frames[i], frames[i + 1]);
  }
  row.errors = rest_errors(points, tracker.mechanical());
  return row;
}

Row follow_extracted(const std::vector<FieldFrame>& frames) {
  const std::unique_ptr<Backend> backend = make_opencl_backend();
  TriangleMesh mesh;
  std::vector<MaterialPoint> points;
  for (std::size_t i = 0; i < frames.size(); ++i) {
    extract_and_transfer(frames[i], *backend, mesh);
    if (i == 0)
      points = seed_points(mesh);
    else
      advect(points, frames[i - 1], frames[i]);
  }
  return {rest_errors(points, mesh), {}};
}

void print(const std::string& name, const char* who, Row row, double voxel) {
  for (double& e : row.errors) e /= voxel;
  std::string landing = "|";
  if (!row.landing.empty())
    landing = fmt::format("{:.1f} ({:.1f}) |", 100.0 * median(row.landing),
                          100.0 * *std::min_element(row.landing.begin(), row.landing.end()));
  std::vector<double> sorted = row.errors;
  std::sort(sorted.begin(), sorted.end());
  std::puts(fmt::format("| {} | {} | {:.2f} | {:.2f} | {}", name, who, median(row.errors),
                        sorted[sorted.size() * 9 / 10], landing)
                .c_str());
}

void run_sequence(const std::string& input, const std::string& velocity, int first, int frames) {
  SequenceOptions options;
  options.grid.velocity = velocity;
  if (first > 0) options.first = first;
  const auto source = open_sequence(input, options);
  const std::vector<FieldFrame> loaded = load_frames(*source, frames);
  const double voxel = loaded.front().field->resolution();
  print(source->name(), "skin, with the velocity grid", follow(loaded, true), voxel);
  print(source->name(), "skin, without", follow(loaded, false), voxel);
  print(source->name(), "marching cubes, nearest point", follow_extracted(loaded), voxel);
}

}  // namespace

int main(int argc, char** argv) {
  int first = 0, frames = 20;
  std::string velocity = "vel";
  std::vector<std::string> inputs;
  for (int i = 1; i < argc; ++i) {
    const std::string word = argv[i];
    if (word == "--frames" && i + 1 < argc)
      frames = std::atoi(argv[++i]);
    else if (word == "--first" && i + 1 < argc)
      first = std::atoi(argv[++i]);
    else if (word == "--velocity" && i + 1 < argc)
      velocity = argv[++i];
    else
      inputs.push_back(word);
  }
  if (inputs.empty() || frames < 1) {
    std::fprintf(stderr, "isoskin-sticking: expected [--first FRAME] [--frames N] [--velocity NAME] SEQUENCE...\n");
    return 2;
  }
  std::printf("%d material points after %d frames; voxels\n\n", kPoints, frames);
  std::puts(
      "| input | who | median error | 90th percentile | p + v dt within a voxel, % of vertices, median (worst) |");
  std::puts("|---|---|---|---|---|");
  try {
    for (const std::string& input : inputs) run_sequence(input, velocity, first, frames);
  } catch (const InputError& error) {
    std::fprintf(stderr, "isoskin-sticking: %s\n", error.what());
    return 2;
  }
}
