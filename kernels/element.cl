// Elements of the elastic skin: forces, frozen frames and the stiffness product, port of core/mechanics/element.h. A
// triangle writes to its three corners' slots; cg.cl gathers them by vertex. No atomics. A work item takes one
// triangle, for frames VW of them: what they take is arithmetic, the products are loads and stores.
#pragma OPENCL FP_CONTRACT OFF
#define INLINE static inline __attribute__((always_inline))

#define SQRT3 1.7320508075688772935f
#define EDGE_TIE 1e-5f
#define ROTATION_TIE 1e-3f
#define FLAT 1e-6f

typedef struct {
  float edge_length;
  float stiffness;  // A0 / e^2 * E / (1 - nu^2), A0 the rest area
  float poisson;
  float spring;
} ElementParams;

typedef struct {
  float3 at[3];
} Corners;

INLINE Corners load_corners(global const float* from, uint3 v) {
  return (Corners){{vload3(v.x, from), vload3(v.y, from), vload3(v.z, from)}};
}

INLINE void store_corners(float3 a, float3 b, float3 c, uint t, global float* slots) {
  vstore3(a, 3 * t, slots);
  vstore3(b, 3 * t + 1, slots);
  vstore3(c, 3 * t + 2, slots);
}

#if VW == 16
typedef float16 vfloat;
typedef int16 vint;
#define LANES(array) vload16(0, array)
#define STORE_LANES(v, array) vstore16(v, 0, array)
#else
typedef float vfloat;
typedef int vint;
#define LANES(array) (array)[0]
#define STORE_LANES(v, array) ((array)[0] = (v))
#endif

// A vector of each triangle of a packet.
typedef struct {
  vfloat x, y, z;
} vec3v;

INLINE vfloat dotv(vec3v a, vec3v b) {
  return a.x * b.x + a.y * b.y + a.z * b.z;
}
INLINE vec3v crossv(vec3v a, vec3v b) {
  return (vec3v){a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
INLINE vec3v minus(vec3v a, vec3v b) {
  return (vec3v){a.x - b.x, a.y - b.y, a.z - b.z};
}
// s a + t b
INLINE vec3v blend(vfloat s, vec3v a, vfloat t, vec3v b) {
  return (vec3v){s * a.x + t * b.x, s * a.y + t * b.y, s * a.z + t * b.z};
}
INLINE vec3v scaled(vfloat s, vec3v a) {
  return (vec3v){s * a.x, s * a.y, s * a.z};
}
INLINE vec3v choose(vint wanted, vec3v a, vec3v b) {
  return (vec3v){select(b.x, a.x, wanted), select(b.y, a.y, wanted), select(b.z, a.z, wanted)};
}

INLINE vec3v any_normal(vec3v a) {
  const vfloat x = fabs(a.x), y = fabs(a.y), z = fabs(a.z);
  const vint is_x = x <= y && x <= z, is_y = !is_x && y <= z;
  const vfloat one = 1.0f, none = 0.0f;
  const vec3v axis = {select(none, one, is_x), select(none, one, is_y), select(one, none, is_x || is_y)};
  const vec3v n = crossv(a, axis);
  return scaled(1.0f / sqrt(dotv(n, n)), n);
}

typedef struct {
  vec3v x, y;
} ElementFrame;

// Straight through for all triangles of a packet: what does not apply is computed and passed over. `side`: -1 where
// inverted, else 1.
INLINE ElementFrame element_frame(vec3v a, vec3v b, vec3v c, vfloat side, vec3v outward) {
  const vfloat none = 0.0f, one = 1.0f;
  const vec3v e0 = minus(b, a), e1 = minus(c, b), e2 = minus(a, c);
  const vfloat square0 = dotv(e0, e0), square1 = dotv(e1, e1), square2 = dotv(e2, e2);
  const vint second = square1 > square0 * (1.0f + EDGE_TIE);
  const vfloat longer = select(square0, square1, second);
  const vint third = square2 > longer * (1.0f + EDGE_TIE);
  const vfloat best = select(longer, square2, third);
  const vfloat length = sqrt(best);
  const vec3v along_longest = choose(third, e2, choose(second, e1, e0));
  const vec3v first = {along_longest.x / length, along_longest.y / length, along_longest.z / length};
  const vec3v uw = scaled(-one, choose(third, e1, choose(second, e0, e2)));

  const vec3v across = crossv(first, uw);
  const vfloat high = sqrt(dotv(across, across));
  const vint has_normal = high > FLAT * length;
  const vec3v given = blend(one, outward, -dotv(outward, first), first);
  const vfloat size = sqrt(dotv(given, given));
  const vec3v normal = choose(has_normal, scaled(side / high, across),
                              choose(size > 0.0f, scaled(1.0f / size, given), any_normal(first)));
  const vfloat height = select(none, side * high, has_normal);
  const vec3v up = crossv(normal, first);

  const vfloat along = dotv(uw, first);
  const vfloat g00 = length, g01 = (2.0f * along - length) / SQRT3, g11 = 2.0f * height / SQRT3;
  const vfloat trace = g00 + g11, spin = -g01;
  const vfloat norm = sqrt(trace * trace + spin * spin);
  const vint ambiguous = norm <= ROTATION_TIE * (fabs(g00) + fabs(g01) + fabs(g11));
  const vfloat cosine = select(trace / norm, one, ambiguous), sine = select(spin / norm, none, ambiguous);
  const vfloat middle = 0.5f, height_of_rest = 0.5f * SQRT3;
  const vfloat turn_cos = select(one, -middle, second || third);
  const vfloat turn_sin = select(select(none, -height_of_rest, second), height_of_rest, third);
  const vfloat turned_cos = cosine * turn_cos - sine * turn_sin, turned_sin = sine * turn_cos + cosine * turn_sin;
  const vint is_some = best > 0.0f;
  const vec3v zero = {none, none, none};
  return (ElementFrame){choose(is_some, blend(turned_cos, first, turned_sin, up), zero),
                        choose(is_some, blend(turned_cos, up, -turned_sin, first), zero)};
}

// Stiffness times the corners' displacements, or times their positions with `rest` = e: minus the forces. Strain is
// taken times e, so e cancels against the area.
INLINE void stress_slots(float3 x, float3 y, float3 d1, float3 d2, float rest, const ElementParams m, uint t,
                         global float* slots) {
  const float3 c1 = (2.0f * d2 - d1) * (1.0f / SQRT3);
  const float xx = dot(x, d1) - rest;
  const float yy = dot(y, c1) - rest;
  const float xy = 0.5f * (dot(x, c1) + dot(y, d1));
  const float sxx = m.stiffness * (xx + m.poisson * yy);
  const float syy = m.stiffness * (yy + m.poisson * xx);
  const float sxy = m.stiffness * (1.0f - m.poisson) * xy;
  const float3 column0 = sxx * x + sxy * y;
  const float3 column1 = sxy * x + syy * y;
  const float3 at1 = column0 - column1 * (1.0f / SQRT3);
  const float3 at2 = column1 * (2.0f / SQRT3);
  store_corners(-(at1 + at2), at1, at2, t, slots);
}

// One vector for each of VW places.
INLINE vec3v load_lanes(global const float* from, const uint* place) {
  float x[VW], y[VW], z[VW];
  for (uint i = 0; i < VW; ++i) {
    const float3 v = vload3(place[i], from);
    x[i] = v.x;
    y[i] = v.y;
    z[i] = v.z;
  }
  return (vec3v){LANES(x), LANES(y), LANES(z)};
}

// frames: 8 floats a triangle, x in 0..2 and y in 4..6. slots: 3 floats a corner, the negated forces.
kernel void element_forces(global const float* positions, global const float* normals, global const uchar* inverted,
                           global const uint* vertex, global float* frames, global float* slots,
                           const ElementParams material, uint count) {
  const uint begin = ITEM * VW;
  if (begin >= count) return;
  uint corner[3][VW];
  float side[VW];
  for (uint i = 0; i < VW; ++i) {  // behind the end: the last triangle again
    const uint t = min(begin + i, count - 1);
    for (uint k = 0; k < 3; ++k) corner[k][i] = vertex[3 * t + k];
    side[i] = inverted[t] ? -1.0f : 1.0f;
  }
  const vec3v a = load_lanes(positions, corner[0]), b = load_lanes(positions, corner[1]),
              c = load_lanes(positions, corner[2]);
  const vec3v na = load_lanes(normals, corner[0]), nb = load_lanes(normals, corner[1]),
              nc = load_lanes(normals, corner[2]);
  const vec3v outward = {na.x + nb.x + nc.x, na.y + nb.y + nc.y, na.z + nb.z + nc.z};
  const ElementFrame frame = element_frame(a, b, c, LANES(side), outward);
  float lane[6][VW];
  STORE_LANES(frame.x.x, lane[0]);
  STORE_LANES(frame.x.y, lane[1]);
  STORE_LANES(frame.x.z, lane[2]);
  STORE_LANES(frame.y.x, lane[3]);
  STORE_LANES(frame.y.y, lane[4]);
  STORE_LANES(frame.y.z, lane[5]);
  for (uint i = 0; i < min((uint)VW, count - begin); ++i) {
    const uint t = begin + i;
    const float3 x = (float3)(lane[0][i], lane[1][i], lane[2][i]), y = (float3)(lane[3][i], lane[4][i], lane[5][i]);
    vstore4((float4)(x, 0.0f), 2 * t, frames);
    vstore4((float4)(y, 0.0f), 2 * t + 1, frames);
    const float3 p0 = vload3(corner[0][i], positions);
    const float rest = all(x == 0.0f) ? 0.0f : material.edge_length;
    stress_slots(x, y, vload3(corner[1][i], positions) - p0, vload3(corner[2][i], positions) - p0, rest, material, t,
                 slots);
  }
}

kernel void element_product(global const float* frames, global const uint* vertex, global const float* d,
                            global float* slots, global const int* done, const ElementParams material, uint count) {
  const uint t = ITEM;
  if (t >= count || *done) return;
  const uint3 v = vload3(t, vertex);
  const float3 d0 = vload3(v.x, d);
  stress_slots(vload4(2 * t, frames).xyz, vload4(2 * t + 1, frames).xyz, vload3(v.y, d) - d0, vload3(v.z, d) - d0, 0.0f,
               material, t, slots);
}

// Half the spring's pull on the start of an edge; the other triangle of the edge has the other half.
INLINE float3 spring_pull(float3 edge, const ElementParams m) {
  const float length = sqrt(dot(edge, edge));
  if (!(length > 0.0f)) return (float3)(0.0f);
  return (0.5f * m.spring * (length - m.edge_length) / length) * edge;
}

INLINE float3 spring_stiffness(float3 edge, float3 change, const ElementParams m) {
  const float length = sqrt(dot(edge, edge));
  if (!(length > 0.0f)) return (float3)(0.0f);
  const float3 a = edge / length;
  const float sideways = fmax(0.0f, 1.0f - m.edge_length / length);
  const float3 along = dot(a, change) * a;
  return (0.5f * m.spring) * (along + sideways * (change - along));
}

kernel void spring_forces(global const float* positions, global const uint* vertex, global float* slots,
                          const ElementParams material, uint count) {
  const uint t = ITEM;
  if (t >= count) return;
  const Corners p = load_corners(positions, vload3(t, vertex));
  const float3 a = spring_pull(p.at[1] - p.at[0], material);
  const float3 b = spring_pull(p.at[2] - p.at[1], material);
  const float3 c = spring_pull(p.at[0] - p.at[2], material);
  store_corners(c - a, a - b, b - c, t, slots);
}

kernel void spring_product(global const float* positions, global const uint* vertex, global const float* d,
                           global float* slots, global const int* done, const ElementParams material, uint count) {
  const uint t = ITEM;
  if (t >= count || *done) return;
  const uint3 v = vload3(t, vertex);
  const Corners p = load_corners(positions, v);
  const Corners dx = load_corners(d, v);
  const float3 a = spring_stiffness(p.at[1] - p.at[0], dx.at[1] - dx.at[0], material);
  const float3 b = spring_stiffness(p.at[2] - p.at[1], dx.at[2] - dx.at[1], material);
  const float3 c = spring_stiffness(p.at[0] - p.at[2], dx.at[0] - dx.at[2], material);
  store_corners(c - a, a - b, b - c, t, slots);
}
