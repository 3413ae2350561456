// isoskin-papers: figures and tables of the papers beside isoskin's own, as a page of Markdown and a folder of
// pictures.
//   isoskin-papers perf/papers.md       writes the page, and pictures to perf/papers-figures/
#include <cstdlib>
#include <ctime>

#include <fmt/chrono.h>

#include "core/io/ply.h"
#include "perf/papers/page.h"
#include "render/rasterize.h"
#include "render/shade.h"

namespace isoskin::papers {

Image wire_picture(const TriangleMesh& mesh, const Box& box, const DVec3& from, int width, int height) {
  constexpr int kAntialias = 2;
  const Camera camera = frame_box(box, kAntialias * width, kAntialias * height, {.from = from});
  Image image = rasterize(mesh, area_weighted_normals(mesh), camera, {.wire = true});
  ShadeOptions options;
  options.wire_width = 0.8 * kAntialias;
  shade(image, camera, options);
  return downsample(image, kAntialias);
}

}  // namespace isoskin::papers

int main(int argc, char** argv) {
  using namespace isoskin;
  if (argc != 2) {
    fmt::print(stderr, "usage: isoskin-papers PAGE.md\n");
    return 2;
  }
  try {
    const std::filesystem::path file = argv[1];
    papers::Page page{std::filesystem::absolute(file).parent_path() / (file.stem().string() + "-figures"), {}};
    std::filesystem::create_directories(page.folder);
    double load[3] = {0, 0, 0};
    getloadavg(load, 3);
    page.add(
        "# The papers' figures and tables, and isoskin's\n\nWritten by `build/release/isoskin-papers perf/papers.md` "
        "on {:%Y-%m-%d}; "
        "the machine's load average was {:.0f} then (4 cores, no GPU), which wall times suffer from.\n\n",
        fmt::gmtime(std::time(nullptr)), load[0]);
    papers::add_particles(page);
    papers::add_spring_lattice(page);
    papers::add_seeds(page);
    papers::add_skins(page);
    papers::add_rumiano(page);
    write_file_atomically(file, page.text);
  } catch (const std::exception& error) {
    fmt::print(stderr, "isoskin-papers: {}\n", error.what());
    return 2;
  }
  return 0;
}
