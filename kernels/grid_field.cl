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

GridCell grid_cell(FIELD_PARAMS, vec3v p) {
  const float3 u = (float3)(p.x, p.y, p.z) * field.over_h;
  const float3 base = floor(u);
  GridCell cell = {0, field.outside, u - base};
  const float3 end = (float3)(field.size[0], field.size[1], field.size[2]) * (float)BRICK;
  if (!all(base >= 0.0f && base < end)) return cell;  // also where u is NaN
  const int3 c = convert_int3(base);
  const int3 b = c / BRICK;
  const int3 i = c % BRICK;
  const int entry = field_table[(b.x * field.size[1] + b.y) * field.size[2] + b.z];
  if (entry < 0)
    cell.value = field_constant[-1 - entry];
  else
    cell.tap = field_tap + (size_t)entry * (TAPS * TAPS * TAPS) + (i.x * TAPS + i.y) * TAPS + i.z;
  return cell;
}

#ifdef CUBIC
// Weights of the cubic B-spline on taps -1, 0, 1, 2 at t in [0, 1), and their derivatives.
float4 weights(float t) {
  const float s = 1.0f - t;
  const float t2 = t * t;
  const float s2 = s * s;
  return (float4)(s2 * s, 4.0f + 3.0f * t2 * (t - 2.0f), 4.0f + 3.0f * s2 * (s - 2.0f), t2 * t) * (1.0f / 6.0f);
}
float4 first_weights(float t) {
  const float s = 1.0f - t;
  return (float4)(-s * s, t * (3.0f * t - 4.0f), s * (4.0f - 3.0f * s), t * t) * 0.5f;
}
float4 second_weights(float t) {
  return (float4)(1.0f - t, 3.0f * t - 2.0f, 1.0f - 3.0f * t, t);
}

float dot4(float4 a, float4 b) {
  const float4 c = a * b;
  return (c.x + c.y) + (c.z + c.w);
}

float4 row(global const float* tap, int x, int y) {
  return vload4(0, tap + (x * TAPS + y) * TAPS);
}

float4 blend(float4 w, float4 a, float4 b, float4 c, float4 d) {
  return MUL_ADD((float4)(w.w), d, MUL_ADD((float4)(w.z), c, MUL_ADD((float4)(w.y), b, w.x * a)));
}

FieldValue field_sample(FIELD_PARAMS, vec3v p) {
  const GridCell cell = grid_cell(FIELD_ARGS, p);
  if (!cell.tap) return (FieldValue){cell.value, {0.0f, 0.0f, 0.0f}};
  const float4 wx = weights(cell.t.x), wy = weights(cell.t.y), wz = weights(cell.t.z);
  const float4 dx = first_weights(cell.t.x), dy = first_weights(cell.t.y), dz = first_weights(cell.t.z);
  float4 by_y[4], by_dy[4];
  for (int i = 0; i < 4; ++i) {
    const float4 a = row(cell.tap, i, 0), b = row(cell.tap, i, 1), c = row(cell.tap, i, 2), d = row(cell.tap, i, 3);
    by_y[i] = blend(wy, a, b, c, d);
    by_dy[i] = blend(dy, a, b, c, d);
  }
  const float4 f = blend(wx, by_y[0], by_y[1], by_y[2], by_y[3]);
  const float4 fx = blend(dx, by_y[0], by_y[1], by_y[2], by_y[3]);
  const float4 fy = blend(wx, by_dy[0], by_dy[1], by_dy[2], by_dy[3]);
  return (FieldValue){dot4(f, wz),
                      {dot4(fx, wz) * field.over_h, dot4(fy, wz) * field.over_h, dot4(f, dz) * field.over_h}};
}

void field_hessian(FIELD_PARAMS, vec3v p, vfloat* h) {
  for (int k = 0; k < 6; ++k) h[k] = 0.0f;
  const GridCell cell = grid_cell(FIELD_ARGS, p);
  if (!cell.tap) return;
  const float4 wz = weights(cell.t.z), dz = first_weights(cell.t.z), ez = second_weights(cell.t.z);
  const float4 wx = weights(cell.t.x), dx = first_weights(cell.t.x), ex = second_weights(cell.t.x);
  const float4 wy = weights(cell.t.y), dy = first_weights(cell.t.y), ey = second_weights(cell.t.y);
  float4 by_y[4], by_dy[4], by_ey[4];
  for (int i = 0; i < 4; ++i) {
    const float4 a = row(cell.tap, i, 0), b = row(cell.tap, i, 1), c = row(cell.tap, i, 2), d = row(cell.tap, i, 3);
    by_y[i] = blend(wy, a, b, c, d);
    by_dy[i] = blend(dy, a, b, c, d);
    by_ey[i] = blend(ey, a, b, c, d);
  }
  const float scale = field.over_h * field.over_h;
  const float4 f = blend(wx, by_y[0], by_y[1], by_y[2], by_y[3]);
  const float4 fx = blend(dx, by_y[0], by_y[1], by_y[2], by_y[3]);
  const float4 fy = blend(wx, by_dy[0], by_dy[1], by_dy[2], by_dy[3]);
  h[0] = scale * dot4(blend(ex, by_y[0], by_y[1], by_y[2], by_y[3]), wz);
  h[1] = scale * dot4(blend(wx, by_ey[0], by_ey[1], by_ey[2], by_ey[3]), wz);
  h[2] = scale * dot4(f, ez);
  h[3] = scale * dot4(blend(dx, by_dy[0], by_dy[1], by_dy[2], by_dy[3]), wz);
  h[4] = scale * dot4(fx, dz);
  h[5] = scale * dot4(fy, dz);
}
#else
// Values at the corners of the cell, z pairs, and the six differences the gradient and the mixed derivatives need.
FieldValue field_sample(FIELD_PARAMS, vec3v p) {
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
void field_hessian(FIELD_PARAMS, vec3v p, vfloat* h) {
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
