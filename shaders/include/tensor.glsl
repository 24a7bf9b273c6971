// Has all addressing and all storing of tensors. A tensor is planar: element (c, y, x) is at
// c * plane + y * width + x. Storage is 16 or 32 bits wide. Sums have 32 bits, and so have products but those
// of conv2d.comp with HALF_DOTS.
#extension GL_EXT_control_flow_attributes : require

#ifdef STORAGE_F16
#extension GL_EXT_shader_16bit_storage : require
#define STORAGE float16_t
#define STORAGE_BYTES 2
#else
#define STORAGE float
#define STORAGE_BYTES 4
#endif

layout(std430, set = 0, binding = 0) buffer Status {
  uint saturated;
  uint not_finite;
} status;

uint address(uint c, uint y, uint x, uint plane, uint width) { return c * plane + y * width + x; }

// Returns where pixel_shuffle() by r moves channel c of pixel (y, x): channel, row and column.
uvec3 shuffled(uint r, uint c, uint y, uint x) {
  return uvec3(c / (r * r), r * y + c / r % r, r * x + c % r);
}

// Returns ReLU of a sum. NaN and -infinity stay: sums of finite values that overflowed must
// reach decode, which counts them.
float rectified(float value) { return value < 0.0 && value >= -3.402823466e38 ? 0.0 : value; }

uint saturated_here = 0;  // this invocation's values that were beyond 16 bits

// Returns the value that STORAGE() can hold. Values beyond 16 bits saturate and are counted; they
// are never passed on as infinity. (A function that returned STORAGE would need 16-bit
// arithmetic, which is not required.)
float storable(float value) {
#ifdef STORAGE_F16
  bool beyond = abs(value) > 65504.0;
  saturated_here += uint(beyond);
  value = mix(value, clamp(value, -65504.0, 65504.0), beyond);
#endif
  return value;
}

// Reports what storable() counted, by one atomic. Shaders call it at the end.
void count_saturated() {
#ifdef STORAGE_F16
  if (saturated_here > 0) atomicAdd(status.saturated, saturated_here);
#endif
}
