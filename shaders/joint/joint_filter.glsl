// Declares the inputs and outputs of joint_filter.comp, weights its taps and stores its sums.
// llvmpipe/joint_filter_vectors.comp includes it too.
layout(push_constant) uniform Push {
  ADDRESS(Values, source) ADDRESS(Values, albedo) ADDRESS(Values, normal) ADDRESS(Values, brightness)
  ADDRESS(Values, target)
  JointFilter p;
  VECTOR_PUSH
};
BUFFER(1, readonly, Source, STORAGE, source)
BUFFER(2, readonly, Albedo, STORAGE, albedo)
BUFFER(3, readonly, Normal, STORAGE, normal)
BUFFER(4, readonly, Brightness, STORAGE, brightness)
BUFFER(5, writeonly, Target, STORAGE, target)
#include "guides.glsl"

const int kStrip = RAYMELD_JOINT_STRIP;

struct Tap {
  Surface surface;
  float brightness;
};

// The sums are precise, so that both shaders give the same bits.
struct Sums {
  precise vec3 light;
  precise float certainty, weight;
};

// Returns the image's row that is `row` steps below row `top` of the image, edges being replicated.
uint row_of(uint top, int row) { return uint(clamp(int(top) + row * int(p.step), 0, int(p.height) - 1)); }

void add(inout Sums sums, Tap own, Tap tap, vec4 value, float kernel) {
  precise float difference = (tap.brightness - own.brightness) * p.brightness;
  precise float distance =
      squared_distance(tap.surface, own.surface, p.albedo, p.normal) + difference * difference;
  precise float weight = kernel * exp(-distance);
  precise float certainty = weight * value.w;
  sums.light += certainty * value.xyz;
  sums.certainty += certainty;
  sums.weight += weight;
}

bool is_inside(uvec2 pixel) { return pixel.x < p.width && pixel.y < p.height; }

void store(uvec2 pixel, Sums sums) {
  if (!is_inside(pixel)) return;
  uint i = address(0, pixel.y, pixel.x, p.plane, p.width);
  for (uint c = 0; c < 3; ++c) target.v[i + c * p.plane] = STORAGE(storable(sums.light[c] / sums.certainty));
  target.v[i + 3 * p.plane] = STORAGE(storable(sums.certainty / sums.weight));
}
