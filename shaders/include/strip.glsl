// The RAYMELD_STRIP pixels below each other that an invocation makes, so that a device has as many loads in flight. What lies
// below the image is its last row again: selections rather than branches, in which drivers for CPUs load lane by lane.
const uint kStrip = RAYMELD_STRIP;

struct Strip {
  uvec2 pixels[kStrip];
  bool wanted[kStrip];  // to be stored
};

// Returns the strip of the invocation at `id`.
Strip strip_at(uvec2 id, uvec2 size) {
  Strip strip;
  [[unroll]] for (uint k = 0; k < kStrip; ++k) {
    uvec2 pixel = uvec2(id.x, kStrip * id.y + k);
    strip.pixels[k] = min(pixel, size - 1);
    strip.wanted[k] = pixel == strip.pixels[k];
  }
  return strip;
}
