// The pull toward sharp features (core/mechanics/relax.h, pull_to_sharp_features): a plane for each triangle through
// its projected centroid, then an area-weighted mean over the triangles about each vertex.
INLINE vec3v load_corner(global const float* positions, global const uint* vertex, uint first, uint count, int k) {
#if VW == 16
  float x[VW], y[VW], z[VW];
  for (uint i = 0; i < VW; ++i) {
    const float3 p = vload3(vertex[3 * min(first + i, count - 1) + k], positions);
    x[i] = p.x;
    y[i] = p.y;
    z[i] = p.z;
  }
  return (vec3v){vload16(0, x), vload16(0, y), vload16(0, z)};
#else
  const float3 p = vload3(vertex[3 * first + k], positions);
  return (vec3v){p.x, p.y, p.z};
#endif
}

INLINE vec3v difference(vec3v a, vec3v b) {
  return (vec3v){a.x - b.x, a.y - b.y, a.z - b.z};
}

// planes: 8 floats a triangle: point (relative to the field's origin), area, unit normal, unused. Area 0: no plane.
kernel void centroid_planes(FIELD_PARAMS, global const float* positions, global const uint* vertex,
                            global float* through, global float* normal, global float* area,
                            const ProjectParams options, uint count) {
  const uint first = ITEM * VW;
  if (first >= count) return;
  const vec3v a = to_local(load_corner(positions, vertex, first, count, 0), field.origin);
  const vec3v b = difference(to_local(load_corner(positions, vertex, first, count, 1), field.origin), a);
  const vec3v c = difference(to_local(load_corner(positions, vertex, first, count, 2), field.origin), a);
  const vec3v center = {a.x + (b.x + c.x) * (1.0f / 3.0f), a.y + (b.y + c.y) * (1.0f / 3.0f),
                        a.z + (b.z + c.z) * (1.0f / 3.0f)};
  const Projected projected = project_packet(FIELD_ARGS, center, is_finite(center), options);
  const vec3v g = field_sample(FIELD_ARGS, projected.point).gradient;
  const vfloat length = sqrt(dot3(g, g));
  const vint good = projected.state == DONE && length > 0.0f;
  const vec3v across = {b.y * c.z - b.z * c.y, b.z * c.x - b.x * c.z, b.x * c.y - b.y * c.x};
  const vec3v unit = {select((vfloat)(0.0f), -g.x / length, good), select((vfloat)(0.0f), -g.y / length, good),
                      select((vfloat)(0.0f), -g.z / length, good)};
  store_points(projected.point, through, first, count);
  store_points(unit, normal, first, count);
  store_values(select((vfloat)(0.0f), 0.5f * sqrt(dot3(across, across)), projected.state == DONE), area, first, count);
}

kernel void pull(global const uint* first, global const uint* corner, global const float* through,
                 global const float* normal, global const float* area, global float* positions, const Origin origin,
                 float longest, uint count) {
  const uint v = ITEM;
  if (v >= count) return;
  const float3 p = vload3(v, positions);
  const float3 at = (p - (float3)(origin.high[0], origin.high[1], origin.high[2])) -
                    (float3)(origin.low[0], origin.low[1], origin.low[2]);
  float3 sum = (float3)(0.0f);
  float weight = 0.0f;
  const uint end = first[v + 1];
  for (uint i = first[v]; i < end; ++i) {
    const uint t = corner[i] / 3;
    const float3 n = vload3(t, normal);
    sum += area[t] * dot(vload3(t, through) - at, n) * n;
    weight += area[t];
  }
  if (!(weight > 0.0f)) return;
  const float3 d = sum / weight;
  const float length = sqrt(dot(d, d));
  if (!isfinite(length)) return;
  vstore3(p + (length > longest ? d * (longest / length) : d), v, positions);
}
