// Declares the image of a frame that a pass reads: floats in a storage buffer or, with
// FRAME_IMAGE, an image of Vulkan.
#ifdef FRAME_IMAGE
#extension GL_EXT_samplerless_texture_functions : require
layout(binding = 1) uniform texture2D frame;

// Returns the unit vector that was folded into [-1, 1] x [-1, 1]: octahedral normals, Cigolle et al. 2014.
vec3 unfolded(vec2 folded) {
  vec3 v = vec3(folded, 1.0 - abs(folded.x) - abs(folded.y));
  vec2 sides = mix(vec2(-1.0), vec2(1.0), greaterThanEqual(v.xy, vec2(0.0)));
  if (v.z < 0.0) v.xy = (1.0 - abs(v.yx)) * sides;
  return normalize(v);
}

vec4 frame_texel(TextureView view, uvec2 at) {
  vec4 texel = texelFetch(frame, ivec2(at + uvec2(view.x, view.y)), 0) * view.scale + view.bias;
  if (view.octahedral != 0) texel.xyz = unfolded(texel.xy);
  return texel;
}

float frame_value(TextureView view, uint channel, uvec2 at) { return frame_texel(view, at)[channel]; }
#else
layout(std430, binding = 1) readonly buffer Frame { float frame[]; };

float frame_value(FrameView view, uint channel, uvec2 at) {
  return frame[view.offset + channel * view.channel_stride + at.y * view.row_stride +
               at.x * view.pixel_stride];
}
#endif
