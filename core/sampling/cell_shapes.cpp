#include "core/sampling/cell_shapes.h"

#include <bit>
#include <vector>

namespace isoskin {
namespace {

constexpr int kNoEdge = -1;

int corner(int axis, int on_axis, int b, int c) {
  return on_axis << axis | b << (axis + 1) % 3 | c << (axis + 2) % 3;
}

/// A face of the cell: its corners counter-clockwise seen from outside the cell, and the edges between them.
struct Face {
  std::array<int, 4> corner;
  std::array<int, 4> edge;  // edge[i] joins corner[i] and corner[i + 1]
};

int edge_between(int p, int q) {
  const int axis = std::countr_zero(static_cast<unsigned>(p ^ q));
  const int b = p >> (axis + 1) % 3 & 1, c = p >> (axis + 2) % 3 & 1;
  return 4 * axis + b + 2 * c;
}

std::array<Face, 6> make_faces() {
  std::array<Face, 6> faces{};
  for (int axis = 0; axis < 3; ++axis)
    for (int side = 0; side < 2; ++side) {
      Face& f = faces[2 * axis + side];
      const int turn[4][2] = {{0, 0}, {1, 0}, {1, 1}, {0, 1}};
      for (int i = 0; i < 4; ++i) {
        const auto& t = turn[side ? i : 3 - i];
        f.corner[i] = corner(axis, side, t[0], t[1]);
      }
      for (int i = 0; i < 4; ++i) f.edge[i] = edge_between(f.corner[i], f.corner[(i + 1) % 4]);
    }
  return faces;
}

const std::array<Face, 6>& faces() {
  static const std::array<Face, 6> all = make_faces();
  return all;
}

bool in_same_face(int p, int q) {
  for (const Face& f : faces()) {
    bool has_p = false, has_q = false;
    for (const int e : f.edge) has_p |= e == p, has_q |= e == q;
    if (has_p && has_q) return true;
  }
  return false;
}

bool is_ambiguous(const Face& f, unsigned signs) {
  const auto in = [&](int i) { return signs >> f.corner[i] & 1; };
  return in(0) == in(2) && in(1) == in(3) && in(0) != in(1);
}

/// Cuts the polygon of edges from..to (inclusive) off along from-to; false when every way has a diagonal in a face.
bool cut(const std::vector<int>& loop, int from, int to, std::vector<std::array<std::uint8_t, 3>>& out) {
  if (to - from < 2) return true;
  const int n = static_cast<int>(loop.size());
  const auto allowed = [&](int i, int j) {
    return j - i == 1 || (i == 0 && j == n - 1) || !in_same_face(loop[i], loop[j]);
  };
  const std::size_t mark = out.size();
  // Middles first: balanced cuts give rounder triangles than fans.
  for (int k = 0, middle = (from + to) / 2; k < 2 * n; ++k) {
    const int at = middle + (k & 1 ? (k + 1) / 2 : -k / 2);
    if (at <= from || at >= to || !allowed(from, at) || !allowed(at, to)) continue;
    out.push_back({static_cast<std::uint8_t>(loop[from]), static_cast<std::uint8_t>(loop[at]),
                   static_cast<std::uint8_t>(loop[to])});
    if (cut(loop, from, at, out) && cut(loop, at, to, out)) return true;
    out.resize(mark);
  }
  return false;
}

std::vector<std::array<std::uint8_t, 3>> triangulate(const std::vector<int>& loop) {
  std::vector<std::array<std::uint8_t, 3>> out;
  const int n = static_cast<int>(loop.size());
  if (cut(loop, 0, n - 1, out)) return out;
  out.clear();
  for (int i = 0; i < n; ++i)
    out.push_back(
        {static_cast<std::uint8_t>(loop[i]), static_cast<std::uint8_t>(loop[(i + 1) % n]), CellShape::kCentre});
  return out;
}

/// joined: bit f set when the positive corners of ambiguous face f are joined.
CellShape make_shape(unsigned signs, unsigned joined) {
  std::array<int, 12> next;
  next.fill(kNoEdge);
  for (int f = 0; f < 6; ++f) {
    const Face& face = faces()[f];
    // Around the face the surface enters where the sign turns positive. It leaves where it turns negative again, going
    // round the positive corners, or where it did so before, going round the negative ones, if the positive are joined.
    for (int i = 0; i < 4; ++i) {
      const auto in = [&](int k) { return signs >> face.corner[k & 3] & 1; };
      if (in(i) || !in(i + 1)) continue;
      const int step = joined >> f & 1 ? 3 : 1;
      int k = i;
      do k = (k + step) & 3;
      while (!(in(k) && !in(k + 1)));
      next[face.edge[i]] = face.edge[k];
    }
  }
  CellShape s;
  std::array<bool, 12> done{};
  for (int e = 0; e < 12; ++e) {
    if (next[e] == kNoEdge || done[e]) continue;
    std::vector<int> loop;
    for (int k = e; !done[k]; k = next[k]) {
      done[k] = true;
      loop.push_back(k);
    }
    const int l = s.loops++;
    s.first[l + 1] = s.first[l];
    for (const int k : loop) s.edge[s.first[l + 1]++] = static_cast<std::uint8_t>(k);
    s.first_triangle[l + 1] = s.first_triangle[l];
    for (const auto& t : triangulate(loop)) s.triangle[s.first_triangle[l + 1]++] = t;
    if (s.has_centre(l)) ++s.centres;
  }
  return s;
}

/// All shapes; those of one sign pattern follow each other, indexed by the decisions on its ambiguous faces.
struct Table {
  std::array<std::uint16_t, 256> first{};
  std::array<std::uint8_t, 256> ambiguous{};  // bit a face
  std::vector<CellShape> shape;

  Table() {
    for (unsigned signs = 0; signs < 256; ++signs) {
      first[signs] = static_cast<std::uint16_t>(shape.size());
      for (int f = 0; f < 6; ++f)
        if (is_ambiguous(faces()[f], signs)) ambiguous[signs] |= static_cast<std::uint8_t>(1 << f);
      for (unsigned joined = 0; joined < 64; ++joined)
        if ((joined & ~ambiguous[signs]) == 0) shape.push_back(make_shape(signs, joined));
    }
  }
};

const Table& table() {
  static const Table all;
  return all;
}

unsigned signs_of(const std::array<float, 8>& v) {
  unsigned signs = 0;
  for (int c = 0; c < 8; ++c) signs |= static_cast<unsigned>(v[c] > 0) << c;
  return signs;
}

bool positive_joined(const Face& f, const std::array<float, 8>& v) {
  const double even = static_cast<double>(v[f.corner[0]]) * v[f.corner[2]];
  const double odd = static_cast<double>(v[f.corner[1]]) * v[f.corner[3]];
  return v[f.corner[0]] > 0 ? even > odd : odd > even;
}

}  // namespace

unsigned ambiguous_faces(const std::array<float, 8>& v) {
  return ambiguous_faces(signs_of(v));
}

unsigned ambiguous_faces(unsigned signs) {
  return table().ambiguous[signs];
}

std::uint16_t plain_shape(unsigned signs) {
  return table().first[signs];
}

std::uint16_t find_shape(const std::array<float, 8>& v, unsigned decided, unsigned joined) {
  const unsigned signs = signs_of(v);
  const Table& t = table();
  unsigned index = t.first[signs], bit = 1;
  for (int f = 0; f < 6; ++f) {
    if (!(t.ambiguous[signs] >> f & 1)) continue;
    if (decided >> f & 1 ? joined >> f & 1 : positive_joined(faces()[f], v)) index += bit;
    bit *= 2;
  }
  return static_cast<std::uint16_t>(index);
}

const CellShape& shape(std::uint16_t index) {
  return table().shape[index];
}

}  // namespace isoskin
