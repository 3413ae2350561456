// Owners of Embree's device and scene, and a mesh as its triangles. Private to render/.
#pragma once

#include <embree3/rtcore.h>

#include "core/mesh/triangle_mesh.h"

namespace isoskin {

/// Throws std::runtime_error when Embree cannot start.
class EmbreeDevice {
public:
  EmbreeDevice();
  ~EmbreeDevice() { rtcReleaseDevice(device_); }
  EmbreeDevice(const EmbreeDevice&) = delete;
  EmbreeDevice& operator=(const EmbreeDevice&) = delete;
  RTCDevice get() const { return device_; }

private:
  RTCDevice device_;
};

/// A committed scene of one geometry, which it takes over. Robust flags: no ray slips between triangles. Throws
/// std::runtime_error when building fails.
class EmbreeScene {
public:
  EmbreeScene(const EmbreeDevice& device, RTCGeometry geometry);
  ~EmbreeScene() { rtcReleaseScene(scene_); }
  EmbreeScene(const EmbreeScene&) = delete;
  EmbreeScene& operator=(const EmbreeScene&) = delete;
  RTCScene get() const { return scene_; }

private:
  RTCScene scene_;
};

/// The mesh's triangles with positions relative to `eye`, so that float32 loses nothing far from the origin.
RTCGeometry triangle_geometry(const EmbreeDevice& device, const TriangleMesh& mesh, const DVec3& eye);

}  // namespace isoskin
