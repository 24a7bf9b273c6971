// Lets shaders find memory by its address. With DATA_BY_ADDRESS activations are found so: drivers for CPUs then
// make one vector instruction of the accesses of all lanes, and read two floats at the price of one. Shaders
// that define WEIGHTS_BY_ADDRESS find weights so in any case, since these drivers read a weight once for all
// lanes.
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

#ifdef DATA_BY_ADDRESS
#define ADDRESS(type, name) type name;
#define BUFFER(index, access, Block, element, name)
#define READ_PAIR(name, at) floats(Pairs(uint64_t(name)).v[(at) / 2])
#define WRITE_PAIR(name, at, values) Pairs(uint64_t(name)).v[(at) / 2] = pair(values)
#endif
