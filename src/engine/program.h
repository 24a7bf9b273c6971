// A graph on a device: memory, pipelines and descriptors are made once; recording only writes commands.
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

namespace raymeld {

// One of both, as the graph has it; the shape matters of buffers.
struct FrameBinding {
  FrameBuffer view = {};
  Shape shape = {};
  FrameTexture texture = {};
};

// The images of one frame, by FrameSlot.
using FrameBindings = std::array<FrameBinding, kFrameSlots>;

// Of one dispatch and of one submit, as Pass::work() counts, so that no watchdog of a slow device fires. A
// pass is never split between submits.
struct WorkLimits {
  double dispatch_work;
  double submit_work;
};

// What suits a device's kind.
WorkLimits limits_for(const DeviceInfo& device);

// Throws Error where the device has no 16-bit storage and is asked for it.
void check_storage(const DeviceInfo& device, Storage storage);

// What the kernels of a graph's passes are made of, pass by pass.
std::vector<KernelRecipe> kernel_recipes(const Graph& graph);

class Program {
 public:
  // Allocates the constants, the activations and the status, packs and uploads the constants, compiles the
  // pipelines. `graph` must be planned and outlive the Program. `sets`: how many recordings may be pending at
  // once. `limits`: what suits the device's kind unless given. `activations`: where they are, unless the
  // Program allocates them. Throws Error, and OutOfMemory.
  Program(const Device& device, const Graph& graph, PipelineCache& cache, uint32_t sets,
          const std::optional<WorkLimits>& limits = {}, const std::optional<MemoryRange>& activations = {});
  // For the frames of another size, in the memory and with the weights and pipelines of `larger`: of a graph
  // that is planned within its, or of one without weights that takes no more memory. Recordings of both may
  // be pending at once; they take turns on the device, and a set of one is the same exposure as that of the
  // other. Compiles what is missing of the pipelines. Throws Error, and OutOfMemory.
  Program(const Program& larger, const Graph& graph, PipelineCache& cache);
  ~Program();
  Program(const Program&) = delete;
  Program& operator=(const Program&) = delete;

  // Points descriptor set `set` at a frame's images. No command buffer recorded with this set may be pending.
  // Throws Error when a binding would pass the device's maxStorageBufferRange.
  void bind(uint32_t set, const FrameBindings& frame);

  // What recordings with descriptor set `set` multiply by and divide by, from their next submit on; 1 until
  // it is set. None may be pending.
  void set_exposure(uint32_t set, float exposure);
  // The last one that was set, or that a pass wrote; read when the device is idle.
  Exposure exposure(uint32_t set) const;

  // Records passes [first, last) with descriptor set `set`, after a barrier against all earlier compute work.
  // A dispatch of more than limits().dispatch_work is split. With `queries`, pass i is followed by a barrier
  // and timestamp i + 1; timestamp 0 comes before pass 0.
  void record(VkCommandBuffer commands, uint32_t set, size_t first, size_t last,
              VkQueryPool queries = VK_NULL_HANDLE) const;

  // Records pass `index` without any workgroup: drivers that compile a kernel when it first runs do so then.
  void record_empty(VkCommandBuffer commands, uint32_t set, size_t index) const;

  const Graph& graph() const { return graph_; }
  const WorkLimits& limits() const { return limits_; }

  // Counts since the last reset by the host; read when the device is idle.
  Status status() const;
  void reset_status();

  // Copies a tensor (c, y, x, dense) from or to the host, rounding to the storage type. The device must be
  // idle; what other tensors have since overwritten is lost, unless the graph was planned without aliasing.
  // Of what the tensor stands for, whatever its exponent.
  void write(const Tensor& tensor, std::span<const float> values);
  std::vector<float> read(const Tensor& tensor) const;

  // Without activations in the caller's memory, and with constants that others have as well.
  uint64_t allocated_bytes() const;
  // Of frames of all sizes.
  size_t pipelines() const { return common_->kernels.size(); }
  // What a Program takes beside its graph's constants and activations.
  static uint64_t host_bytes(uint32_t sets);

 private:
  void create_kernels(PipelineCache& cache);
  void upload_constants();
  void create_sets(uint32_t sets);
  void prepare(PipelineCache& cache, uint32_t sets);
  // Of descriptor set `set`; `frame` is null where the pass touches no frame image.
  void write_set(uint32_t set, size_t index, const FrameBindings* frame) const;
  VkDeviceAddress address_of(const Binding& binding, uint32_t set) const;
  VkDescriptorBufferInfo buffer_info(const Binding& binding, uint32_t set, const FrameBindings* frame) const;
  // Of the image that a pass touches, as its push constants begin.
  std::array<uint32_t, 5> view_of(const Binding& binding, const FrameBindings& frame) const;
  void bind_pass(VkCommandBuffer commands, uint32_t set, size_t index) const;
  void dispatch(VkCommandBuffer commands, const Pass& pass) const;

  // Of frames of all sizes.
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
  std::vector<std::vector<std::array<uint32_t, 5>>> views_;  // [set][pass], where it touches an image
  WorkLimits limits_;
};

}  // namespace raymeld
