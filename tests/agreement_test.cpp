// The ray-traced field and the rasterized surface of the same field must be one picture, on real input.
#include <gtest/gtest.h>

#include "core/backend.h"
#include "core/io/scene.h"
#include "core/sampling/marching_cubes.h"
#include "render/compare.h"
#include "render/rasterize.h"
#include "render/raytrace.h"

using namespace isoskin;

namespace {

struct Case {
  const char* file;
  int frame;
  int size;      // pixels a side
  double share;  // lattice spacing, of the unit: the mesh's own error must stay under the tolerance
};

std::ostream& operator<<(std::ostream& out, const Case& c) {
  return out << c.file << " frame " << c.frame;
}

class Agreement : public ::testing::TestWithParam<Case> {};

// A mesh that shares nothing with the tracer: marching cubes on a fine lattice, vertices projected.
TriangleMesh fine_mesh(const Field& field, Backend& backend, double spacing, std::vector<Vec3>& normals) {
  const BrickLattice lattice = sample_lattice(field, backend, spacing);
  TriangleMesh mesh = marching_cubes(lattice, lattice_topology(lattice));
  ProjectOptions options;
  options.tolerance = static_cast<float>(1e-4 * spacing);
  options.max_step = static_cast<float>(spacing);
  backend.project(mesh.vertices.position, options, {});
  backend.set_mesh(mesh);
  normals.resize(mesh.vertex_count());
  backend.vertex_normals(normals);
  return mesh;
}

}  // namespace

TEST_P(Agreement, TracedFieldAndRasterizedMeshAreOnePicture) {
  const auto source = open_input(std::string(ISOSKIN_TEST_DATA) + "/" + GetParam().file).source;
  const auto field = source->load(GetParam().frame).field;
  const bool grid = field->resolution() > 0.0;
  CompareOptions options;
  options.unit = grid ? field->resolution() : field->bounds().diagonal() / 60.0;
  options.depth_p99 = grid ? 0.25 : 0.02;

  const auto backend = make_reference_backend();
  backend->set_field(field);
  std::vector<Vec3> normals;
  const TriangleMesh mesh = fine_mesh(*field, *backend, GetParam().share * options.unit, normals);
  const Camera camera = frame_box(field->bounds(), GetParam().size, GetParam().size);
  const CompareReport report =
      compare(rasterize(mesh, normals, camera), raytrace(*field, camera).image, options).report;
  EXPECT_TRUE(report.passed) << report.verdict;
  EXPECT_GT(report.depth_inside.pixels, 5000u);
  EXPECT_GT(report.depth.mean, 0.0);  // a mesh is not its field
}

INSTANTIATE_TEST_SUITE_P(DemoInput, Agreement,
                         ::testing::Values(Case{"dam_break/dam_break.%04d.vdb", 34, 512, 0.5},
                                           Case{"dam_break/dam_break.%04d.vdb", 45, 512, 0.5},
                                           Case{"two_points.toml", 30, 256, 0.25}, Case{"chain12.toml", 20, 256, 0.25},
                                           Case{"metaballs7.toml", 60, 256, 0.25}, Case{"norm_p4.toml", 1, 256, 0.25},
                                           Case{"norm_p10.toml", 1, 256, 0.25}));
