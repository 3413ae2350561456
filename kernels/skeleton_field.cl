// Field part of a program: SkeletonField (core/field/skeleton_field.h) over a packet of points. Triangles and boxes are
// known with SOLIDS, norms other than 2 with GENERAL_NORM. Compact elements far
// from a point are skipped through a uniform grid of element lists; the others are in the list of all points. With
// GROUPS it is a BlendGraphField, and every group's elements are added in turn.
enum { INVERSE_SQUARE, CAUCHY, METABALL, BLINN, WYVILL };

#define SINGULARITY 1e-6f  // inverse square is constant nearer than this share of the radius
#define FAR 1e18f          // its square is still a float
#define LEAST_SHARE 1e-6f  // of |x_i| / d in the derivatives of a p-norm

typedef struct {
  float a[3];
  float unused;
  float ab[3];
  float over_length2;  // 1 / |ab|^2, 0 for a point
  float over_radius2;
  float scale[3];  // of the potential's value, twice its first and four times its second derivative by d^2
  float norm;
  int potential;
  int solid;  // index of the SkeletonSolid among the elements; 0 for points and segments
  int more_unused;
} SkeletonElement;

// The other half of a triangle or a box; as large as an element.
typedef struct {
  float ac[3];
  float over_ac2;
  float ad[3];  // of a triangle: its unit normal, 0 where it is flat
  float over_ad2;
  float to_b[3];  // dot product with p - a: the share of corner b in the nearest point of the triangle's plane
  float over_bc2;
  float to_c[3];
  int is_box;
} SkeletonSolid;

typedef struct {
  Origin origin;
  float iso;
  float low[3];  // of the grid of lists, relative to the origin
  float over_cell;
  int size[3];
  uint always;  // the first entries of the list: elements that reach every point
} SkeletonParams;

#define FIELD_PARAMS                                                                                           \
  global const SkeletonElement *field_elements, global const uint *field_first, global const uint *field_list, \
      const SkeletonParams field
#define FIELD_ARGS field_elements, field_first, field_list, field

typedef struct {
  vfloat value;
  vec3v g;
  vfloat xx, yy, zz, xy, xz, yz;
} SkeletonSum;

typedef struct {  // of a potential by s = d^2: value, 2 first and 4 second derivative
  vfloat value, slope, bend;
} Profile;

INLINE Profile profile(const SkeletonElement e, vfloat s) {
  const vfloat q = s * e.over_radius2;
  Profile f;
  switch (e.potential) {
    case INVERSE_SQUARE: {
      const vfloat over_q = 1.0f / q;
      const vfloat over_s = 1.0f / s;
      const vint near = q < SINGULARITY * SINGULARITY;
      f.value = select(over_q, (vfloat)(1.0f / (SINGULARITY * SINGULARITY)), near);
      f.slope = select(over_q * over_s, (vfloat)(0.0f), near);
      f.bend = select(over_q * over_s * over_s, (vfloat)(0.0f), near);
      break;
    }
    case CAUCHY: {
      f.value = 1.0f / (1.0f + s);
      f.slope = f.value * f.value;
      f.bend = f.slope * f.value;
      break;
    }
    case METABALL: {
      f.bend = fmax(1.0f - q, 0.0f);
      f.slope = f.bend * f.bend;
      f.value = f.slope * f.bend;
      break;
    }
    case BLINN: {
      f.value = exp(-q);
      f.slope = f.value;
      f.bend = f.value;
      break;
    }
    default: {  // WYVILL
      const vint far = q >= 1.0f;
      f.value = select(1.0f + q * (-22.0f + q * (17.0f - 4.0f * q)) * (1.0f / 9.0f), (vfloat)(0.0f), far);
      f.slope = select(-22.0f + q * (34.0f - 12.0f * q), (vfloat)(0.0f), far);
      f.bend = select(34.0f - 24.0f * q, (vfloat)(0.0f), far);
    }
  }
  f.value *= e.scale[0];
  f.slope *= e.scale[1];
  f.bend *= e.scale[2];
  return f;
}

// Of a Euclidean distance; `x` is p minus the nearest point.
INLINE Profile add_value_and_gradient(const SkeletonElement e, vec3v x, SkeletonSum* sum) {
  const Profile f = profile(e, dot3(x, x));
  sum->value += f.value;
  sum->g.x = MUL_ADD(f.slope, x.x, sum->g.x);
  sum->g.y = MUL_ADD(f.slope, x.y, sum->g.y);
  sum->g.z = MUL_ADD(f.slope, x.z, sum->g.z);
  return f;
}

// Orthonormal directions along which an element's nearest point follows p; zero where there are none.
typedef struct {
  vec3v a;
#ifdef SOLIDS
  vec3v b, c;
#endif
} Slides;

INLINE vec3v times(vfloat t, vec3v v) {
  return (vec3v){t * v.x, t * v.y, t * v.z};
}

INLINE vec3v packet(const float* v) {
  return (vec3v){(vfloat)(v[0]), (vfloat)(v[1]), (vfloat)(v[2])};
}

INLINE vec3v across_one(vec3v g, vec3v slide) {
  const vfloat along = dot3(g, slide);
  g.x -= along * slide.x;
  g.y -= along * slide.y;
  g.z -= along * slide.z;
  return g;
}

INLINE vec3v across(vec3v g, Slides slides) {
  g = across_one(g, slides.a);
#ifdef SOLIDS
  g = across_one(across_one(g, slides.b), slides.c);
#endif
  return g;
}

#ifdef GENERAL_NORM
INLINE vfloat diagonal_power(vfloat x, vfloat over_d, float norm) {
  return powr(fmax(fabs(x) * over_d, LEAST_SHARE), (vfloat)(norm - 2.0f));
}

// d of the p-norm, 0 at 0.
INLINE vfloat norm_of(vec3v x, float norm) {
  const vfloat most = fmax(fabs(x.x), fmax(fabs(x.y), fabs(x.z)));
  const vfloat scale = 1.0f / fmax(most, FLT_MIN);
  const vfloat p = (vfloat)(norm);
  const vfloat sum = powr(fabs(x.x) * scale, p) + powr(fabs(x.y) * scale, p) + powr(fabs(x.z) * scale, p);
  return most * powr(fmax(sum, 1.0f), (vfloat)(1.0f / norm));
}

INLINE void add_general(const SkeletonElement e, vec3v x, Slides slides, int with_hessian, SkeletonSum* sum) {
  const vfloat d = norm_of(x, e.norm);
  const vfloat over_d = 1.0f / fmax(d, FLT_MIN);
  const Profile f = profile(e, d * d);
  const vfloat rx = diagonal_power(x.x, over_d, e.norm), ry = diagonal_power(x.y, over_d, e.norm),
               rz = diagonal_power(x.z, over_d, e.norm);
  vec3v v;  // grad d
  v.x = select(copysign(rx * fmax(fabs(x.x) * over_d, LEAST_SHARE), x.x), (vfloat)(0.0f), x.x == 0.0f);
  v.y = select(copysign(ry * fmax(fabs(x.y) * over_d, LEAST_SHARE), x.y), (vfloat)(0.0f), x.y == 0.0f);
  v.z = select(copysign(rz * fmax(fabs(x.z) * over_d, LEAST_SHARE), x.z), (vfloat)(0.0f), x.z == 0.0f);
  const vint live = d > 0.0f;
  const vfloat slope = select((vfloat)(0.0f), f.slope * d, live);
  vec3v g = {slope * v.x, slope * v.y, slope * v.z};
  g = across(g, slides);
  sum->value += f.value;
  sum->g.x += g.x;
  sum->g.y += g.y;
  sum->g.z += g.z;
  if (!with_hessian) return;
  const vfloat outer = f.bend * d * d + f.slope * (2.0f - e.norm);
  const vfloat bend = f.slope * (e.norm - 1.0f);
  const vint steep = live && (f.slope != 0.0f || f.bend != 0.0f);
  // keep h keep with keep = I - the slides' squares: rows first, then columns.
  vec3v row_x = {outer * v.x * v.x + bend * rx, outer * v.x * v.y, outer * v.x * v.z};
  vec3v row_y = {outer * v.y * v.x, outer * v.y * v.y + bend * ry, outer * v.y * v.z};
  vec3v row_z = {outer * v.z * v.x, outer * v.z * v.y, outer * v.z * v.z + bend * rz};
  row_x = across(row_x, slides);
  row_y = across(row_y, slides);
  row_z = across(row_z, slides);
  vec3v column_x = {row_x.x, row_y.x, row_z.x};
  vec3v column_y = {row_x.y, row_y.y, row_z.y};
  vec3v column_z = {row_x.z, row_y.z, row_z.z};
  column_x = across(column_x, slides);
  column_y = across(column_y, slides);
  column_z = across(column_z, slides);
  sum->xx += select((vfloat)(0.0f), column_x.x, steep);
  sum->yy += select((vfloat)(0.0f), column_y.y, steep);
  sum->zz += select((vfloat)(0.0f), column_z.z, steep);
  sum->xy += select((vfloat)(0.0f), column_y.x, steep);
  sum->xz += select((vfloat)(0.0f), column_z.x, steep);
  sum->yz += select((vfloat)(0.0f), column_z.y, steep);
}
#endif

#ifdef SOLIDS
// Takes from x what the nearest point does along an edge: `edge` from where x begins, `over` its squared length. The
// direction, where that point is within.
INLINE vec3v hold_along(vec3v edge, float over, vec3v* x) {
  const vfloat t = dot3(*x, edge) * over;
  const vfloat held = clamp(t, 0.0f, 1.0f);
  x->x -= held * edge.x;
  x->y -= held * edge.y;
  x->z -= held * edge.z;
  return times(select((vfloat)(0.0f), (vfloat)(sqrt(over)), t > 0.0f && t < 1.0f), edge);
}

INLINE vec3v choose(vec3v a, vec3v b, vint second) {
  return (vec3v){select(a.x, b.x, second), select(a.y, b.y, second), select(a.z, b.z, second)};
}

typedef struct {  // the part of an element that holds the nearest point: p minus that point, along what it slides
  vec3v x, slide;
  vint sure;
} Nearest;

// The edge from where x begins: `outside` where p lies beyond it, seen from the triangle.
INLINE void offer_edge(vec3v x, vec3v edge, float over, vint outside, Nearest* best) {
  const vfloat t = dot3(x, edge) * over;
  const vec3v slide = hold_along(edge, over, &x);
  // Where squared distances are the same but for rounding, only the shares tell the edge from its ends.
  const vint sure = outside && t > 0.0f && t < 1.0f;
  const vint chosen = sure || (!best->sure && dot3(x, x) < dot3(best->x, best->x));
  best->sure = best->sure || sure;
  best->x = choose(best->x, x, chosen);
  best->slide = choose(best->slide, slide, chosen);
}

// p - a becomes p minus the nearest point.
INLINE Slides hold_in_triangle(const SkeletonElement e, const SkeletonSolid s, vec3v* x) {
  const vec3v zero = {0.0f, 0.0f, 0.0f}, w = *x;
  const vec3v ab = packet(e.ab), ac = packet(s.ac), normal = packet(s.ad);
  const vec3v bc = {ac.x - ab.x, ac.y - ab.y, ac.z - ab.z}, from_b = {w.x - ab.x, w.y - ab.y, w.z - ab.z};
  const vfloat of_b = dot3(w, packet(s.to_b)), of_c = dot3(w, packet(s.to_c)), of_a = 1.0f - of_b - of_c;
  Nearest best = {w, zero, (vint)(0)};
  offer_edge(w, ab, e.over_length2, of_c < 0.0f, &best);
  offer_edge(w, ac, s.over_ac2, of_b < 0.0f, &best);
  offer_edge(from_b, bc, s.over_bc2, of_a < 0.0f, &best);
  const vint face = of_b > 0.0f && of_c > 0.0f && of_a > 0.0f;
  const vec3v along = times((vfloat)(sqrt(e.over_length2)), ab);
  const vec3v over = {normal.y * along.z - normal.z * along.y, normal.z * along.x - normal.x * along.z,
                      normal.x * along.y - normal.y * along.x};
  *x = choose(best.x, times(dot3(w, normal), normal), face);
  return (Slides){choose(best.slide, along, face), choose(zero, over, face), zero};
}

INLINE void add_solid(const SkeletonElement e, const SkeletonSolid s, vec3v x, int with_hessian, SkeletonSum* sum) {
  Slides slides;
  if (s.is_box) {
    slides.a = hold_along(packet(e.ab), e.over_length2, &x);
    slides.b = hold_along(packet(s.ac), s.over_ac2, &x);
    slides.c = hold_along(packet(s.ad), s.over_ad2, &x);
  } else {
    slides = hold_in_triangle(e, s, &x);
  }
  // Nothing is left along a slide but rounding, which a steep potential would make much of within a box.
  x = across(x, slides);
#ifdef GENERAL_NORM
  if (e.norm != 2.0f) {
    add_general(e, x, slides, with_hessian, sum);
    return;
  }
#endif
  const Profile f = add_value_and_gradient(e, x, sum);
  if (!with_hessian) return;
  // 4 f'' x x^T + 2 f' (I - the slides' squares).
  const vec3v ones = across((vec3v){1.0f, 0.0f, 0.0f}, slides), twos = across((vec3v){0.0f, 1.0f, 0.0f}, slides),
              threes = across((vec3v){0.0f, 0.0f, 1.0f}, slides);
  sum->xx += f.bend * x.x * x.x + f.slope * ones.x;
  sum->yy += f.bend * x.y * x.y + f.slope * twos.y;
  sum->zz += f.bend * x.z * x.z + f.slope * threes.z;
  sum->xy += f.bend * x.x * x.y + f.slope * ones.y;
  sum->xz += f.bend * x.x * x.z + f.slope * ones.z;
  sum->yz += f.bend * x.y * x.z + f.slope * twos.z;
}
#endif

INLINE void add_element(FIELD_PARAMS, uint at, vec3v p, int with_hessian, SkeletonSum* sum) {
  const SkeletonElement e = field_elements[field_list[at]];
  vec3v x = {p.x - e.a[0], p.y - e.a[1], p.z - e.a[2]};
#ifdef SOLIDS
  if (e.solid) {
    add_solid(e, *(global const SkeletonSolid*)(field_elements + e.solid), x, with_hessian, sum);
    return;
  }
#endif
  vfloat inside = 0.0f;  // 1 where the nearest point is within the segment
  if (e.over_length2 > 0.0f) {
    const vfloat t = (x.x * e.ab[0] + x.y * e.ab[1] + x.z * e.ab[2]) * e.over_length2;
    const vfloat held = clamp(t, 0.0f, 1.0f);
    inside = select((vfloat)(0.0f), (vfloat)(1.0f), t > 0.0f && t < 1.0f);
    x.x -= held * e.ab[0];
    x.y -= held * e.ab[1];
    x.z -= held * e.ab[2];
  }
#ifdef GENERAL_NORM
  if (e.norm != 2.0f) {
    const float unit = sqrt(e.over_length2);
    const Slides slides = {{inside * (e.ab[0] * unit), inside * (e.ab[1] * unit), inside * (e.ab[2] * unit)}};
    add_general(e, x, slides, with_hessian, sum);
    return;
  }
#endif
  const Profile f = add_value_and_gradient(e, x, sum);
  if (!with_hessian) return;
  // 4 f'' x x^T + 2 f' (I - slide slide^T): x is normal to the segment already.
  const vfloat slid = f.slope * inside * e.over_length2;
  sum->xx += f.bend * x.x * x.x + f.slope - slid * e.ab[0] * e.ab[0];
  sum->yy += f.bend * x.y * x.y + f.slope - slid * e.ab[1] * e.ab[1];
  sum->zz += f.bend * x.z * x.z + f.slope - slid * e.ab[2] * e.ab[2];
  sum->xy += f.bend * x.x * x.y - slid * e.ab[0] * e.ab[1];
  sum->xz += f.bend * x.x * x.z - slid * e.ab[0] * e.ab[2];
  sum->yz += f.bend * x.y * x.z - slid * e.ab[1] * e.ab[2];
}

#ifdef GROUPS
// The greatest sum of a group (core/field/blend_graph.h). field_first tells where each group's elements begin,
// field.always how many groups there are.
INLINE SkeletonSum sum_elements(FIELD_PARAMS, vec3v p, int with_hessian) {
  SkeletonSum best = {-INFINITY, {0.0f, 0.0f, 0.0f}, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f};
  for (uint group = 0; group < field.always; ++group) {
    SkeletonSum sum = {-field.iso, {0.0f, 0.0f, 0.0f}, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f};
    for (uint at = field_first[group]; at < field_first[group + 1]; ++at)
      add_element(FIELD_ARGS, at, p, with_hessian, &sum);
    const vint more = sum.value > best.value;
    best.value = select(best.value, sum.value, more);
    best.g.x = select(best.g.x, sum.g.x, more);
    best.g.y = select(best.g.y, sum.g.y, more);
    best.g.z = select(best.g.z, sum.g.z, more);
    if (!with_hessian) continue;
    best.xx = select(best.xx, sum.xx, more);
    best.yy = select(best.yy, sum.yy, more);
    best.zz = select(best.zz, sum.zz, more);
    best.xy = select(best.xy, sum.xy, more);
    best.xz = select(best.xz, sum.xz, more);
    best.yz = select(best.yz, sum.yz, more);
  }
  return best;
}
#else
// Index of the list of each lane's cell; INT_MAX outside the grid.
INLINE vint cell_of(FIELD_PARAMS, vec3v p) {
  const vfloat x = floor((p.x - field.low[0]) * field.over_cell);
  const vfloat y = floor((p.y - field.low[1]) * field.over_cell);
  const vfloat z = floor((p.z - field.low[2]) * field.over_cell);
  const vint within = x >= 0.0f && y >= 0.0f && z >= 0.0f && x < (float)field.size[0] && y < (float)field.size[1] &&
                      z < (float)field.size[2];
  // Lanes outside would overflow the conversion.
  const vint i = TO_INT(select((vfloat)(0.0f), x, within));
  const vint j = TO_INT(select((vfloat)(0.0f), y, within));
  const vint k = TO_INT(select((vfloat)(0.0f), z, within));
  return select((vint)(INT_MAX), (i * field.size[1] + j) * field.size[2] + k, within);
}

// Every lane adds the elements of its own lists in their order, whatever its neighbours are: while the list of one cell
// is added, lanes of other cells stand where no compact element reaches.
INLINE SkeletonSum sum_elements(FIELD_PARAMS, vec3v p, int with_hessian) {
  SkeletonSum sum = {-field.iso, {0.0f, 0.0f, 0.0f}, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f};
  for (uint at = 0; at < field.always; ++at) add_element(FIELD_ARGS, at, p, with_hessian, &sum);
  if (!field.size[0]) return sum;
  vint cells = cell_of(FIELD_ARGS, p);
  for (;;) {
    const int cell = least(cells);
    if (cell == INT_MAX) return sum;
    const vint mine = cells == cell;
    const vec3v here = {select((vfloat)(FAR), p.x, mine), select((vfloat)(FAR), p.y, mine),
                        select((vfloat)(FAR), p.z, mine)};
    for (uint at = field_first[cell]; at < field_first[cell + 1]; ++at)
      add_element(FIELD_ARGS, at, here, with_hessian, &sum);
    cells = select(cells, (vint)(INT_MAX), mine);
  }
}
#endif

INLINE FieldValue field_sample(FIELD_PARAMS, vec3v p) {
  const SkeletonSum sum = sum_elements(FIELD_ARGS, p, 0);
  return (FieldValue){sum.value, sum.g};
}

// xx yy zz xy xz yz
INLINE void field_hessian(FIELD_PARAMS, vec3v p, vfloat* h) {
  const SkeletonSum sum = sum_elements(FIELD_ARGS, p, 1);
  h[0] = sum.xx;
  h[1] = sum.yy;
  h[2] = sum.zz;
  h[3] = sum.xy;
  h[4] = sum.xz;
  h[5] = sum.yz;
}
