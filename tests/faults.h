// What stands between raymeld and a driver in tests: counts calls, keeps count of what was made and is not
// gone, and makes calls fail. Of a process; used in it by CallerDevice and, in a program's, by fault_layer/.
#pragma once

#include <vulkan/vulkan_core.h>

#include <cstdint>
#include <map>
#include <string>

namespace raymeld::test {

// The `call`-th call, from 1, of `function`, or of any that may return `code`, returns that and does nothing.
struct Fault {
  std::string function = {};  // such as "vkAllocateMemory"; empty: any
  int call = 0;               // 0: none
  VkResult code = VK_SUCCESS;
  // Later calls fail as well. A lost device always stays lost; what it was doing is done first, as if the
  // rest had been dropped.
  bool lasting = false;
};

// The `call`-th vkQueueSubmit, from 1, waits until the file exists: until then a frame is being computed.
struct Hold {
  int call = 0;  // 0: none
  std::string file = {};
};

struct Interposed {
  Fault fault;
  Hold hold;
  uint64_t most_allocation_bytes = UINT64_MAX;  // what is beyond fails for want of device memory
  VkDevice device = VK_NULL_HANDLE;             // whose functions were asked for last

  std::map<std::string, int> calls;  // by function, of those that may fail
  std::map<std::string, int> alive;  // by the function that made them; none of count 0
  int failures = 0;
  std::string failed;  // the function of the first failure
};

Interposed& interposed();
void interpose_device(VkDevice device);

// Instead of `real`, where `name` is a function that may fail or destroys what such a one made; else `real`.
PFN_vkVoidFunction interpose(const char* name, PFN_vkVoidFunction real);

}  // namespace raymeld::test
