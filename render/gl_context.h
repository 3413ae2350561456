// One headless OpenGL 4.5 context a process, through EGL: a GPU's device when there is one, else Mesa's llvmpipe.
#pragma once

#include <mutex>
#include <string>

namespace isoskin {

/// Holds the process's context current on this thread for its lifetime; other threads wait for their turn. The context
/// is made by the first one. Throws InputError, one line, when there is no EGL or no OpenGL 4.5.
class GlCurrent {
public:
  GlCurrent();
  ~GlCurrent();
  GlCurrent(const GlCurrent&) = delete;
  GlCurrent& operator=(const GlCurrent&) = delete;

private:
  std::unique_lock<std::mutex> lock_;
};

/// What draws, as OpenGL names it ("llvmpipe (LLVM 15.0.6, 256 bits)"). Throws InputError as above.
std::string gl_renderer();

}  // namespace isoskin
