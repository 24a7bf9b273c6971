// What an invocation works on: an item, as a pixel or a tile. In a dense graph the invocations are the items. In a sparse one,
// whose convolutions compute some blocks of the image only, x counts the items of a part of a list of blocks: see params.h.
// Behind its end lie blocks far outside of the image, so that no invocation is without one. To be included after the push
// constants, whose last member is `Place place`.
#include "sparse.glsl"

layout(constant_id = 30) const uint kItemColumns = 0;  // of a block; 0: the graph is dense
layout(constant_id = 31) const uint kItemRows = 0;

struct Item {
  uvec2 block, inner;
};

Item listed_item() {
  uint index = place.first + gl_WorkGroupID.x * gl_WorkGroupSize.x * gl_WorkGroupSize.y + local_invocation_index();
  uint inner = index % (kItemColumns * kItemRows);
  uint at = status.words[place.begin] + index / (kItemColumns * kItemRows);
  uint block = at < status.words[place.end] ? sparse_word(at) : ~0u;
  return Item(uvec2(block & 0xffff, block >> 16), uvec2(inner % kItemColumns, inner / kItemColumns));
}

uvec2 item() {
  if (kItemColumns == 0) return global_invocation_id().xy;
  Item listed = listed_item();
  return listed.block * uvec2(kItemColumns, kItemRows) + listed.inner;
}
