// Adds the layers of the joint base.
#include <bit>

#include "layers/llvmpipe.h"
#include "layers/shapes.h"
#include "layers/upsampled.h"

namespace raymeld {
namespace {

constexpr uint32_t kCandidates = RAYMELD_CANDIDATES;

}  // namespace

void irradiance(Graph& graph, const std::string& name, const Tensor& lrhs, const Tensor& albedo,
                const Tensor& normal, const Tensor& out, const JointOptions& options) {
  expect_shape(name, "LRHS", lrhs, with_channels(out.shape, 3));
  expect_shape(name, "the albedo", albedo, enlarged(out.shape, options.scale, 3));
  expect_shape(name, "the normal", normal, albedo.shape);
  expect_shape(name, "the output", out, lrhs.shape);
  Pass pass = pass_of(graph, name, shaders::kIrradiance, {lrhs, albedo, normal}, out);
  pass.set_push(params::Irradiance{out.shape.height, out.shape.width, graph.plane(out), graph.plane(albedo),
                                   options.scale, options.phase > 0, options.transfer == Transfer::kLog});
  pass.groups = pixel_groups(out.shape);
  graph.add(std::move(pass));
}

void demodulate(Graph& graph, const std::string& name, const Tensor& color, const Tensor& albedo,
                const Tensor& lrhs, const Tensor& out, const JointOptions& options) {
  expect_shape(name, "the color", color, with_channels(out.shape, 3));
  expect_shape(name, "the albedo", albedo, color.shape);
  expect_shape(name, "the output", out, with_channels(color.shape, 5));
  expect_shape(name, "LRHS", lrhs, with_channels(lrhs.shape, 6));
  expect_shape(name, "the color", color, enlarged(lrhs.shape, options.scale, 3));
  Pass pass = pass_of(graph, name, shaders::kDemodulate, {color, albedo, lrhs}, out);
  const float pixels = static_cast<float>(options.scale * options.scale);
  pass.set_push(params::Demodulate{
      upsampled(graph, out, lrhs, options.transfer, options.scale, options.phase), options.scale,
      options.phase > 0 ? options.lrhs_certainty / pixels : options.lrhs_certainty});
  pass.groups = strip_groups(with_channels(out.shape, 1));
  graph.add(std::move(pass));
}

void joint_filter(Graph& graph, const std::string& name, const Tensor& in, const Tensor& albedo,
                  const Tensor& normal, const Tensor& brightness, const Tensor& out, uint32_t step,
                  const GuideFactors& factors) {
  const Shape shape = with_channels(out.shape, 4), guide = with_channels(out.shape, 3);
  expect_shape(name, "the input", in, shape);
  expect_shape(name, "the albedo", albedo, guide);
  expect_shape(name, "the normal", normal, guide);
  expect_shape(name, "the brightness", brightness, with_channels(shape, 1));
  expect_shape(name, "the output", out, shape);
  if (!std::has_single_bit(step))
    throw Error("layer {}: a step of {} pixels, expected a power of two", name, step);
  const Shape strips{divide_up(shape.height, RAYMELD_JOINT_STRIP * step) * step, shape.width, 1};
  const uint32_t vector = llvmpipe::filter_vector(graph, strips, step);
  Pass pass = pass_of(graph, name, shaders::kJointFilter, {in, albedo, normal, brightness}, out, vector > 0);
  if (vector > 0) pass.constants = {vector};
  set_push(pass,
           params::JointFilter{shape.height, shape.width, graph.plane(out), step,
                               factors.albedo / float(RAYMELD_ALBEDO_WIDTH),
                               factors.normal / float(RAYMELD_NORMAL_WIDTH),
                               factors.brightness / float(RAYMELD_BRIGHTNESS_WIDTH)},
           vector > 0);
  pass.groups = pixel_groups(strips);
  constexpr double kFlopOfTap = 34;
  pass.flop = 9 * kFlopOfTap * static_cast<double>(shape.pixels());
  graph.add(std::move(pass));
}

void remodulate(Graph& graph, const std::string& name, const Tensor& demodulated, const Tensor& albedo,
                const Tensor& out, Transfer transfer, const std::optional<Tensor>& rest) {
  const Shape shape = with_channels(out.shape, 3);
  expect_shape(name, "the demodulated radiance", demodulated, shape);
  expect_shape(name, "the albedo", albedo, shape);
  expect_shape(name, "the output", out, shape);
  if (rest) expect_shape(name, "the rest", *rest, shape);
  Pass pass = pass_of(graph, name, shaders::kRemodulate, {demodulated, albedo, rest.value_or(albedo)}, out);
  pass.constants = {rest.has_value()};
  if (!rest) pass.bytes -= traffic(graph, albedo);  // which is bound in the place of the rest, and not read
  pass.set_push(params::Remodulate{shape.height, shape.width, graph.plane(out), transfer == Transfer::kLog});
  pass.groups = strip_groups(shape);
  graph.add(std::move(pass));
}

void mix(Graph& graph, const std::string& name, const Tensor& rec, const Tensor& lrhs, const Tensor& albedo,
         const Tensor& candidates, const Tensor& out, const JointOptions& options) {
  const Shape shape = enlarged(lrhs.shape, options.scale, 3);
  expect_shape(name, "LRHS", lrhs, with_channels(lrhs.shape, 6));
  expect_shape(name, "the network's output", rec, with_channels(shape, 3 + kCandidates));
  expect_shape(name, "the albedo", albedo, shape);
  expect_shape(name, "the filtered candidates", candidates, with_channels(shape, 9));
  expect_shape(name, "the output", out, shape);
  Pass pass = pass_of(graph, name, shaders::kMix, {rec, lrhs, albedo, candidates}, out);
  pass.set_push(upsampled(graph, out, lrhs, options.transfer, options.scale, options.phase));
  pass.groups = pixel_groups(out.shape);
  graph.add(std::move(pass));
}

}  // namespace raymeld
