#include "core/particles/delaunay.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <numeric>
#include <stdexcept>
#include <string>

extern "C" {
#include <libqhull_r/qhull_ra.h>
}

namespace isoskin {
namespace {

/// One run of Qhull, and the memory stream that catches what it has to say.
class QhullRun {
public:
  QhullRun() : said_(open_memstream(&text_, &length_)) { qh_zero(&qh_, said_); }
  ~QhullRun() {
    qh_.NOerrexit = True;
    qh_freeqhull(&qh_, qh_ALL);
    int kept = 0, bytes = 0;
    qh_memfreeshort(&qh_, &kept, &bytes);
    std::fclose(said_);
    std::free(text_);
  }
  QhullRun(const QhullRun&) = delete;
  QhullRun& operator=(const QhullRun&) = delete;

  /// `coordinates`: 3 a point. "Qt" cuts cells of more than four points; joggling ("QJ") is not asked for.
  void triangulate(std::vector<coordT>& coordinates) {
    char command[] = "qhull d Qt";
    const int failed =
        qh_new_qhull(&qh_, 3, int(coordinates.size() / 3), coordinates.data(), False, command, nullptr, said_);
    if (!failed) return;
    std::fflush(said_);
    const std::string text(text_, length_);
    throw std::runtime_error("Qhull: " + text.substr(0, text.find('\n')));
  }
  const facetT* facets() const { return qh_.facet_list; }
  Index point(const vertexT* vertex) { return Index(qh_pointid(&qh_, vertex->point)); }

private:
  char* text_ = nullptr;
  std::size_t length_ = 0;
  FILE* said_;
  qhT qh_;
};

struct Frame {
  DVec3 center{0.0};
  double scale = 1.0;
};

/// Qhull squares coordinates, so they are brought about the origin first.
Frame unit_frame(std::span<const DVec3> points) {
  Box box;
  for (const DVec3& p : points) {
    if (!std::isfinite(p.x + p.y + p.z)) throw std::invalid_argument("delaunay: a point is not finite");
    box.add(p);
  }
  const double half = 0.5 * std::max({box.size().x, box.size().y, box.size().z});
  return {box.center(), half > 0.0 ? half : 1.0};
}

}  // namespace

Delaunay delaunay(std::span<const DVec3> points) {
  if (points.size() < 5) throw std::invalid_argument("delaunay: fewer than 5 points");
  const Frame frame = unit_frame(points);
  std::vector<coordT> coordinates;
  coordinates.reserve(3 * points.size());
  for (const DVec3& p : points)
    for (int axis = 0; axis < 3; ++axis) coordinates.push_back((p[axis] - frame.center[axis]) / frame.scale);
  QhullRun run;
  run.triangulate(coordinates);

  std::vector<std::array<Index, 4>> tetrahedra;
  std::vector<DVec3> centers;
  for (const facetT* facet = run.facets(); facet && facet->next; facet = facet->next) {
    if (facet->upperdelaunay) continue;
    std::array<Index, 4> corners{};
    int n = 0;
    for (void** v = &facet->vertices->e[0].p; *v && n < 4; ++v) corners[n++] = run.point(static_cast<vertexT*>(*v));
    std::sort(corners.begin(), corners.end());
    tetrahedra.push_back(corners);
    // Lower facets of the paraboloid over the points: z = 2 c . p + d, with c the centre of the empty sphere.
    const DVec3 normal(facet->normal[0], facet->normal[1], facet->normal[2]);
    centers.push_back(frame.center + frame.scale * (-0.5 / facet->normal[3]) * normal);
  }
  std::vector<Index> order(tetrahedra.size());
  std::iota(order.begin(), order.end(), Index{0});
  std::sort(order.begin(), order.end(), [&](Index a, Index b) { return tetrahedra[a] < tetrahedra[b]; });
  Delaunay result;
  for (const Index t : order) {
    result.tetrahedron.push_back(tetrahedra[t]);
    result.circumcenter.push_back(centers[t]);
  }
  return result;
}

}  // namespace isoskin
