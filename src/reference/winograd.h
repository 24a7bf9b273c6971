// Computes F(2, 3) and F(4, 3) (Lavin and Gray 2016) tile by tile: Y = A^T ((G g G^T) * (B^T d B)) A.
#pragma once

#include "reference/reference.h"

namespace raymeld::reference {

// Maps (in, h, w) to (out, h, w): the convolution's sums without its bias, in double. `tile` is 2 or 4.
Planes winograd(const Planes& x, const Conv& conv, int tile);
// Does the same in floats, each sum in the order of its equation, as one right device would.
Planes winograd_in_floats(const Planes& x, const Conv& conv, int tile);
// Returns the magnitudes S: the same sums with the absolute values of weights, inputs and transforms.
Planes winograd_magnitudes(const Bounded& x, const Conv& conv, int tile);

// Counts the roundings besides those of the sums over channels: up to 4 in each of two passes of the input's
// transform and of the weight's, up to 6 in each of two passes of the output's, 1 for the bias.
inline constexpr int kWinogradRoundings = 2 * 4 + 2 * 4 + 2 * 6 + 1;

}  // namespace raymeld::reference
