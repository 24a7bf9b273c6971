// Reads what a recording has of its frame. `exposure` and the push constants must be declared before.

// Returns where the recording lies in its frame.
Place place_of_recording() {
  uint at[8];
  [[unroll]] for (uint i = 0; i < 8; ++i) at[i] = uint(exposure.v[2 + i]);
  return Place(at[0], at[1], at[2], at[3], at[4], at[5], at[6], at[7]);
}

// Returns the motion from a full-size pixel, as the frame has it: it may be anything, even NaN.
vec2 motion_at(uvec2 at) { return vec2(frame_value(p.motion, 0, at), frame_value(p.motion, 1, at)); }
