// What an invocation works on: an item, as a pixel or a tile. In a dense graph the invocations are the items. In a sparse one,
// whose passes compute some blocks of the image only, x counts the items of the blocks of a list: see sparse.glsl. The list
// ends with blocks far outside of the image, so that no invocation is without one. To be included after the push constants,
// whose last member is `Place place`.
layout(constant_id = 30) const uint kItemColumns = 0;  // of a block; 0: the graph is dense
layout(constant_id = 31) const uint kItemRows = 0;

// Of LRHS, width and height.
uvec2 sparse_size() { return uvec2(status.words[RAYMELD_SPARSE_WIDTH], status.words[RAYMELD_SPARSE_HEIGHT]); }

uvec2 item() {
  if (kItemColumns == 0) return gl_GlobalInvocationID.xy;
  uint index = place.first + gl_WorkGroupID.x * gl_WorkGroupSize.x * gl_WorkGroupSize.y + gl_LocalInvocationIndex;
  uint inner = index % (kItemColumns * kItemRows);
  uint block = status.words[place.list + index / (kItemColumns * kItemRows)];
  return uvec2(block & 0xffff, block >> 16) * uvec2(kItemColumns, kItemRows) +
         uvec2(inner % kItemColumns, inner / kItemColumns);
}
