// Measures the same convolutions with oneDNN on one CPU thread, in the memory formats that oneDNN prefers.
// Reorders are not timed.
#include <algorithm>
#include <chrono>
#include <dnnl.hpp>

#include "bench.h"

namespace raymeld::bench {
namespace {

using dnnl::memory;

void convolution(benchmark::State& state, const Conv2dShape& s, memory::data_type type,
                 dnnl::algorithm algorithm) {
  static dnnl::engine engine(dnnl::engine::kind::cpu, 0);
  static dnnl::stream stream(engine);
  const memory::dim h = s.height, w = s.width, pad = s.kernel / 2;
  const auto any = [&](memory::dims dims, memory::data_type t) {
    return memory::desc(dims, t, memory::format_tag::any);
  };
  try {
    dnnl::primitive_attr attributes;
    dnnl::post_ops relu;
    relu.append_eltwise(1, dnnl::algorithm::eltwise_relu, 0, 0);
    attributes.set_post_ops(relu);
    const dnnl::convolution_forward::primitive_desc descriptor(
        {dnnl::prop_kind::forward_inference,
         algorithm,
         any({1, s.channels_in, h, w}, type),
         any({s.channels_out, s.channels_in, s.kernel, s.kernel}, type),
         any({s.channels_out}, memory::data_type::f32),
         any({1, s.channels_out, h, w}, type),
         {1, 1},
         {pad, pad},
         {pad, pad}},
        attributes, engine);
    memory source(descriptor.src_desc(), engine), weights(descriptor.weights_desc(), engine),
        bias(descriptor.bias_desc(), engine), target(descriptor.dst_desc(), engine);
    // Every value is 0.05, in fp32 and in bf16. New memory may hold subnormal values, which are several times
    // as slow.
    for (const memory& values : {source, weights, bias}) {
      auto* words = static_cast<uint32_t*>(values.get_data_handle());
      std::fill_n(words, values.get_desc().get_size() / sizeof(uint32_t), 0x3d4d3d4du);
    }
    const dnnl::convolution_forward convolve(descriptor);
    const auto run = [&] {
      convolve.execute(stream, {{DNNL_ARG_SRC, source},
                                {DNNL_ARG_WEIGHTS, weights},
                                {DNNL_ARG_BIAS, bias},
                                {DNNL_ARG_DST, target}});
      stream.wait();
    };
    run();
    for ([[maybe_unused]] auto _ : state) {
      const auto start = std::chrono::steady_clock::now();
      run();
      state.SetIterationTime(std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
    }
    state.counters["FLOP/s"] = benchmark::Counter(s.flop(), benchmark::Counter::kIsIterationInvariantRate);
  } catch (const dnnl::error& error) {
    state.SkipWithError(error.what());
  }
}

}  // namespace

void register_onednn() {
  for (const Conv2dShape& shape : shapes()) {
    const auto add = [&](const char* kind, memory::data_type type, dnnl::algorithm algorithm) {
      const std::string name = "conv2d/" + name_of(shape) + "/onednn/" + kind;
      benchmark::RegisterBenchmark(
          name.c_str(), [=](benchmark::State& state) { convolution(state, shape, type, algorithm); })
          ->UseManualTime()
          ->Unit(benchmark::kMillisecond);
    };
    add("fp32", memory::data_type::f32, dnnl::algorithm::convolution_direct);
    add("bf16", memory::data_type::bf16, dnnl::algorithm::convolution_direct);
    if (shape.kernel == 3) add("winograd", memory::data_type::f32, dnnl::algorithm::convolution_winograd);
  }
}

}  // namespace raymeld::bench
