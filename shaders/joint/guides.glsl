// Weights the taps of the joint base's filters, which average surfaces alike in albedo and normal with a
// binomial kernel. It must be included after the declarations of `albedo` and `normal`.

struct Surface {
  vec3 albedo, normal;
};

// Returns the surface at address i of tensors whose planes have `plane` elements.
Surface surface_of(uint i, uint plane) {
  uint j = i + plane, k = j + plane;
  return Surface(vec3(albedo.v[i], albedo.v[j], albedo.v[k]), vec3(normal.v[i], normal.v[j], normal.v[k]));
}

// `precise` makes both shaders of the joint filter give the same bits: see joint_filter.glsl. A caller's
// `precise` does not reach into the functions that it calls.
float squared(vec3 v) {
  precise float sum = v.x * v.x + v.y * v.y + v.z * v.z;
  return sum;
}

// Returns the squared distance of surfaces whose albedo and normal are multiplied by these factors.
float squared_distance(Surface a, Surface b, float albedo_factor, float normal_factor) {
  precise vec3 color = (a.albedo - b.albedo) * albedo_factor,
               facing = (a.normal - b.normal) * normal_factor;
  precise float sum = squared(color) + squared(facing);
  return sum;
}

// Returns the weight of the pixel that is dx and dy (-1, 0 or 1) away.
float binomial(int dx, int dy) { return (dy == 0 ? 0.5 : 0.25) * (dx == 0 ? 0.5 : 0.25); }
