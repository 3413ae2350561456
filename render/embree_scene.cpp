#include "render/embree_scene.h"

#include <fmt/format.h>

#include <algorithm>

namespace isoskin {

EmbreeDevice::EmbreeDevice() : device_(rtcNewDevice(nullptr)) {
  if (!device_) {
    throw std::runtime_error(fmt::format("Embree: error {} at start", static_cast<int>(rtcGetDeviceError(nullptr))));
  }
}

EmbreeScene::EmbreeScene(const EmbreeDevice& device, RTCGeometry geometry) : scene_(rtcNewScene(device.get())) {
  rtcCommitGeometry(geometry);
  rtcAttachGeometry(scene_, geometry);
  rtcReleaseGeometry(geometry);
  rtcSetSceneFlags(scene_, RTC_SCENE_FLAG_ROBUST);
  rtcCommitScene(scene_);
  if (const RTCError error = rtcGetDeviceError(device.get()); error != RTC_ERROR_NONE) {
    rtcReleaseScene(scene_);
    throw std::runtime_error(fmt::format("Embree: error {} while building", static_cast<int>(error)));
  }
}

RTCGeometry triangle_geometry(const EmbreeDevice& device, const TriangleMesh& mesh, const DVec3& eye) {
  RTCGeometry geometry = rtcNewGeometry(device.get(), RTC_GEOMETRY_TYPE_TRIANGLE);
  auto* vertices = static_cast<Vec3*>(rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                                                              sizeof(Vec3), mesh.vertex_count()));
  auto* corners = static_cast<Index*>(rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                                                              3 * sizeof(Index), mesh.triangle_count()));
  for (std::size_t v = 0; v < mesh.vertex_count(); ++v) {
    vertices[v] = Vec3(DVec3(mesh.position(static_cast<Index>(v))) - eye);
  }
  std::copy(mesh.vertex.begin(), mesh.vertex.end(), corners);
  return geometry;
}

}  // namespace isoskin
