#include "kernels/opencl_backend.h"

namespace isoskin {}
