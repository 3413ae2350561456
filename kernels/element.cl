// Elements of the elastic skin: forces, frozen frames and the stiffness product, port of core/mechanics/element.h. One
// triangle a work item writes to its three corners' slots; cg.cl gathers them by vertex. No atomics.
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
  float3 x, y;
} ElementFrame;

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

INLINE float3 any_normal(float3 a) {
  const float3 b = fabs(a);
  const float3 axis = b.x <= b.y && b.x <= b.z ? (float3)(1.0f, 0.0f, 0.0f)
                      : b.y <= b.z             ? (float3)(0.0f, 1.0f, 0.0f)
                                               : (float3)(0.0f, 0.0f, 1.0f);
  const float3 n = cross(a, axis);
  return n / sqrt(dot(n, n));
}

INLINE ElementFrame element_frame(Corners p, int inverted, float3 outward) {
  const float3 edge[3] = {p.at[1] - p.at[0], p.at[2] - p.at[1], p.at[0] - p.at[2]};
  int k = 0;
  float best = 0.0f;
  for (int i = 0; i < 3; ++i) {
    const float squared = dot(edge[i], edge[i]);
    if (squared > best * (1.0f + EDGE_TIE)) {
      k = i;
      best = squared;
    }
  }
  ElementFrame frame = {(float3)(0.0f), (float3)(0.0f)};
  const float length = sqrt(best);
  if (!(length > 0.0f)) return frame;
  const float3 uv = k == 0 ? edge[0] : k == 1 ? edge[1] : edge[2];
  const float3 uw = -(k == 0 ? edge[2] : k == 1 ? edge[0] : edge[1]);
  const float3 first = uv / length;

  float3 normal = cross(first, uw);
  float height = sqrt(dot(normal, normal));
  if (height > FLAT * length) {
    normal *= (inverted ? -1.0f : 1.0f) / height;
    height = inverted ? -height : height;
  } else {
    normal = outward - dot(outward, first) * first;
    const float size = sqrt(dot(normal, normal));
    normal = size > 0.0f ? normal / size : any_normal(first);
    height = 0.0f;
  }
  const float3 second = cross(normal, first);

  const float along = dot(uw, first);
  const float g00 = length, g01 = (2.0f * along - length) / SQRT3, g11 = 2.0f * height / SQRT3;
  const float trace = g00 + g11, spin = -g01;
  const float norm = sqrt(trace * trace + spin * spin);
  const int ambiguous = norm <= ROTATION_TIE * (fabs(g00) + fabs(g01) + fabs(g11));
  float c = ambiguous ? 1.0f : trace / norm, s = ambiguous ? 0.0f : spin / norm;
  const float turn_cos = k == 0 ? 1.0f : -0.5f;
  const float turn_sin = k == 0 ? 0.0f : k == 1 ? -0.5f * SQRT3 : 0.5f * SQRT3;
  const float turned = c * turn_cos - s * turn_sin;
  s = s * turn_cos + c * turn_sin;
  c = turned;
  frame.x = c * first + s * second;
  frame.y = c * second - s * first;
  return frame;
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

// frames: 8 floats a triangle, x in 0..2 and y in 4..6. slots: 3 floats a corner, the negated forces.
kernel void element_forces(global const float* positions, global const float* normals, global const uchar* inverted,
                           global const uint* vertex, global float* frames, global float* slots,
                           const ElementParams material, uint count) {
  const uint t = get_global_id(0);
  if (t >= count) return;
  const uint3 v = vload3(t, vertex);
  const Corners p = load_corners(positions, v);
  const Corners n = load_corners(normals, v);
  const ElementFrame frame = element_frame(p, inverted[t], n.at[0] + n.at[1] + n.at[2]);
  vstore4((float4)(frame.x, 0.0f), 2 * t, frames);
  vstore4((float4)(frame.y, 0.0f), 2 * t + 1, frames);
  const float rest = all(frame.x == 0.0f) ? 0.0f : material.edge_length;
  stress_slots(frame.x, frame.y, p.at[1] - p.at[0], p.at[2] - p.at[0], rest, material, t, slots);
}

kernel void element_product(global const float* frames, global const uint* vertex, global const float* d,
                            global float* slots, global const int* done, const ElementParams material, uint count) {
  const uint t = get_global_id(0);
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
  const uint t = get_global_id(0);
  if (t >= count) return;
  const Corners p = load_corners(positions, vload3(t, vertex));
  const float3 a = spring_pull(p.at[1] - p.at[0], material);
  const float3 b = spring_pull(p.at[2] - p.at[1], material);
  const float3 c = spring_pull(p.at[0] - p.at[2], material);
  store_corners(c - a, a - b, b - c, t, slots);
}

kernel void spring_product(global const float* positions, global const uint* vertex, global const float* d,
                           global float* slots, global const int* done, const ElementParams material, uint count) {
  const uint t = get_global_id(0);
  if (t >= count || *done) return;
  const uint3 v = vload3(t, vertex);
  const Corners p = load_corners(positions, v);
  const Corners dx = load_corners(d, v);
  const float3 a = spring_stiffness(p.at[1] - p.at[0], dx.at[1] - dx.at[0], material);
  const float3 b = spring_stiffness(p.at[2] - p.at[1], dx.at[2] - dx.at[1], material);
  const float3 c = spring_stiffness(p.at[0] - p.at[2], dx.at[0] - dx.at[2], material);
  store_corners(c - a, a - b, b - c, t, slots);
}
