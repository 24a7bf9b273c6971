#include "engine/graph.h"

#include <algorithm>
#include <bit>
#include <functional>
#include <map>
#include <numeric>

#include "engine/barriers.h"

namespace raymeld {
namespace {

// Vulkan lets a device ask at most this alignment of a storage binding's offset.
constexpr uint64_t kAlignmentBytes = 256;

uint64_t align(uint64_t bytes) { return (bytes + kAlignmentBytes - 1) / kAlignmentBytes * kAlignmentBytes; }

}  // namespace

const Binding* Pass::frame() const {
  for (const Binding& binding : bindings) {
    if (binding.kind == Binding::Kind::kFrame) return &binding;
  }
  return nullptr;
}

bool Pass::varies() const {
  return std::ranges::any_of(bindings, [](const Binding& binding) {
    return binding.kind == Binding::Kind::kFrame ||
           (binding.kind == Binding::Kind::kExposure && !binding.by_address);
  });
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

Tensor Graph::tensor(const std::string& name, Shape shape, int exponent) {
  if (shape.pixels() == 0 || shape.channels == 0) {
    throw Error("tensor {}: {}x{}x{} is empty", name, shape.height, shape.width, shape.channels);
  }
  tensors_.push_back({.name = name, .shape = shape, .rows = shape.height, .exponent = exponent});
  const Tensor result{static_cast<uint32_t>(tensors_.size() - 1), shape, 0};
  tensors_.back().size_bytes = size_bytes(result);
  return result;
}

void Graph::keep_rows(const Tensor& tensor, uint32_t rows) {
  TensorRecord& record = tensors_.at(tensor.id);
  if (!std::has_single_bit(rows) || record.first_use >= 0)
    throw Error("tensor {} cannot keep {} rows, expected a power of two, before any pass uses the tensor",
                record.name, rows);
  if (rows >= record.shape.height) return;
  record.rows = rows;
  record.size_bytes = size_bytes({tensor.id, record.shape, 0});
}

uint32_t Graph::rows_mask(const Tensor& tensor) const {
  const TensorRecord& record = tensors_.at(tensor.id);
  return record.rows < record.shape.height ? record.rows - 1 : ~0u;
}

uint32_t Graph::plane(const Tensor& tensor) const {
  const uint64_t pixels = uint64_t{tensors_.at(tensor.id).rows} * tensor.shape.width;
  return static_cast<uint32_t>(plane_stride(pixels, storage_));
}

Tensor Graph::scratch(const std::string& name, uint64_t count) {
  const Shape shape{1, static_cast<uint32_t>(count), 1};
  tensors_.push_back(
      {.name = name, .shape = shape, .rows = 1, .size_bytes = count * sizeof(float), .scratch = true});
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

// Places all tensors and barriers as if no tensors shared memory. Returns for each pass how many barriers
// precede it. A graph without passes has one stage, of its inputs.
std::vector<int> Graph::place_apart() {
  uint64_t offset_bytes = 0;
  for (TensorRecord& tensor : tensors_) {
    tensor.offset_bytes = offset_bytes;
    offset_bytes += align(tensor.size_bytes);
  }
  place_barriers();
  std::vector<int> result(std::max<size_t>(passes_.size(), 1));
  std::inclusive_scan(barriers_.begin(), barriers_.end(), result.begin(), std::plus<>(), 0);
  return result;
}

// Lifetimes count in stages, so that tensors which share memory add no barriers.
void Graph::place_tensors() {
  const std::vector<int> stages = place_apart();
  const auto stage_of = [&](int pass) { return pass < 0 ? pass : stages[static_cast<size_t>(pass)]; };
  const int last = static_cast<int>(stages.size()) - 1;
  std::vector<ArenaRequest> requests;
  for (const TensorRecord& tensor : tensors_) {
    const bool shares = !keep_ || tensor.scratch;
    requests.push_back({tensor.size_bytes, stage_of(shares ? tensor.first_use : 0),
                        stage_of(shares ? tensor.last_use : last)});
  }
  const ArenaPlan plan = plan_arena(requests, kAlignmentBytes);
  for (size_t i = 0; i < tensors_.size(); ++i)
    tensors_[i].offset_bytes = activation_bytes_ + plan.offset_bytes[i];
  activation_bytes_ += plan.size_bytes;
}

void Graph::plan() {
  activation_bytes_ = kGuardBytes;
  place_tensors();
  activation_bytes_ += kGuardBytes;
  place_barriers();
}

void Graph::plan_within(const Graph& larger) {
  const auto fits = [](const TensorRecord& small, const TensorRecord& large) {
    return small.name == large.name && small.size_bytes <= large.size_bytes;
  };
  if (!std::ranges::equal(tensors_, larger.tensors_, fits))
    throw Error("the graph is not of the same network for smaller frames");
  for (size_t i = 0; i < tensors_.size(); ++i) tensors_[i].offset_bytes = larger.tensors_[i].offset_bytes;
  activation_bytes_ = larger.activation_bytes_;
  check_places();
  place_barriers();
}

// This graph may have fewer passes than the larger one, and so other lifetimes.
void Graph::check_places() const {
  for (const TensorRecord& a : tensors_) {
    for (const TensorRecord& b : tensors_) {
      const bool meet_in_time = a.first_use <= b.last_use && b.first_use <= a.last_use;
      const bool meet_in_place =
          a.offset_bytes < b.offset_bytes + b.size_bytes && b.offset_bytes < a.offset_bytes + a.size_bytes;
      if (&a != &b && meet_in_time && meet_in_place)
        throw Error("tensors {} and {} would share memory while both are used", a.name, b.name);
    }
  }
}

// The exposure counts as a range after all others. Frame images are only read, or written by the last pass,
// and constants never change, so neither needs a barrier.
void Graph::place_barriers() {
  std::vector<MemoryUse> uses(passes_.size());
  for (size_t i = 0; i < passes_.size(); ++i) {
    for (const Binding& binding : passes_[i].bindings) {
      ByteRange range{UINT64_MAX - 1, UINT64_MAX};
      if (binding.kind == Binding::Kind::kTensor) {
        const uint64_t begin = offset_bytes(binding.tensor);
        range = {begin, begin + size_bytes(binding.tensor)};
      } else if (binding.kind != Binding::Kind::kExposure) {
        continue;
      }
      (binding.access == Access::kRead ? uses[i].reads : uses[i].writes).push_back(range);
    }
  }
  barriers_ = plan_barriers(uses);
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
      uint64_t bytes = 0;
      if (binding.kind == Binding::Kind::kTensor) bytes = size_bytes(binding.tensor);
      if (binding.kind == Binding::Kind::kConstant) bytes = constants_.at(binding.constant).size_bytes;
      // Shaders reach by address all that they can count in 32 bits.
      if (!binding.by_address || bytes > UINT32_MAX) largest = std::max(largest, bytes);
    }
  }
  return largest;
}

std::vector<const Pass*> Graph::layers() const {
  std::vector<const Pass*> last;
  std::map<std::string, size_t> places;
  for (const Pass& pass : passes_) {
    const auto [place, is_new] = places.try_emplace(pass.name, last.size());
    if (is_new) last.push_back(nullptr);
    last[place->second] = &pass;
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
  return tensors_.at(tensor.id).offset_bytes +
         uint64_t{tensor.channel_offset} * plane(tensor) * element_bytes(storage_);
}

uint64_t Graph::size_bytes(const Tensor& tensor) const {
  if (tensors_.at(tensor.id).scratch) return tensors_[tensor.id].size_bytes;
  return uint64_t{plane(tensor)} * tensor.shape.channels * element_bytes(storage_);
}

}  // namespace raymeld
