// Minimal filtering F(kTile x kTile, 3 x 3), Lavin and Gray 2016: Y = A^T ((G g G^T) * (B^T d B)) A, with the
// points 0, 1, -1, for tiles of 4 also 2, -2, and infinity.
//
// Tiles are numbered along the rows of a band. Element (position, channel, tile) of the transformed input and of the
// products is at position * position_stride + (tile / kLanes * channels + channel) * kLanes + tile % kLanes. Where a lane of a
// vector makes products of two tiles at once, as far apart as the vector is long, those lie side by side instead.
layout(constant_id = 0) const uint kTile = 4;  // 2 or 4
const uint kKernel = 3;
const uint kSide = kTile + kKernel - 1;        // there are kSide x kSide positions
const uint kMostSide = 6;
const uint kLanes = RAYMELD_LANES;

uint element(uint position, uint channel, uint tile, uint position_stride, uint channels) {
  return position * position_stride + (tile / kLanes * channels + channel) * kLanes + tile % kLanes;
}

// Which tile of two vectors it is whose product is the i-th then.
uint tile_of_pairs(uint i, uint vector) { return i / 2 + i % 2 * vector; }

// n / d, without the division of integers that few devices have: exact below 2^20, as a quotient of floats is wrong by 2.5
// units in the last place at most.
uint quotient(uint n, uint d) { return uint((float(n) + 0.5) / float(d)); }
