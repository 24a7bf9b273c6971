// Declares the compiled shaders, and the parts from which layers put passes together.
#pragma once

#include <array>

#include "layers/frame_slots.h"
#include "numbers.h"
#include "params.h"

namespace raymeld {

// Holds a shader with activations in buffers, the shader with activations by address, and its form in
// shaders/llvmpipe, if there is one.
struct Forms {
  Shader buffers, addresses, vectors = {};
};

namespace shaders {
extern const Shader kConv2d;
extern const Shader kConv2dColumns;
extern const Shader kConv2dMatrix;  // has no code for 32-bit storage
extern const Forms kPointwise;
extern const Forms kPointwiseUnshuffled;
extern const Forms kWinogradWeights;
extern const Forms kWinogradInput;
extern const Forms kWinogradMultiply;
extern const Forms kWinogradOutput;
extern const Shader kExposureSums;
extern const Shader kExposureSumsImage;
extern const Shader kExposure;
extern const Forms kEncode;
extern const Forms kEncodeImage;  // reads images of Vulkan: see frame.glsl
extern const Forms kVariance;
extern const Forms kVarianceImage;
extern const Forms kAboveClip;
extern const Forms kAboveClipImage;
extern const Forms kDecode;
extern const Forms kDecodeImage;
extern const Forms kRemodulate;
extern const Forms kKernelFilter;
extern const Forms kPool;
extern const Forms kLight;
extern const Forms kCellLight;
extern const Forms kCompose;
extern const Forms kChannelMeans;
extern const Forms kAttend;
extern const Forms kGradients;
extern const Forms kRemainder;
extern const Forms kLightChange;
extern const Forms kLightChangeImage;
extern const Forms kAccumulate;
extern const Forms kAccumulateImage;
extern const Forms kSettle;
extern const Forms kSettleImage;
extern const Forms kColorVariance;
extern const Forms kCellShare;
}  // namespace shaders

// Returns a pass with the form of the shader that the graph's activations need or, with `vectors`, with the
// form in shaders/llvmpipe. Marks the bindings that this form finds by address: all but the first frame
// image, since the others are dense buffers.
inline Pass pass_of(const Graph& graph, std::string name, const Forms& forms, std::vector<Binding> bindings,
                    bool vectors = false) {
  const bool by_address = graph.addressed() || vectors;
  Pass pass;
  pass.name = std::move(name);
  pass.shader = &(vectors ? forms.vectors : by_address ? forms.addresses : forms.buffers);
  pass.bindings = std::move(bindings);
  for (Binding& binding : pass.bindings) {
    if (&binding != pass.frame()) binding.by_address |= by_address;
  }
  return pass;
}

// Sets the push constants, after which shaders/llvmpipe finds digits: see uniform.glsl.
template <typename Params>
void set_push(Pass& pass, const Params& params, bool vectors) {
  const struct {
    Params params;
    uint32_t digits[4];
  } with_digits{params, {0, 1, 2, 3}};
  vectors ? pass.set_push(with_digits) : pass.set_push(params);
}

inline Binding read_binding(const Tensor& tensor) {
  return {.kind = Binding::Kind::kTensor, .access = Access::kRead, .tensor = tensor};
}
inline Binding write_binding(const Tensor& tensor) {
  return {.kind = Binding::Kind::kTensor, .access = Access::kWrite, .tensor = tensor};
}
inline Binding constant_binding(uint32_t constant, bool by_address = false) {
  return {.kind = Binding::Kind::kConstant,
          .access = Access::kRead,
          .constant = constant,
          .by_address = by_address};
}
inline Binding frame_binding(const Graph& graph, FrameSlot slot) {
  const bool written = slot == kFusedSlot;
  return {.kind = Binding::Kind::kFrame,
          .access = written ? Access::kWrite : Access::kRead,
          .slot = slot,
          .image = written ? graph.frame_images().output : graph.frame_images().inputs};
}

inline Binding exposure_binding(Access access = Access::kRead) {
  return {.kind = Binding::Kind::kExposure, .access = access};
}

inline constexpr uint32_t kPixelsX = 64, kPixelsY = 2;  // pixels of a workgroup

// Returns the workgroups of a shader with one invocation for each element.
constexpr std::array<uint32_t, 3> element_groups(const Shape& shape) {
  return {divide_up(shape.width, kPixelsX), divide_up(shape.height, kPixelsY), shape.channels};
}

// Returns the workgroups of a shader with one invocation for each pixel.
constexpr std::array<uint32_t, 3> pixel_groups(const Shape& shape) {
  return element_groups({shape.height, shape.width, 1});
}

inline constexpr uint32_t kStrip = RAYMELD_STRIP;  // pixels of an invocation

// Returns the workgroups of a shader that uses strip.glsl.
constexpr std::array<uint32_t, 3> strip_groups(const Shape& shape) {
  return element_groups({divide_up(shape.height, kStrip), shape.width, shape.channels});
}

// Returns the bytes of a tensor, read or written once.
inline double traffic(const Graph& graph, const Tensor& tensor) {
  return static_cast<double>(tensor.shape.pixels() * tensor.shape.channels * element_bytes(graph.storage()));
}

}  // namespace raymeld
