// Declares the types by which shaders find memory by its address.
#extension GL_EXT_buffer_reference : require
#extension GL_EXT_buffer_reference2 : require
#extension GL_EXT_shader_explicit_arithmetic_types_int64 : require
layout(buffer_reference, std430, buffer_reference_align = 4) buffer Floats { float v[]; };
layout(buffer_reference, std430, buffer_reference_align = 16) readonly buffer Quads { vec4 v[]; };
layout(buffer_reference, std430, buffer_reference_align = 8) buffer Pairs { uint64_t v[]; };
vec2 floats(uint64_t pair) { return uintBitsToFloat(unpackUint2x32(pair)); }
uint64_t pair(vec2 values) { return packUint2x32(floatBitsToUint(values)); }
#ifdef STORAGE_F16
layout(buffer_reference, std430, buffer_reference_align = 2) buffer Values { float16_t v[]; };
#else
#define Values Floats
#endif
