// Measures the peak of the device's arithmetic: in each round, an invocation does kSteps * kSums
// multiplications and additions in registers, which a driver may fuse or not.
#version 450
#extension GL_EXT_control_flow_attributes : require

layout(local_size_x = 64) in;
layout(push_constant) uniform Push {
  uint rounds;
  float x, y;
} p;
layout(std430, binding = 1) writeonly buffer Output { float v[]; } target;

const uint kSums = 12, kSteps = 80, kFactors = 8;

void main() {
  uint id = gl_GlobalInvocationID.x;
  float x[kFactors], y[kFactors], sum[kSums];
  [[unroll]] for (uint k = 0; k < kFactors; ++k) {
    x[k] = float(id + k) * p.x;
    y[k] = float(id + k) * p.y;
  }
  [[unroll]] for (uint k = 0; k < kSums; ++k) sum[k] = 0.0;
  for (uint round = 0; round < p.rounds; ++round) {
    [[unroll]] for (uint step = 0; step < kSteps; ++step) {
      [[unroll]] for (uint k = 0; k < kSums; ++k) {
        uint n = step * kSums + k;
        sum[k] += x[n % kFactors] * y[(n + n / kFactors) % kFactors];
      }
    }
    [[unroll]] for (uint k = 0; k < kFactors; ++k) x[k] += p.y;
  }
  float all = 0.0;
  [[unroll]] for (uint k = 0; k < kSums; ++k) all += sum[k];
  target.v[id] = all;
}
