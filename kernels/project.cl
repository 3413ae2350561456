// Newton projection with a bracketing safeguard (core/mechanics/project.h), written once over any field_sample(). One
// loop serves both phases, so a packet's lanes may be in different ones: a lane first steps, then halves its bracket.
typedef struct {
  float tolerance;
  float max_step;
  int max_newton;
  int max_bisection;
  float reach;
} ProjectParams;

enum { STEPPING, BRACKETED, DONE, FAILED };

INLINE vec3v pick(vec3v a, vec3v b, vint mask) {
  return (vec3v){select(a.x, b.x, mask), select(a.y, b.y, mask), select(a.z, b.z, mask)};
}

INLINE vfloat distance3(vec3v a, vec3v b) {
  const vec3v d = {b.x - a.x, b.y - a.y, b.z - a.z};
  return sqrt(dot3(d, d));
}

typedef struct {
  vec3v point;  // local; the input where not converged
  vint state;   // DONE or FAILED
} Projected;

INLINE Projected project_packet(FIELD_PARAMS, vec3v start, vint good, const ProjectParams o) {
  // a: the last point with a sample (one end of the bracket), b: the bracket's other end, now: to be sampled.
  vec3v a = start, b = start, now = start;
  vfloat a_value = 0.0f, b_value = 0.0f;
  vfloat width = 0.0f;
  vint state = select((vint)(FAILED), (vint)(STEPPING), good);
  vint newton = 0, halvings = 0;
  vint has_last = 0;
  vint halve = 0;
  const int most = o.max_newton + o.max_bisection + 2;
  for (int i = 0; i < most; ++i) {
    const vint stepping = state == STEPPING;
    const vint searching = state == BRACKETED;
    if (!ANY(stepping || searching)) break;

    const FieldValue f = field_sample(FIELD_ARGS, now);
    // Scaled by its largest component, so that the square of a faint gradient does not vanish.
    const vfloat steepest = fmax(fabs(f.gradient.x), fmax(fabs(f.gradient.y), fabs(f.gradient.z)));
    const vint usable = isfinite(f.value) && isfinite(f.gradient.x) && isfinite(f.gradient.y) &&
                        isfinite(f.gradient.z) && steepest > 0.0f;
    const vec3v g = {f.gradient.x / steepest, f.gradient.y / steepest, f.gradient.z / steepest};
    const vfloat g_length = sqrt(dot3(g, g));
    const vfloat slope = steepest * g_length;
    const vint landed = usable && fabs(f.value) <= o.tolerance * slope;
    const vint crossed = stepping && has_last && usable && ((f.value > 0.0f) != (a_value > 0.0f));

    state = select(state, (vint)(DONE), (stepping || searching) && landed);
    state = select(state, (vint)(FAILED), (stepping || searching) && !usable);
    const vint out_of_steps = stepping && !crossed && newton == o.max_newton;
    state = select(state, (vint)(FAILED), out_of_steps && state == STEPPING);

    // The bracket a-b: made when a step crossed the surface, else narrowed to the half that still crosses it.
    const vint same_side = searching && ((f.value > 0.0f) == (a_value > 0.0f));
    const vint to_b = crossed || (searching && !same_side);
    b = pick(b, now, to_b);
    b_value = select(b_value, f.value, to_b);
    const vint to_a = same_side || (stepping && !crossed);
    a = pick(a, now, to_a);
    a_value = select(a_value, f.value, to_a);
    state = select(state, (vint)(BRACKETED), crossed && state == STEPPING);

    const vfloat old_width = width;
    width = distance3(a, b);
    const vint bracketed = state == BRACKETED;
    const vint narrow = bracketed && width <= o.tolerance;
    const vint exhausted = bracketed && halvings >= o.max_bisection;
    const vec3v nearer = pick(b, a, fabs(a_value) <= fabs(b_value));
    // A bisection halves by definition: rounding must not say otherwise.
    halve = searching && !halve && width > 0.5f * old_width;
    const vfloat t = select(a_value / (a_value - b_value), (vfloat)(0.5f), halve);
    const vec3v middle = {a.x + t * (b.x - a.x), a.y + t * (b.y - a.y), a.z + t * (b.z - a.z)};
    state = select(state, (vint)(FAILED), exhausted);
    state = select(state, (vint)(DONE), narrow && !exhausted);

    const vfloat length = fabs(f.value) / slope;
    const vfloat scale = copysign(fmin(length, o.max_step), -f.value) / g_length;
    const vec3v stepped = {now.x + scale * g.x, now.y + scale * g.y, now.z + scale * g.z};
    const vint step_on = state == STEPPING;
    state = select(state, (vint)(FAILED), step_on && (!isfinite(length) || distance3(start, stepped) > o.reach));
    now = pick(now, stepped, step_on);
    now = pick(now, middle, state == BRACKETED);
    now = pick(now, nearer, narrow && !exhausted);
    newton += select((vint)(0), (vint)(1), step_on);
    halvings += select((vint)(0), (vint)(1), state == BRACKETED);
    has_last = select(has_last, ALL_LANES, step_on);
  }
  state = select((vint)(FAILED), (vint)(DONE), state == DONE);
  return (Projected){pick(start, now, state == DONE), state};
}

// Moves points in place; those that do not converge keep their bits, and so do those that are on the surface already.
kernel void project(FIELD_PARAMS, global float* points, global uchar* status, const ProjectParams options, uint count) {
  const uint first = ITEM * VW;
  if (first >= count) return;
  const vec3v p = load_points(points, first, count);
  const vec3v start = to_local(p, field.origin);
  const Projected result = project_packet(FIELD_ARGS, start, is_finite(p), options);
  const vint changed = result.point.x != start.x || result.point.y != start.y || result.point.z != start.z;
  const vint moved = result.state == DONE && changed;
  store_points(pick(p, to_world(result.point, field.origin), moved), points, first, count);
  store_flags(select((vint)(1), (vint)(0), result.state == DONE), status, first, count);
}
