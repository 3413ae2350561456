// What the compiler owes us: doubles passed through float32 are rounded.
#include <gtest/gtest.h>

#include "core/types.h"

namespace isoskin {
namespace {

[[gnu::noipa]] DVec3 through_floats(const DVec3& x) {
  return DVec3(Vec3(x));
}

TEST(Rounding, float32_rounds_every_component) {
  const DVec3 x(0.1, 0.2, 0.7);
  const DVec3 rounded = through_floats(x);
  for (int i = 0; i < 3; ++i) {
    const volatile float narrow = float(x[i]);
    EXPECT_EQ(rounded[i], double(narrow)) << i;
  }
}

}  // namespace
}  // namespace isoskin
