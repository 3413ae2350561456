#include "perf/peers.h"

#include <openvdb/openvdb.h>
#include <openvdb/tools/Count.h>
#include <openvdb/tools/Dense.h>
#include <openvdb/tools/VolumeToMesh.h>

#ifdef ISOSKIN_PEERS
#include <CGAL/Polygon_mesh_processing/orient_polygon_soup.h>
#include <CGAL/Polygon_mesh_processing/polygon_soup_to_polygon_mesh.h>
#include <CGAL/Polygon_mesh_processing/remesh.h>
#include <CGAL/Simple_cartesian.h>
#include <CGAL/Surface_mesh.h>
#include <vtkCellArray.h>
#include <vtkFloatArray.h>
#include <vtkFlyingEdges3D.h>
#include <vtkImageData.h>
#include <vtkNew.h>
#include <vtkPointData.h>
#include <vtkPolyData.h>
#endif

namespace isoskin::perf {

struct PeerGrid {
  openvdb::FloatGrid::Ptr grid;
};

namespace {

constexpr double kEdge = 1.5;  // voxels: isoskin's default

using Clocked = std::function<void(const std::function<void()>&)>;

TriangleMesh mesh_by_openvdb(const PeerGrid& input, const Clocked& clocked) {
  const openvdb::FloatGrid& grid = *input.grid;
  std::vector<openvdb::Vec3s> points;
  std::vector<openvdb::Vec3I> triangles;
  std::vector<openvdb::Vec4I> quads;
  clocked([&] { openvdb::tools::volumeToMesh(grid, points, triangles, quads, 0.0, 0.0); });
  TriangleMesh mesh;  // OpenVDB winds clockwise
  for (const auto& p : points) mesh.vertices.position.emplace_back(p.x(), p.y(), p.z());
  for (const auto& t : triangles) mesh.vertex.insert(mesh.vertex.end(), {t[2], t[1], t[0]});
  for (const auto& q : quads) mesh.vertex.insert(mesh.vertex.end(), {q[2], q[1], q[0], q[3], q[2], q[0]});
  mesh.vertices.resize(mesh.vertices.position.size());
  return mesh;
}

#ifdef ISOSKIN_PEERS

TriangleMesh mesh_by_flying_edges(const PeerGrid& input, const Clocked& clocked) {
  const openvdb::FloatGrid& grid = *input.grid;
  const openvdb::CoordBBox box = grid.evalActiveVoxelBoundingBox();
  const openvdb::Coord size = box.dim();
  const openvdb::Vec3d origin = grid.indexToWorld(box.min());
  const double voxel = grid.voxelSize().x();
  vtkNew<vtkImageData> image;
  image->SetDimensions(size.x(), size.y(), size.z());
  image->SetOrigin(origin.x(), origin.y(), origin.z());
  image->SetSpacing(voxel, voxel, voxel);
  image->AllocateScalars(VTK_FLOAT, 1);
  openvdb::tools::Dense<float, openvdb::tools::LayoutXYZ> dense(box, static_cast<float*>(image->GetScalarPointer()));
  openvdb::tools::copyToDense(grid, dense);
  vtkNew<vtkFlyingEdges3D> flying_edges;
  flying_edges->SetInputData(image);
  flying_edges->SetValue(0, 0.0);
  flying_edges->ComputeNormalsOff();
  flying_edges->ComputeGradientsOff();
  flying_edges->ComputeScalarsOff();
  clocked([&] { flying_edges->Update(); });
  TriangleMesh mesh;
  vtkPolyData* surface = flying_edges->GetOutput();
  for (vtkIdType i = 0; i < surface->GetNumberOfPoints(); ++i) {
    const double* p = surface->GetPoint(i);
    mesh.vertices.position.emplace_back(p[0], p[1], p[2]);
  }
  vtkIdType corners = 0;
  const vtkIdType* corner = nullptr;
  for (vtkCellArray* cells = surface->GetPolys(); cells->GetNextCell(corners, corner);)
    mesh.vertex.insert(mesh.vertex.end(), {Index(corner[0]), Index(corner[1]), Index(corner[2])});
  mesh.vertices.resize(mesh.vertices.position.size());
  return mesh;
}

TriangleMesh mesh_by_cgal(const PeerGrid& grid, const Clocked& clocked) {
  namespace pmp = CGAL::Polygon_mesh_processing;
  using Point = CGAL::Simple_cartesian<double>::Point_3;
  TriangleMesh extracted;
  clocked([&] { extracted = mesh_by_openvdb(grid, [](const auto& work) { work(); }); });
  std::vector<Point> points;
  for (const Vec3& p : extracted.vertices.position) points.emplace_back(p.x, p.y, p.z);
  std::vector<std::vector<std::size_t>> triangles;
  for (std::size_t h = 0; h < extracted.vertex.size(); h += 3)
    triangles.push_back({extracted.vertex[h], extracted.vertex[h + 1], extracted.vertex[h + 2]});
  pmp::orient_polygon_soup(points, triangles);  // parts vertices at which sheets touch: remeshing wants a 2-manifold
  CGAL::Surface_mesh<Point> remeshed;
  pmp::polygon_soup_to_polygon_mesh(points, triangles, remeshed);
  clocked([&] {
    pmp::isotropic_remeshing(faces(remeshed), kEdge * grid.grid->voxelSize().x(), remeshed,
                             CGAL::parameters::number_of_iterations(3));
  });
  remeshed.collect_garbage();
  TriangleMesh mesh;
  for (const auto v : remeshed.vertices()) {
    const Point& p = remeshed.point(v);
    mesh.vertices.position.emplace_back(p.x(), p.y(), p.z());
  }
  for (const auto f : remeshed.faces())
    for (const auto v : vertices_around_face(remeshed.halfedge(f), remeshed)) mesh.vertex.push_back(Index(v));
  mesh.vertices.resize(mesh.vertices.position.size());
  return mesh;
}

#endif

}  // namespace

std::vector<Peer> peers() {
  std::vector<Peer> all{{"volumeToMesh", mesh_by_openvdb}};
#ifdef ISOSKIN_PEERS
  all.push_back({"Flying Edges (dense)", mesh_by_flying_edges});
  all.push_back({"volumeToMesh + CGAL remeshing", mesh_by_cgal});
#endif
  return all;
}

std::shared_ptr<const PeerGrid> read_peer_grid(const std::string& path) {
  openvdb::initialize();
  openvdb::io::File file(path);
  file.open();
  for (auto name = file.beginName(); name != file.endName(); ++name)
    if (auto grid = openvdb::gridPtrCast<openvdb::FloatGrid>(file.readGrid(*name)))
      return std::make_shared<PeerGrid>(PeerGrid{grid});
  throw InputError(path + ": no grid of floats; expected a level set");
}

}  // namespace isoskin::perf
