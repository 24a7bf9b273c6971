// Says how lanes read floats that lie side by side. When each lane reads its own, some drivers for CPUs load lane by lane,
// each behind a branch; what has the same address for all lanes they read once. So each lane takes its own of kVector loads
// that are the same for all of them, and compilers make one load of a vector of these. Subgroups must be kVector invocations
// side by side, rows of the workgroup whole numbers of them, and nothing may branch. To be included after kVector,
// invocation.glsl and uniform.glsl.
#extension GL_KHR_shader_subgroup_basic : require

// Returns the first invocation of the own vector along x and y.
uvec2 first_of_vector() {
  const uint vectors = gl_WorkGroupSize.x / kVector;
  return uvec2(kVector * uniform_number(gl_WorkGroupID.x * vectors + gl_SubgroupID % vectors),
               uniform_number(gl_WorkGroupID.y * gl_WorkGroupSize.y + gl_SubgroupID / vectors));
}

// Returns the float at `first` to the first of the vector, and the one after it to the next. Only where `first` is a constant
// do compilers see that these are neighbours. Where vectors overlap they must not see it, or they load the parts.
float read_vector(Floats from, uint first) {
  float own = from.v[first];
  [[unroll]] for (uint lane = 1; lane < kVector; ++lane) {
    float other = from.v[first + lane];
    own = gl_SubgroupInvocationID == lane ? other : own;
  }
  return own;
}

// Does the same with weights, whose address is the same for all lanes and a multiple of 16 bytes: drivers take a fifth of the
// time to compile these loads of four.
float read_weights(Quads from, uint first) {
  float own = 0.0;
  [[unroll]] for (uint lane = 0; lane < kVector; lane += 4) {
    vec4 others = from.v[(first + lane) / 4];
    [[unroll]] for (uint i = 0; i < 4; ++i) own = gl_SubgroupInvocationID == lane + i ? others[i] : own;
  }
  return own;
}

#ifdef KEEPS_ORDER
// Compilers would move all loads to the front, and spill: what is kept here later loads might depend on, for all they know.
// It does not matter which lane's sum that is; end_order() reads it lest it be left out, and is false, as no sum is a
// signalling NaN.
shared float in_order[gl_WorkGroupSize.x * gl_WorkGroupSize.y];

void keep_order(float sum) { in_order[uniform_number(gl_SubgroupID)] = sum; }

bool end_order() {
  memoryBarrierShared();
  return floatBitsToUint(in_order[uniform_number(gl_SubgroupID)]) == 0x7f812345u;
}
#endif
