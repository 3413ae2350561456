// Runs frames: advance, predict, alter, relax, project, handle events, refine (design 3).
#pragma once

#include <array>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "core/backend.h"
#include "core/mechanics/alter.h"
#include "core/refine/refine.h"
#include "core/topology/repair.h"

namespace isoskin {

struct TrackOptions {
  double edge_length = 0.0;     // e, world units; 0: 1.5 voxels, or 1/60 of the diagonal of the first frame's bounds
  double lattice_spacing = 0.0; // s of the certificate; 0: half a voxel, or e / 2
  RefineOptions refine;         // alpha_r and N_p of the geometric mesh
  AlterOptions alter;           // edge_length and dt are filled in
  RelaxOptions relax;           // edge_length is filled in
  ProjectOptions project;       // tolerance and max_step are filled in from e
  int settle_rounds = 12;       // alter + relax rounds a freshly extracted surface gets
  int rounds = 2;               // alter + relax rounds of an ordinary frame
  bool validate = false;        // check the manifold after every frame (always on in debug builds)
};

/// One topology event or repair, a line of ledger.jsonl.
struct LedgerEntry {
  int frame = 0;
  double time = 0.0;
  std::string kind;  // "missing", "euler", ... the fault that was repaired
  int tier = 3;
  DVec3 position{0.0};
  std::size_t vertices = 0;
  double ms = 0.0;
};

/// What happened in one frame, a line of report.jsonl (design 10).
struct FrameReport {
  int frame = 0;
  double time = 0.0;
  std::size_t mechanical_triangles = 0, geometric_triangles = 0;
  double survived = 1.0;                        // share of the last frame's vertices whose ids are still there
  std::array<double, 3> reextracted{0, 0, 0};   // share of area by tier 1, 2, 3
  std::size_t events = 0, repairs = 0;
  bool certified = false;
  std::string certificate;                      // one line when not certified at once
  ShapeStatistics mechanical, geometric;
  std::size_t inverted = 0, quasi_critical = 0;
  std::size_t peak_bytes = 0;
  std::vector<std::pair<std::string, double>> ms;  // one entry a step of design 3, in order, plus certify and total
};

/// Keeps the mechanical mesh on the field from frame to frame. Not thread safe; parallel inside.
class Tracker {
public:
  Tracker(std::unique_ptr<Backend> backend, TrackOptions options);
  ~Tracker();

  /// Advances to the next frame (the first call extracts the surface).
  FrameReport advance(const FieldFrame& frame);
  /// Goes on from a mesh read back from disk (--resume): the next advance() behaves as if this tracker had made it.
  void resume(TriangleMesh mechanical, const FieldFrame& frame);

  const TriangleMesh& mechanical() const { return mesh_; }
  const std::vector<Vec3>& mechanical_normals() const { return normals_; }
  const GeometricMesh& geometric() const { return geometric_; }
  const std::vector<LedgerEntry>& ledger() const { return ledger_; }  // of the last frame
  double edge_length() const { return edge_length_; }
  Backend& backend() { return *backend_; }

private:
  std::unique_ptr<Backend> backend_;
  TrackOptions options_;
  double edge_length_ = 0.0;
  double spacing_ = 0.0;
  TriangleMesh mesh_;
  std::vector<Vec3> normals_;
  GeometricMesh geometric_;
  std::vector<LedgerEntry> ledger_;
};

}  // namespace isoskin
