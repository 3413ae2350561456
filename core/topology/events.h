// Tier 1 of design 8 for C2 fields: the critical points whose values change sign between two frames, and the operation
// each of them asks for (Rumiano 2007, section 3.3).
#pragma once

#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "core/backend.h"
#include "core/mesh/triangle_mesh.h"
#include "core/topology/critical_points.h"
#include "core/topology/critical_tracking.h"
#include "core/topology/surgery.h"

namespace isoskin {

/// What one frame hands to the next: the field the mesh lies on and its critical points. Where the points are says all:
/// each is describe_critical_point() of its position, so that a state can be stored and restored exactly.
struct CriticalState {
  std::shared_ptr<const Field> field;  // null before the first frame
  std::vector<CriticalPoint> points;
};

struct EventOptions {
  CriticalOptions critical;  // edge_length is e in all three
  TrackingOptions tracking;
  SurgeryOptions surgery;
  double separation = 6.0;      // events nearer to each other than this are kept apart in time; units of e
  double shortest_part = 1e-3;  // but no part of a frame is shorter than this share of it
  double narrow = 0.25;         // the radius of a narrow waist; units of e
  std::size_t complete_elements =
      64;  // the first frame of a skeleton of at most this many points is searched completely
  std::size_t complete_boxes = 150'000;  // and that search ends after so many boxes
};
/// The default options for a wanted edge length e.
EventOptions event_options(double edge_length);

/// One event, a line of the ledger.
struct CriticalEvent {
  std::string kind;       // "create", "destroy", "connect", "cut", "pierce", "spackle", "open_bubble", "burst_bubble"
  DVec3 position{0.0};    // of the critical point at the crossing
  double crossing = 0.0;  // when, as a share of the frame
  std::size_t vertices = 0;  // mesh vertices added, or removed with the piece
  double area = 0.0;         // of the new triangles, world units^2
  bool done = false;
  std::string reason;  // why it was left over
};

struct EventReport {
  std::vector<CriticalEvent> events;  // in order of crossing
  std::size_t critical_points = 0, degenerate = 0, born = 0, died = 0;
  std::size_t done = 0, left_over = 0;
};

/// Whether they tell of events. Grids have one in every other voxel; they are left to the collisions and the
/// certificate.
bool has_critical_points(const Field& field);

/// Where searches for critical points start: vertices of least gradient, the elements of a skeleton and the middles of
/// those that overlap.
std::vector<DVec3> critical_seeds(const TriangleMesh& mesh, const Field& field, Backend& backend,
                                  const ChangeMask& about = {{true, {}}, 0.0});

/// The state of `field` with critical points at `positions`.
CriticalState restore_critical_points(std::span<const DVec3> positions, std::shared_ptr<const Field> field,
                                      const EventOptions& options);

/// The state a first frame begins with: the critical points of `field`, the backend's current one, on which `mesh`
/// lies. A skeleton of points of norm 2 that is not too large is searched completely.
CriticalState start_critical_points(const TriangleMesh& mesh, std::shared_ptr<const Field> field, Backend& backend,
                                    const EventOptions& options);

/// The events between state.field and a later field, found but not operated on.
struct EventPlan {
  std::shared_ptr<const Field> field;  // the later one
  CriticalTracking tracking;
  std::vector<CriticalPath> crossings;  // in order of their time (ties: of position)
  std::size_t degenerate = 0;
};

/// Finds them. `field` must be the backend's current one; `mesh` lies on state.field, which is not null.
EventPlan plan_critical_events(const TriangleMesh& mesh, const CriticalState& state, std::shared_ptr<const Field> field,
                               Backend& backend, const EventOptions& options);

/// Where to cut the frame in two, as a share of it, so that no two events of its first part are nearer to each other
/// than options.separation: each would be operated on a mesh that does not show the other yet. Nothing when all are
/// far apart or simultaneous.
std::optional<double> time_between_events(const EventPlan& plan, const EventOptions& options);

/// Where to cut the frame in two, as a share of it, so that the first event which was refused finds the waist of its
/// neck or tunnel narrow: thick, it may hang together with what else lies in its plane. `done`: of the whole plan, in
/// order. Nothing when all were done, or the waist was narrow.
std::optional<double> time_before_refusal(const EventPlan& plan, const EventReport& done, const EventOptions& options);

/// The field at the share s from `before` to `after`, along the way that critical points are tracked. Null when it
/// cannot be made as a field that backends know: both must be skeletons.
std::shared_ptr<const Field> field_between(const Field& before, const Field& after, double s);

/// Operates on `mesh` for every crossing of the plan; the mesh then has the topology of plan.field but still lies where
/// it was, new vertices apart. An event whose operation refuses is left over: the mesh is as the others made it, and
/// the certificate and local repair take it from there. Moves `state` to plan.field. Deterministic.
EventReport operate_on_critical_events(TriangleMesh& mesh, CriticalState& state, const EventPlan& plan,
                                       const EventOptions& options);

/// Plans and operates at once. Does nothing without a state.
EventReport handle_critical_events(TriangleMesh& mesh, CriticalState& state, std::shared_ptr<const Field> field,
                                   Backend& backend, const EventOptions& options);

}  // namespace isoskin
