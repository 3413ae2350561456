// Conjugate gradients for (I + dt K) dx = dt f, filtered at each vertex with S = I - n n^T, or S = 0 where it is pinned
// (core/mechanics/relax.h).
// Every work item owns a fixed share of the vertices, so a sum has the same tree whatever the device does; one item
// finishes the partial sums in order and keeps the scalars. After convergence all kernels return at once.
#pragma OPENCL FP_CONTRACT OFF
#define INLINE static inline __attribute__((always_inline))

#if VW == 16
typedef float16 vfloat;
#define LOAD(i, from) vload16(i, from)
#define STORE(v, i, to) vstore16(v, i, to)
// A CPU's item owns neighbours, a GPU's strides so that neighbours are read together.
#define OWN(k) (item * share.each + (k))
#define OWN_PACKET(k) (item * (3 * share.each / VW) + (k))
INLINE float lane_sum(float16 v) {
  const float8 a = v.lo + v.hi;
  const float4 b = a.lo + a.hi;
  const float2 c = b.lo + b.hi;
  return c.x + c.y;
}
#else
typedef float vfloat;
#define LOAD(i, from) ((from)[i])
#define STORE(v, i, to) ((to)[i] = (v))
#define OWN(k) (item + (k)*share.items)
#define OWN_PACKET(k) (item + (k)*share.items)
INLINE float lane_sum(float v) {
  return v;
}
#endif

typedef struct {
  uint items;     // work items with a share
  uint each;      // vertices of each; arrays hold items * each vertices, zero behind the last
  uint vertices;  // of the mesh
} Share;

typedef struct {
  int done;
  int iterations;  // of all solves since the state was cleared
  float start;     // r.r at the start
  float rr;        // r.r now
  float alpha;
  float beta;
} CgState;

// S a at one vertex.
INLINE float3 filtered(float3 a, float3 n, uchar pinned) {
  return pinned ? (float3)(0.0f) : a - dot(n, a) * n;
}

INLINE float3 gather_corners(global const uint* first, global const uint* corner, global const float* slots, uint v) {
  float3 sum = (float3)(0.0f);
  const uint end = first[v + 1];
  for (uint i = first[v]; i < end; ++i) sum += vload3(corner[i], slots);
  return sum;
}

// r = p = S dt f with f minus the gathered slots; x = 0.
kernel void start(global const uint* first, global const uint* corner, global const float* slots,
                  global const float* normals, global const uchar* pinned, global float* x, global float* r,
                  global float* p, global float* partial, float dt, const Share share) {
  const uint item = ITEM;
  if (item >= share.items) return;
  float sum = 0.0f;
  for (uint k = 0; k < share.each; ++k) {
    const uint v = OWN(k);
    float3 f = (float3)(0.0f);
    if (v < share.vertices) {
      f = filtered(-dt * gather_corners(first, corner, slots, v), vload3(v, normals), pinned[v]);
    }
    vstore3((float3)(0.0f), v, x);
    vstore3(f, v, r);
    vstore3(f, v, p);
    sum += dot(f, f);
  }
  partial[item] = sum;
}

// q = S (p + dt K p) with K p gathered from the slots; partial sums of p.q.
kernel void product(global const uint* first, global const uint* corner, global const float* slots,
                    global const float* normals, global const uchar* pinned, global const float* p, global float* q,
                    global float* partial, global const CgState* state, float dt, const Share share) {
  const uint item = ITEM;
  if (item >= share.items || state->done) return;
  float sum = 0.0f;
  for (uint k = 0; k < share.each; ++k) {
    const uint v = OWN(k);
    float3 a = (float3)(0.0f);
    if (v < share.vertices) {
      const float3 d = vload3(v, p);
      a = filtered(d + dt * gather_corners(first, corner, slots, v), vload3(v, normals), pinned[v]);
      sum += dot(d, a);
    }
    vstore3(a, v, q);
  }
  partial[item] = sum;
}

// x += alpha p, r -= alpha q; partial sums of r.r.
kernel void advance(global float* x, global float* r, global const float* p, global const float* q,
                    global float* partial, global const CgState* state, const Share share) {
  const uint item = ITEM;
  if (item >= share.items || state->done) return;
  const float alpha = state->alpha;
  vfloat sum = 0.0f;
  for (uint k = 0; k < 3 * share.each / VW; ++k) {
    const uint i = OWN_PACKET(k);
    const vfloat left = LOAD(i, r) - alpha * LOAD(i, q);
    STORE(LOAD(i, x) + alpha * LOAD(i, p), i, x);
    STORE(left, i, r);
    sum += left * left;
  }
  partial[item] = lane_sum(sum);
}

// p = r + beta p
kernel void turn(global float* p, global const float* r, global const CgState* state, const Share share) {
  const uint item = ITEM;
  if (item >= share.items || state->done) return;
  const float beta = state->beta;
  for (uint k = 0; k < 3 * share.each / VW; ++k) {
    const uint i = OWN_PACKET(k);
    STORE(LOAD(i, r) + beta * LOAD(i, p), i, p);
  }
}

// Neumaier's compensated sum: as good as double, on devices that have none.
INLINE float finish_sum(global const float* partial, uint count) {
  float sum = 0.0f, lost = 0.0f;
  for (uint i = 0; i < count; ++i) {
    const float next = partial[i];
    const float total = sum + next;
    lost += fabs(sum) >= fabs(next) ? (sum - total) + next : (next - total) + sum;
    sum = total;
  }
  return sum + lost;
}

kernel void finish_start(global const float* partial, global CgState* state, float tolerance, uint count) {
  if (ITEM != 0) return;
  const float rr = finish_sum(partial, count);
  state->start = rr;
  state->rr = rr;
  state->done = !(rr > tolerance * tolerance * rr);
}

kernel void finish_alpha(global const float* partial, global CgState* state, uint count) {
  if (ITEM != 0 || state->done) return;
  const float pq = finish_sum(partial, count);
  state->done = !(pq > 0.0f);  // only when p has vanished: the system is positive definite
  state->alpha = state->rr / pq;
}

kernel void finish_beta(global const float* partial, global CgState* state, float tolerance, uint count) {
  if (ITEM != 0 || state->done) return;
  const float rr = finish_sum(partial, count);
  state->beta = rr / state->rr;
  state->rr = rr;
  state->iterations += 1;
  state->done = !(rr > tolerance * tolerance * state->start);
}

// positions += dx, clamped to the longest move; a move that is not finite is none.
kernel void move(global float* positions, global const float* x, float longest, uint count) {
  const uint v = ITEM;
  if (v >= count) return;
  const float3 d = vload3(v, x);
  const float length = sqrt(dot(d, d));
  if (!isfinite(length)) return;
  vstore3(vload3(v, positions) + (length > longest ? d * (longest / length) : d), v, positions);
}
