#include "app/cold_start.h"

#include <array>
#include <cstdio>

#include "core/field/brick_builder.h"

namespace isoskin {
namespace {

/// A ball of five voxels: all that kernels need to be compiled is something to run on.
std::shared_ptr<const GridField> small_grid(Interpolation interpolation) {
  constexpr int kSize = BrickGrid::kBrick;
  constexpr float kRadius = 5.0f;
  BlockValues blocks;
  blocks.low = IVec3(-1);
  blocks.size = IVec3(2);
  std::vector<std::vector<float>> values;
  for (int block = 0; block < 8; ++block) {
    const IVec3 low = kSize * (blocks.low + IVec3(block / 4, block / 2 % 2, block % 2));
    std::vector<float>& f = values.emplace_back();
    for (int i = 0; i < kSize * kSize * kSize; ++i)
      f.push_back(kRadius - glm::length(Vec3(low + IVec3(i / (kSize * kSize), i / kSize % kSize, i % kSize))));
  }
  for (const std::vector<float>& f : values) blocks.values.push_back(f.data());
  blocks.constant.assign(values.size(), 0.0f);
  blocks.outside = -kRadius;
  return std::make_shared<GridField>(std::make_shared<BrickGrid>(build_bricks(blocks, DVec3(0.0), 1.0, interpolation)));
}

/// What a frame asks of a backend, on an octahedron.
void run_every_kernel(const OpenClOptions& options, Interpolation interpolation) {
  const auto backend = make_opencl_backend(options);
  const TriangleMesh mesh = make_mesh({{5, 0, 0}, {-5, 0, 0}, {0, 5, 0}, {0, -5, 0}, {0, 0, 5}, {0, 0, -5}},
                                      {0, 2, 4, 2, 1, 4, 1, 3, 4, 3, 0, 4, 2, 0, 5, 1, 2, 5, 3, 1, 5, 0, 3, 5});
  std::vector<Vec3> points = mesh.vertices.position, normals(mesh.vertex_count());
  std::vector<float> values(points.size());
  std::vector<std::uint8_t> inverted(mesh.triangle_count());
  backend->set_field(small_grid(interpolation));
  backend->evaluate(points, values, {});
  backend->evaluate(points, values, normals);
  backend->project(points, {}, {});
  backend->set_mesh(mesh);
  backend->relax({}, {});
  backend->project_mesh({});
  backend->vertex_normals(normals);
  backend->inverted_triangles(inverted);
}

}  // namespace

ColdStart::ColdStart(const BackendOptions& backend, std::optional<Interpolation> grids)
    : cold_(opencl_options(backend)) {
  if (cold_ && kernels_are_compiled(*cold_)) cold_.reset();
  if (cold_ && grids) compiling_ = std::async(std::launch::async, run_every_kernel, *cold_, *grids);
}

void ColdStart::wait(bool silent) {
  if (cold_ && !silent) std::fputs("compiling kernels (first run on this machine only)\n", stderr);
  if (compiling_.valid()) compiling_.get();
}

void ColdStart::note_first_frame() {
  if (cold_) note_compiled_kernels(*cold_);
  cold_.reset();
}

}  // namespace isoskin
