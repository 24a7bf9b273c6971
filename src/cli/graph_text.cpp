#include "cli/graph_text.h"

#include <algorithm>
#include <map>

#include "cli/common/console.h"
#include "layers/frame_slots.h"

namespace raymeld::cli {
namespace {

const char* slot_name(FrameSlot slot) {
  return slot == kLrhsSlot ? "LRHS" : slot == kFusedSlot ? "fused" : "HRLS";
}

// Escapes a name for a quoted string in Graphviz's language.
std::string escaped(const std::string& name) {
  std::string text;
  for (const char c : name) {
    if (c == '"' || c == '\\') text += '\\';
    text += c;
  }
  return text;
}

std::string shape_text(const Shape& shape) {
  return fmt::format("{}x{}x{}", shape.height, shape.width, shape.channels);
}

std::string binding_text(const Binding& binding) {
  return binding.kind == Binding::Kind::kFrame ? slot_name(binding.slot) : shape_text(binding.tensor.shape);
}

// Lists the operands that the pass reads, each once, and those that it writes.
std::string operands_text(const Pass& pass) {
  std::string from, to;
  std::vector<Tensor> listed;
  for (const Binding& binding : pass.bindings) {
    if (binding.kind == Binding::Kind::kConstant || binding.kind == Binding::Kind::kExposure) continue;
    if (binding.kind == Binding::Kind::kTensor) {
      if (std::find(listed.begin(), listed.end(), binding.tensor) != listed.end()) continue;
      listed.push_back(binding.tensor);
    }
    std::string& operand = binding.access == Access::kWrite ? to : from;
    operand += (operand.empty() ? "" : " + ") + binding_text(binding);
  }
  return from + " -> " + to;
}

bool shares_channels(const Tensor& a, const Tensor& b) {
  return a.id == b.id && a.channel_offset < b.channel_offset + b.shape.channels &&
         b.channel_offset < a.channel_offset + a.shape.channels;
}

// Returns the edges into pass `reader`, one from each pass that wrote one of its inputs.
std::string edges(const Graph& graph, size_t reader) {
  std::map<size_t, const Tensor*> written_by;
  for (const Binding& binding : graph.passes()[reader].bindings) {
    if (binding.kind != Binding::Kind::kTensor || binding.access != Access::kRead) continue;
    for (size_t writer = 0; writer < reader; ++writer) {
      const Tensor* written = graph.passes()[writer].output();
      if (written && shares_channels(*written, binding.tensor)) written_by[writer] = written;
    }
  }
  std::string text;
  for (const auto& [writer, written] : written_by)
    text += fmt::format("  p{} -> p{} [label=\"{}\"];\n", writer, reader, shape_text(written->shape));
  return text;
}

}  // namespace

std::string passes_text(const Graph& graph) {
  std::string text = fmt::format("{:>4}   {:<30} {:<15} {:>15}   {:<30} {:>8} {:>9}\n", "", "dispatch",
                                 "kernel", "workgroups", "height x width x channels", "GFLOP", "MiB");
  double flop = 0;
  for (size_t i = 0; i < graph.passes().size(); ++i) {
    const Pass& pass = graph.passes()[i];
    const std::string groups = fmt::format("{}x{}x{}", pass.groups[0], pass.groups[1], pass.groups[2]);
    text += fmt::format("{:>4} {} {:<30} {:<15} {:>15}   {:<30} {:>8.3f} {:>9.2f}\n", i,
                        graph.barrier_before(i) ? '|' : ' ', pass.name, pass.shader->name, groups,
                        operands_text(pass), pass.flop * 1e-9, pass.bytes / kMebibyte);
    flop += pass.flop;
  }
  return text + fmt::format("{} dispatches, {} barriers (|), {:.3f} GFLOP\n", graph.passes().size(),
                            graph.barrier_count(), flop * 1e-9);
}

std::string memory_text(const Graph& graph) {
  std::string text = fmt::format("{:<32} {:<25} {:>10} {:>14}   {}\n", "tensor", "height x width x channels",
                                 "MiB", "offset", "first .. last dispatch");
  for (const TensorRecord& tensor : graph.tensors()) {
    text += fmt::format("{:<32} {:<25} {:>10.2f} {:>14}   {} .. {}\n", tensor.name, shape_text(tensor.shape),
                        double(tensor.size_bytes) / kMebibyte, tensor.offset_bytes, tensor.first_use,
                        tensor.last_use);
  }
  const double aliased = double(graph.activation_bytes()), unaliased = double(graph.unaliased_bytes());
  return text +
         fmt::format("peak with aliasing {:.2f} MiB, without {:.2f} MiB ({:.0f} %); weights {:.2f} MiB\n",
                     aliased / kMebibyte, unaliased / kMebibyte, 100 * aliased / unaliased,
                     double(graph.constant_bytes()) / kMebibyte);
}

std::string graph_dot(const Graph& graph, const std::string& name) {
  std::string text = fmt::format("digraph \"{}\" {{\n  node [shape=box];\n", escaped(name));
  for (FrameSlot slot : {kLrhsSlot, kHrlsSlot, kFusedSlot})
    text += fmt::format("  {} [shape=ellipse];\n", slot_name(slot));
  for (size_t i = 0; i < graph.passes().size(); ++i) {
    const Pass& pass = graph.passes()[i];
    text += fmt::format("  p{} [label=\"{}\\n{}\"];\n", i, escaped(pass.name), pass.shader->name);
    text += edges(graph, i);
    const Binding* frame = pass.frame();
    if (!frame) continue;
    text += frame->access == Access::kWrite ? fmt::format("  p{} -> {};\n", i, slot_name(frame->slot))
                                            : fmt::format("  {} -> p{};\n", slot_name(frame->slot), i);
  }
  return text + "}\n";
}

}  // namespace raymeld::cli
