// Finds a pixel in the last frame. A history is a buffer of planes of the whole frame, scene linear and
// dense.

// Holds the four pixels of the last frame around a point, and their bilinear weights, which are 0 outside the
// frame.
struct Taps {
  uvec2 pixels[4];
  float weights[4];
};

// Returns the taps around `point`, which may be anything, even NaN.
Taps taps_at(vec2 point, uvec2 size) {
  Taps taps;
  bool known = is_finite(point.x) && is_finite(point.y);
  point = known ? clamp(point, vec2(-2.0), vec2(size) + 1.0) : vec2(-2.0);
  vec2 first = floor(point), t = point - first;
  [[unroll]] for (uint i = 0; i < 4; ++i) {
    ivec2 at = ivec2(first) + ivec2(i % 2, i / 2), inside = clamp(at, ivec2(0), ivec2(size) - 1);
    taps.pixels[i] = uvec2(inside);
    float weight = (i % 2 == 0 ? 1.0 - t.x : t.x) * (i / 2 == 0 ? 1.0 - t.y : t.y);
    taps.weights[i] = at == inside ? weight : 0.0;
  }
  return taps;
}

// Returns how much reading blurs: 0 at a pixel, 3/4 in the middle of four.
float blur_of(Taps taps) {
  float blur = 1.0;
  [[unroll]] for (uint i = 0; i < 4; ++i) blur -= taps.weights[i] * taps.weights[i];
  return blur;
}

// Returns the squared distance of a value from the range [low, high].
float beyond(float value, float low, float high) {
  float distance = max(value - high, 0.0) + max(low - value, 0.0);
  return distance * distance;
}
