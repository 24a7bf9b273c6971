// Computes F(2, 3) and F(4, 3) (Lavin and Gray 2016) tile by tile: Y = A^T ((G g G^T) * (B^T d B)) A, where a
// direction of a tile's m of 1 has the transforms of F(1, 3), a direct sum.
#pragma once

#include "reference/reference.h"

namespace raymeld::reference {

// Maps (in, h, w) to (out, h, w): the convolution's sums without its bias, in double.
Planes winograd(const Planes& x, const Conv& conv, const Tile& tile);
// Does the same in floats, each sum in the order of its equation, as one right device would.
Planes winograd_in_floats(const Planes& x, const Conv& conv, const Tile& tile);
// Returns the magnitudes S: the same sums with the absolute values of weights, inputs and transforms.
Planes winograd_magnitudes(const Bounded& x, const Conv& conv, const Tile& tile);

// Counts the roundings of an output: those of the sums over channels, and over the columns of the filter
// where these are summed directly; for each direction that is transformed, up to 4 in the input's transform,
// 4 in the weight's and 6 in the output's; and 2 for the bias, which is stored and added.
int winograd_roundings(const Conv& conv, const Tile& tile);

}  // namespace raymeld::reference
