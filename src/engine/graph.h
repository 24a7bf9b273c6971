// The network as data: what is dispatched, on which tensors, and where these live. Knows no device.
#pragma once

#include <array>
#include <cstddef>
#include <cstring>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "engine/arena.h"
#include "engine/kernel.h"
#include "engine/tensor.h"
#include "numbers.h"

namespace raymeld {

// The images that a frame brings and takes are numbered; what they are is for the layers to say. They are
// bound anew for each recording.
using FrameSlot = uint32_t;
inline constexpr uint32_t kFrameSlots = 8;

// Which of them are images of Vulkan, others being buffers.
struct FrameImages {
  bool inputs = false, output = false;
  bool any() const { return inputs || output; }
};

// What the device counted while a frame ran.
struct Status {
  uint32_t saturated = 0;   // values beyond 65504 that were stored in 16 bits as +-65504
  uint32_t not_finite = 0;  // output values that were NaN or infinite, written as 0
};

// What the images of a recording are multiplied by on their way in, and divided by on their way out.
struct Exposure {
  float factor = 1;
  float inverse = 1;
};

enum class Access { kRead, kWrite };

// One storage buffer of a pass, or an image. What kFrame and kExposure mean differs from recording to
// recording.
struct Binding {
  enum class Kind { kTensor, kConstant, kFrame, kExposure };
  Kind kind = Kind::kTensor;
  Access access = Access::kRead;
  Tensor tensor = {};     // kTensor
  uint32_t constant = 0;  // kConstant: index of the graph's constant
  FrameSlot slot = 0;     // kFrame
  bool image = false;     // kFrame: of Vulkan
  // The shader reads its address in the push constants, and there is no descriptor. Not for kFrame.
  bool by_address = false;

  VkDescriptorType descriptor_type() const {
    if (!image) return VK_DESCRIPTOR_TYPE_STORAGE_BUFFER;
    return access == Access::kWrite ? VK_DESCRIPTOR_TYPE_STORAGE_IMAGE : VK_DESCRIPTOR_TYPE_SAMPLED_IMAGE;
  }
};

// One dispatch.
struct Pass {
  static constexpr uint32_t kMaxPushBytes = 128;  // what every Vulkan device offers

  std::string name;  // the layer's name; of a layer's only or last pass: the key of its weights
  const Shader* shader = nullptr;
  std::vector<uint32_t> constants;  // specialization constants, by id
  // Those with a descriptor are bindings 1, 2, ...; binding 0 is the graph's status. The addresses of the
  // others are the first push constants.
  std::vector<Binding> bindings;
  alignas(8) std::array<std::byte, kMaxPushBytes> push{};
  uint32_t push_bytes = 0;
  std::array<uint32_t, 3> groups{1, 1, 1};
  std::optional<CooperativeMatrix> matrix =
      {};            // the shader multiplies these: only for a device that has them
  double flop = 0;   // multiply-adds count as two
  double bytes = 0;  // every operand once: the least traffic

  // What dispatches and submits are measured by.
  double work() const { return flop + bytes; }
  // Copies a structure of shaders/include/params.h into the push constants, behind the addresses: after
  // `bindings`.
  template <typename Params>
  void set_push(const Params& params) {
    static_assert(sizeof(Params) % 4 == 0);
    const size_t addresses_bytes = address_count() * sizeof(uint64_t);
    if (addresses_bytes + sizeof(Params) > kMaxPushBytes)
      throw Error("layer {}: too many push constants", name);
    std::memcpy(push.data() + addresses_bytes, &params, sizeof(Params));
    push_bytes = static_cast<uint32_t>(addresses_bytes + sizeof(Params));
  }
  size_t address_count() const;
  // The frame image this pass reads or writes, if any.
  const Binding* frame() const;
  // Whether its descriptors differ from recording to recording.
  bool varies() const;
  // The tensor this pass writes, if any; the last of its bindings where it writes scratch as well.
  const Tensor* output() const;
};

struct TensorRecord {
  std::string name;
  Shape shape;
  uint32_t rows = 0;  // that are kept, see Graph::keep_rows()
  int exponent = 0;   // what is stored is 2^-exponent times what the tensor stands for
  uint64_t size_bytes = 0;
  uint64_t offset_bytes = 0;  // in the activation block, after plan()
  bool scratch = false;       // of one layer's own, and no activation
  int first_use = -1;         // pass indices, inclusive
  int last_use = -1;
};

// Weights, biases and tables: packed only when a device wants them.
struct ConstantRecord {
  std::string name;
  uint64_t size_bytes = 0;
  uint64_t offset_bytes = 0;  // in the constant block
  std::function<void(std::byte*)> fill;
};

class Graph {
 public:
  static constexpr uint64_t kGuardBytes = 512;  // see plan()
  // `frame_images`: whose layers come in slots of their own. `addressed`: shaders that can read and write
  // activations by address, which is faster on some devices. `keep`: all activations can still be read when
  // the frame is done; none share memory.
  explicit Graph(Storage storage, bool addressed = false, bool keep = false, FrameImages frame_images = {})
      : storage_(storage), addressed_(addressed), keep_(keep), frame_images_(frame_images) {}

  Storage storage() const { return storage_; }
  bool addressed() const { return addressed_; }
  bool keep() const { return keep_; }
  FrameImages frame_images() const { return frame_images_; }
  // DeviceInfo::vector_lanes, if passes that are added from now on shall read pixels side by side as vectors.
  void read_vectors(uint32_t lanes) { vector_ = lanes; }
  uint32_t vector() const { return vector_; }

  // A new activation; its memory lives from the first pass that touches it to the last.
  Tensor tensor(const std::string& name, Shape shape, int exponent = 0);
  int exponent(const Tensor& tensor) const { return tensors_.at(tensor.id).exponent; }
  // Of a tensor that no pass uses yet, only as many rows, a power of two, are in memory at a time: row y is
  // where row y % rows is, in all channels. For passes that take turns, see conv2d_chain().
  void keep_rows(const Tensor& tensor, uint32_t rows);
  // Row y is at y & rows_mask(), and elements from one channel's plane to the next.
  uint32_t rows_mask(const Tensor& tensor) const;
  uint32_t plane(const Tensor& tensor) const;
  // Floats of 32 bits, whatever the storage, that passes of one layer hand to each other: (1, count, 1).
  Tensor scratch(const std::string& name, uint64_t count);
  // One that the host fills with Program::write() before each run; how layers are tested alone.
  Tensor input(const std::string& name, Shape shape);
  // `fill` writes size_bytes bytes; called once for each device.
  uint32_t constant(const std::string& name, uint64_t size_bytes, std::function<void(std::byte*)> fill);
  // Passes run in the order in which they were added.
  void add(Pass pass);

  // Gives every tensor its place: those whose lifetimes do not meet share memory, but see keep(). In front of
  // and behind them all are kGuardBytes, as vectors may begin or end outside of a tensor.
  void plan();
  // The same, but with the places that the tensors have in the graph of the same network for larger frames:
  // it takes no more memory, whatever the size. Throws Error where they do not fit there.
  void plan_within(const Graph& larger);

  std::span<const Pass> passes() const { return passes_; }
  std::span<const TensorRecord> tensors() const { return tensors_; }
  std::span<const ConstantRecord> constants() const { return constants_; }
  // Whether a barrier must come before pass i: it touches what a pass since the last barrier wrote, or writes
  // what one read. Arena reuse makes write-after-read and write-after-write hazards as real as
  // read-after-write.
  bool barrier_before(size_t i) const { return barriers_.at(i); }
  size_t barrier_count() const;

  uint64_t activation_bytes() const { return activation_bytes_; }
  uint64_t unaliased_bytes() const;  // of activations, without scratch
  uint64_t constant_bytes() const { return constant_bytes_; }
  // The largest range of a tensor or constant that takes a descriptor or, by address, more than 32 bits.
  uint64_t largest_binding_bytes() const;

  // The last pass of each layer, whose passes all have its name.
  std::vector<const Pass*> layers() const;

  // The most workgroups that a dispatch has along x, y and z.
  std::array<uint32_t, 3> most_groups() const;

  // Where a run of channels lies in the activation block, after plan().
  uint64_t offset_bytes(const Tensor& tensor) const;
  uint64_t size_bytes(const Tensor& tensor) const;

 private:
  void place_tensors();
  void place_barriers();
  void check_places() const;

  Storage storage_;
  bool addressed_;
  bool keep_;
  uint32_t vector_ = 0;
  FrameImages frame_images_;
  std::vector<Pass> passes_;
  std::vector<TensorRecord> tensors_;
  std::vector<ConstantRecord> constants_;
  std::vector<bool> barriers_;
  uint64_t activation_bytes_ = 0;
  uint64_t constant_bytes_ = 0;
};

}  // namespace raymeld
