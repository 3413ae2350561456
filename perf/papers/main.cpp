// isoskin-papers: figures and tables of the papers beside isoskin's own, as a page of Markdown and a folder of
// pictures.
//   isoskin-papers perf/papers.md              writes the page, and pictures to perf/papers-figures/
//   isoskin-papers out/page.md rumiano skins   some of its parts
#include <algorithm>
#include <cstdlib>
#include <ctime>
#include <set>

#include <fmt/chrono.h>

#include "core/io/ply.h"
#include "perf/papers/page.h"
#include "render/rasterize.h"
#include "render/shade.h"

namespace isoskin::papers {

namespace {

constexpr int kAntialias = 2;

struct View {
  Camera camera;
  Image image;
};

View view(const TriangleMesh& mesh, std::span<const Vec3> normals, const Box& box, const DVec3& from, int width,
          int height, bool wire) {
  View view{frame_box(box, kAntialias * width, kAntialias * height, {.from = from}), {}};
  const std::vector<Vec3> own = normals.empty() ? area_weighted_normals(mesh) : std::vector<Vec3>{};
  view.image = rasterize(mesh, normals.empty() ? own : normals, view.camera, {.wire = wire});
  return view;
}

}  // namespace

Image wire_picture(const TriangleMesh& mesh, const Box& box, const DVec3& from, int width, int height) {
  View v = view(mesh, {}, box, from, width, height, true);
  ShadeOptions options;
  options.wire_width = 0.8 * kAntialias;
  shade(v.image, v.camera, options);
  return downsample(v.image, kAntialias);
}

Image plain_picture(const TriangleMesh& mesh, std::span<const Vec3> normals, const Box& box, const DVec3& from,
                    int width, int height) {
  View v = view(mesh, normals, box, from, width, height, false);
  shade(v.image, v.camera);
  return downsample(v.image, kAntialias);
}

Image colored_picture(const TriangleMesh& mesh, const Box& box, const DVec3& from, int width, int height) {
  View v = view(mesh, {}, box, from, width, height, false);
  ShadeOptions options;
  options.color = options.back_color = DVec3(1.0);
  shade(v.image, v.camera, options);
  for (const auto& [channel, rest] : {std::pair("R", "rest.X"), {"G", "rest.Y"}, {"B", "rest.Z"}})
    for (std::size_t i = 0; i < v.image.pixels(); ++i) v.image.at(channel)[i] *= v.image.at(rest)[i];
  return downsample(v.image, kAntialias);
}

}  // namespace isoskin::papers

namespace {

struct Part {
  const char* name;
  void (*add)(isoskin::papers::Page&);
};

constexpr Part kParts[] = {
    {"particles", isoskin::papers::add_particles}, {"springs", isoskin::papers::add_spring_lattice},
    {"seeds", isoskin::papers::add_seeds},         {"skins", isoskin::papers::add_skins},
    {"rumiano", isoskin::papers::add_rumiano},     {"local", isoskin::papers::add_local},
};

int usage() {
  fmt::print(stderr, "usage: isoskin-papers PAGE.md [particles] [springs] [seeds] [skins] [rumiano] [local]\n");
  return 2;
}

}  // namespace

int main(int argc, char** argv) {
  using namespace isoskin;
  if (argc < 2 || argv[1][0] == '-') return usage();
  const std::set<std::string> wanted(argv + 2, argv + argc);
  for (const std::string& name : wanted)
    if (std::ranges::none_of(kParts, [&](const Part& part) { return part.name == name; })) return usage();
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
    for (const Part& part : kParts)
      if (wanted.empty() || wanted.contains(part.name)) part.add(page);
    write_file_atomically(file, page.text);
  } catch (const std::exception& error) {
    fmt::print(stderr, "isoskin-papers: {}\n", error.what());
    return 2;
  }
  return 0;
}
