// Returns the ids of an invocation. It must be included after the size of the workgroup.
#ifdef DATA_BY_ADDRESS
#include "ids.glsl"
#else
uint local_invocation_index() { return gl_LocalInvocationIndex; }

uvec3 global_invocation_id() { return gl_GlobalInvocationID; }
#endif
