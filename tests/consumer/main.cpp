#include "core/io/ply.h"
#include "core/io/scene.h"
#include "core/tracker.h"
#include "kernels/opencl_backend.h"

int main(int, char** argv) {
  const isoskin::Scene scene = isoskin::open_input(argv[1]);  // a .vdb, a pattern, a folder or a scene.toml
  const isoskin::FieldFrame first = scene.source->load(scene.source->first_frame());
  isoskin::Tracker tracker(isoskin::make_opencl_backend(), isoskin::resolved({}, *first.field));
  tracker.advance(first);  // and again for every following frame
  isoskin::write_ply("skin.ply", tracker.geometric().mesh, tracker.geometric().normal);
}
