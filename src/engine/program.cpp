#include "engine/program.h"

#include <Imath/half.h>

#include <algorithm>
#include <bit>
#include <cmath>

#include "engine/commands.h"
#include "params.h"

namespace raymeld {
namespace {

// One set's exposure, with its place, lies this far from the next: the largest alignment that Vulkan lets a
// device ask of a binding's offset.
constexpr uint64_t kExposureStrideBytes = 256;

constexpr VkAccessFlags kShaderAccess = VK_ACCESS_SHADER_READ_BIT | VK_ACCESS_SHADER_WRITE_BIT;

// Orders all dispatches recorded before it ahead of all recorded after it.
void full_barrier(const VulkanFunctions& vk, VkCommandBuffer commands) {
  constexpr VkPipelineStageFlags kStage = VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT;
  auto barrier = vk_struct<VkMemoryBarrier>(VK_STRUCTURE_TYPE_MEMORY_BARRIER);
  barrier.srcAccessMask = barrier.dstAccessMask = kShaderAccess;
  vk.CmdPipelineBarrier(commands, kStage, kStage, 0, 1, &barrier, 0, nullptr, 0, nullptr);
}

// Returns the type of each binding with a descriptor; binding 0 is the status.
std::vector<VkDescriptorType> descriptor_types(const Pass& pass) {
  std::vector<VkDescriptorType> types{VK_DESCRIPTOR_TYPE_STORAGE_BUFFER};
  for (const Binding& binding : pass.bindings) {
    if (!binding.by_address) types.push_back(binding.descriptor_type());
  }
  return types;
}

// Throws Error unless the device's shaders can have as many bindings and push constants as the pass has.
void check_limits(const DeviceInfo& device, const Pass& pass) {
  const auto types = descriptor_types(pass);
  const auto buffers = std::ranges::count(types, VK_DESCRIPTOR_TYPE_STORAGE_BUFFER);
  if (buffers > device.max_storage_buffers) {
    throw Error("layer {} binds {} storage buffers; device {} binds at most {}", pass.name, buffers,
                device.name, device.max_storage_buffers);
  }
  if (pass.push_bytes > device.max_push_bytes) {
    throw Error("layer {} has {} bytes of push constants; device {} has at most {}", pass.name,
                pass.push_bytes, device.name, device.max_push_bytes);
  }
}

}  // namespace

// A watchdog fires after about two seconds. These limits keep a dispatch near a tenth of a second on slow
// devices of each kind (measured or typical: a few GFLOP/s on CPU drivers, tens on old integrated GPUs).
WorkLimits limits_for(const DeviceInfo& info) {
  const double dispatch_work = info.is_cpu ? 1e8 : info.type == "discrete GPU" ? 4e10 : 4e9;
  return {dispatch_work, 8 * dispatch_work};
}

void check_storage(const DeviceInfo& device, Storage storage) {
  if (storage == Storage::kFloat16 && !device.storage_16bit)
    throw Error("device {} has no 16-bit storage (storageBuffer16BitAccess); use fp32", device.name);
}

std::vector<KernelRecipe> kernel_recipes(const Graph& graph, const DeviceInfo& device) {
  const auto code_of = [&](const Shader& shader) {
    if (graph.storage() == Storage::kFloat32) return shader.f32;
    return device.half_dots && !shader.f16_dots.empty() ? shader.f16_dots : shader.f16;
  };
  std::vector<KernelRecipe> recipes;
  for (const Pass& pass : graph.passes()) {
    KernelRecipe recipe{.name = pass.shader->name,
                        .spirv = code_of(*pass.shader),
                        .constants = pass.constants,
                        .descriptors = descriptor_types(pass),
                        .push_bytes = pass.push_bytes};
    // Subgroups must be whole, and of the size that was planned with, to compute a matrix.
    if (pass.matrix) {
      recipe.stage_flags = VK_PIPELINE_SHADER_STAGE_CREATE_REQUIRE_FULL_SUBGROUPS_BIT_EXT;
      if (pass.matrix->requires_size) recipe.subgroup_size = pass.matrix->subgroup_size;
    }
    recipes.push_back(std::move(recipe));
  }
  return recipes;
}

Program::Program(const Device& device, const Graph& graph, PipelineCache& cache, uint32_t sets,
                 const std::optional<WorkLimits>& limits, const std::optional<MemoryRange>& activations)
    : device_(device),
      graph_(graph),
      common_(std::make_shared<Common>()),
      limits_(limits.value_or(limits_for(device.info()))) {
  check_storage(device.info(), graph.storage());
  // This limit has 32 bits, so the shaders' 32-bit addresses reach whatever is bound.
  if (graph.largest_binding_bytes() > device.info().max_storage_range_bytes) {
    throw Error("a layer binds {} bytes; device {} binds at most {}", graph.largest_binding_bytes(),
                device.info().name, device.info().max_storage_range_bytes);
  }
  const auto passes = graph.passes();
  const bool addresses =
      std::any_of(passes.begin(), passes.end(), [](const Pass& p) { return p.address_count() > 0; });
  if (addresses && !device.info().buffer_device_address) {
    throw Error("device {} has no buffer addresses (bufferDeviceAddress and shaderInt64)",
                device.info().name);
  }
  if (graph.frame_images().output && !device.info().image_writes) {
    throw Error("device {} cannot write images of any format (shaderStorageImageWriteWithoutFormat)",
                device.info().name);
  }
  for (const Pass& pass : passes) check_limits(device.info(), pass);
  for (const Pass& pass : passes) {
    if (!pass.matrix || pass.matrix == device.info().cooperative_matrix) continue;
    throw Error("layer {}: device {} has no cooperative matrices of {}x{}x{}, or they are not enabled",
                pass.name, device.info().name, pass.matrix->m, pass.matrix->n, pass.matrix->k);
  }
  const auto place_activations = [&](const auto& memory) {
    return Buffer(device, graph.activation_bytes(), memory, "activations");
  };
  common_->activations = activations ? place_activations(*activations) : place_activations(Memory::kDevice);
  common_->status = Buffer(device, sizeof(Status), Memory::kShared, "status");
  reset_status();
  common_->exposures = Buffer(device, sets * kExposureStrideBytes, Memory::kShared, "exposures");
  for (uint32_t set = 0; set < sets; ++set) {
    set_exposure(set, 1);
    set_place(set, {});
  }
  if (graph.constant_bytes() > 0) upload_constants();
  prepare(cache, sets);
}

Program::Program(const Program& larger, const Graph& graph, PipelineCache& cache)
    : device_(larger.device_), graph_(graph), common_(larger.common_), limits_(larger.limits_) {
  const auto same = [](const ConstantRecord& a, const ConstantRecord& b) {
    return a.name == b.name && a.size_bytes == b.size_bytes && a.offset_bytes == b.offset_bytes;
  };
  if (graph.activation_bytes() > larger.graph_.activation_bytes() ||
      (!graph.constants().empty() && !std::ranges::equal(graph.constants(), larger.graph_.constants(), same)))
    throw Error("the graph has other weights, or needs more memory, than the graph of larger frames");
  prepare(cache, static_cast<uint32_t>(larger.sets_.size()));
}

void Program::prepare(PipelineCache& cache, uint32_t sets) {
  create_kernels(cache);
  try {
    create_sets(sets);
  } catch (...) {
    device_.vk().DestroyDescriptorPool(device_.handle(), pool_, device_.allocator());
    throw;
  }
}

Program::~Program() { device_.vk().DestroyDescriptorPool(device_.handle(), pool_, device_.allocator()); }

void Program::upload_constants() {
  std::vector<std::byte> content(graph_.constant_bytes());
  for (const ConstantRecord& constant : graph_.constants())
    constant.fill(content.data() + constant.offset_bytes);
  common_->constants = device_.constants().get(device_, std::move(content));
}

void Program::create_kernels(PipelineCache& cache) {
  for (auto& kernel :
       device_.kernels().get(device_, cache.handle(), kernel_recipes(graph_, device_.info()))) {
    pass_kernels_.push_back(kernel.get());
    common_->kernels.insert(std::move(kernel));
  }
}

// Passes that touch no frame image and no exposure need one descriptor set, others one for each recording
// that may be pending.
void Program::create_sets(uint32_t sets) {
  const VulkanFunctions& vk = device_.vk();
  std::vector<VkDescriptorSetLayout> layouts;
  std::map<VkDescriptorType, uint32_t> counts;
  for (uint32_t set = 0; set < sets; ++set) {
    for (size_t i = 0; i < graph_.passes().size(); ++i) {
      if (set > 0 && !graph_.passes()[i].varies()) continue;
      layouts.push_back(pass_kernels_[i]->set_layout());
      for (const VkDescriptorType type : descriptor_types(graph_.passes()[i])) ++counts[type];
    }
  }
  std::vector<VkDescriptorPoolSize> sizes;
  for (const auto& [type, count] : counts) sizes.push_back({type, count});
  auto pool = vk_struct<VkDescriptorPoolCreateInfo>(VK_STRUCTURE_TYPE_DESCRIPTOR_POOL_CREATE_INFO);
  pool.maxSets = static_cast<uint32_t>(layouts.size());
  pool.poolSizeCount = static_cast<uint32_t>(sizes.size());
  pool.pPoolSizes = sizes.data();
  check(vk.CreateDescriptorPool(device_.handle(), &pool, device_.allocator(), &pool_),
        "creating a descriptor pool");
  auto info = vk_struct<VkDescriptorSetAllocateInfo>(VK_STRUCTURE_TYPE_DESCRIPTOR_SET_ALLOCATE_INFO);
  info.descriptorPool = pool_;
  info.descriptorSetCount = pool.maxSets;
  info.pSetLayouts = layouts.data();
  std::vector<VkDescriptorSet> handles(layouts.size());
  check(vk.AllocateDescriptorSets(device_.handle(), &info, handles.data()), "allocating descriptor sets");

  views_.assign(sets, std::vector<std::array<uint32_t, 5>>(graph_.passes().size()));
  frame_addresses_.assign(sets, {});
  auto next = handles.begin();
  for (uint32_t set = 0; set < sets; ++set) {
    std::vector<VkDescriptorSet> row;
    for (size_t i = 0; i < graph_.passes().size(); ++i) {
      const Pass& pass = graph_.passes()[i];
      if (set > 0 && !pass.varies()) {
        row.push_back(sets_[0][i]);
        continue;
      }
      row.push_back(*next++);
      device_.name(VK_OBJECT_TYPE_DESCRIPTOR_SET, row.back(), pass.name);
    }
    sets_.push_back(std::move(row));
  }
  for (size_t i = 0; i < graph_.passes().size(); ++i) {
    if (graph_.passes()[i].frame()) continue;
    for (uint32_t set = 0; set < (graph_.passes()[i].varies() ? sets : 1); ++set) write_set(set, i, nullptr);
  }
}

VkDeviceAddress Program::address_of(const Binding& binding, uint32_t set) const {
  switch (binding.kind) {
    case Binding::Kind::kTensor:
      return common_->activations.address() + graph_.offset_bytes(binding.tensor);
    case Binding::Kind::kConstant:
      return common_->constants->buffer.address() + graph_.constants()[binding.constant].offset_bytes;
    case Binding::Kind::kExposure:
      return common_->exposures.address() + set * kExposureStrideBytes;
    case Binding::Kind::kFrame:
      return frame_addresses_.at(set).at(binding.slot);
  }
  throw Error("a binding of no kind");
}

VkDescriptorBufferInfo Program::buffer_info(const Binding& binding, uint32_t set,
                                            const FrameBindings* frame) const {
  switch (binding.kind) {
    case Binding::Kind::kTensor:
      return {common_->activations.handle(), graph_.offset_bytes(binding.tensor),
              graph_.size_bytes(binding.tensor)};
    case Binding::Kind::kConstant: {
      const ConstantRecord& constant = graph_.constants()[binding.constant];
      return {common_->constants->buffer.handle(), constant.offset_bytes, constant.size_bytes};
    }
    case Binding::Kind::kExposure:
      return {common_->exposures.handle(), set * kExposureStrideBytes, sizeof(Exposure) + sizeof(Place)};
    case Binding::Kind::kFrame:
      break;
  }
  const FrameBuffer& view = (*frame)[binding.slot].view;
  const Shape& shape = (*frame)[binding.slot].shape;
  const uint64_t alignment = device_.info().storage_alignment_bytes;
  const uint64_t begin = view.offset_bytes / alignment * alignment;
  const uint64_t last = uint64_t{shape.channels - 1} * view.channel_stride +
                        uint64_t{shape.height - 1} * view.row_stride +
                        uint64_t{shape.width - 1} * view.pixel_stride;
  const uint64_t range = view.offset_bytes - begin + (last + 1) * 4;
  if (range > device_.info().max_storage_range_bytes) {
    throw Error("a frame image of {}x{}x{} spans {} bytes; device {} binds at most {}", shape.height,
                shape.width, shape.channels, range, device_.info().name,
                device_.info().max_storage_range_bytes);
  }
  return {view.buffer, begin, range};
}

void Program::write_set(uint32_t set, size_t index, const FrameBindings* frame) const {
  const Pass& pass = graph_.passes()[index];
  constexpr size_t kMostBindings = 9;
  std::array<VkDescriptorBufferInfo, kMostBindings> infos{};
  VkDescriptorImageInfo image{};  // a pass touches one at most
  std::array<VkWriteDescriptorSet, kMostBindings> writes{};
  uint32_t count = 0;
  const auto add = [&](VkDescriptorType type) {
    if (count == kMostBindings)
      throw Error("layer {} has more than {} descriptors", pass.name, kMostBindings);
    writes[count].sType = VK_STRUCTURE_TYPE_WRITE_DESCRIPTOR_SET;
    writes[count].dstSet = sets_.at(set)[index];
    writes[count].dstBinding = count;
    writes[count].descriptorCount = 1;
    writes[count].descriptorType = type;
    writes[count].pImageInfo = &image;
    writes[count].pBufferInfo = &infos[count];
    return count++;
  };
  infos[add(VK_DESCRIPTOR_TYPE_STORAGE_BUFFER)] = {common_->status.handle(), 0, common_->status.size_bytes()};
  for (const Binding& binding : pass.bindings) {
    if (binding.by_address) continue;
    const uint32_t at = add(binding.descriptor_type());
    if (binding.image) {
      const FrameTexture& texture = (*frame)[binding.slot].texture;
      image = {VK_NULL_HANDLE, texture.view, texture.layout};
    } else {
      infos[at] = buffer_info(binding, set, frame);
    }
  }
  device_.vk().UpdateDescriptorSets(device_.handle(), count, writes.data(), 0, nullptr);
}

void Program::bind(uint32_t set, const FrameBindings& frame) {
  std::ranges::transform(frame, frame_addresses_.at(set).begin(), &FrameBinding::address);
  for (size_t i = 0; i < graph_.passes().size(); ++i) {
    const Pass& pass = graph_.passes()[i];
    const Binding* binding = pass.frame();
    if (!binding) continue;
    write_set(set, i, &frame);
    views_[set][i] = view_of(*binding, frame);
  }
}

std::array<uint32_t, 5> Program::view_of(const Binding& binding, const FrameBindings& frame) const {
  static_assert(sizeof(params::FrameView) == 20 && sizeof(params::TextureView) == 20);
  const FrameBuffer& view = frame[binding.slot].view;
  const FrameTexture& texture = frame[binding.slot].texture;
  if (binding.image) {
    return std::bit_cast<std::array<uint32_t, 5>>(
        params::TextureView{texture.x, texture.y, texture.scale, texture.bias, texture.octahedral});
  }
  const auto remainder =
      static_cast<uint32_t>(view.offset_bytes % device_.info().storage_alignment_bytes / 4);
  return {remainder, view.pixel_stride, view.row_stride, view.channel_stride, 0};
}

void Program::set_exposure(uint32_t set, float exposure) {
  const Exposure values{exposure, 1 / exposure};
  std::memcpy(static_cast<std::byte*>(common_->exposures.mapped()) + set * kExposureStrideBytes, &values,
              sizeof(values));
}

void Program::set_place(uint32_t set, const Place& place) {
  static_assert(sizeof(Place) == sizeof(params::Place));
  const auto numbers = std::bit_cast<std::array<uint32_t, sizeof(Place) / sizeof(uint32_t)>>(place);
  std::array<float, numbers.size()> values;
  std::ranges::copy(numbers, values.begin());
  std::byte* recording = static_cast<std::byte*>(common_->exposures.mapped()) + set * kExposureStrideBytes;
  std::memcpy(recording + sizeof(Exposure), values.data(), sizeof(values));
}

Exposure Program::exposure(uint32_t set) const {
  Exposure values;
  std::memcpy(&values, static_cast<std::byte*>(common_->exposures.mapped()) + set * kExposureStrideBytes,
              sizeof(values));
  return values;
}

void Program::record(VkCommandBuffer commands, uint32_t set, size_t first, size_t last,
                     const Timestamps* timestamps) const {
  const VulkanFunctions& vk = device_.vk();
  full_barrier(vk, commands);
  if (timestamps && first == 0) timestamps->start(commands);
  for (size_t i = first; i < last; ++i) {
    if (i > first && (timestamps || graph_.barrier_before(i))) full_barrier(vk, commands);
    bind_pass(commands, set, i);
    dispatch(commands, graph_.passes()[i]);
    if (timestamps) timestamps->mark(commands, static_cast<uint32_t>(i));
  }
}

// Binds the pipeline and the descriptors of pass `index` and pushes its constants.
void Program::bind_pass(VkCommandBuffer commands, uint32_t set, size_t index) const {
  const VulkanFunctions& vk = device_.vk();
  const Pass& pass = graph_.passes()[index];
  const Kernel& kernel = *pass_kernels_[index];
  vk.CmdBindPipeline(commands, VK_PIPELINE_BIND_POINT_COMPUTE, kernel.pipeline());
  vk.CmdBindDescriptorSets(commands, VK_PIPELINE_BIND_POINT_COMPUTE, kernel.layout(), 0, 1,
                           &sets_.at(set)[index], 0, nullptr);
  auto push = pass.push;
  size_t next = 0;
  for (const Binding& binding : pass.bindings) {
    if (!binding.by_address) continue;
    const VkDeviceAddress address = address_of(binding, set);
    std::memcpy(push.data() + next, &address, sizeof(address));
    next += sizeof(address);
  }
  // The frame's view is the first member of the parameters of every pass that touches a frame image.
  if (pass.frame()) std::memcpy(push.data() + next, views_[set][index].data(), sizeof(views_[set][index]));
  if (pass.push_bytes > 0) {
    vk.CmdPushConstants(commands, kernel.layout(), VK_SHADER_STAGE_COMPUTE_BIT, 0, pass.push_bytes,
                        push.data());
  }
}

void Program::record_empty(VkCommandBuffer commands, uint32_t set, size_t index) const {
  bind_pass(commands, set, index);
  device_.vk().CmdDispatch(commands, 0, 0, 0);
}

// Splits along z (channels), then along y (rows).
void Program::dispatch(VkCommandBuffer commands, const Pass& pass) const {
  const auto [x, y, z] = pass.groups;
  const double pieces = std::max(1.0, std::ceil(pass.work() / limits_.dispatch_work));
  const auto z_step = static_cast<uint32_t>(std::max(1.0, std::floor(z / pieces)));
  const double y_pieces = std::max(1.0, std::ceil(pieces / z));
  const auto y_step = static_cast<uint32_t>(std::max(1.0, std::ceil(y / y_pieces)));
  for (uint32_t z_left = divide_up(z, z_step); z_left-- > 0;) {
    for (uint32_t y_left = divide_up(y, y_step); y_left-- > 0;) {
      const uint32_t z0 = z_left * z_step, y0 = y_left * y_step;
      const uint32_t y_count = std::min(y_step, y - y0), z_count = std::min(z_step, z - z0);
      // Synchronization validation (up to 1.3.239 at least) sees the plain dispatch only.
      if (y0 == 0 && z0 == 0) {
        device_.vk().CmdDispatch(commands, x, y_count, z_count);
      } else {
        device_.vk().CmdDispatchBase(commands, 0, y0, z0, x, y_count, z_count);
      }
    }
  }
}

Status Program::status() const {
  Status status;
  std::memcpy(&status, common_->status.mapped(), sizeof(status));
  return status;
}

void Program::reset_status() { std::memset(common_->status.mapped(), 0, sizeof(Status)); }

void Program::write(const Tensor& tensor, std::span<const float> values) {
  const uint64_t size_bytes = graph_.size_bytes(tensor), pixels = tensor.shape.pixels();
  if (graph_.rows_mask(tensor) != ~0u) throw Error("writing a tensor that does not keep all of its rows");
  if (values.size() != pixels * tensor.shape.channels) {
    throw Error("writing {} values to a tensor of {}", values.size(), pixels * tensor.shape.channels);
  }
  const Buffer host(device_, size_bytes, Memory::kUpload, "tensor upload");
  const uint64_t stride = graph_.plane(tensor);
  const auto stored = [scale = std::ldexp(1.0f, -graph_.exponent(tensor))](float v) { return v * scale; };
  for (uint64_t c = 0; c < tensor.shape.channels; ++c) {
    const auto plane = values.subspan(c * pixels, pixels);
    if (graph_.storage() == Storage::kFloat16) {
      std::ranges::transform(plane, static_cast<Imath::half*>(host.mapped()) + c * stride, stored);
    } else {
      std::ranges::transform(plane, static_cast<float*>(host.mapped()) + c * stride, stored);
    }
  }
  copy_now(device_, host.handle(), common_->activations.handle(),
           {0, graph_.offset_bytes(tensor), size_bytes}, "tensor upload");
}

void Program::fill(const Tensor& tensor, float value) {
  const float stored = std::ldexp(value, -graph_.exponent(tensor));
  const bool half = graph_.storage() == Storage::kFloat16;
  const uint32_t pattern = half ? Imath::half(stored).bits() * 0x10001u : std::bit_cast<uint32_t>(stored);
  fill_now(device_, common_->activations.handle(),
           {graph_.offset_bytes(tensor), graph_.size_bytes(tensor), pattern}, "tensor fill");
}

std::vector<float> Program::read(const Tensor& tensor) const {
  const uint64_t size_bytes = graph_.size_bytes(tensor), pixels = tensor.shape.pixels();
  if (graph_.rows_mask(tensor) != ~0u) throw Error("reading a tensor that does not keep all of its rows");
  const Buffer host(device_, size_bytes, Memory::kReadback, "tensor download");
  copy_now(device_, common_->activations.handle(), host.handle(),
           {graph_.offset_bytes(tensor), 0, size_bytes}, "tensor download");
  host.invalidate();
  const uint64_t stride = graph_.plane(tensor);
  std::vector<float> values(pixels * tensor.shape.channels);
  for (uint64_t c = 0; c < tensor.shape.channels; ++c) {
    const auto plane = values.begin() + static_cast<ptrdiff_t>(c * pixels);
    if (graph_.storage() == Storage::kFloat16) {
      std::copy_n(static_cast<const Imath::half*>(host.mapped()) + c * stride, pixels, plane);
    } else {
      std::copy_n(static_cast<const float*>(host.mapped()) + c * stride, pixels, plane);
    }
  }
  const float scale = std::ldexp(1.0f, graph_.exponent(tensor));
  for (float& value : values) value *= scale;
  return values;
}

uint64_t Program::allocated_bytes() const {
  return (common_->constants ? common_->constants->buffer.size_bytes() : 0) +
         common_->activations.allocated_bytes() + common_->status.size_bytes() +
         common_->exposures.size_bytes();
}

uint64_t Program::host_bytes(uint32_t sets) { return sizeof(Status) + sets * kExposureStrideBytes; }

}  // namespace raymeld
