// Tier 1 of design 8 for C2 fields: the critical points whose values change sign between two frames, and the operation
// each of them asks for (Rumiano 2007, section 3.3).
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "core/backend.h"
#include "core/mesh/triangle_mesh.h"
#include "core/topology/critical_points.h"
#include "core/topology/critical_tracking.h"
#include "core/topology/surgery.h"

namespace isoskin {

/// What one frame hands to the next: the field the mesh lies on and its critical points.
struct CriticalState {
  std::shared_ptr<const Field> field;  // null before the first frame
  std::vector<CriticalPoint> points;
};

struct EventOptions {
  CriticalOptions critical;  // edge_length is e in all three
  TrackingOptions tracking;
  SurgeryOptions surgery;
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
  bool done = false;
  std::string reason;  // why it was left over
};

struct EventReport {
  std::vector<CriticalEvent> events;  // in order of crossing
  std::size_t critical_points = 0, degenerate = 0, born = 0, died = 0;
  std::size_t done = 0, left_over = 0;
};

/// Where searches for critical points start: vertices of least gradient, the elements of a skeleton and the middles of
/// those that overlap.
std::vector<DVec3> critical_seeds(const TriangleMesh& mesh, const Field& field, Backend& backend);

/// The state a first frame begins with, or one that is resumed: the critical points of `field`, the backend's current
/// one, on which `mesh` lies. A skeleton of points of norm 2 that is not too large is searched completely.
CriticalState start_critical_points(const TriangleMesh& mesh, std::shared_ptr<const Field> field, Backend& backend,
                                    const EventOptions& options);

/// Operates on `mesh`, which lies on state.field, for every event between that field and `field`, the backend's current
/// one; the mesh then has the topology of `field` but still lies where it was, new vertices apart. Events are taken in
/// order of their crossing (ties: of position). An event whose operation refuses is left over: the mesh is as the
/// others made it, and the certificate and local repair take it from there. Updates `state`. Does nothing without a
/// state. Deterministic.
EventReport handle_critical_events(TriangleMesh& mesh, CriticalState& state, std::shared_ptr<const Field> field,
                                   Backend& backend, const EventOptions& options);

}  // namespace isoskin
