// Simple points against the definition: pieces, cavities and Euler characteristic of random voxel sets before and
// after.
#include "core/topology/simple_point.h"

#include <random>

#include <gtest/gtest.h>

#include "tests/digital_topology.h"

using namespace isoskin;

namespace {

struct Counts {
  int pieces, holes, euler;
  bool operator==(const Counts&) const = default;
};

Counts counts(const digital::Lattice& lattice) {
  return {digital::pieces(lattice, true, true, false), digital::pieces(lattice, false, false, false),
          digital::euler(lattice)};
}

Neighbourhood around(const digital::Lattice& lattice, int x, int y, int z) {
  Neighbourhood mask = 0;
  for (int i = 0; i < 27; ++i)
    if (lattice.at(x + i / 9 - 1, y + i / 3 % 3 - 1, z + i % 3 - 1)) mask |= 1u << i;
  return mask;
}

}  // namespace

TEST(SimplePoint, FlipsOfSimplePointsChangeNothing) {
  std::mt19937 random(7);
  int simple = 0, others = 0, changed = 0;
  for (int trial = 0; trial < 3000; ++trial) {
    digital::Lattice lattice;
    lattice.size = IVec3(7);
    lattice.inside.assign(343, 0);
    for (int x = 2; x < 5; ++x)
      for (int y = 2; y < 5; ++y)
        for (int z = 2; z < 5; ++z) lattice.inside[lattice.index(x, y, z)] = random() % 2;
    const bool is = is_simple(around(lattice, 3, 3, 3), false);
    digital::Lattice flipped = lattice;
    flipped.inside[lattice.index(3, 3, 3)] ^= 1;
    if (is) {
      ++simple;
      EXPECT_EQ(counts(lattice), counts(flipped));
    } else {
      ++others;
      changed += !(counts(lattice) == counts(flipped));
    }
  }
  EXPECT_GT(simple, 100);
  EXPECT_GT(others, 100);
  EXPECT_GT(changed, others / 2);  // a flip may open one tunnel and close another
}

TEST(SimplePoint, SidesAreMirrorImages) {
  std::mt19937 random(8);
  for (int trial = 0; trial < 10000; ++trial) {
    const Neighbourhood inside = random() & ((1u << 27) - 1);
    EXPECT_EQ(is_simple(inside, false), is_simple(~inside & ((1u << 27) - 1), true));
  }
}

TEST(SimplePoint, IsolatedAndBuriedCornersAreNotSimple) {
  EXPECT_FALSE(is_simple(0, false));
  EXPECT_FALSE(is_simple((1u << 27) - 1, false));
  EXPECT_TRUE(is_simple(0x1ff, false));  // on a flat floor
}
