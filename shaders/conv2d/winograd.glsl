// Has the sizes and addresses of Winograd convolutions F(kTile x kTile, 3 x 3), Lavin and Gray 2016:
//   Y = A^T ((G g G^T) * (B^T d B)) A
// The points are 0, 1, -1, for tiles of 4 also 2, -2, and infinity.
//
// Tiles are numbered along the rows of a band. Element (position, channel, tile) of the transformed
// input and of the products is at
//   position * position_stride + (tile / kLanes * channels + channel) * kLanes + tile % kLanes
// If a lane computes the products of two tiles at once, one vector apart, these lie side by side instead.
layout(constant_id = 0) const uint kTile = 4;  // 2 or 4
const uint kKernel = 3;
const uint kSide = kTile + kKernel - 1;  // there are kSide x kSide positions
const uint kMostSide = 6;
const uint kLanes = RAYMELD_LANES;

uint element(uint position, uint channel, uint tile, uint position_stride, uint channels) {
  return position * position_stride + (tile / kLanes * channels + channel) * kLanes + tile % kLanes;
}

// Returns which tile of two vectors has the i-th product where tiles lie in such pairs.
uint tile_of_pairs(uint i, uint vector) { return i / 2 + i % 2 * vector; }

// Returns n / d without the division of integers, which few devices have. It is exact below 2^20, as a
// quotient of floats is wrong by 2.5 units in the last place at most.
uint quotient(uint n, uint d) { return uint((float(n) + 0.5) / float(d)); }
