// Lets lanes read floats that lie side by side. When each lane reads its own float, some drivers for CPUs
// load lane by lane, each behind a branch. They read a float once if its address is the same for all lanes.
// So kVector such loads are made, each lane takes its own, and compilers turn the loads into one load of a
// vector. Subgroups must be kVector invocations side by side, rows of the workgroup must be whole numbers of
// subgroups, and nothing may branch. It must be included after kVector, invocation.glsl and uniform.glsl.
#extension GL_KHR_shader_subgroup_basic : require

// Returns x and y of the first invocation in this invocation's vector.
uvec2 first_of_vector() {
  const uint vectors = gl_WorkGroupSize.x / kVector;
  return uvec2(kVector * uniform_number(gl_WorkGroupID.x * vectors + gl_SubgroupID % vectors),
               uniform_number(gl_WorkGroupID.y * gl_WorkGroupSize.y + gl_SubgroupID / vectors));
}

// Returns the float at `first` to the vector's first lane, the float after it to the next lane, and so on.
// Compilers see that these are neighbours only where `first` is a constant. They must not see it where
// vectors overlap, or they load each float once and put vectors together from pieces.
float read_vector(Floats from, uint first) {
  float own = from.v[first];
  [[unroll]] for (uint lane = 1; lane < kVector; ++lane) {
    float other = from.v[first + lane];
    own = gl_SubgroupInvocationID == lane ? other : own;
  }
  return own;
}

// Does the same with weights, whose address is the same for all lanes and a multiple of 16 bytes. Drivers
// take a fifth of the time to compile these loads of four.
float read_weights(Quads from, uint first) {
  float own = 0.0;
  [[unroll]] for (uint lane = 0; lane < kVector; lane += 4) {
    vec4 others = from.v[(first + lane) / 4];
    [[unroll]] for (uint i = 0; i < 4; ++i) own = gl_SubgroupInvocationID == lane + i ? others[i] : own;
  }
  return own;
}

#ifdef KEEPS_ORDER
// Compilers would move all loads to the front and spill registers. keep_order() stores a sum, and later loads
// might depend on it, for all that a compiler knows; which lane's sum is stored does not matter. end_order()
// reads it, so that the store is not removed. It returns false, as no sum is a signalling NaN.
shared float in_order[gl_WorkGroupSize.x * gl_WorkGroupSize.y];

void keep_order(float sum) { in_order[uniform_number(gl_SubgroupID)] = sum; }

bool end_order() {
  memoryBarrierShared();
  return floatBitsToUint(in_order[uniform_number(gl_SubgroupID)]) == 0x7f812345u;
}
#endif
