// Computes what invocation.glsl declares. Some drivers for CPUs divide to find the built-in variables, lane
// by lane.
#extension GL_KHR_shader_subgroup_basic : require

layout(constant_id = 29) const uint kIdLanes = 0;  // lanes of subgroups that lie side by side, or 0

uint local_invocation_index() {
  return kIdLanes == 0 ? gl_LocalInvocationIndex : gl_SubgroupID * kIdLanes + gl_SubgroupInvocationID;
}

uvec3 global_invocation_id() {
  if (kIdLanes == 0) return gl_GlobalInvocationID;
  uint index = local_invocation_index();
  return gl_WorkGroupID * gl_WorkGroupSize + uvec3(index % gl_WorkGroupSize.x, index / gl_WorkGroupSize.x, 0);
}
