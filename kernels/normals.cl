// Outward unit normals of the field at vertices, and the triangles that face the wrong way (core/mechanics/relax.h).
kernel void vertex_normals(FIELD_PARAMS, global const float* positions, global float* normals, uint count) {
  const uint first = ITEM * VW;
  if (first >= count) return;
  const vec3v p = load_points(positions, first, count);
  const FieldValue f = field_sample(FIELD_ARGS, to_local(p, field.origin));
  // Scaled by its largest component, so that the square of a faint gradient does not vanish.
  const vfloat steepest = fmax(fabs(f.gradient.x), fmax(fabs(f.gradient.y), fabs(f.gradient.z)));
  const vec3v g = {f.gradient.x / steepest, f.gradient.y / steepest, f.gradient.z / steepest};
  const vfloat length = sqrt(dot3(g, g));
  const vint good = is_finite(p) && is_finite(f.gradient) && steepest > 0.0f;
  const vec3v n = {select((vfloat)(0.0f), -g.x / length, good), select((vfloat)(0.0f), -g.y / length, good),
                   select((vfloat)(0.0f), -g.z / length, good)};
  store_points(n, normals, first, count);
}

// 1 where the triangle's normal points against the outward normals of all three corners.
kernel void mark_inverted(global const float* positions, global const float* normals, global const uint* vertex,
                          global uchar* inverted, uint count) {
  const uint t = ITEM;
  if (t >= count) return;
  const uint a = vertex[3 * t], b = vertex[3 * t + 1], c = vertex[3 * t + 2];
  const float3 pa = vload3(a, positions);
  const float3 n = cross(vload3(b, positions) - pa, vload3(c, positions) - pa);
  inverted[t] =
      dot(n, vload3(a, normals)) < 0.0f && dot(n, vload3(b, normals)) < 0.0f && dot(n, vload3(c, normals)) < 0.0f;
}
