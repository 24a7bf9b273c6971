#pragma once

#include "conform/network.h"
#include "gpu.h"
#include "io/image.h"

namespace raymeld::test {

using conform::make_subject;
using conform::Subject;

// Returns an architecture for x2, x4 or x8 with a bilinear base, so that the phase matters. Its halo is at
// most 5 LRHS pixels.
reference::Architecture small_architecture(int scale);
// Returns small_architecture() with HRLS unshuffled, upscaling at once, a guide, a head and a bias for
// centered samples.
reference::Architecture guided_architecture(int scale);
// Returns guided_architecture() with the log transfer and a 1x1 convolution of the unshuffled HRLS.
reference::Architecture unshuffled_architecture(int scale);
// Returns a pyramid network, whose frames are padded to multiples of 16 / scale LRHS pixels.
reference::Architecture pyramid_architecture(int scale);
// Returns EDSR, which reads LRHS alone.
reference::Architecture edsr_architecture(int scale);
// Returns KPCN, which reads HRLS alone.
reference::Architecture kpcn_architecture();
// Returns RCAN, which reads LRHS alone and takes means over whole frames.
reference::Architecture rcan_architecture(int scale);

// Writes a subject's network to a file in `folder` and loads it. `metadata` is that of the file.
Model saved_model(const std::filesystem::path& folder, const Subject& subject,
                  const std::map<std::string, std::string>& metadata = {});

// Returns whether Graph::kGuardBytes lie before and after all tensors.
bool has_guards(const Graph& graph);

// Returns the planes as an image, which is empty without planes.
Image image_of(const reference::Planes& planes);
reference::Planes planes_of(const Image& image);

}  // namespace raymeld::test
