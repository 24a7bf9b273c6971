// One level of an a-trous filter (Dammertz et al. 2010): the mean of 3x3 pixels `step` apart, edges replicated, weighted
// by a binomial kernel, by how alike their albedo, normal and brightness are, and by their certainty, channel 3, of which
// the mean is passed on (normalized convolution, Knutsson and Westin 1993). One invocation for each strip of pixels, `step`
// apart below one another, which share what is around them.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "params.h"
#include "tensor.glsl"
#include "memory.glsl"

layout(local_size_x = 64, local_size_y = 2) in;
layout(constant_id = 0) const uint kVector = 0;  // with DATA_BY_ADDRESS, of 32 bits
#include "invocation.glsl"
#ifdef DATA_BY_ADDRESS
layout(push_constant) uniform Push {
  Values source, albedo, normal, brightness, target;
  JointFilter p;
};
#else
layout(push_constant) uniform Push { JointFilter p; };
layout(std430, binding = 1) readonly buffer Source { STORAGE v[]; } source;
layout(std430, binding = 2) readonly buffer Albedo { STORAGE v[]; } albedo;
layout(std430, binding = 3) readonly buffer Normal { STORAGE v[]; } normal;
layout(std430, binding = 4) readonly buffer Brightness { STORAGE v[]; } brightness;
layout(std430, binding = 5) writeonly buffer Target { STORAGE v[]; } target;
#endif
#include "guides.glsl"
#define KEEPS_ORDER
#include "uniform.glsl"
#include "vector.glsl"

const int kStrip = RAYMELD_JOINT_STRIP;

// The pixel of a row that lies dx steps beside the invocation's column, `own`, edges being replicated; `first` is the column of
// its vector.
struct Site {
  uint row, own, first;
  int dx;
};

struct Tap {
  Surface surface;
  float brightness;
};

// Precise: the same bits, whichever way the taps were read.
struct Sums {
  precise vec3 light;
  precise float certainty, weight;
};

Site site(uint top, int row, int dx, uint own, uint first) {
  return Site(uint(clamp(int(top) + row * int(p.step), 0, int(p.height) - 1)), own, first, dx);
}

int column_of(Site at) { return int(at.own) + at.dx * int(p.step); }

uint element_of(Site at, uint channel) {
  return address(channel, at.row, clamp(column_of(at), 0, int(p.width) - 1), p.plane, p.width);
}

#if defined(DATA_BY_ADDRESS) && !defined(STORAGE_F16)
// Parts of the vector may lie beyond the row, and even beyond all tensors.
float read(Floats from, uint channel, Site at) {
  if (kVector == 0) return from.v[element_of(at, channel)];
  uint64_t row = uint64_t(from) + 4ul * address(channel, at.row, 0, p.plane, p.width);
  float value = read_vector(Floats(row + uint64_t(int64_t(4 * (int(at.first) + at.dx * int(p.step))))), 0);
  if (at.dx == 0) return value;
  float edge = Floats(row).v[at.dx < 0 ? 0 : p.width - 1];  // in a branch, lanes would read it one by one
  int column = column_of(at);
  return column < 0 || column >= int(p.width) ? edge : value;
}
#define READ(from, channel, at) read(from, channel, at)
#else
#define READ(from, channel, at) float(from.v[element_of(at, channel)])
#endif

Tap tap_at(Site at) {
  return Tap(Surface(vec3(READ(albedo, 0, at), READ(albedo, 1, at), READ(albedo, 2, at)),
                     vec3(READ(normal, 0, at), READ(normal, 1, at), READ(normal, 2, at))),
             READ(brightness, 0, at));
}

void add(inout Sums sums, Tap own, Tap tap, vec4 value, float kernel) {
  precise float difference = (tap.brightness - own.brightness) / RAYMELD_BRIGHTNESS_WIDTH;
  precise float weight = kernel * exp(-(squared_distance(tap.surface, own.surface) + difference * difference));
  precise float certainty = weight * value.w;
  sums.light += certainty * value.xyz;
  sums.certainty += certainty;
  sums.weight += weight;
}

bool is_wanted(uvec2 pixel) { return pixel.x < p.width && pixel.y < p.height; }

void main() {
  uvec2 id = global_invocation_id().xy, first = first_of_vector();
  uint phase = first.y & (p.step - 1), top = (first.y - phase) * kStrip + phase;
  bool any = false;
  [[unroll]] for (uint k = 0; k < kStrip; ++k) any = any || is_wanted(uvec2(id.x, top + k * p.step));
  if (kVector == 0 && !any) return;
  Tap own[kStrip];
  Sums sums[kStrip];
  [[unroll]] for (int k = 0; k < kStrip; ++k) {
    own[k] = tap_at(site(top, k, 0, id.x, first.x));
    sums[k] = Sums(vec3(0.0), 0.0, 0.0);
  }
  [[unroll]] for (int row = -1; row <= kStrip; ++row) {
    [[unroll]] for (int dx = -1; dx <= 1; ++dx) {
      Site at = site(top, row, dx, id.x, first.x);
      Tap tap;
      if (dx == 0 && row >= 0 && row < kStrip) {
        tap = own[row];
      } else {
        tap = tap_at(at);
      }
      vec4 value = vec4(READ(source, 0, at), READ(source, 1, at), READ(source, 2, at), READ(source, 3, at));
      [[unroll]] for (int dy = -1; dy <= 1; ++dy) {
        int of = row - dy;
        if (of >= 0 && of < kStrip) add(sums[of], own[of], tap, value, binomial(dx, dy));
      }
    }
    if (kVector > 0) {
      float all = 0.0;
      [[unroll]] for (uint k = 0; k < kStrip; ++k) all += sums[k].weight + sums[k].certainty + sums[k].light.x;
      keep_order(all);
    }
  }
  if (kVector > 0 && end_order()) return;
  [[unroll]] for (uint k = 0; k < kStrip; ++k) {
    uvec2 pixel = uvec2(id.x, top + k * p.step);
    if (!is_wanted(pixel)) continue;
    uint i = address(0, pixel.y, pixel.x, p.plane, p.width);
    for (uint c = 0; c < 3; ++c) {
      target.v[i + c * p.plane] = STORAGE(storable(sums[k].light[c] / sums[k].certainty));
    }
    target.v[i + 3 * p.plane] = STORAGE(storable(sums[k].certainty / sums[k].weight));
  }
}
