// Field values, gradients and Hessians at points, written once over any field's field_sample() and field_hessian().
// Within the range of float; zero where the point is not finite.
INLINE vfloat held(vfloat v, vint good) {
  return select((vfloat)(0.0f), clamp(v, -FLT_MAX, FLT_MAX), good);
}

kernel void evaluate(FIELD_PARAMS, global const float* points, global float* values, global float* gradients,
                     uint count) {
  const uint first = ITEM * VW;
  if (first >= count) return;
  const vec3v p = load_points(points, first, count);
  const vint good = is_finite(p);
  FieldValue f = field_sample(FIELD_ARGS, to_local(p, field.origin));
  f.gradient.x = held(f.gradient.x, good);
  f.gradient.y = held(f.gradient.y, good);
  f.gradient.z = held(f.gradient.z, good);
  store_values(select((vfloat)(NAN), held(f.value, good), good), values, first, count);
  store_points(f.gradient, gradients, first, count);
}

kernel void evaluate_values(FIELD_PARAMS, global const float* points, global float* values, uint count) {
  const uint first = ITEM * VW;
  if (first >= count) return;
  const vec3v p = load_points(points, first, count);
  const vint good = is_finite(p);
  const vfloat value = field_sample(FIELD_ARGS, to_local(p, field.origin)).value;
  store_values(select((vfloat)(NAN), held(value, good), good), values, first, count);
}

kernel void evaluate_hessian(FIELD_PARAMS, global const float* points, global float* hessians, uint count) {
  const uint first = ITEM * VW;
  if (first >= count) return;
  const vec3v p = load_points(points, first, count);
  const vint good = is_finite(p);
  vfloat h[6];
  field_hessian(FIELD_ARGS, to_local(p, field.origin), h);
  float lane[6][VW];
  for (int k = 0; k < 6; ++k) {
    h[k] = held(h[k], good);
#if VW == 1
    lane[k][0] = h[k];
#else
    vstore16(h[k], 0, lane[k]);
#endif
  }
  for (uint i = 0; i < min((uint)VW, count - first); ++i)
    for (int k = 0; k < 6; ++k) hessians[6 * (first + i) + k] = lane[k][i];
}
