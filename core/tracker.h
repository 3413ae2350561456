// Runs frames: advance, predict, alter, relax, project, handle events, refine (design 3).
#pragma once

#include <array>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "core/backend.h"
#include "core/mechanics/alter.h"
#include "core/mechanics/sleep.h"
#include "core/mesh/mesh_part.h"
#include "core/refine/geometric_mesh.h"
#include "core/refine/shape_sums.h"
#include "core/topology/bad_sites.h"
#include "core/topology/collisions.h"
#include "core/topology/events.h"
#include "core/topology/repair.h"
#include "core/topology/reskin.h"
#include "core/topology/thin_features.h"
#include "core/topology/thin_motion.h"

namespace isoskin {

/// Which operations change the mesh's topology (tier 1 of design 8).
enum class Topology {
  automatic,  // critical where the field has second derivatives, else collision; neither on grids, which repairs serve
  critical,   // only at critical points; fields without them are left to repairs
  collision,  // where sheets of the mesh collide and where vertices find no surface
};

/// One of the local repairs that are tried in turn until the certificate passes.
struct ReskinTry {
  bool suspects_only = false;  // see ReskinOptions
  bool spare_sound = false;    // see ReskinOptions
  bool replace_all = false;    // see ReskinOptions
  bool as_extracted = false;   // new skin is left as the lattice has it: neither coarsened nor settled
  double widened = 1.0;        // the radius about a bad site, in those of ReskinOptions
  // All of the pieces whose topology differs is asked, tile by tile, and nothing else.
  std::optional<Tiles> tiles = std::nullopt;
  // Asked is all skin from whose triangles no surface is found, on pieces that passed too, and nothing else.
  bool astray = false;
};

struct TrackOptions {
  double edge_length = 0.0;  // e, world units; 0: 1.5 voxels, or 1/60 of the diagonal of the first frame's bounds
  double lattice_spacing =
      0.0;  // s of the certificate; 0: half a voxel (a whole one in frames in which is_plain()), or e / 2
  double tolerance = 0.0;         // corners farther than this must be on the right side; 0: one voxel, or e / 2
  std::optional<double> sagitta;  // of the geometric mesh, world units, 0: by angle alone; none: 0.04 voxels or
                                  // 0.0027 e at 18 degrees, else as the square of the angle
  int rounds = 2;                 // alter + relax rounds of a frame
  int most_parts = 8;             // parts a frame is cut in where topology events are too near to each other
  std::vector<int> parts{2, 4};   // a frame of a skeleton that fails is followed once more in so many parts, in turn
  Topology topology = Topology::automatic;
  bool self_intersections = false;  // count the mechanical mesh's too
  bool validate = false;            // check the manifold after every frame (always on in debug builds)
  AlterOptions alter;               // edge_length and dt are filled in by resolved() and advance()
  RelaxOptions relax;               // of fresh skin; edge_length is filled in
  // The skin that follows: one step of 14 iterations leaves the angles that two of 10 each leave.
  int follow_steps = 1, follow_iterations = 14;
  SleepOptions sleep;      // where the field stands still and there is no velocity grid
  ProjectOptions project;  // tolerance and max_step are filled in: 1e-4 e and e / 2
  SettleOptions settle;    // how a freshly extracted surface becomes near-equilateral
  BadSiteOptions sites;    // where local repairs are made; tolerance is filled in
  ReskinOptions reskin;    // local repair; edge_length and alter are filled in
  // Small holes first; then about all that looks odd where the topology differs; then wherever it differs, farther and
  // farther about whatever looks odd; then the same without sparing sound skin; at last as the lattice has it, spikes
  // thinner than e and all.
  std::vector<ReskinTry> repairs{{.suspects_only = true, .spare_sound = true, .widened = 0.3},
                                 {.suspects_only = true, .spare_sound = true, .widened = 0.6},
                                 {.spare_sound = true, .widened = 0.6},
                                 {.spare_sound = true, .widened = 0.1, .tiles = Tiles{}},
                                 {.spare_sound = true, .widened = 0.1, .tiles = Tiles{.shift = 0.333}},
                                 {.spare_sound = true, .widened = 0.1, .tiles = Tiles{.shift = 0.667}},
                                 {.spare_sound = true},
                                 {.spare_sound = true, .widened = 1.5},
                                 {.spare_sound = true, .widened = 2.5},
                                 {.spare_sound = true, .widened = 0.1, .tiles = Tiles{.width = 32.0}},
                                 {.spare_sound = true, .widened = 0.1, .tiles = Tiles{.width = 32.0, .shift = 0.5}},
                                 {.widened = 0.6},
                                 {},
                                 {.widened = 1.5},
                                 {.widened = 2.5},
                                 {.replace_all = true},
                                 {.replace_all = true, .widened = 1.5},
                                 {.replace_all = true, .widened = 2.5},
                                 {.replace_all = true, .as_extracted = true, .widened = 0.6},
                                 {.replace_all = true, .as_extracted = true, .widened = 1.5}};
  std::size_t small_piece = 100;  // failed pieces of at most so many vertices are replaced whole
  double astray = 0.5;            // skin whose triangles are farther off the surface is doubted; units of e
  int reskin_rounds = 4;          // relax + alter rounds of the new skin after a local repair
  double inherit = 0.5;           // a vertex of new skin takes over the id of an old one no farther off; units of e
  int reskin_rings = 3;           // old vertices so many edges from the new skin settle with it
  RefineOptions refine;           // alpha_r and N_p of the geometric mesh; sagitta and shortest are filled in
};

/// Fills in every length that is 0 from the first frame's field. Throws InputError for an edge length that is NaN,
/// negative, longer than the surface's diagonal, or so short that the mesh would not fit in memory: under 1/4096 of the
/// diagonal, unless it is a grid's default.
TrackOptions resolved(TrackOptions options, const Field& first);

/// One topology event or repair, a line of ledger.jsonl.
struct LedgerEntry {
  int frame = 0;
  double time = 0.0;
  std::string kind;  // the event ("cut", "spackle", ...: core/topology/events.h) or the fault that was repaired
                     // ("missing", "euler", ...: core/topology/certificate.h)
  int tier = 3;
  DVec3 position{0.0};       // centre of the piece concerned
  std::size_t vertices = 0;  // mesh vertices of the piece that was removed, 0 where there was none
  double ms = 0.0;           // of the whole repair, shared by all entries it made
};

/// What happened in one frame, a line of report.jsonl (design 10).
struct FrameReport {
  int frame = 0;
  double time = 0.0;
  std::size_t mechanical_triangles = 0, geometric_triangles = 0;
  double survived = 1.0;   // share of the last frame's vertices whose ids are still there
  double inherited = 0.0;  // of those, by vertices of new skin where they had come to (inherit_ids.h)
  std::array<double, 3> reextracted{0, 0, 0};  // share of the area by tier 1, 2, 3; tier 2: with a vertex of new skin
  std::size_t events = 0, repairs = 0;
  bool certified = false;   // at the end of the frame
  std::string certificate;  // one line, of the mesh before repairs
  ShapeStatistics mechanical, geometric;
  std::size_t inverted = 0, quasi_critical = 0;  // mechanical triangles and vertices at the end of the frame
  // Overlapping pairs of triangles without a common vertex; of the mechanical mesh when options.self_intersections.
  std::size_t geometric_intersections = 0;
  std::optional<std::size_t> mechanical_intersections;
  std::vector<std::pair<std::string, double>> ms;  // one entry a step of design 3, in order
};

/// Keeps the mechanical mesh on the field from frame to frame. Not thread safe; parallel inside.
class Tracker {
public:
  /// `options` must be resolved().
  Tracker(std::unique_ptr<Backend> backend, const TrackOptions& options);

  /// The first frame begins with `mesh` (closed) instead of an extracted surface: it is fitted to the field as any
  /// frame is, keeps its ids and rest positions, and pieces that the certificate does not pass are extracted.
  void start(TriangleMesh mesh) { mesh_ = std::move(mesh); }

  /// Advances to the next frame; the first one extracts the surface, but for what start() gave. Throws std::logic_error
  /// when options.validate finds a fault (a bug of isoskin). `next`, the frame after, gives the first frame's vertices
  /// their velocities where there is no velocity grid; they are zero without it.
  FrameReport advance(const FieldFrame& frame, const FieldFrame* next = nullptr);

  /// Goes on from the mechanical mesh, field and critical_points() of the frame before (--resume): all state a frame
  /// hands to the next is in them. Without critical points they are searched for, as after a first frame.
  void resume(TriangleMesh mechanical, const FieldFrame& last,
              const std::optional<std::vector<DVec3>>& critical_points = std::nullopt);

  const TriangleMesh& mechanical() const { return mesh_; }
  const std::vector<Vec3>& mechanical_normals() const { return normals_; }
  const GeometricMesh& geometric() const { return geometric_.mesh(); }
  /// Triangles of the mechanical mesh, or of its copies, that the last frame refined.
  std::size_t refined_triangles() const { return geometric_.refined_triangles(); }
  const std::vector<LedgerEntry>& ledger() const { return ledger_; }  // of the last frame
  /// Where the last field's critical points are, once they are tracked (from the second frame of a skeleton on).
  std::optional<std::vector<DVec3>> critical_points() const;
  const TrackOptions& options() const { return options_; }

private:
  /// What a frame's mesh is judged by.
  struct Evidence {
    std::shared_ptr<const Field> field;  // that the lattice was sampled from
    BrickLattice lattice;
    LatticeTopology topology;
    MeshPieces pieces;
    Certificate certificate;
    SideMemory sides;
    std::optional<BadSites> sites;  // of the mesh that was certified, once they are asked for
  };

  /// What a relaxation left undone: one byte a triangle, one a vertex.
  struct Relaxed {
    std::vector<std::uint8_t> inverted, quasi_critical;
  };

  /// What critical events made of the mesh.
  struct Operated {
    std::optional<TriangleMesh> mesh;  // none: it stays as it is
    CriticalState critical;
    EventReport report;
    double ms = 0.0;
  };

  double seconds_to(const FieldFrame& frame) const { return started_ ? frame.time - time_ : 0.0; }
  void report_survivors(const std::vector<Index>& before, Index first_new, const std::optional<MeshChanges>& changes,
                        FrameReport& report) const;
  void take_up(const FieldFrame& frame);
  void wake_up(const FieldFrame& frame);
  void note_start(const FieldFrame& frame);
  void operate(const FieldFrame& frame, FrameReport& report, int parts = 1);
  EventPlan plan_events(const std::shared_ptr<const Field>& field, FrameReport& report);
  Operated operated_on(const EventPlan& plan, FrameReport& report);
  void take_over(Operated operated, EventPlan plan, const FieldFrame& frame, FrameReport& report);
  Evidence sample(const FieldFrame& frame, FrameReport& report);
  double lattice_spacing(const Field& field, bool goes_on);
  OpenSet awake() const;
  OpenSet move(const FieldFrame& frame, Evidence& evidence, FrameReport& report);
  void fold_in_flaps(TriangleMesh predicted, const FieldFrame& frame, Evidence& evidence, FrameReport& report);
  void follow_in_parts(const FieldFrame& frame, Evidence& evidence, FrameReport& report);
  bool collides(const Field& field) const;
  bool collide(const FieldFrame& frame, Evidence& evidence, const VertexTable& before, std::vector<Ball>& split,
               FrameReport& report);
  void relax(OpenSet awake, FrameReport& report, TriangleMesh* predicted = nullptr);
  void unfold_skin(const OpenSet& open, Relaxed& relaxed, FrameReport& report);
  Relaxed relax_but(const OpenSet& open, const RelaxOptions& how);
  Relaxed relax_whole(const RelaxOptions& how);
  std::vector<std::uint8_t> held_vertices(const OpenSet& open) const;
  ThinOptions thin_options() const;
  ThinMotion thin_motion(const Field& field) const;
  std::vector<std::uint8_t> folded_in(const OpenSet& open);
  void keep_awake(const Relaxed& relaxed);
  void look_at(std::shared_ptr<const Field> field, Evidence& evidence, FrameReport& report);
  void look_closer(const FieldFrame& frame, Evidence& evidence, FrameReport& report);
  void handle_events(const FieldFrame& frame, Evidence& evidence, FrameReport& report);
  void update_normals(const std::optional<MeshChanges>& changes);
  void certify(Evidence& evidence, FrameReport& report);
  CertifyOptions certify_options() const;
  void repair(const FieldFrame& frame, Evidence& evidence, GrowingFilling& filling, FrameReport& report);
  bool reskin(const FieldFrame& frame, Evidence& evidence, const ReskinTry& how, GrowingFilling& filling,
              FrameReport& report);
  BadSites sites_of(const FieldFrame& frame, Evidence& evidence, const ReskinTry& how) const;
  BadSites all_sites(const FieldFrame& frame, const Evidence& evidence) const;
  double share_renewed(Index first_new) const;
  void settle_new_skin(Index first_new);
  void reextract(const FieldFrame& frame, const Evidence& evidence, float coarsening, FrameReport& report);
  double share_of_area(double part) const;

  std::unique_ptr<Backend> backend_;
  TrackOptions options_;
  std::shared_ptr<const Field> last_field_;
  FieldChanges changes_;        // from it to the frame's
  Evidence before_;             // of its field, so that only what changes is looked at again; no field: it is of no use
  std::optional<IVec3> rough_;  // a brick of it that is not plain, if it is a grid with such
  double time_ = 0.0;           // of the last frame
  bool started_ = false;
  bool goes_on_ = false;            // this frame's lattice was made from the last one's
  bool stands_still_ = false;       // and is that, since the field is the same
  bool material_is_known_ = false;  // a velocity grid tells it; else it moves with the vertices
  TriangleMesh mesh_, predicted_;   // the other: as it was before it was relaxed
  std::vector<Vec3> normals_;
  ShapeSums shape_;  // of the mechanical mesh
  GeometricSkin geometric_;
  std::vector<LedgerEntry> ledger_;
  std::vector<Index> inherited_;     // ids that vertices of new skin have taken over in this frame
  CriticalState critical_;           // of the last field, where it has second derivatives
  TriangleMesh start_;               // the mesh at the frame's start, and where it can be operated on
  CriticalState critical_at_start_;  // the critical points then
  CriticalState critical_before_;    // these, and the field on which the mesh lies before it moves to the frame's
  CriticalTracking tracking_;        // of critical points to the frame's field
};

}  // namespace isoskin
