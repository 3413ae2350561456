// What the operations of surgery.h share; for surgery*.cpp only.
#pragma once

#include <optional>
#include <utility>

#include "core/topology/mesh_patch.h"
#include "core/topology/surgery.h"

namespace isoskin::surgery {

/// Which way round: `solid` as the operation's name says, `hollow` with inside and outside exchanged.
enum class Matter : int { solid = 1, hollow = -1 };

inline double sign(Matter matter) {
  return double(int(matter));
}

inline SurgeryReport refused(const char* reason) {
  SurgeryReport report;
  report.reason = reason;
  return report;
}

inline SurgeryReport applied(TriangleMesh& mesh, const MeshPatch& patch) {
  SurgeryReport report;
  report.area = patch.area(mesh);
  if (!patch.apply(mesh)) return refused("the new triangles do not fit");
  report.done = true;
  report.vertices_added = patch.vertices_added();
  report.triangles_added = patch.triangles_added();
  report.triangles_removed = patch.triangles_removed();
  return report;
}

/// What all operations share: the site with its axis, the field, and lengths in world units.
struct Theatre {
  const SurgerySite& site;
  const Field& field;
  const SurgeryOptions& options;
  Matter matter;

  double e() const { return options.edge_length; }
  double reach() const { return options.reach * options.edge_length; }
  /// The eigenvector of the one eigenvalue whose sign differs from the other two.
  DVec3 axis(const CriticalPoint& point) const { return point.hessian.vectors[matter == Matter::solid ? 2 : 0]; }
  DVec3 axis_before() const { return axis(site.before); }
  DVec3 axis_after() const {
    const DVec3 a = axis(site.after);
    return glm::dot(a, axis_before()) < 0.0 ? -a : a;
  }
  /// Two unit vectors across the axis after; with the axis they are right-handed.
  std::pair<DVec3, DVec3> across_after() const {
    const DVec3 u = site.after.hessian.vectors[1];
    return {u, glm::cross(axis_after(), u)};
  }
  /// Positive where there is matter: inside for solid, outside for hollow.
  double filled(const DVec3& p) const { return sign(matter) * field.value(p); }
  /// Distance from the critical point after, along `direction`, to the surface; nothing within reach.
  std::optional<double> surface_along(const DVec3& direction) const {
    constexpr double kStep = 0.1;  // of e
    constexpr int kHalvings = 40;
    const DVec3& origin = site.after.position;
    const bool start = filled(origin) > 0.0;
    for (double far = kStep * e(); far <= reach(); far += kStep * e()) {
      if ((filled(origin + far * direction) > 0.0) == start) continue;
      double low = far - kStep * e(), high = far;
      for (int i = 0; i < kHalvings; ++i) {
        const double middle = 0.5 * (low + high);
        ((filled(origin + middle * direction) > 0.0) == start ? low : high) = middle;
      }
      return 0.5 * (low + high);
    }
    return std::nullopt;
  }
};

SurgeryReport make_shell(TriangleMesh& mesh, const Theatre& theatre);    // create_component, open_bubble
SurgeryReport remove_shell(TriangleMesh& mesh, const Theatre& theatre);  // destroy_component, burst_bubble
SurgeryReport join(TriangleMesh& mesh, const Theatre& theatre);          // connect, pierce
SurgeryReport sever(TriangleMesh& mesh, const Theatre& theatre);         // cut, spackle

}  // namespace isoskin::surgery
