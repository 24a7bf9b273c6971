// Reads the bits of floats: a compiler may take it that isnan() and isinf() are never true.

bool is_nan(float value) { return (floatBitsToUint(value) & 0x7fffffffu) > 0x7f800000u; }

bool is_finite(float value) { return (floatBitsToUint(value) & 0x7fffffffu) < 0x7f800000u; }
