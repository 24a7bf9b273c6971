// Finds fireflies among the pixels of a strip. It must be included after strip.glsl and color_at(), which
// returns the scene linear color of a pixel.
const vec3 kLuminance = vec3(0.2126, 0.7152, 0.0722);

// Holds the colors of a strip, and the luminances of its pixels and of those around it, 0 outside the image.
struct Neighbours {
  vec3 own[kStrip];
  float luminances[kStrip + 2][3];
};

// Returns the neighbours of the strip at `id`, where `last` is the image's last pixel.
Neighbours neighbours_of(uvec2 id, ivec2 last) {
  Neighbours result;
  [[unroll]] for (uint row = 0; row < kStrip + 2; ++row) {
    [[unroll]] for (uint column = 0; column < 3; ++column) {
      ivec2 at = ivec2(id.x, kStrip * id.y) + ivec2(column, row) - 1;
      ivec2 inside = clamp(at, ivec2(0), last);
      vec3 color = color_at(inside);
      result.luminances[row][column] = at == inside ? dot(color, kLuminance) : 0.0;
      if (column == 1 && row >= 1 && row <= kStrip) result.own[row - 1] = color;
    }
  }
  return result;
}

// Returns the factor, at most 1, that darkens a firefly to RAYMELD_FIREFLY times its second brightest
// neighbour + RAYMELD_FIREFLY_FLOOR. The pixel is in the middle of the 3x3 luminances from `row` on,
// which are 0 outside the image.
float firefly_limit(float luminances[kStrip + 2][3], uint row) {
  float first = 0.0, second = 0.0;
  [[unroll]] for (uint i = 0; i < 9; ++i) {
    if (i == 4) continue;
    float near = luminances[row + i / 3][i % 3];
    second = max(second, min(first, near));
    first = max(first, near);
  }
  float most = RAYMELD_FIREFLY * second + RAYMELD_FIREFLY_FLOOR;
  return min(1.0, most / max(luminances[row + 1][1], RAYMELD_FIREFLY_FLOOR));
}
