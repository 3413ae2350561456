// Field part of a program: SkeletonField (core/field/skeleton_field.h) over a packet of points. Compact elements far
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
  int more_unused[2];
} SkeletonElement;

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

INLINE vec3v across(vec3v g, vec3v slide) {
  const vfloat along = dot3(g, slide);
  g.x -= along * slide.x;
  g.y -= along * slide.y;
  g.z -= along * slide.z;
  return g;
}

INLINE void add_general(const SkeletonElement e, vec3v x, vec3v slide, int with_hessian, SkeletonSum* sum) {
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
  g = across(g, slide);
  sum->value += f.value;
  sum->g.x += g.x;
  sum->g.y += g.y;
  sum->g.z += g.z;
  if (!with_hessian) return;
  const vfloat outer = f.bend * d * d + f.slope * (2.0f - e.norm);
  const vfloat bend = f.slope * (e.norm - 1.0f);
  const vint steep = live && (f.slope != 0.0f || f.bend != 0.0f);
  // keep h keep with keep = I - slide slide^T: rows first, then columns.
  vec3v row_x = {outer * v.x * v.x + bend * rx, outer * v.x * v.y, outer * v.x * v.z};
  vec3v row_y = {outer * v.y * v.x, outer * v.y * v.y + bend * ry, outer * v.y * v.z};
  vec3v row_z = {outer * v.z * v.x, outer * v.z * v.y, outer * v.z * v.z + bend * rz};
  row_x = across(row_x, slide);
  row_y = across(row_y, slide);
  row_z = across(row_z, slide);
  vec3v column_x = {row_x.x, row_y.x, row_z.x};
  vec3v column_y = {row_x.y, row_y.y, row_z.y};
  vec3v column_z = {row_x.z, row_y.z, row_z.z};
  column_x = across(column_x, slide);
  column_y = across(column_y, slide);
  column_z = across(column_z, slide);
  sum->xx += select((vfloat)(0.0f), column_x.x, steep);
  sum->yy += select((vfloat)(0.0f), column_y.y, steep);
  sum->zz += select((vfloat)(0.0f), column_z.z, steep);
  sum->xy += select((vfloat)(0.0f), column_y.x, steep);
  sum->xz += select((vfloat)(0.0f), column_z.x, steep);
  sum->yz += select((vfloat)(0.0f), column_z.y, steep);
}
#endif

INLINE void add_element(const SkeletonElement e, vec3v p, int with_hessian, SkeletonSum* sum) {
  vec3v x = {p.x - e.a[0], p.y - e.a[1], p.z - e.a[2]};
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
    const vec3v slide = {inside * (e.ab[0] * unit), inside * (e.ab[1] * unit), inside * (e.ab[2] * unit)};
    add_general(e, x, slide, with_hessian, sum);
    return;
  }
#endif
  const Profile f = profile(e, dot3(x, x));
  sum->value += f.value;
  sum->g.x = MUL_ADD(f.slope, x.x, sum->g.x);
  sum->g.y = MUL_ADD(f.slope, x.y, sum->g.y);
  sum->g.z = MUL_ADD(f.slope, x.z, sum->g.z);
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
      add_element(field_elements[field_list[at]], p, with_hessian, &sum);
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
  vint cells = cell_of(FIELD_ARGS, p);
  vec3v here = p;
  uint at = 0, end = field.always;
  for (;;) {
    for (; at < end; ++at) add_element(field_elements[field_list[at]], here, with_hessian, &sum);
    const int cell = least(cells);
    if (cell == INT_MAX) return sum;
    const vint mine = cells == cell;
    here.x = select((vfloat)(FAR), p.x, mine);
    here.y = select((vfloat)(FAR), p.y, mine);
    here.z = select((vfloat)(FAR), p.z, mine);
    cells = select(cells, (vint)(INT_MAX), mine);
    at = field_first[cell];
    end = field_first[cell + 1];
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
