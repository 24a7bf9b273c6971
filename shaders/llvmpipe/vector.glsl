// How lanes read floats that lie side by side. Of what each lane reads on its own, some drivers for CPUs make one load a lane,
// each behind a branch; what has the same address for all lanes they read once. So each lane takes its own of kVector loads
// that are the same for all of them, and compilers make one load of a vector of these. Subgroups must be kVector invocations
// side by side, rows of the workgroup whole numbers of them, and nothing may branch. kVector 0: each lane reads its own. To be
// included behind kVector, invocation.glsl and uniform.glsl.
#extension GL_KHR_shader_subgroup_basic : require

// The first invocation of the own vector along x and y, or the own one.
uvec2 first_of_vector() {
  if (kVector == 0) return global_invocation_id().xy;
  const uint vectors = gl_WorkGroupSize.x / (kVector == 0 ? 1 : kVector);
  return uvec2(kVector * uniform_number(gl_WorkGroupID.x * vectors + gl_SubgroupID % vectors),
               uniform_number(gl_WorkGroupID.y * gl_WorkGroupSize.y + gl_SubgroupID / vectors));
}

#ifdef HAS_FLOATS
// What lies at `first` for the first of the vector, and one further for each other one. Only where `first` is a constant do
// compilers see that these are neighbours. Of vectors that overlap they must not see that they do, or they load the parts.
float read_vector(Floats from, uint first) {
  float own = from.v[first];
  [[unroll]] for (uint lane = 1; lane < kVector; ++lane) {
    float other = from.v[first + lane];
    own = gl_SubgroupInvocationID == lane ? other : own;
  }
  return own;
}

// The same of weights, whose address is the same for all lanes and a multiple of 16 bytes: drivers take a fifth of the time to
// compile these loads of four.
float read_weights(Quads from, uint first) {
  float own = 0.0;
  [[unroll]] for (uint lane = 0; lane < kVector; lane += 4) {
    vec4 others = from.v[(first + lane) / 4];
    [[unroll]] for (uint i = 0; i < 4; ++i) own = gl_SubgroupInvocationID == lane + i ? others[i] : own;
  }
  return own;
}
#endif

#ifdef KEEPS_ORDER
// Compilers would move all loads to the front, and spill: what is kept here later loads might depend on, for all they know.
// Which lane's sum that is does not matter; end_order() reads it lest it be left out, and is false, as no sum is a
// signalling NaN.
shared float in_order[gl_WorkGroupSize.x * gl_WorkGroupSize.y];

void keep_order(float sum) { in_order[uniform_number(gl_SubgroupID)] = sum; }

bool end_order() {
  memoryBarrierShared();
  return floatBitsToUint(in_order[uniform_number(gl_SubgroupID)]) == 0x7f812345u;
}
#endif
