// Stands between raymeld and a driver in tests: counts calls and live objects, and makes calls fail. There is
// one per process; CallerDevice uses it in the tests' process, fault_layer/ in a program's.
#pragma once

#include <vulkan/vulkan_core.h>

#include <cstdint>
#include <map>
#include <string>
#include <vector>

namespace raymeld::test {

// Makes the `call`-th call, counted from 1, of `function`, or of any function that may return `code`, return
// `code` and do nothing.
struct Fault {
  std::string function = {};  // such as "vkAllocateMemory"; empty: any
  int call = 0;               // 0: none
  VkResult code = VK_SUCCESS;
  // Later calls fail too. Calls to a lost device always do; its earlier work is finished first, and later
  // work is dropped.
  bool lasting = false;
};

// Makes the `call`-th vkQueueSubmit, counted from 1, wait until the file exists: a frame is then in progress.
struct Hold {
  int call = 0;  // 0: none
  std::string file = {};
};

struct Interposed {
  Fault fault;
  Hold hold;
  uint64_t most_allocation_bytes = UINT64_MAX;  // larger allocations fail for want of device memory
  bool discrete = false;                        // the host sees none of the memory that is the device's own
  uint32_t most_storage_buffers = UINT32_MAX;   // the device binds no more to one shader
  uint32_t timestamp_bits = 64;                 // queues count no more bits of a timestamp
  VkDevice device = VK_NULL_HANDLE;             // the device whose functions were asked for last

  std::vector<std::string> copies;   // "barrier" and "copy", in the order of the calls that record them
  std::map<std::string, int> calls;  // the number of calls of each function that may fail
  std::map<std::string, int> alive;  // the number of live objects by the function that made them; never 0
  int failures = 0;
  std::string failed;                           // the function whose call failed first
  std::map<std::string, int> alive_at_failure;  // `alive` at that call
};

Interposed& interposed();
void interpose_device(VkDevice device);

// Returns a stand-in for `real` if `name` may fail or destroys an object; otherwise returns `real`.
PFN_vkVoidFunction interpose(const char* name, PFN_vkVoidFunction real);

}  // namespace raymeld::test
