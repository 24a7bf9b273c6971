// How lanes read floats that lie side by side. Of what each lane reads on its own, some drivers for CPUs make one load a lane,
// each behind a branch; what has the same address for all lanes they read once. So each lane takes its own of kVector loads
// that are the same for all of them, and compilers make one load of a vector of these. Subgroups must be kVector invocations
// side by side, workgroups one row, and nothing may branch. kVector 0: each lane reads its own. To be included behind kVector
// and uniform.glsl.
#extension GL_KHR_shader_subgroup_basic : require

// The first invocation along x of the own vector, or the own one.
uint first_of_vector() {
  if (kVector == 0) return gl_GlobalInvocationID.x;
  const uint vectors = gl_WorkGroupSize.x / (kVector == 0 ? 1 : kVector);
  return kVector * uniform_number(gl_WorkGroupID.x * vectors + gl_SubgroupID);
}

// What lies at `first` for the first of the vector, and one further for each other one. Only where `first` is a constant do
// compilers see that these are neighbours.
float read_vector(Floats from, uint first) {
  float own = from.v[first];
  [[unroll]] for (uint lane = 1; lane < kVector; ++lane) {
    float other = from.v[first + lane];
    own = gl_SubgroupInvocationID == lane ? other : own;
  }
  return own;
}
