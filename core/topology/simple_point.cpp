#include "core/topology/simple_point.h"

#include <array>
#include <bit>

namespace isoskin {
namespace {

constexpr int kMiddle = 13;
constexpr Neighbourhood kAll = (1u << 27) - 1;

struct Adjacency {
  std::array<Neighbourhood, 27> faces{}, touching{};  // neighbours across faces; at faces, edges or corners
  Neighbourhood six = 0, eighteen = 0;                // of the middle
};

constexpr Adjacency make_adjacency() {
  Adjacency a;
  const auto coordinate = [](int i, int axis) { return axis == 0 ? i / 9 : axis == 1 ? i / 3 % 3 : i % 3; };
  for (int i = 0; i < 27; ++i)
    for (int j = 0; j < 27; ++j) {
      int sum = 0, most = 0;
      for (int axis = 0; axis < 3; ++axis) {
        const int d = coordinate(i, axis) - coordinate(j, axis);
        sum += d < 0 ? -d : d;
        most = (d < 0 ? -d : d) > most ? (d < 0 ? -d : d) : most;
      }
      if (sum == 1) a.faces[i] |= 1u << j;
      if (most == 1) a.touching[i] |= 1u << j;
    }
  a.six = a.faces[kMiddle];
  for (int j = 0; j < 27; ++j) {
    int off = 0;
    for (int axis = 0; axis < 3; ++axis) off += coordinate(j, axis) != 1;
    if (off == 1 || off == 2) a.eighteen |= 1u << j;
  }
  return a;
}

constexpr Adjacency kAdjacency = make_adjacency();

/// Pieces of `set` under `joined` that contain one of `touched`.
int pieces(Neighbourhood set, const std::array<Neighbourhood, 27>& joined, Neighbourhood touched) {
  int count = 0;
  while (Neighbourhood seeds = set & touched) {
    Neighbourhood piece = seeds & -seeds, rim = piece;
    while (rim) {
      Neighbourhood next = 0;
      for (; rim; rim &= rim - 1) next |= joined[std::countr_zero(rim)];
      rim = next & set & ~piece;
      piece |= rim;
    }
    set &= ~piece;
    ++count;
  }
  return count;
}

}  // namespace

bool is_simple(Neighbourhood inside, bool inside_apart) {
  const Neighbourhood around = kAll & ~(1u << kMiddle);
  const Neighbourhood outside = ~inside & around;
  const Neighbourhood joined = inside_apart ? outside : inside & around;
  const Neighbourhood apart = (inside_apart ? inside : outside) & kAdjacency.eighteen;
  return pieces(joined, kAdjacency.touching, around) == 1 && pieces(apart, kAdjacency.faces, kAdjacency.six) == 1;
}

}  // namespace isoskin
