#include "engine/graph.h"

#include <algorithm>

namespace raymeld {
namespace {

// The largest alignment that Vulkan lets a device ask of a storage binding's offset.
constexpr uint64_t kAlignmentBytes = 256;

uint64_t align(uint64_t bytes) { return (bytes + kAlignmentBytes - 1) / kAlignmentBytes * kAlignmentBytes; }

struct Range {
  uint64_t begin, end;
};

bool meets(const std::vector<Range>& ranges, const Range& range) {
  return std::any_of(ranges.begin(), ranges.end(),
                     [&](const Range& r) { return r.begin < range.end && range.begin < r.end; });
}

}  // namespace

const Binding* Pass::frame() const {
  for (const Binding& binding : bindings) {
    if (binding.kind == Binding::Kind::kFrame) return &binding;
  }
  return nullptr;
}

size_t Pass::address_count() const {
  return static_cast<size_t>(
      std::count_if(bindings.begin(), bindings.end(), [](const Binding& b) { return b.by_address; }));
}

const Tensor* Pass::output() const {
  for (auto binding = bindings.rbegin(); binding != bindings.rend(); ++binding) {
    if (binding->kind == Binding::Kind::kTensor && binding->access == Access::kWrite) return &binding->tensor;
  }
  return nullptr;
}

Tensor Graph::tensor(const std::string& name, Shape shape) {
  if (shape.pixels() == 0 || shape.channels == 0) {
    throw Error("tensor {}: {}x{}x{} is empty", name, shape.height, shape.width, shape.channels);
  }
  const uint64_t elements = plane_stride(shape.pixels(), storage_) * shape.channels;
  tensors_.push_back({name, shape, elements * element_bytes(storage_)});
  return {static_cast<uint32_t>(tensors_.size() - 1), shape, 0};
}

Tensor Graph::scratch(const std::string& name, uint64_t count) {
  const Shape shape{1, static_cast<uint32_t>(count), 1};
  tensors_.push_back({.name = name, .shape = shape, .size_bytes = count * sizeof(float), .scratch = true});
  return {static_cast<uint32_t>(tensors_.size() - 1), shape, 0};
}

Tensor Graph::input(const std::string& name, Shape shape) {
  const Tensor result = tensor(name, shape);
  tensors_[result.id].first_use = tensors_[result.id].last_use = 0;
  return result;
}

uint32_t Graph::constant(const std::string& name, uint64_t size_bytes, std::function<void(std::byte*)> fill) {
  constants_.push_back({name, size_bytes, constant_bytes_, std::move(fill)});
  constant_bytes_ += align(size_bytes);
  return static_cast<uint32_t>(constants_.size() - 1);
}

void Graph::add(Pass pass) {
  const int index = static_cast<int>(passes_.size());
  for (const Binding& binding : pass.bindings) {
    if (binding.kind != Binding::Kind::kTensor) continue;
    TensorRecord& record = tensors_.at(binding.tensor.id);
    if (record.first_use < 0) {
      if (binding.access == Access::kRead) {
        throw Error("layer {} reads tensor {}, which nothing wrote", pass.name, record.name);
      }
      record.first_use = index;
    }
    record.last_use = index;
  }
  passes_.push_back(std::move(pass));
}

void Graph::plan(bool alias) {
  std::vector<ArenaRequest> requests;
  const int last = static_cast<int>(passes_.size()) - 1;
  for (const TensorRecord& tensor : tensors_) {
    const bool own = alias || tensor.scratch;
    requests.push_back({tensor.size_bytes, own ? tensor.first_use : 0, own ? tensor.last_use : last});
  }
  const ArenaPlan plan = plan_arena(requests, kAlignmentBytes);
  for (size_t i = 0; i < tensors_.size(); ++i) tensors_[i].offset_bytes = plan.offset_bytes[i];
  activation_bytes_ = plan.size_bytes;
  place_barriers();
}

// Ranges of the activation block that passes since the last barrier read and wrote decide. Frame images are
// read by one pass each or written by the last, and constants never change, so neither needs one.
void Graph::place_barriers() {
  barriers_.assign(passes_.size(), false);
  std::vector<Range> read, written;
  for (size_t i = 0; i < passes_.size(); ++i) {
    std::vector<Range> reads, writes;
    for (const Binding& binding : passes_[i].bindings) {
      if (binding.kind != Binding::Kind::kTensor) continue;
      const uint64_t begin = offset_bytes(binding.tensor);
      const Range range{begin, begin + size_bytes(binding.tensor)};
      (binding.access == Access::kRead ? reads : writes).push_back(range);
    }
    const auto hazard = [&](const Range& r) { return meets(written, r); };
    const bool needed = std::any_of(reads.begin(), reads.end(), hazard) ||
                        std::any_of(writes.begin(), writes.end(),
                                    [&](const Range& r) { return meets(written, r) || meets(read, r); });
    if (needed) {
      barriers_[i] = true;
      read.clear();
      written.clear();
    }
    read.insert(read.end(), reads.begin(), reads.end());
    written.insert(written.end(), writes.begin(), writes.end());
  }
}

size_t Graph::barrier_count() const {
  return static_cast<size_t>(std::count(barriers_.begin(), barriers_.end(), true));
}

uint64_t Graph::unaliased_bytes() const {
  uint64_t sum = 0;
  for (const TensorRecord& tensor : tensors_) sum += tensor.scratch ? 0 : align(tensor.size_bytes);
  return sum;
}

uint64_t Graph::largest_binding_bytes() const {
  uint64_t largest = 0;
  for (const Pass& pass : passes_) {
    for (const Binding& binding : pass.bindings) {
      if (binding.kind == Binding::Kind::kTensor) largest = std::max(largest, size_bytes(binding.tensor));
      if (binding.kind == Binding::Kind::kConstant) {
        largest = std::max(largest, constants_.at(binding.constant).size_bytes);
      }
    }
  }
  return largest;
}

std::vector<const Pass*> Graph::layers() const {
  std::vector<const Pass*> last;
  for (const Pass& pass : passes_) {
    if (!last.empty() && last.back()->name == pass.name) last.pop_back();
    last.push_back(&pass);
  }
  return last;
}

std::array<uint32_t, 3> Graph::most_groups() const {
  std::array<uint32_t, 3> most{};
  for (const Pass& pass : passes_) {
    for (size_t axis = 0; axis < 3; ++axis) most[axis] = std::max(most[axis], pass.groups[axis]);
  }
  return most;
}

uint64_t Graph::offset_bytes(const Tensor& tensor) const {
  const uint64_t plane_bytes = plane_stride(tensor.shape.pixels(), storage_) * element_bytes(storage_);
  return tensors_.at(tensor.id).offset_bytes + tensor.channel_offset * plane_bytes;
}

uint64_t Graph::size_bytes(const Tensor& tensor) const {
  if (tensors_.at(tensor.id).scratch) return tensors_[tensor.id].size_bytes;
  return plane_stride(tensor.shape.pixels(), storage_) * element_bytes(storage_) * tensor.shape.channels;
}

}  // namespace raymeld
