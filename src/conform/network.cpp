#include "conform/network.h"

#include <fmt/format.h>

#include "conform/model_file.h"
#include "conform/suites.h"

namespace raymeld::conform {
namespace {

using reference::Architecture;
using reference::Bounded;
using reference::Planes;
using reference::Precision;

// Returns the reference's name of a pass's output, which is empty for decode.
std::string reference_name(const std::string& pass, const Architecture& a) {
  if (pass == "decode") return {};
  for (int g = 0; g < a.groups; ++g) {
    if (pass != fmt::format("groups.{}.blocks.{}.merge", g, a.blocks - 1)) continue;
    return g + 1 == a.groups ? "trunk" : fmt::format("groups.{}", g);
  }
  return pass;
}

reference::Weights rounded_weights(const Subject& subject, const NetworkTrial& trial) {
  reference::Weights weights;
  for (const auto& [name, conv] : subject.weights) weights[name] = round_to(conv, trial.precision);
  return weights;
}

reference::Outputs expected_outputs(const Subject& subject, const NetworkTrial& trial,
                                    const std::map<std::string, Planes>& given) {
  return reference::network(subject.architecture, rounded_weights(subject, trial), subject.lrhs, subject.hrls,
                            trial.phase, trial.precision, given, trial.exposure, trial.method.tile(),
                            trial.method.units(trial.precision));
}

std::map<std::string, Planes> in_floats(const Subject& subject, const NetworkTrial& trial) {
  return reference::network_in_floats(subject.architecture, rounded_weights(subject, trial), subject.lrhs,
                                      subject.hrls, trial.phase, trial.precision, trial.exposure,
                                      trial.method.tile());
}

// Compares the output with those of other devices. Each is within the bound of the same expected value, so
// they differ by at most twice the bound, and likewise by twice the allowed RMS error unless `rms` is 0.
void agree(const Collector& collector, const std::string& name, const NetworkTrial& trial,
           const Planes& output, const Bounded& expected, double rms) {
  const std::string key = fmt::format("{}, {}, {}", name, trial.method.name, name_of(trial.precision));
  for (const Values& other : collector.options().others) {
    const std::string layer = "agreement with " + other.device;
    const auto known = other.outputs.find(key);
    if (known == other.outputs.end()) {
      collector.unsupported({layer, trial.method.name, trial.precision, name},
                            "the other device has no such output");
      continue;
    }
    collector.run(layer, trial.method, trial.precision, name, [&](Check& check) {
      Bounded near{known->second, expected.bound};
      for (double& bound : near.bound.data) bound *= 2;
      check.within(output, near);
      if (rms > 0) check.rms(output, known->second, 2 * rms, "difference of both devices");
    });
  }
  if (collector.options().keep) collector.options().keep->outputs[key] = output;
}

}  // namespace

Subject make_subject(const Architecture& a, int height, int width, uint64_t seed) {
  using reference::Fill, reference::random_planes;
  Subject subject{a, reference::random_weights(a, Precision::kFp32, seed),
                  random_planes(3, height, width, Fill::kUniform, seed + 1000),
                  random_planes(3 * int(a.hrls_layers.size()), a.scale * height, a.scale * width,
                                Fill::kUniform, seed + 2000)};
  if (a.scale == 1) subject.lrhs = slice(reference::exact(subject.hrls), 0, 3).value;
  return subject;
}

NetworkRun run_network(const Target& target, const Model& model, const Subject& subject,
                       FuserOptions options) {
  options.keep_activations = true;
  Fuser fuser(target.device, model, uint32_t(subject.lrhs.h), uint32_t(subject.lrhs.w), options,
              target.cache_folder);
  std::vector<float> fused(3 * size_t(subject.hrls.h) * size_t(subject.hrls.w));
  NetworkRun run;
  run.report = fuser.fuse(reference::floats(subject.lrhs).data(), reference::floats(subject.hrls).data(),
                          fused.data());
  run.output = reference::planes(3, subject.hrls.h, subject.hrls.w, fused);
  for (const Pass* layer : fuser.graph().layers()) {
    const std::string name = reference_name(layer->name, subject.architecture);
    if (name.empty()) continue;
    const Shape& shape = layer->output()->shape;
    run.layers[name] = reference::planes(int(shape.channels), int(shape.height), int(shape.width),
                                         fuser.program().read(*layer->output()));
  }
  return run;
}

Kernels kernels_of(const Method& method) {
  return {.addressed = method.addressed,
          .vector = method.kernel.vector,
          .conv2d = [kernel = method.kernel](const Conv2dShape& shape) {
            Conv2dKernel result = kernel;
            if (shape.kernel == 1 && result.algorithm == Algorithm::kWinograd)
              result.algorithm = Algorithm::kPointwise;
            return result.computes(shape.kernel) ? result : Conv2dKernel{};
          }};
}

std::vector<Method> network_methods(const DeviceInfo& device, size_t index) {
  std::vector<Method> methods{direct_method(device), columns_method(index % 2 == 0 ? 2 : 4)};
  for (const uint32_t tile : {2u, 4u}) {
    const bool addressed = (index + tile / 2) % 2 == 0;
    // Tiny networks have few channels. With these parameters they have several parts and bands.
    methods.push_back({.name = fmt::format("F({}, 3){}", tile, addressed ? " by address" : ""),
                       .kernel = {.algorithm = Algorithm::kWinograd,
                                  .tile = tile,
                                  .outputs = 8,
                                  .channels = 8,
                                  .band = 64,
                                  .vector = addressed ? device.vector_lanes : 0},
                       .addressed = addressed});
  }
  // Tiles that are possible for 3x3 convolutions are possible for 1x1 ones too.
  methods.push_back({.name = "matrices",
                     .kernel = {.algorithm = Algorithm::kMatrix, .matrix = matrix_tiles(device, 3).front()}});
  return methods;
}

void conform_one(const Collector& collector, const std::string& name, const Subject& subject,
                 const NetworkTrial& trial) {
  const Method& method = trial.method;
  const Precision precision = trial.precision;
  NetworkRun run;
  const auto of = [&](const std::string& layer, const std::function<void(Check&)>& body) {
    collector.run(layer, method, precision, name, body);
  };
  of("network, layer by layer", [&](Check& check) {
    const Model model(model_file(subject.architecture, subject.weights), "tiny");
    run = run_network(collector.target(), model, subject,
                      {.storage = storage_of(precision),
                       .kernels = kernels_of(method),
                       .phase = trial.phase,
                       .exposure = trial.exposure});
    reference::Outputs layers = expected_outputs(subject, trial, run.layers);
    for (const auto& [layer, device] : run.layers) check.within(device, layers.at(layer), layer);
    check.within(run.output, layers.at("output"), "output");
    check.that(run.report.status.saturated == 0, "counted saturated values");
  });
  Bounded carried;
  double rms = 0;
  of("network, whole", [&](Check& check) {
    if (run.layers.empty()) throw Error("the network did not run");
    const reference::Outputs right = expected_outputs(subject, trial, {});
    carried = right.at("output");
    check.within(run.output, carried);
    const std::map<std::string, Planes> near = in_floats(subject, trial);
    // The RMS of few values is a matter of luck: half of them may be zeros of a ReLU, which are exact.
    constexpr size_t kLeastValues = 200;
    const auto hold = [&](const std::string& layer, const Planes& device) {
      const Planes& expected = right.at(layer).value;
      if (expected.data.size() < kLeastValues) return 0.0;
      const double allowed =
          method.units(precision) * reference::allowed_rms(expected, near.at(layer), precision);
      check.rms(device, expected, allowed, layer);
      return allowed;
    };
    for (const auto& [layer, device] : run.layers) hold(layer, device);
    rms = hold("output", run.output);
  });
  if (!run.layers.empty() && !carried.value.data.empty())
    agree(collector, name, trial, run.output, carried, rms);
}

}  // namespace raymeld::conform
