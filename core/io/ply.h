// Meshes on disk: binary little-endian PLY (design 10).
#pragma once

#include <filesystem>
#include <optional>
#include <span>
#include <vector>

#include "core/mesh/triangle_mesh.h"

namespace isoskin {

/// What a file says about its frame besides the mesh.
struct PlyHeader {
  int frame = 0;
  double time = 0.0;
  std::optional<std::vector<DVec3>> critical_points{};  // of the field: Tracker::critical_points()
};

/// Writes x y z nx ny nz s t r vx vy vz id age (float32, ids and age uint32), faces as uchar-counted uint32
/// `vertex_indices` and, where they are known, critical points as an element `critical_point` of float64 x y z; to a
/// temporary name in the same folder, flushed and then renamed. Header comments carry frame, time and next_id. Without
/// normals the three columns are left out. Throws InputError naming the file when the disk is full or the folder cannot
/// be written; nothing half-written stays.
void write_ply(const std::filesystem::path& path, const TriangleMesh& mesh, std::span<const Vec3> normals,
               const PlyHeader& header = {});

/// The bytes that write_ply() writes.
std::vector<char> ply_bytes(const TriangleMesh& mesh, std::span<const Vec3> normals, const PlyHeader& header = {});

/// Reads what write_ply wrote, and any binary little-endian or ascii PLY of triangles with x y z; absent columns get
/// make_mesh's defaults. Throws InputError naming the file and what was expected: truncated, not PLY, not triangles,
/// index out of range, non-finite position. Does not link twins of an open mesh: `closed` says whether it is closed.
struct PlyMesh {
  TriangleMesh mesh;          // twins linked when closed, else twin is empty
  std::vector<Vec3> normals;  // empty when the file has none
  bool closed = false;
  std::string open_reason;  // why not, when not
  PlyHeader header;
};
PlyMesh read_ply(const std::filesystem::path& path);

/// Writes bytes to a temporary name in the folder of `path`, flushes, renames. Throws InputError as above.
void write_file_atomically(const std::filesystem::path& path, std::span<const char> bytes);

}  // namespace isoskin
