// First part of every program: a packet of VW points a work item (16 on CPUs for explicit SIMD, 1 on GPUs), and the
// loads and stores of packed float triples that guard the tail.
#pragma OPENCL FP_CONTRACT OFF

// PoCL calls what it is not told to inline, and passes structs through memory.
#define INLINE static inline __attribute__((always_inline))

#ifndef VW
#define VW 1
#endif

#if VW == 16
typedef float16 vfloat;
typedef int16 vint;
#define ANY(mask) any(mask)
#elif VW == 1
typedef float vfloat;
typedef int vint;
#define ANY(mask) (mask)
#else
#error "VW must be 1 or 16"
#endif

// Comparisons give -1 in vectors and 1 in scalars; select() takes both.
#if VW == 1
#define ALL_LANES 1
#define TO_INT(v) convert_int_rtn(v)
#define TO_FLOAT(v) convert_float(v)
#else
#define ALL_LANES ((vint)(-1))
#define TO_INT(v) convert_int16_rtn(v)
#define TO_FLOAT(v) convert_float16(v)
#endif

// One rounding where the device has it, two where it would have to be emulated.
#ifdef FP_FAST_FMAF
#define MUL_ADD(a, b, c) fma(a, b, c)
#else
#define MUL_ADD(a, b, c) ((a) * (b) + (c))
#endif

typedef struct {
  vfloat x, y, z;
} vec3v;

INLINE vfloat dot3(vec3v a, vec3v b) {
  return MUL_ADD(a.z, b.z, MUL_ADD(a.y, b.y, a.x * b.x));
}

INLINE vint is_finite(vec3v p) {
  return isfinite(p.x) && isfinite(p.y) && isfinite(p.z);
}

#if VW == 16
INLINE vec3v unpack(float16 a, float16 b, float16 c) {
  vec3v p;
  p.x = (float16)(a.s0369, a.scf, b.s258b, b.se, c.s147a, c.sd);
  p.y = (float16)(a.s147a, a.sd, b.s0369, b.scf, c.s258b, c.se);
  p.z = (float16)(a.s258b, a.se, b.s147a, b.sd, c.s0369, c.scf);
  return p;
}

typedef struct {
  float16 a, b, c;
} Packed;

INLINE Packed pack(vec3v p) {
  const float16 x = p.x, y = p.y, z = p.z;
  const float16 a =
      (float16)(x.s0, y.s0, z.s0, x.s1, y.s1, z.s1, x.s2, y.s2, z.s2, x.s3, y.s3, z.s3, x.s4, y.s4, z.s4, x.s5);
  const float16 b =
      (float16)(y.s5, z.s5, x.s6, y.s6, z.s6, x.s7, y.s7, z.s7, x.s8, y.s8, z.s8, x.s9, y.s9, z.s9, x.sa, y.sa);
  const float16 c =
      (float16)(z.sa, x.sb, y.sb, z.sb, x.sc, y.sc, z.sc, x.sd, y.sd, z.sd, x.se, y.se, z.se, x.sf, y.sf, z.sf);
  return (Packed){a, b, c};
}

// Points first .. first + VW - 1 of a packed array; lanes behind the end repeat the last point.
INLINE vec3v load_points(global const float* from, uint first, uint count) {
  const uint at = 3 * first;
  if (first + VW <= count) return unpack(vload16(0, from + at), vload16(1, from + at), vload16(2, from + at));
  float lane[3 * VW];
  for (uint i = 0; i < VW; ++i)
    for (uint k = 0; k < 3; ++k) lane[3 * i + k] = from[3 * min(first + i, count - 1) + k];
  return unpack(vload16(0, lane), vload16(1, lane), vload16(2, lane));
}

INLINE void store_points(vec3v p, global float* to, uint first, uint count) {
  const Packed packed = pack(p);
  const uint at = 3 * first;
  if (first + VW <= count) {
    vstore16(packed.a, 0, to + at);
    vstore16(packed.b, 1, to + at);
    vstore16(packed.c, 2, to + at);
    return;
  }
  float lane[3 * VW];
  vstore16(packed.a, 0, lane);
  vstore16(packed.b, 1, lane);
  vstore16(packed.c, 2, lane);
  for (uint i = 0; i < 3 * (count - first); ++i) to[at + i] = lane[i];
}

INLINE void store_values(vfloat v, global float* to, uint first, uint count) {
  if (first + VW <= count) {
    vstore16(v, 0, to + first);
  } else {
    float lane[VW];
    vstore16(v, 0, lane);
    for (uint i = 0; i < count - first; ++i) to[first + i] = lane[i];
  }
}

INLINE void store_flags(vint v, global uchar* to, uint first, uint count) {
  const uchar16 flags = convert_uchar16(v);
  if (first + VW <= count) {
    vstore16(flags, 0, to + first);
    return;
  }
  uchar lane[VW];
  vstore16(flags, 0, lane);
  for (uint i = 0; i < count - first; ++i) to[first + i] = lane[i];
}

INLINE int least(int16 v) {
  const int8 a = min(v.lo, v.hi);
  const int4 b = min(a.lo, a.hi);
  const int2 c = min(b.lo, b.hi);
  return min(c.lo, c.hi);
}
#else
INLINE vec3v load_points(global const float* from, uint first, uint count) {
  const float3 p = vload3(first, from);
  return (vec3v){p.x, p.y, p.z};
}
INLINE void store_points(vec3v p, global float* to, uint first, uint count) {
  vstore3((float3)(p.x, p.y, p.z), first, to);
}
INLINE void store_values(vfloat v, global float* to, uint first, uint count) {
  to[first] = v;
}
INLINE void store_flags(vint v, global uchar* to, uint first, uint count) {
  to[first] = (uchar)v;
}
INLINE int least(int v) {
  return v;
}
#endif

// Positions relative to an origin kept in two floats: exact near the origin however far that is from zero.
typedef struct {
  float high[3];
  float low[3];
} Origin;

INLINE vec3v to_local(vec3v p, Origin o) {
  p.x = (p.x - o.high[0]) - o.low[0];
  p.y = (p.y - o.high[1]) - o.low[1];
  p.z = (p.z - o.high[2]) - o.low[2];
  return p;
}

INLINE vec3v to_world(vec3v p, Origin o) {
  p.x = (p.x + o.low[0]) + o.high[0];
  p.y = (p.y + o.low[1]) + o.high[1];
  p.z = (p.z + o.low[2]) + o.high[2];
  return p;
}

typedef struct {
  vfloat value;
  vec3v gradient;
} FieldValue;
