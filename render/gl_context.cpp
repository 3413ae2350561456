#include "render/gl_context.h"

#include <epoxy/egl.h>
#include <epoxy/gl.h>

#include <array>
#include <cstring>

#include "core/types.h"

namespace isoskin {
namespace {

struct Context {
  EGLDisplay display = EGL_NO_DISPLAY;
  EGLContext context = EGL_NO_CONTEXT;
};

bool has(const char* extensions, const char* name) {
  return extensions && std::strstr(extensions, name);
}

// An OpenGL 4.5 context that needs no surface, or EGL_NO_CONTEXT.
Context open_display(EGLDisplay display) {
  EGLint major = 0, minor = 0;
  if (display == EGL_NO_DISPLAY || !eglInitialize(display, &major, &minor)) return {};
  const char* extensions = eglQueryString(display, EGL_EXTENSIONS);
  if (!has(extensions, "EGL_KHR_surfaceless_context") || !has(extensions, "EGL_KHR_no_config_context")) return {};
  if (!eglBindAPI(EGL_OPENGL_API)) return {};
  const EGLint wanted[] = {
      EGL_CONTEXT_MAJOR_VERSION,           4,       EGL_CONTEXT_MINOR_VERSION, 5, EGL_CONTEXT_OPENGL_PROFILE_MASK,
      EGL_CONTEXT_OPENGL_CORE_PROFILE_BIT, EGL_NONE};
  return {display, eglCreateContext(display, EGL_NO_CONFIG_KHR, EGL_NO_CONTEXT, wanted)};
}

Context open_gpu() {
  std::array<EGLDeviceEXT, 16> devices{};
  EGLint count = 0;
  if (!eglQueryDevicesEXT(devices.size(), devices.data(), &count)) return {};
  for (EGLint i = 0; i < count; ++i) {
    if (has(eglQueryDeviceStringEXT(devices[i], EGL_EXTENSIONS), "EGL_MESA_device_software")) continue;
    const Context opened = open_display(eglGetPlatformDisplayEXT(EGL_PLATFORM_DEVICE_EXT, devices[i], nullptr));
    if (opened.context != EGL_NO_CONTEXT) return opened;
  }
  return {};
}

Context open_context() {
  const char* client = eglQueryString(EGL_NO_DISPLAY, EGL_EXTENSIONS);
  Context opened;
  if (has(client, "EGL_EXT_platform_device") && has(client, "EGL_EXT_device_enumeration")) opened = open_gpu();
  if (opened.context == EGL_NO_CONTEXT && has(client, "EGL_MESA_platform_surfaceless")) {
    opened = open_display(eglGetPlatformDisplayEXT(EGL_PLATFORM_SURFACELESS_MESA, EGL_DEFAULT_DISPLAY, nullptr));
  }
  if (opened.context == EGL_NO_CONTEXT) {
    throw InputError(
        "rasterizer: no headless OpenGL 4.5 through EGL; expected a GPU driver or Mesa's llvmpipe (libegl1, "
        "libgl1-mesa-dri)");
  }
  return opened;
}

// Lives until the process ends: drivers do not like to be shut down from static destructors.
const Context& the_context() {
  static const Context context = open_context();
  return context;
}

std::mutex& context_mutex() {
  static std::mutex mutex;
  return mutex;
}

}  // namespace

GlCurrent::GlCurrent() : lock_(context_mutex()) {
  const Context& context = the_context();
  if (!eglMakeCurrent(context.display, EGL_NO_SURFACE, EGL_NO_SURFACE, context.context)) {
    throw InputError("rasterizer: the OpenGL context cannot be made current on this thread");
  }
}

GlCurrent::~GlCurrent() {
  const Context& context = the_context();
  eglMakeCurrent(context.display, EGL_NO_SURFACE, EGL_NO_SURFACE, EGL_NO_CONTEXT);
}

std::string gl_renderer() {
  const GlCurrent current;
  return reinterpret_cast<const char*>(glGetString(GL_RENDERER));
}

}  // namespace isoskin
