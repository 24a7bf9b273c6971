// Selects how shaders reach memory, whose cost depends on the driver. Activations lie in storage buffers or,
// with DATA_BY_ADDRESS, are found by their address: drivers for CPUs then make one vector instruction of the
// accesses of all lanes, and read two floats at the price of one. Shaders that define WEIGHTS_BY_ADDRESS
// always find weights by address, since drivers for CPUs read those once for all lanes.
//
// A shader declares its inputs and outputs twice: ADDRESS() among its push constants, BUFFER() after them.
// One of the two declares `name.v[]`, the other nothing.
#if defined(DATA_BY_ADDRESS) || defined(WEIGHTS_BY_ADDRESS)
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
#endif

#ifdef DATA_BY_ADDRESS
#define ADDRESS(type, name) type name;
#define BUFFER(index, access, Block, element, name)
// These access floats `at` and at + 1, where `at` is even.
#define READ_PAIR(name, at) floats(Pairs(uint64_t(name)).v[(at) / 2])
#define WRITE_PAIR(name, at, values) Pairs(uint64_t(name)).v[(at) / 2] = pair(values)
#else
#define ADDRESS(type, name)
#define BUFFER(index, access, Block, element, name) \
  layout(std430, binding = index) access buffer Block { element v[]; } name;
#define READ_PAIR(name, at) vec2(name.v[at], name.v[(at) + 1])
#define WRITE_PAIR(name, at, values) name.v[at] = (values).x, name.v[(at) + 1] = (values).y
#endif

// These do the same with activations, which may have 16 bits.
#ifdef STORAGE_F16
#define READ_VALUES(name, at) vec2(float(name.v[at]), float(name.v[(at) + 1]))
#define WRITE_VALUES(name, at, values) name.v[at] = STORAGE((values).x), name.v[(at) + 1] = STORAGE((values).y)
#else
#define READ_VALUES(name, at) READ_PAIR(name, at)
#define WRITE_VALUES(name, at, values) WRITE_PAIR(name, at, values)
#endif
