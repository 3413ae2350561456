// The page of results: text in Markdown, pictures in a folder beside it.
#pragma once

#include <filesystem>
#include <span>
#include <string>

#include <fmt/format.h>

#include "core/mesh/triangle_mesh.h"
#include "render/image.h"

namespace isoskin::papers {

struct Page {
  std::filesystem::path folder;  // of the pictures
  std::string text;

  template <class... Values>
  void add(fmt::format_string<Values...> format, Values&&... values) {
    text += fmt::format(format, std::forward<Values>(values)...);
  }
  /// Writes NAME.png and shows it with its caption.
  void picture(const std::string& name, const Image& image, const std::string& caption) {
    save_png(folder / (name + ".png"), image, {.palette = true});
    add("![{}]({}/{}.png)\n\n", caption, folder.filename().string(), name);
  }
};

constexpr DVec3 kThreeQuarters{-0.52, -0.80, 0.42};  // a direction to look from

/// A mesh as the rasterizer shows it with its edges, from the framing direction.
Image wire_picture(const TriangleMesh& mesh, const Box& box, const DVec3& from, int width, int height);
/// Smooth, by `normals` (one a vertex; empty: by area).
Image plain_picture(const TriangleMesh& mesh, std::span<const Vec3> normals, const Box& box, const DVec3& from,
                    int width, int height);
/// Rest positions are colours, linear.
Image colored_picture(const TriangleMesh& mesh, const Box& box, const DVec3& from, int width, int height);

void add_particles(Page& page);         // Figueiredo et al. 1992, figures 3 and 4
void add_spring_lattice(Page& page);    // figures 5 to 7
void add_seeds(Page& page);             // Desbrun et al. 1995, figures 3, 4, 7 and 8
void add_skin_figures(Page& page);      // Nesme-Bouthors 2006, figures 1, 2, 9, 10 and 13
void add_fluid_figures(Page& page);     // Bouthors-Nesme 2007, figures 11 and 12; the others are the report's
void add_critical_figures(Page& page);  // Rumiano 2007, figures 9 to 12
void add_rumiano(Page& page);           // Rumiano 2007, these, figure 13 and edge swaps
void add_local(Page& page);             // the last remark of section 4.2, after all else
void add_skins(Page& page);             // Nesme-Bouthors 2006 tables 2 and 3, Bouthors-Nesme 2007 table 2

}  // namespace isoskin::papers
