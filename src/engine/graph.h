// Holds a network as data: the dispatches, their tensors, and where these lie in memory. It knows no device.
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

// Numbers the images that a frame brings and takes; the layers say which is which. They are bound anew for
// each recording.
using FrameSlot = uint32_t;
inline constexpr uint32_t kFrameSlots = 11;

// Says which of these images are Vulkan images; the others are buffers.
struct FrameImages {
  bool inputs = false, output = false;
  bool any() const { return inputs || output; }
};

// Holds the device's counts while a frame ran.
struct Status {
  uint32_t saturated = 0;   // values beyond 65504 that were stored in 16 bits as +-65504
  uint32_t not_finite = 0;  // output values that were NaN or infinite, written as 0
};

// Holds the factor by which a recording's images are multiplied on their way in and divided on their way out.
struct Exposure {
  float factor = 1;
  float inverse = 1;
};

// Says which part of a frame a recording computes, for layers that read another frame. All are full-size
// pixels; see params::Place.
struct Place {
  uint32_t y = 0, x = 0;           // the first pixel of the recording in the frame
  uint32_t height = 0, width = 0;  // of the frame
  uint32_t core_y = 0, core_x = 0, core_height = 0, core_width = 0;
};

enum class Access { kRead, kWrite };

// Names a storage buffer or an image of a pass. kFrame and kExposure are bound anew for each recording. The
// shader gets the view of the first kFrame of a pass; others are dense buffers.
struct Binding {
  enum class Kind { kTensor, kConstant, kFrame, kExposure };
  Kind kind = Kind::kTensor;
  Access access = Access::kRead;
  Tensor tensor = {};     // kTensor
  uint32_t constant = 0;  // kConstant: index of the graph's constant
  FrameSlot slot = 0;     // kFrame
  bool image = false;     // kFrame: a Vulkan image
  // The shader reads the address from the push constants, and there is no descriptor. Never set for the first
  // kFrame of a pass.
  bool by_address = false;

  VkDescriptorType descriptor_type() const {
    if (!image) return VK_DESCRIPTOR_TYPE_STORAGE_BUFFER;
    return access == Access::kWrite ? VK_DESCRIPTOR_TYPE_STORAGE_IMAGE : VK_DESCRIPTOR_TYPE_SAMPLED_IMAGE;
  }
};

// Describes one dispatch.
struct Pass {
  static constexpr uint32_t kMaxPushBytes = 128;  // every Vulkan device offers as many

  std::string name;  // the layer's name, which all of its passes have
  const Shader* shader = nullptr;
  std::vector<uint32_t> constants;  // specialization constants, by id
  // Those with a descriptor are bindings 1, 2, ...; binding 0 is the graph's status. The addresses of the
  // others are the first push constants.
  std::vector<Binding> bindings;
  alignas(8) std::array<std::byte, kMaxPushBytes> push{};
  uint32_t push_bytes = 0;
  std::array<uint32_t, 3> groups{1, 1, 1};
  std::optional<CooperativeMatrix> matrix = {};  // the shader multiplies these, which only some devices can
  double flop = 0;                               // multiply-adds count as two
  double bytes = 0;                              // the least traffic: every operand counts once
  double loop_trips = 0;                         // mean length of the loops of loops.glsl; 0: there are none

  // Returns the work by which dispatches and submits are limited, see WorkLimits.
  double work() const { return flop + bytes; }
  // Copies a structure of shaders/include/params.h into the push constants, after the addresses. `bindings`
  // must be set before.
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
  // Returns the first frame image that this pass reads or writes, or null.
  const Binding* frame() const;
  // Returns whether its descriptors differ from recording to recording.
  bool varies() const;
  // Returns the tensor that this pass writes, or null. A pass that writes scratch too binds its output last.
  const Tensor* output() const;
};

struct TensorRecord {
  std::string name;
  Shape shape;
  uint32_t rows = 0;  // rows in memory, see Graph::keep_rows()
  int exponent = 0;   // the stored values are 2^-exponent times the true ones
  uint64_t size_bytes = 0;
  uint64_t offset_bytes = 0;  // place in the activation block, after plan()
  bool scratch = false;       // memory of one layer, and no activation
  int first_use = -1;         // pass indices, inclusive
  int last_use = -1;
};

// Describes weights, biases or a table, which are packed only when a device wants them.
struct ConstantRecord {
  std::string name;
  uint64_t size_bytes = 0;
  uint64_t offset_bytes = 0;  // place in the constant block
  std::function<void(std::byte*)> fill;
};

class Graph {
 public:
  static constexpr uint64_t kGuardBytes = 512;  // see plan()
  // `frame_images` says which are Vulkan images, whose layers come in slots of their own. With `addressed`,
  // the shaders that can do so read and write activations by address, which is faster on some devices. With
  // `keep` no activations share memory, so that all can be read when the frame is done.
  explicit Graph(Storage storage, bool addressed = false, bool keep = false, FrameImages frame_images = {})
      : storage_(storage), addressed_(addressed), keep_(keep), frame_images_(frame_images) {}

  Storage storage() const { return storage_; }
  bool addressed() const { return addressed_; }
  bool keep() const { return keep_; }
  FrameImages frame_images() const { return frame_images_; }
  // Makes 1x1 convolutions of unshuffled pixels that are added from now on read vectors of so many pixels,
  // DeviceInfo::vector_lanes; 0 makes them read each by itself.
  void read_vectors(uint32_t lanes) { vector_ = lanes; }
  uint32_t vector() const { return vector_; }

  // Adds an activation, whose memory lives from the first pass that touches it to the last.
  Tensor tensor(const std::string& name, Shape shape, int exponent = 0);
  int exponent(const Tensor& tensor) const { return tensors_.at(tensor.id).exponent; }
  // Keeps only `rows` rows, a power of two, of a tensor in memory at a time: row y lies where row y % rows
  // does, in all channels. No pass may use the tensor yet. See conv2d_chain(), whose passes take turns.
  void keep_rows(const Tensor& tensor, uint32_t rows);
  // Returns the mask of the rows in memory: row y lies at row y & rows_mask().
  uint32_t rows_mask(const Tensor& tensor) const;
  uint32_t plane(const Tensor& tensor) const;
  // Adds memory (1, count, 1) of 32-bit floats, whatever the storage, in which passes of one layer hand
  // values to each other.
  Tensor scratch(const std::string& name, uint64_t count);
  // Adds a tensor that the host fills with Program::write() before each run; layers are tested alone with it.
  Tensor input(const std::string& name, Shape shape);
  // Adds a constant. `fill` writes size_bytes bytes; each Program that allocates memory calls it once.
  uint32_t constant(const std::string& name, uint64_t size_bytes, std::function<void(std::byte*)> fill);
  // Adds a pass. Passes run in the order in which they were added.
  void add(Pass pass);

  // Gives every tensor its place. Two tensors share memory only if a barrier that is needed anyway lies
  // between their lifetimes, but see keep(). kGuardBytes lie before and after them all, since vectors may
  // begin or end outside of a tensor.
  void plan();
  // Does the same, but with the places that the tensors have in the graph of the same network for larger
  // frames. It takes no more memory, whatever the size. Throws Error where the tensors do not fit there.
  void plan_within(const Graph& larger);

  std::span<const Pass> passes() const { return passes_; }
  std::span<const TensorRecord> tensors() const { return tensors_; }
  std::span<const ConstantRecord> constants() const { return constants_; }
  // Returns whether a barrier must come before pass i: since the last barrier a pass wrote memory that pass i
  // touches, or read memory that it writes. After plan_within() tensors that share memory may add barriers.
  bool barrier_before(size_t i) const { return barriers_.at(i); }
  size_t barrier_count() const;

  uint64_t activation_bytes() const { return activation_bytes_; }
  uint64_t unaliased_bytes() const;  // the activations' sum, without scratch
  uint64_t constant_bytes() const { return constant_bytes_; }
  // Returns the largest range of a tensor or constant that needs a descriptor or more than 32-bit addresses.
  uint64_t largest_binding_bytes() const;

  // Returns the last pass of each layer; all passes of a layer have its name.
  std::vector<const Pass*> layers() const;

  // Returns the most workgroups that a dispatch has along x, y and z.
  std::array<uint32_t, 3> most_groups() const;

  // Returns where a run of channels lies in the activation block, after plan().
  uint64_t offset_bytes(const Tensor& tensor) const;
  uint64_t size_bytes(const Tensor& tensor) const;

 private:
  std::vector<int> place_apart();
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
