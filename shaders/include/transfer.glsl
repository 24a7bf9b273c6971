// Converts scene linear radiance to the network's range. Here and below mix() selects without a branch.
float to_network(float x, uint log_transfer) { return mix(x, log(1.0 + 8.0 * x) / 3.0, log_transfer != 0); }

// Converts the network's range to scene linear radiance. The limit of 10 keeps exp from overflowing and lies
// where results are clamped anyway: log(1 + 8 * 65504 * 2^24) / 3 < 10, 2^24 being the largest exposure.
float to_linear(float y, uint log_transfer) {
  return mix(y, (exp(3.0 * min(y, 10.0)) - 1.0) / 8.0, log_transfer != 0);
}
