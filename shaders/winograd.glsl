// Minimal filtering F(kTile x kTile, 3 x 3), Lavin and Gray 2016: Y = A^T ((G g G^T) * (B^T d B)) A, with the
// points 0, 1, -1, for tiles of 4 also 2, -2, and infinity.
//
// Tiles are numbered along the rows of a band. Element (position, channel, tile) of the transformed input and of the
// products is at position * position_stride + (tile / kLanes * channels + channel) * kLanes + tile % kLanes.
layout(constant_id = 0) const uint kTile = 4;  // 2 or 4
const uint kKernel = 3;
const uint kSide = kTile + kKernel - 1;        // there are kSide x kSide positions
const uint kMostSide = 6;
const uint kLanes = RAYMELD_LANES;

uint element(uint position, uint channel, uint tile, uint position_stride, uint channels) {
  return position * position_stride + (tile / kLanes * channels + channel) * kLanes + tile % kLanes;
}
