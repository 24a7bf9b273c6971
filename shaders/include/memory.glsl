// How shaders reach memory whose cost depends on the driver: activations lie in storage buffers or, with DATA_BY_ADDRESS,
// are found by their address, where each lane's own access is one vector instruction; a 64-bit access then brings two
// floats at the price of one. Shaders that define WEIGHTS_BY_ADDRESS find weights by address always: drivers for CPUs read
// them once for all lanes.
#if defined(DATA_BY_ADDRESS) || defined(WEIGHTS_BY_ADDRESS)
#extension GL_EXT_buffer_reference : require
#extension GL_EXT_buffer_reference2 : require
#extension GL_EXT_shader_explicit_arithmetic_types_int64 : require
layout(buffer_reference, std430, buffer_reference_align = 4) buffer Floats { float v[]; };
layout(buffer_reference, std430, buffer_reference_align = 16) readonly buffer Quads { vec4 v[]; };
layout(buffer_reference, std430, buffer_reference_align = 8) buffer Pairs { uint64_t v[]; };
layout(buffer_reference, std430, buffer_reference_align = 4) readonly buffer Words { uint v[]; };
vec2 floats(uint64_t pair) { return uintBitsToFloat(unpackUint2x32(pair)); }
uint64_t pair(vec2 values) { return packUint2x32(floatBitsToUint(values)); }
#ifdef STORAGE_F16
layout(buffer_reference, std430, buffer_reference_align = 2) buffer Values { float16_t v[]; };
#else
#define Values Floats
#endif
#define HAS_FLOATS
#endif
