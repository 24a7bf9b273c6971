// Gives an invocation RAYMELD_STRIP pixels below each other, so that a device has as many loads in flight.
// Pixels below the image are replaced by its last row. The code selects them rather than branches, since
// drivers for CPUs load lane by lane in branches.
const uint kStrip = RAYMELD_STRIP;

struct Strip {
  uvec2 pixels[kStrip];
  bool wanted[kStrip];  // false for pixels below the image, which are not stored
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
