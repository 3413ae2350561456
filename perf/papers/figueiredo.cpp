// Figueiredo, Gomes, Terzopoulos and Velho 1992: figures 3 to 7.
#include <chrono>
#include <cmath>

#include "core/counter_random.h"
#include "core/io/scene.h"
#include "core/lattice_springs/spring_lattice.h"
#include "core/mesh/validate.h"
#include "core/particles/particle_mesh.h"
#include "perf/papers/drawing.h"
#include "perf/papers/page.h"
#include "tests/analytic_fields.h"

namespace isoskin::papers {
namespace {

using namespace analytic;

const Vec3 kInk(0.02f, 0.03f, 0.05f), kBlue(0.05f, 0.2f, 0.5f), kGrey(0.6f, 0.62f, 0.66f);

/// The planar curve y^2 - x^3 + x = 0.
class CubicCurve final : public Field {
public:
  FieldSample sample(const DVec3& p) const override {
    return {p.x * p.x * p.x - p.x - p.y * p.y, DVec3(3.0 * p.x * p.x - 1.0, -2.0 * p.y, 0.0)};
  }
  Box bounds() const override { return {DVec3(-2.0, -2.0, 0.0), DVec3(2.0, 2.0, 0.0)}; }
  Interval range(const Box&) const override {
    return {-std::numeric_limits<double>::infinity(), std::numeric_limits<double>::infinity()};
  }
};

/// x^2 + y^2 = 1 without ends.
class CylinderField final : public Field {
public:
  FieldSample sample(const DVec3& p) const override {
    return {1.0 - p.x * p.x - p.y * p.y, DVec3(-2.0 * p.x, -2.0 * p.y, 0.0)};
  }
  Box bounds() const override { return {DVec3(-1.0), DVec3(1.0)}; }
  Interval range(const Box&) const override {
    return {-std::numeric_limits<double>::infinity(), std::numeric_limits<double>::infinity()};
  }
};

std::unique_ptr<Backend> backend_of(const std::shared_ptr<const Field>& field) {
  auto backend = make_reference_backend();
  backend->set_field(field);
  return backend;
}

void draw_curve(Page& page) {
  constexpr int kParticles = 240, kWidth = 340;
  const dvec2 low(-2.1, -2.1), high(2.1, 2.1);
  const auto backend = backend_of(std::make_shared<CubicCurve>());
  std::vector<Vec3> points(kParticles);
  for (std::size_t i = 0; i < points.size(); ++i) {
    const DVec3 u = counter_point(1992, i);
    points[i] = Vec3(4.0 * u.x - 2.0, 4.0 * u.y - 2.0, 0.0);
  }
  Drawing paths(low, high, kWidth), ends(low, high, kWidth);
  std::vector<Vec3> last = points;
  std::vector<std::uint8_t> arrived(points.size());
  const ParticleReport report = fall_to_surface(points, arrived, *backend, {}, [&](std::span<const Vec3> now) {
    for (std::size_t i = 0; i < now.size(); ++i) {
      paths.line({last[i].x, last[i].y}, {now[i].x, now[i].y}, 0.9, kBlue);
      last[i] = now[i];
    }
  });
  backend->project(points, {}, {});
  int oval = 0;
  for (const Vec3& p : points) {
    ends.disc({p.x, p.y}, 2.4, kInk);
    oval += p.x < 0.5f;
  }
  page.add("## Figueiredo, Gomes, Terzopoulos and Velho 1992\n\n### Figure 3: particles fall on y^2 - x^3 + x = 0\n\n");
  page.picture("figure3", beside(paths.image(), ends.image()), "Trajectories, and where the particles come to rest");
  page.add(
      "{} random starts; {} arrive within {} steps (the paper: \"usually less than 100\"), {} on the oval and {} on "
      "the "
      "branch.\n\n",
      kParticles, report.arrived, report.steps, oval, kParticles - oval);
}

/// A row of the table of meshes.
void add_mesh_row(Page& page, const char* what, double e, const TriangleMesh& mesh, int steps, double ms) {
  const ShapeStatistics shape = shape_statistics(mesh);
  const MeshPieces pieces = mesh_pieces(mesh);
  page.add("| {} | {} | {} | {} | {} | {} | {:.1f} / {:.1f} / {:.1f} | {:.3f} | {:.0f} |\n", what, steps,
           mesh.vertex_count(), mesh.triangle_count(), validate(mesh) ? "closed manifold" : "no manifold",
           pieces.euler.empty() ? 0 : pieces.euler[0], shape.min_angle, shape.p1_angle, shape.mean_angle,
           shape.mean_edge / e, ms);
}

constexpr const char* kMeshTable =
    "| surface | steps | vertices | triangles | is a | Euler | smallest angles: worst / 1 % / mean | mean edge / e | "
    "ms |\n"
    "|---|---|---|---|---|---|---|---|---|\n";

struct Subject {
  const char* name;
  std::shared_ptr<const Field> field;
  double edge_length;
};

std::vector<Subject> subjects() {
  return {{"sphere", std::make_shared<SphereField>(), 0.14},
          {"torus", std::make_shared<TorusField>(), 0.1},
          {"eight (genus 2)", load_scene(ISOSKIN_TEST_DATA "/eight.toml").source->load(1).field, 0.1}};
}

double milliseconds(std::chrono::steady_clock::time_point since) {
  return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - since).count();
}

Image particle_picture(const std::vector<Vec3>& points) {
  Drawing drawing({-1.25, -1.25}, {1.25, 1.25}, 300);
  for (const Vec3& p : points)
    if (p.y < 0.0f) drawing.disc({p.x, p.z}, 2.4, kInk);  // the half that faces the eye
  return drawing.image();
}

struct Histogram {
  std::vector<int> count = std::vector<int>(12, 0);  // smallest angles, 5 degrees each
  int total = 0;

  void add(const SimplexSurface& s) {
    for (std::size_t h = 0; h < s.triangle.size(); h += 3) {
      double least = 180.0;
      for (int k = 0; k < 3; ++k) {
        const auto at = [&](int i) { return DVec3(s.position[s.triangle[h + (k + i) % 3]]); };
        const DVec3 u = at(1) - at(0), v = at(2) - at(0);
        const double lengths = glm::length(u) * glm::length(v);
        least = std::min(
            least, lengths > 0.0 ? glm::degrees(std::acos(std::clamp(glm::dot(u, v) / lengths, -1.0, 1.0))) : 0.0);
      }
      ++count[std::min<std::size_t>(count.size() - 1, std::size_t(least / 5.0))];
      ++total;
    }
  }
  double share(std::size_t bin) const { return total ? double(count[bin]) / total : 0.0; }
};

Image histogram_picture(const Histogram& before, const Histogram& after) {
  constexpr double kTop = 60.0;  // per cent
  Drawing drawing({-2.0, -2.0}, {62.0, kTop}, 420);
  for (std::size_t bin = 0; bin < before.count.size(); ++bin) {
    const double x = 5.0 * double(bin);
    drawing.bar({x + 0.3, 0.0}, {x + 2.4, std::min(kTop, 100.0 * before.share(bin))}, kGrey);
    drawing.bar({x + 2.6, 0.0}, {x + 4.7, std::min(kTop, 100.0 * after.share(bin))}, kBlue);
  }
  drawing.line({0.0, 0.0}, {60.0, 0.0}, 1.0, kInk);
  return drawing.image();
}

Image lattice_picture(const FreudenthalComplex& complex) {
  // from a little above the side
  const DVec3 right(0.94, 0.342, 0.0), up(-0.117, 0.321, 0.94);
  Drawing drawing({-1.6, -2.4}, {1.6, 2.4}, 240);
  const auto seen = [&](Index v) {
    const DVec3 p(complex.node[v]);
    return dvec2(glm::dot(right, p), glm::dot(up, p));
  };
  const DVec3 away = glm::cross(right, up);
  for (const auto& [a, b] : complex.edge) {
    if (glm::dot(away, DVec3(complex.node[a]) + DVec3(complex.node[b])) > 0.0)  // the half that faces the eye
      drawing.line(seen(a), seen(b), 0.7, kBlue);
  }
  return drawing.image();
}

TriangleMesh open_mesh(const SimplexSurface& surface) {
  TriangleMesh mesh;
  mesh.vertex = surface.triangle;
  mesh.vertices.resize(surface.position.size());
  mesh.vertices.position = mesh.vertices.rest = surface.position;
  return mesh;
}

std::string histogram_rows(const Histogram& before, const Histogram& after) {
  std::string head = "| degrees |", rule = "|---|", first = "| before, % |", second = "| after, % |";
  for (std::size_t bin = 0; bin < before.count.size(); ++bin) {
    head += fmt::format(" {}-{} |", 5 * bin, 5 * bin + 5);
    rule += "---|";
    first += fmt::format(" {:.1f} |", 100.0 * before.share(bin));
    second += fmt::format(" {:.1f} |", 100.0 * after.share(bin));
  }
  return head + "\n" + rule + "\n" + first + "\n" + second + "\n\n";
}

}  // namespace

void add_particles(Page& page) {
  draw_curve(page);
  page.add("### Figure 4: meshes of particles (`isoskin extract --method particles`)\n\n");
  std::string rows;
  Page table{page.folder, {}};
  for (const Subject& s : subjects()) {
    const auto backend = backend_of(s.field);
    const auto begin = std::chrono::steady_clock::now();
    const BrickLattice lattice = sample_lattice(*s.field, *backend, 0.5 * s.edge_length);
    ParticleMeshOptions options;
    options.edge_length = s.edge_length;
    ParticleMeshReport report;
    ProjectOptions project;
    project.tolerance = float(1e-4 * s.edge_length);
    project.max_step = float(0.5 * s.edge_length);
    const TriangleMesh mesh =
        particle_mesh(*s.field, *backend, lattice, lattice_topology(lattice), project, options, &report);
    add_mesh_row(table, s.name, s.edge_length, mesh, report.fall.steps, milliseconds(begin));
    if (std::string(s.name) == "sphere")
      page.picture("figure4",
                   beside(particle_picture(mesh.vertices.position),
                          wire_picture(mesh, s.field->bounds().grown(0.1), {0.0, -1.0, 0.0}, 300, 300)),
                   "Particles on the sphere, and the restricted Delaunay triangles between them");
  }
  page.add("{}{}\n", kMeshTable, table.text);
}

void add_spring_lattice(Page& page) {
  page.add("### Figures 5 to 7: a lattice of springs (`isoskin extract --method spring-lattice`)\n\n");
  constexpr double kSpacing = 0.25;
  const auto backend = backend_of(std::make_shared<CylinderField>());
  const BrickLattice lattice = lattice_of_box({DVec3(-2.0), DVec3(2.0)}, kSpacing, *backend);
  FreudenthalComplex complex = intersecting_complex(lattice);
  hold_border(complex, lattice);
  const SimplexSurface before = march_simplices(complex, *backend);
  const Image lattice_before = lattice_picture(complex);
  const SpringLatticeReport report = deform(complex, *backend);
  const SimplexSurface after = march_simplices(complex, *backend);
  page.picture("figure5", beside(lattice_before, lattice_picture(complex)),
               "The intersecting complex of the cylinder before and after deformation");
  const Box detail{DVec3(-0.75, -1.0, -0.75), DVec3(0.75, -0.6, 0.75)};
  page.picture("figure6",
               beside(wire_picture(open_mesh(before), detail, {0.0, -1.0, 0.0}, 300, 300),
                      wire_picture(open_mesh(after), detail, {0.0, -1.0, 0.0}, 300, 300)),
               "A detail of the polygonization before and after");
  Histogram angles_before, angles_after;
  angles_before.add(before);
  angles_after.add(after);
  page.picture("figure6-angles", histogram_picture(angles_before, angles_after),
               "Smallest angles of triangles, 0 to 60 degrees: grey before, blue after");
  page.add(
      "The cylinder's {} tetrahedra on springs, {} steps (the paper: \"usually less than 100\"). \"Note how the "
      "deformation "
      "of the mesh produces a very homogeneous polygon structure, transforming long, thin elements to nearly "
      "equilateral "
      "ones\": smallest angles of its {} triangles:\n\n{}",
      complex.tetrahedron.size(), report.steps, angles_after.total, histogram_rows(angles_before, angles_after));
  const Box whole{DVec3(-1.0, -1.0, -2.0), DVec3(1.0, 1.0, 2.0)};
  page.picture("figure7", wire_picture(open_mesh(after), whole, {-0.5, -0.8, 0.4}, 300, 300),
               "The final polygonization of the cylinder");
  Page table{page.folder, {}};
  for (const Subject& s : subjects()) {
    const auto own = backend_of(s.field);
    const auto begin = std::chrono::steady_clock::now();
    SpringMeshOptions options;
    options.edge_length = s.edge_length;
    SpringLatticeReport done;
    const TriangleMesh mesh = spring_lattice_mesh(*s.field, *own, options, &done);
    add_mesh_row(table, s.name, s.edge_length, mesh, done.steps, milliseconds(begin));
  }
  page.add("{}{}\n", kMeshTable, table.text);
}

}  // namespace isoskin::papers
