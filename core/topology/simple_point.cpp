#include "core/topology/simple_point.h"

namespace isoskin {
namespace {

constexpr Neighbourhood kAll = (1u << 27) - 1, kMiddle = 1u << 13;

/// The neighbours with wanted(x, y, z), each 0 .. 2.
template <class Wanted>
constexpr Neighbourhood neighbours_where(const Wanted& wanted) {
  Neighbourhood found = 0;
  for (int i = 0; i < 27; ++i)
    if (wanted(i / 9, i / 3 % 3, i % 3)) found |= 1u << i;
  return found;
}

constexpr Neighbourhood kFrontY = neighbours_where([](int, int y, int) { return y > 0; });
constexpr Neighbourhood kBackY = neighbours_where([](int, int y, int) { return y < 2; });
constexpr Neighbourhood kFrontZ = neighbours_where([](int, int, int z) { return z > 0; });
constexpr Neighbourhood kBackZ = neighbours_where([](int, int, int z) { return z < 2; });
constexpr int off_middle(int x, int y, int z) {
  return (x != 1) + (y != 1) + (z != 1);
}
constexpr Neighbourhood kSix = neighbours_where([](int x, int y, int z) { return off_middle(x, y, z) == 1; });
constexpr Neighbourhood kEighteen =
    neighbours_where([](int x, int y, int z) { return off_middle(x, y, z) == 1 || off_middle(x, y, z) == 2; });

constexpr Neighbourhood along_x(Neighbourhood set) {
  return (set << 9 | set >> 9) & kAll;
}
constexpr Neighbourhood along_y(Neighbourhood set) {
  return (set << 3 & kFrontY) | (set >> 3 & kBackY);
}
constexpr Neighbourhood along_z(Neighbourhood set) {
  return (set << 1 & kFrontZ) | (set >> 1 & kBackZ);
}

/// What of the set hangs together with one of its corners, `about` giving the neighbours of some.
template <class About>
Neighbourhood piece(Neighbourhood set, Neighbourhood corner, const About& about) {
  for (Neighbourhood before = 0; before != corner;) {
    before = corner;
    corner |= about(corner) & set;
  }
  return corner;
}

Neighbourhood lowest(Neighbourhood set) {
  return set & -set;
}

/// Is all of the set one piece, corners being joined when they touch at all?
bool is_one_piece(Neighbourhood set) {
  const auto touching = [](Neighbourhood corners) {
    corners |= along_z(corners);
    corners |= along_y(corners);
    return corners | along_x(corners);
  };
  return set != 0 && piece(set, lowest(set), touching) == set;
}

/// Are the set's corners beside the middle in one piece, corners being joined across faces?
bool is_one_beside_middle(Neighbourhood set) {
  const auto beside = [](Neighbourhood corners) { return along_x(corners) | along_y(corners) | along_z(corners); };
  const Neighbourhood six = set & kSix;
  return six != 0 && (six & ~piece(set, lowest(six), beside)) == 0;
}

}  // namespace

bool is_simple(Neighbourhood inside, bool inside_apart) {
  inside &= ~kMiddle;
  const Neighbourhood outside = ~inside & kAll & ~kMiddle;
  return is_one_beside_middle((inside_apart ? inside : outside) & kEighteen) &&
         is_one_piece(inside_apart ? outside : inside);
}

}  // namespace isoskin
