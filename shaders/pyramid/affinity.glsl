// Weights the taps of a predicted kernel also by how alike the surfaces are. It must be included after the
// declaration of `guides`, an image of albedo and normal.

struct Surface {
  vec3 albedo, normal;
};

// Returns the surface at address i of a tensor whose planes have `plane` elements.
Surface surface_of(uint i, uint plane) {
  return Surface(vec3(guides.v[i], guides.v[i + plane], guides.v[i + 2 * plane]),
                 vec3(guides.v[i + 3 * plane], guides.v[i + 4 * plane], guides.v[i + 5 * plane]));
}

// Returns the factor that a logit stands for.
float affinity_factor(float logit) { return exp(clamp(logit, -6.0, 6.0)); }

// Returns what the difference of two surfaces takes from the logit of a tap; the factors are those of albedo
// and normal.
float unlikeness(Surface a, Surface b, vec2 factors) {
  vec3 color = a.albedo - b.albedo, facing = a.normal - b.normal;
  return factors.x * dot(color, color) + factors.y * dot(facing, facing);
}
