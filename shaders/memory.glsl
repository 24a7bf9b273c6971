// How the kernels of convolutions that are chosen by measuring reach memory: weights by their address, which drivers for
// CPUs read once for all lanes; activations in storage buffers or, with DATA_BY_ADDRESS, by address as well, where each
// lane's own access is one vector instruction. A 64-bit access then brings two floats at the price of one.
#extension GL_EXT_buffer_reference : require
#extension GL_EXT_buffer_reference2 : require
#extension GL_EXT_shader_explicit_arithmetic_types_int64 : require

layout(buffer_reference, std430, buffer_reference_align = 4) buffer Floats { float v[]; };
#ifdef DATA_BY_ADDRESS
layout(buffer_reference, std430, buffer_reference_align = 8) buffer Pairs { uint64_t v[]; };
#ifdef STORAGE_F16
layout(buffer_reference, std430, buffer_reference_align = 2) buffer Values { float16_t v[]; };
#else
#define Values Floats
#endif
#endif
