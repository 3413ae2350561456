#include "core/mechanics/flow.h"

#include <algorithm>
#include <utility>

#include "core/mesh/independent_edits.h"
#include "core/mesh/small_pieces.h"
#include "core/parallel.h"

namespace isoskin {
namespace {

constexpr float kLeastSlope = 0.1f;  // of what a distance has: less is no direction to go by

/// What displacements must be along one direction a vertex; zero directions ask for nothing.
struct NormalParts {
  std::vector<Vec3> direction;
  std::vector<float> length;
};

Vec3 normalized(const Vec3& v) {
  const float length = glm::length(v);
  return length > 0.0f ? v / length : Vec3(0.0f);
}

std::vector<Vec3> normals_of(const TriangleMesh& mesh, const VertexCorners& corners) {
  std::vector<Vec3> normals(mesh.vertex_count());
  for_each_index(normals.size(), [&](std::size_t v) {
    const Vec3& p = mesh.position(Index(v));
    Vec3 sum(0.0f);
    for (Index i = corners.first[v]; i < corners.first[v + 1]; ++i) {
      const Index h = corners.corner[i];
      sum += glm::cross(mesh.position(mesh.to(h)) - p, mesh.position(mesh.from(TriangleMesh::prev(h))) - p);
    }
    normals[v] = normalized(sum);
  });
  return normals;
}

/// A vector in a register of its own: neighbours are added up with one instruction each.
using Padded = float __attribute__((vector_size(16)));

Padded padded(const Vec3& v) {
  return Padded{v.x, v.y, v.z, 0.0f};
}

/// Displacements become their neighbours' mean, but for what is known of them; Chebyshev's weights carry it as many
/// edges as there are sweeps (Jacobi's alone: their root). `neighbour`: one a corner.
void sweep(const VertexCorners& corners, const std::vector<Index>& neighbour, const NormalParts& known, int times,
           std::vector<Vec3>& displacement) {
  constexpr float kRadius = 0.95f;  // spectral, as of a small mesh: what is slower to settle is left to later frames
  constexpr std::size_t kGrain = 1024;  // vertices take nanoseconds
  std::vector<Padded> now(displacement.size());
  for_each_index(now.size(), [&](std::size_t v) { now[v] = padded(displacement[v]); });
  std::vector<Padded> before = now;
  float weight = 1.0f;
  for (int i = 0; i < times; ++i) {
    if (i > 0) weight = 1.0f / (1.0f - (i == 1 ? 0.5f : 0.25f) * kRadius * kRadius * weight);
    // Where a vertex was before is asked for by itself alone, so what comes next can be left there.
    const auto take_mean = [&](std::size_t v) {
      const Index begin = corners.first[v], end = corners.first[v + 1];
      if (begin == end) return;
      Padded sum{};
      for (Index c = begin; c < end; ++c) sum += now[neighbour[c]];
      const Padded mean = sum / float(end - begin), n = padded(known.direction[v]), along = n * mean;
      const Padded mended = mean + (known.length[v] - (along[0] + along[1] + along[2])) * n;
      before[v] += weight * (mended - before[v]);
    };
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, now.size(), kGrain), [&](const auto& range) {
      for (std::size_t v = range.begin(); v != range.end(); ++v) take_mean(v);
    });
    std::swap(before, now);
  }
  for_each_index(now.size(), [&](std::size_t v) { displacement[v] = Vec3(now[v][0], now[v][1], now[v][2]); });
}

/// A vertex on its way to the rim of the sheet it is in.
struct Walker {
  Index vertex;
  Vec3 at, heading;
};

/// The field where displaced vertices are.
struct Landing {
  std::vector<float> value;
  std::vector<Vec3> gradient;
};

Landing landing_of(const TriangleMesh& mesh, const std::vector<Vec3>& displacement, Backend& backend) {
  std::vector<Vec3> points(displacement.size());
  for_each_index(points.size(), [&](std::size_t v) { points[v] = mesh.position(Index(v)) + displacement[v]; });
  Landing landing{std::vector<float>(points.size()), std::vector<Vec3>(points.size())};
  backend.evaluate(points, landing.value, landing.gradient);
  return landing;
}

/// Vertices that their displacement leaves inside while the surface nearest to them faces elsewhere than they do: the
/// rim of a sheet has outrun them. They walk on along the sheet, in the direction they face, until they come out of it
/// at a rim again; those that turn back, or get where it is no sheet, stay where they were.
class RimWalk {
public:
  RimWalk(const TriangleMesh& mesh, const std::vector<Vec3>& normals, const FlowOptions& options, Landing& landing,
          std::vector<Vec3>& displacement)
      : mesh_(mesh),
        normals_(normals),
        options_(options),
        landing_(landing),
        displacement_(displacement),
        arrived_(normals.size()) {}

  /// Which vertices have come to a rim.
  std::vector<std::uint8_t> follow(const Field& field, Backend& backend) {
    std::vector<Walker> walkers(displacement_.size());
    for_each_index(walkers.size(), [&](std::size_t v) {
      walkers[v] = {Index(v), mesh_.position(Index(v)) + displacement_[v], normals_[v]};
    });
    keep_walking(walkers, [&](std::size_t w) {
      Walker& walker = walkers[w];
      const float value = landing_.value[w];
      const Vec3 outward = outward_at(landing_.gradient[w]);
      const bool outrun = value > 0.0f && glm::dot(outward, walker.heading) < kAgree;
      return outrun && walk_on(walker, value, outward);
    });
    int steps = 0;
    for (; steps < options_.rim_steps && walkers.size() > options_.few_walkers; ++steps) step_all(walkers, backend);
    tbb::parallel_for(std::size_t(0), walkers.size(), [&](std::size_t w) {
      const auto goes_on = [&](Walker& walker) {
        const FieldSample here = field.sample(DVec3(walker.at));
        return step(walker, float(here.value), Vec3(here.gradient));
      };
      for (int i = steps; i < options_.rim_steps && goes_on(walkers[w]); ++i) {
      }
    });
    return std::move(arrived_);
  }

private:
  static constexpr float kAgree = 0.5f;     // cosine between what a vertex faces and what it comes out at
  static constexpr float kAlong = 0.5f;     // of a heading: less is a bump amid the sheet, to be walked over
  static constexpr float kToMiddle = 0.5f;  // of a step

  static Vec3 outward_at(const Vec3& gradient) {
    const float slope = glm::length(gradient);
    return slope > kLeastSlope ? -gradient / slope : Vec3(0.0f);
  }

  template <class GoesOn>
  static void keep_walking(std::vector<Walker>& walkers, const GoesOn& goes_on) {
    std::size_t kept = 0;
    for (std::size_t w = 0; w < walkers.size(); ++w)
      if (goes_on(w)) walkers[kept++] = walkers[w];
    walkers.resize(kept);
  }

  void step_all(std::vector<Walker>& walkers, Backend& backend) {
    std::vector<Vec3> points(walkers.size()), gradients(walkers.size());
    std::vector<float> values(walkers.size());
    for_each_index(points.size(), [&](std::size_t w) { points[w] = walkers[w].at; });
    backend.evaluate(points, values, gradients);
    keep_walking(walkers, [&](std::size_t w) { return step(walkers[w], values[w], gradients[w]); });
  }

  /// Whether it walks on from where the field is this.
  bool step(Walker& walker, float value, const Vec3& gradient) {
    const Vec3 outward = outward_at(gradient);
    const Index v = walker.vertex;
    if (value <= 0.0f && glm::dot(outward, walker.heading) > kAgree) {
      displacement_[v] = walker.at - mesh_.position(v);
      landing_.value[v] = value;
      landing_.gradient[v] = gradient;
      arrived_[v] = 1;
    }
    return value > 0.0f && walk_on(walker, value, outward);
  }

  bool walk_on(Walker& walker, float value, const Vec3& outward) const {
    if (!(value <= options_.half_sheet)) return false;
    const Vec3 along = walker.heading - glm::dot(outward, walker.heading) * outward;
    if (glm::length(along) >= kAlong) walker.heading = normalized(along);
    if (glm::dot(walker.heading, normals_[walker.vertex]) < 0.0f) return false;
    walker.at += 0.25f * options_.half_sheet * (walker.heading - kToMiddle * outward);
    return true;
  }

  const TriangleMesh& mesh_;
  const std::vector<Vec3>& normals_;
  const FlowOptions& options_;
  Landing& landing_;
  std::vector<Vec3>& displacement_;
  std::vector<std::uint8_t> arrived_;  // one a vertex
};

/// Where displaced vertices are near the surface: to land on it, along its normals there.
void aim(const Landing& landing, const std::vector<Vec3>& displacement, float max_step, NormalParts& known) {
  for_each_index(displacement.size(), [&](std::size_t v) {
    const float slope = glm::length(landing.gradient[v]);
    const bool steep = slope > kLeastSlope;
    if (steep) known.direction[v] = -landing.gradient[v] / slope;
    const float step = steep ? std::clamp(landing.value[v] / slope, -max_step, max_step) : 0.0f;
    known.length[v] = glm::dot(known.direction[v], displacement[v]) + step;
  });
}

/// What faces elsewhere than the vertices aimed at it is another sheet or the other side of their own: not theirs to
/// land on. They have nothing then, a direction of zero. Those that followed a rim to where it is have what they looked
/// for.
void turn_from_others(const std::vector<Vec3>& normals, const std::vector<std::uint8_t>& at_rim, NormalParts& known) {
  constexpr float kAgree = 0.3f;  // cosine between normals
  for_each_index(normals.size(), [&](std::size_t v) {
    if (!at_rim[v] && glm::dot(known.direction[v], normals[v]) < kAgree)
      known.direction[v] = Vec3(known.length[v] = 0.0f);
  });
}

/// On either side of a lost vertex, along its normal.
struct Look {
  Index vertex;
  float behind, before;  // F at the last places looked at
};

/// Where vertices that have nothing of their own to land on (a direction of zero) come out of the body along what they
/// face, within three of the longest steps on either side: a sheet may have gone farther than it is thick.
void look_along_normals(const TriangleMesh& mesh, const std::vector<Vec3>& normals,
                        const std::vector<Vec3>& displacement, const Landing& landing, float max_step, Backend& backend,
                        NormalParts& known) {
  constexpr int kSteps = 4;
  const float step = 0.75f * max_step;
  std::vector<Look> lost;
  for (const Index v : indices_where(displacement.size(), [&](Index v) { return known.direction[v] == Vec3(0.0f); }))
    lost.push_back({v, landing.value[v], landing.value[v]});
  for (int k = 1; k <= kSteps && !lost.empty(); ++k) {
    std::vector<Vec3> points;
    std::vector<float> values(2 * lost.size());
    for (const Look& look : lost)
      for (const float side : {-1.0f, 1.0f})
        points.push_back(mesh.position(look.vertex) + displacement[look.vertex] +
                         side * float(k) * step * normals[look.vertex]);
    backend.evaluate(points, values, {});
    std::size_t kept = 0;
    for (std::size_t i = 0; i < lost.size(); ++i) {
      const Look look = lost[i];
      const float behind = values[2 * i], before = values[2 * i + 1];
      const bool back = look.behind <= 0.0f && behind > 0.0f, ahead = look.before > 0.0f && before <= 0.0f;
      if (!back && !ahead) {
        lost[kept++] = {look.vertex, behind, before};
        continue;
      }
      const float steps =
          back ? behind / (behind - look.behind) - float(k) : float(k) - before / (before - look.before);
      known.direction[look.vertex] = normals[look.vertex];
      known.length[look.vertex] = glm::dot(normals[look.vertex], displacement[look.vertex]) + steps * step;
    }
    lost.resize(kept);
  }
}

}  // namespace

std::vector<Vec3> surface_flow(const TriangleMesh& mesh, double dt, const Field& field, Backend& backend,
                               float max_step, const FlowOptions& options) {
  const VertexCorners corners = vertex_corners(mesh);
  std::vector<Index> neighbour(corners.corner.size());
  for_each_index(neighbour.size(), [&](std::size_t c) { neighbour[c] = mesh.to(corners.corner[c]); });
  std::vector<Vec3> displacement(mesh.vertex_count());
  NormalParts known{normals_of(mesh, corners), std::vector<float>(mesh.vertex_count())};
  for_each_index(displacement.size(), [&](std::size_t v) {
    displacement[v] = float(dt) * mesh.vertices.velocity[v];
    known.length[v] = glm::dot(known.direction[v], displacement[v]);
  });
  std::vector<std::pair<Index, Vec3>> small;
  for (const Index v : small_piece_vertices(mesh)) small.emplace_back(v, known.length[v] * known.direction[v]);
  sweep(corners, neighbour, known, options.sweeps, displacement);
  const std::vector<Vec3> normals = known.direction;
  for (int i = 0; i < options.aims; ++i) {
    Landing landing = landing_of(mesh, displacement, backend);
    std::vector<std::uint8_t> at_rim(displacement.size());
    if (options.half_sheet > 0.0f)
      at_rim = RimWalk(mesh, normals, options, landing, displacement).follow(field, backend);
    aim(landing, displacement, max_step, known);
    if (options.facing) {
      turn_from_others(normals, at_rim, known);
      look_along_normals(mesh, normals, displacement, landing, max_step, backend, known);
    }
    sweep(corners, neighbour, known, options.sweeps, displacement);
  }
  for (const auto& [v, straight] : small) displacement[v] = straight;
  return displacement;
}

}  // namespace isoskin
