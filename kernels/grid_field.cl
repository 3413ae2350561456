// Field part of a program: GridField (core/field/grid_field.h), one point a work item (build with VW=1). Taps come in
// rows of four along z from bricks padded to 11^3, so no tap ever crosses a brick.
#if VW != 1
#error "grid fields take one point a work item"
#endif

#define BRICK 8
#define TAPS 11

typedef struct {
  Origin origin;  // of voxel 8 * table_low
  float over_h;
  int size[3];  // of the table, bricks
  float outside;
} GridParams;

#define FIELD_PARAMS                                                                                \
  global const int *field_table, global const float *field_constant, global const float *field_tap, \
      const GridParams field
#define FIELD_ARGS field_table, field_constant, field_tap, field

// Where a point's taps begin, or the constant that holds there.
typedef struct {
  global const float* tap;  // 0: constant
  float value;
  float3 t;  // within the cell
} GridCell;

INLINE GridCell grid_cell(FIELD_PARAMS, vec3v p) {
  const float x = p.x * field.over_h, y = p.y * field.over_h, z = p.z * field.over_h;
  GridCell cell = {0, field.outside, (float3)(0.0f)};
  const int within = x >= 0.0f && y >= 0.0f && z >= 0.0f && x < (float)(BRICK * field.size[0]) &&
                     y < (float)(BRICK * field.size[1]) && z < (float)(BRICK * field.size[2]);
  if (!within) return cell;  // also where the point is not a number
  const int i = (int)x, j = (int)y, k = (int)z;
  const int entry = field_table[((i >> 3) * field.size[1] + (j >> 3)) * field.size[2] + (k >> 3)];
  cell.t = (float3)(x - (float)i, y - (float)j, z - (float)k);
  if (entry < 0)
    cell.value = field_constant[-1 - entry];
  else
    cell.tap = field_tap + (size_t)entry * (TAPS * TAPS * TAPS) + ((i & 7) * TAPS + (j & 7)) * TAPS + (k & 7);
  return cell;
}

#ifdef CUBIC
// Weights of the cubic B-spline on taps -1, 0, 1, 2 at t in [0, 1), and their derivatives.
INLINE float4 weights(float t) {
  const float s = 1.0f - t;
  const float t2 = t * t;
  const float s2 = s * s;
  return (float4)(s2 * s, 4.0f + 3.0f * t2 * (t - 2.0f), 4.0f + 3.0f * s2 * (s - 2.0f), t2 * t) * (1.0f / 6.0f);
}
INLINE float4 first_weights(float t) {
  const float s = 1.0f - t;
  return (float4)(-s * s, t * (3.0f * t - 4.0f), s * (4.0f - 3.0f * s), t * t) * 0.5f;
}
INLINE float4 second_weights(float t) {
  return (float4)(1.0f - t, 3.0f * t - 2.0f, 1.0f - 3.0f * t, t);
}

INLINE float dot4(float4 a, float4 b) {
  const float4 c = a * b;
  return (c.x + c.y) + (c.z + c.w);
}

INLINE float4 blend(float4 w, float4 a, float4 b, float4 c, float4 d) {
  return MUL_ADD((float4)(w.w), d, MUL_ADD((float4)(w.z), c, MUL_ADD((float4)(w.y), b, w.x * a)));
}

// The rows of four planes of equal x, blended along y. Named, not arrays: PoCL would keep arrays in memory.
typedef struct {
  float4 a, b, c, d;
} Planes;

INLINE float4 rows(global const float* tap, float4 w) {
  return blend(w, vload4(0, tap), vload4(0, tap + TAPS), vload4(0, tap + 2 * TAPS), vload4(0, tap + 3 * TAPS));
}

INLINE Planes planes(global const float* tap, float4 w) {
  const int next = TAPS * TAPS;
  return (Planes){rows(tap, w), rows(tap + next, w), rows(tap + 2 * next, w), rows(tap + 3 * next, w)};
}

INLINE float4 across(float4 w, Planes p) {
  return blend(w, p.a, p.b, p.c, p.d);
}

INLINE FieldValue field_sample(FIELD_PARAMS, vec3v p) {
  const GridCell cell = grid_cell(FIELD_ARGS, p);
  if (!cell.tap) return (FieldValue){cell.value, {0.0f, 0.0f, 0.0f}};
  const float4 wx = weights(cell.t.x), wy = weights(cell.t.y), wz = weights(cell.t.z);
  const float4 dx = first_weights(cell.t.x), dy = first_weights(cell.t.y), dz = first_weights(cell.t.z);
  const Planes by_y = planes(cell.tap, wy), by_dy = planes(cell.tap, dy);
  const float4 f = across(wx, by_y), fx = across(dx, by_y), fy = across(wx, by_dy);
  return (FieldValue){dot4(f, wz),
                      {dot4(fx, wz) * field.over_h, dot4(fy, wz) * field.over_h, dot4(f, dz) * field.over_h}};
}

INLINE void field_hessian(FIELD_PARAMS, vec3v p, vfloat* h) {
  for (int k = 0; k < 6; ++k) h[k] = 0.0f;
  const GridCell cell = grid_cell(FIELD_ARGS, p);
  if (!cell.tap) return;
  const float4 wz = weights(cell.t.z), dz = first_weights(cell.t.z), ez = second_weights(cell.t.z);
  const float4 wx = weights(cell.t.x), dx = first_weights(cell.t.x), ex = second_weights(cell.t.x);
  const float4 wy = weights(cell.t.y), dy = first_weights(cell.t.y), ey = second_weights(cell.t.y);
  const Planes by_y = planes(cell.tap, wy), by_dy = planes(cell.tap, dy), by_ey = planes(cell.tap, ey);
  const float scale = field.over_h * field.over_h;
  h[0] = scale * dot4(across(ex, by_y), wz);
  h[1] = scale * dot4(across(wx, by_ey), wz);
  h[2] = scale * dot4(across(wx, by_y), ez);
  h[3] = scale * dot4(across(dx, by_dy), wz);
  h[4] = scale * dot4(across(dx, by_y), dz);
  h[5] = scale * dot4(across(wx, by_dy), dz);
}
#else
// Values at the corners of the cell, z pairs, and the six differences the gradient and the mixed derivatives need.
INLINE FieldValue field_sample(FIELD_PARAMS, vec3v p) {
  const GridCell cell = grid_cell(FIELD_ARGS, p);
  if (!cell.tap) return (FieldValue){cell.value, {0.0f, 0.0f, 0.0f}};
  global const float* corner = cell.tap + (TAPS + 1) * TAPS + 1;
  const float2 a = vload2(0, corner), b = vload2(0, corner + TAPS);
  const float2 c = vload2(0, corner + TAPS * TAPS), d = vload2(0, corner + TAPS * TAPS + TAPS);
  const float2 low = MUL_ADD((float2)(cell.t.y), b - a, a), high = MUL_ADD((float2)(cell.t.y), d - c, c);
  const float2 f = MUL_ADD((float2)(cell.t.x), high - low, low);
  const float2 fx = high - low;
  const float2 fy = MUL_ADD((float2)(cell.t.x), (d - c) - (b - a), b - a);
  const float tz = cell.t.z;
  return (FieldValue){MUL_ADD(tz, f.y - f.x, f.x),
                      {MUL_ADD(tz, fx.y - fx.x, fx.x) * field.over_h, MUL_ADD(tz, fy.y - fy.x, fy.x) * field.over_h,
                       (f.y - f.x) * field.over_h}};
}

// Linear along each axis: only the mixed derivatives are not zero.
INLINE void field_hessian(FIELD_PARAMS, vec3v p, vfloat* h) {
  for (int k = 0; k < 6; ++k) h[k] = 0.0f;
  const GridCell cell = grid_cell(FIELD_ARGS, p);
  if (!cell.tap) return;
  global const float* corner = cell.tap + (TAPS + 1) * TAPS + 1;
  const float2 a = vload2(0, corner), b = vload2(0, corner + TAPS);
  const float2 c = vload2(0, corner + TAPS * TAPS), d = vload2(0, corner + TAPS * TAPS + TAPS);
  const float2 fxy = (d - c) - (b - a);
  const float2 fx = MUL_ADD((float2)(cell.t.y), fxy, c - a);
  const float2 fy = MUL_ADD((float2)(cell.t.x), fxy, b - a);
  const float scale = field.over_h * field.over_h;
  h[3] = scale * MUL_ADD(cell.t.z, fxy.y - fxy.x, fxy.x);
  h[4] = scale * (fx.y - fx.x);
  h[5] = scale * (fy.y - fy.x);
}
#endif
