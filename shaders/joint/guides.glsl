// What the filters of the joint base go by: surfaces alike in albedo and normal are averaged, with a binomial kernel.
// To be included behind the declarations of `albedo` and `normal`.

struct Surface {
  vec3 albedo, normal;
};

// That at address i, with planes of that many elements.
Surface surface_of(uint i, uint plane) {
  uint j = i + plane, k = j + plane;
  return Surface(vec3(albedo.v[i], albedo.v[j], albedo.v[k]), vec3(normal.v[i], normal.v[j], normal.v[k]));
}

// Precise: see joint_filter.comp; what calls a function does not make it so.
float squared(vec3 v) {
  precise float sum = v.x * v.x + v.y * v.y + v.z * v.z;
  return sum;
}

float squared_distance(Surface a, Surface b) {
  precise vec3 color = (a.albedo - b.albedo) / RAYMELD_ALBEDO_WIDTH, facing = (a.normal - b.normal) / RAYMELD_NORMAL_WIDTH;
  precise float sum = squared(color) + squared(facing);
  return sum;
}

// Of the pixel dx and dy (-1, 0 or 1) away.
float binomial(int dx, int dy) { return (dy == 0 ? 0.5 : 0.25) * (dx == 0 ? 0.5 : 0.25); }
