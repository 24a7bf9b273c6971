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

float squared(vec3 v) { return dot(v, v); }

float squared_distance(Surface a, Surface b) {
  return squared((a.albedo - b.albedo) / RAYMELD_ALBEDO_WIDTH) + squared((a.normal - b.normal) / RAYMELD_NORMAL_WIDTH);
}

// Of the pixel dx and dy (-1, 0 or 1) away.
float binomial(int dx, int dy) { return (dy == 0 ? 0.5 : 0.25) * (dx == 0 ? 0.5 : 0.25); }
