// Declares what a shader reads and writes: storage buffers or, with DATA_BY_ADDRESS, addresses among the push
// constants (llvmpipe/addresses.glsl). A shader declares each tensor twice, by ADDRESS() among its push
// constants and by BUFFER() after them. One of the two declares `name.v[]`, the other nothing. Shaders that
// define WEIGHTS_BY_ADDRESS find weights by address in any case: drivers for CPUs read such a weight once for
// all lanes.
#if defined(DATA_BY_ADDRESS) || defined(WEIGHTS_BY_ADDRESS)
#include "references.glsl"
#endif

#ifdef DATA_BY_ADDRESS
#include "addresses.glsl"
#else
#define ADDRESS(type, name)
#define BUFFER(index, access, Block, element, name) \
  layout(std430, binding = index) access buffer Block { element v[]; } name;
// These access floats `at` and at + 1, where `at` is even.
#define READ_PAIR(name, at) vec2(name.v[at], name.v[(at) + 1])
#define WRITE_PAIR(name, at, values) name.v[at] = (values).x, name.v[(at) + 1] = (values).y
#endif

// These do the same with activations, which may have 16 bits.
#ifdef STORAGE_F16
#define READ_VALUES(name, at) vec2(float(name.v[at]), float(name.v[(at) + 1]))
#define WRITE_VALUES(name, at, values) \
  name.v[at] = STORAGE((values).x), name.v[(at) + 1] = STORAGE((values).y)
#else
#define READ_VALUES(name, at) READ_PAIR(name, at)
#define WRITE_VALUES(name, at, values) WRITE_PAIR(name, at, values)
#endif

#ifndef VECTOR_PUSH
#define VECTOR_PUSH  // more push constants, which shaders/llvmpipe defines
#endif
