// Puts a graph on a device. Memory, pipelines and descriptors are made once; recording only writes commands.
#pragma once

#include <map>
#include <memory>
#include <optional>
#include <set>

#include "engine/buffer.h"
#include "engine/constants.h"
#include "engine/graph.h"
#include "engine/kernel_pool.h"
#include "engine/pipeline_cache.h"
#include "engine/timestamps.h"

namespace raymeld {

// Binds an image of a frame: a buffer by `view` and `shape` or, where the graph has Vulkan images, `texture`.
struct FrameBinding {
  FrameBuffer view = {};
  Shape shape = {};
  FrameTexture texture = {};
  VkDeviceAddress address = 0;  // of a dense buffer, for Binding::by_address
};

// Holds the images of one frame by FrameSlot.
using FrameBindings = std::array<FrameBinding, kFrameSlots>;

// Limits the work of one dispatch and of one submit, as Pass::work() counts it, so that no watchdog of a slow
// device fires. A pass is never split between submits.
struct WorkLimits {
  double dispatch_work;
  double submit_work;
};

// Returns the limits that suit the device's kind.
WorkLimits limits_for(const DeviceInfo& device);

// Throws Error where the device has no 16-bit storage and is asked for it.
void check_storage(const DeviceInfo& device, Storage storage);

// Returns the recipe of each pass's kernel, pass by pass.
std::vector<KernelRecipe> kernel_recipes(const Graph& graph, const DeviceInfo& device);

class Program {
 public:
  // Allocates the constants, the activations and the status, packs and uploads the constants, and compiles
  // the pipelines. `graph` must be planned and outlive the Program. `sets` is how many recordings may be
  // pending at once. `limits` defaults to limits_for() the device. `activations` is memory of the caller's
  // for these; by default the Program allocates it. Throws Error, and OutOfMemory.
  Program(const Device& device, const Graph& graph, PipelineCache& cache, uint32_t sets,
          const std::optional<WorkLimits>& limits = {}, const std::optional<MemoryRange>& activations = {});
  // Runs frames of another size in the memory of `larger`, with its weights and pipelines. `graph` must be
  // planned within the graph of `larger`, or have no weights and take no more memory. Recordings of both may
  // be pending at once; they take turns on the device, and descriptor set i of both has the same exposure.
  // Compiles the pipelines that are missing. Throws Error, and OutOfMemory.
  Program(const Program& larger, const Graph& graph, PipelineCache& cache);
  ~Program();
  Program(const Program&) = delete;
  Program& operator=(const Program&) = delete;

  // Points descriptor set `set` at a frame's images. No command buffer recorded with this set may be pending.
  // Throws Error when a binding would exceed the device's maxStorageBufferRange.
  void bind(uint32_t set, const FrameBindings& frame);

  // Sets the exposure of recordings with descriptor set `set`, from their next submit on; it is 1 until then.
  // No such recording may be pending.
  void set_exposure(uint32_t set, float exposure);
  // Returns the exposure that was last set, or that a pass wrote. The device must be idle.
  Exposure exposure(uint32_t set) const;

  // Sets the place of recordings with descriptor set `set`, as set_exposure() does. Its numbers are at most
  // 2^24.
  void set_place(uint32_t set, const Place& place);

  // Records passes [first, last) with descriptor set `set`, after a barrier against all earlier compute work.
  // A dispatch of more than limits().dispatch_work is split. With `timestamps`, which has as many passes as
  // the graph, a timestamp and a barrier follow each pass.
  void record(VkCommandBuffer commands, uint32_t set, size_t first, size_t last,
              const Timestamps* timestamps = nullptr) const;

  // Records pass `index` without any workgroup: drivers that compile a kernel when it first runs do so then.
  void record_empty(VkCommandBuffer commands, uint32_t set, size_t index) const;

  const Graph& graph() const { return graph_; }
  const WorkLimits& limits() const { return limits_; }

  // Returns the counts since the host last reset them. The device must be idle.
  Status status() const;
  void reset_status();

  // Copies a tensor (c, y, x, dense) from or to the host, rounding to the storage type. `values` are the true
  // ones, whatever the tensor's exponent. The device must be idle. Values that other tensors have since
  // overwritten are lost, unless the graph keeps its activations.
  void write(const Tensor& tensor, std::span<const float> values);
  std::vector<float> read(const Tensor& tensor) const;
  // Stores one value everywhere in a tensor, without a copy from the host. The device must be idle.
  void fill(const Tensor& tensor, float value);

  // Returns the allocated bytes: with constants that other Programs have as well, without activations in the
  // caller's memory.
  uint64_t allocated_bytes() const;
  // Returns the number of pipelines for frames of all sizes.
  size_t pipelines() const { return common_->kernels.size(); }
  // Returns the bytes that a Program takes beside its graph's constants and activations.
  static uint64_t host_bytes(uint32_t sets);

 private:
  void create_kernels(PipelineCache& cache);
  void upload_constants();
  void create_sets(uint32_t sets);
  void prepare(PipelineCache& cache, uint32_t sets);
  // Writes pass `index` of descriptor set `set`; `frame` is null where the pass touches no frame image.
  void write_set(uint32_t set, size_t index, const FrameBindings* frame) const;
  VkDeviceAddress address_of(const Binding& binding, uint32_t set) const;
  VkDescriptorBufferInfo buffer_info(const Binding& binding, uint32_t set, const FrameBindings* frame) const;
  // Returns the view of a pass's frame image, the first member of the pass's parameters.
  std::array<uint32_t, 5> view_of(const Binding& binding, const FrameBindings& frame) const;
  void bind_pass(VkCommandBuffer commands, uint32_t set, size_t index) const;
  void dispatch(VkCommandBuffer commands, const Pass& pass) const;

  // Holds what is the same for frames of all sizes.
  struct Common {
    std::shared_ptr<const Constants> constants;
    Buffer activations, exposures, status;
    std::set<std::shared_ptr<const Kernel>> kernels;
  };

  const Device& device_;
  const Graph& graph_;
  std::shared_ptr<Common> common_;
  std::vector<const Kernel*> pass_kernels_;
  VkDescriptorPool pool_ = VK_NULL_HANDLE;
  std::vector<std::vector<VkDescriptorSet>> sets_;           // [set][pass]
  std::vector<std::vector<std::array<uint32_t, 5>>> views_;  // [set][pass], if the pass touches an image
  std::vector<std::array<VkDeviceAddress, kFrameSlots>> frame_addresses_;  // [set][slot]
  WorkLimits limits_;
};

}  // namespace raymeld
