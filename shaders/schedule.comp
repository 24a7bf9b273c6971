// From the blocks of a sparse graph that are needed, distance 0, to everything that its dispatches ask: the other blocks'
// distances, the lists, how many workgroups each dispatch has. See params.h for where that lies. One workgroup.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "params.h"
#include "tensor.glsl"

const uint kInvocations = 128;
layout(local_size_x = kInvocations) in;
shared uint counts[kInvocations];

const uint kFar = ~0u;

bool is_near(uint block, uint columns, uint rows, uint distance) {
  ivec2 at = ivec2(block % columns, block / columns);
  for (int y = max(at.y - 1, 0); y <= min(at.y + 1, int(rows) - 1); ++y) {
    for (int x = max(at.x - 1, 0); x <= min(at.x + 1, int(columns) - 1); ++x)
      if (status.words[RAYMELD_SPARSE_DISTANCES + y * columns + x] == distance) return true;
  }
  return false;
}

void synchronize() {
  memoryBarrierBuffer();
  barrier();
}

// The blocks of distance `list` or less, in order: every invocation those of a run of blocks.
void make_list(uint list, uint columns, uint blocks) {
  uint run = (blocks + kInvocations - 1) / kInvocations, self = gl_LocalInvocationIndex;
  uint first = min(self * run, blocks), last = min(first + run, blocks), own = 0;
  for (uint block = first; block < last; ++block)
    own += uint(status.words[RAYMELD_SPARSE_DISTANCES + block] <= list);
  counts[self] = own;
  barrier();
  uint rows = blocks / columns, begins = RAYMELD_SPARSE_DISTANCES + blocks + list * (rows + 1 + blocks), total = 0;
  uint next = begins + rows + 1;
  for (uint i = 0; i < kInvocations; ++i) {
    next += i < self ? counts[i] : 0;
    total += counts[i];
  }
  for (uint block = first; block < last; ++block) {
    if (block % columns == 0) status.words[begins + block / columns] = next;
    if (status.words[RAYMELD_SPARSE_DISTANCES + block] > list) continue;
    status.words[next++] = block % columns | block / columns << 16;
  }
  if (self == 0) {
    status.words[begins + rows] = begins + rows + 1 + total;
    status.words[RAYMELD_SPARSE_COUNTS + list] = total;
  }
  barrier();
}

void main() {
  uint columns = (status.words[RAYMELD_SPARSE_WIDTH] + RAYMELD_SPARSE_SIDE - 1) / RAYMELD_SPARSE_SIDE;
  uint rows = (status.words[RAYMELD_SPARSE_HEIGHT] + RAYMELD_SPARSE_SIDE - 1) / RAYMELD_SPARSE_SIDE;
  uint blocks = columns * rows, lists = status.words[RAYMELD_SPARSE_LISTS], self = gl_LocalInvocationIndex;
  for (uint distance = 1; distance < lists; ++distance) {
    for (uint block = self; block < blocks; block += kInvocations) {
      uint at = RAYMELD_SPARSE_DISTANCES + block;
      if (status.words[at] == kFar && is_near(block, columns, rows, distance - 1)) status.words[at] = distance;
    }
    synchronize();
  }
  for (uint list = 0; list < lists; ++list) make_list(list, columns, blocks);
  synchronize();
  uint table = status.words[RAYMELD_SPARSE_TABLE], groups = status.words[RAYMELD_SPARSE_GROUPS];
  for (uint i = self; i < status.words[RAYMELD_SPARSE_DISPATCHES]; i += kInvocations) {
    uint row = table + i * RAYMELD_SPARSE_COLUMNS;
    uint blocks = status.words[status.words[row + 1]] - status.words[status.words[row]];
    uint items = blocks * status.words[row + 2], first = status.words[row + 3], local = status.words[row + 5];
    uint own = min(items - min(items, first), status.words[row + 4]);
    status.words[groups + 3 * i] = (own + local - 1) / local;
    status.words[groups + 3 * i + 1] = status.words[row + 6];
    status.words[groups + 3 * i + 2] = status.words[row + 7];
  }
}
