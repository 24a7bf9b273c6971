// Between scene linear radiance and the network's range.
float to_network(float x, uint log_transfer) { return log_transfer != 0 ? log(1.0 + 8.0 * x) / 3.0 : x; }

// exp overflows where results are clamped anyway: log(1 + 8 * 65504 * 2^24) / 3 < 10, 2^24 being the largest
// exposure.
float to_linear(float y, uint log_transfer) { return log_transfer != 0 ? (exp(3.0 * min(y, 10.0)) - 1.0) / 8.0 : y; }
