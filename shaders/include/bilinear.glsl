// Holds the position at which an image of the LRHS size is read for a full-size pixel: LRHS pixel (i, j)
// samples the full-size image at (scale * i + phase, scale * j + phase). Positions are exact in float: the
// inverse of a scale is a power of two, and a phase is a multiple of one half.
struct Bilinear {
  uvec2 low, high;
  vec2 t;
};

Bilinear bilinear_at(uvec2 pixel, float phase, float inverse_scale, uvec2 lrhs_size) {
  vec2 last = vec2(lrhs_size - 1);
  vec2 at = clamp((vec2(pixel) - phase) * inverse_scale, vec2(0.0), last);
  uvec2 low = uvec2(at);
  return Bilinear(low, min(low + 1, uvec2(last)), at - vec2(low));
}

// Interpolates the values at (low.y, low.x), (low.y, high.x), (high.y, low.x) and (high.y, high.x).
float blended(Bilinear at, vec4 values) {
  return mix(mix(values.x, values.y, at.t.x), mix(values.z, values.w, at.t.x), at.t.y);
}
