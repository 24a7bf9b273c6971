#include "subject.h"

namespace raymeld::test {

using reference::Architecture;
using reference::LayerKind;
using reference::Planes;

Architecture small_architecture(int scale) {
  return {.scale = scale,
          .features = 5,
          .growth = 3,
          .dense_layers = 1,
          .blocks = 1,
          .groups = 1,
          .hrls_layers = {LayerKind::kRadiance, LayerKind::kAlbedo, LayerKind::kNormal},
          .has_base = true,
          .clip = 100};
}

Architecture guided_architecture(int scale) {
  Architecture a = small_architecture(scale);
  a.hrls_unshuffled = a.hrls_guide = a.both_samplings = true;
  a.upscale = reference::Upscale::kDirect;
  a.upscaled_features = 3;
  a.head_features = 4;
  a.head_layers = 2;
  return a;
}

Architecture unshuffled_architecture(int scale) {
  Architecture a = guided_architecture(scale);
  a.transfer = reference::Transfer::kLog;
  a.hrls_kernel = 1;
  return a;
}

Architecture pyramid_architecture(int scale) {
  return {.scale = scale,
          .hrls_layers = {LayerKind::kRadiance, LayerKind::kAlbedo, LayerKind::kNormal},
          .transfer = reference::Transfer::kLog,
          .clip = 100,
          .both_samplings = true,
          .upscaled_features = 3,
          .lrhs_certainty = double(scale * scale),
          .widths = {4, 3, 3, 2}};
}

Architecture kpcn_architecture() {
  Architecture a = pyramid_architecture(1);
  a.widths.clear();
  a.hrls_layers.push_back(LayerKind::kRadiance);
  a.features = 3;
  a.depth = 3;
  a.kernel_side = 7;
  return a;
}

Architecture rcan_architecture(int scale) {
  Architecture a = edsr_architecture(scale);
  a.upscaler = reference::Upscaler::kRcan;
  a.groups = 2;
  a.squeezed_features = 2;
  return a;
}

Architecture edsr_architecture(int scale) {
  return {.upscaler = reference::Upscaler::kEdsr,
          .scale = scale,
          .features = 3,
          .blocks = 2,
          .transfer = reference::Transfer::kLog,
          .clip = 100};
}

Model saved_model(const std::filesystem::path& folder, const Subject& subject,
                  const std::map<std::string, std::string>& metadata) {
  const std::filesystem::path file = folder / "model.safetensors";
  write_model(file, subject.architecture, subject.weights, metadata);
  return Model(file);
}

bool has_guards(const Graph& graph) {
  for (const TensorRecord& tensor : graph.tensors()) {
    if (tensor.first_use < 0) continue;
    if (tensor.offset_bytes < Graph::kGuardBytes ||
        tensor.offset_bytes + tensor.size_bytes + Graph::kGuardBytes > graph.activation_bytes())
      return false;
  }
  return true;
}

Image image_of(const Planes& planes) {
  if (planes.c == 0) return {};
  Image image(planes.w, planes.h, planes.c);
  image.data = floats(planes);
  return image;
}

Planes planes_of(const Image& image) { return planes(image.channels, image.height, image.width, image.data); }

}  // namespace raymeld::test
