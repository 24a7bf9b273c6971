#pragma once

#include "conform/network.h"
#include "gpu.h"
#include "io/image.h"

namespace raymeld::test {

using conform::make_subject;
using conform::Subject;

// x2, x4 or x8, with a bilinear base, so that the phase matters. Its halo is at most 5 LRHS pixels.
reference::Architecture small_architecture(int scale);
// The same with HRLS unshuffled, upscaling at once, a guide, a head and a bias for centered samples.
reference::Architecture guided_architecture(int scale);
// That with a joint base and the log transfer.
reference::Architecture joint_architecture(int scale);
// That with a 1x1 of the unshuffled HRLS.
reference::Architecture cells_architecture(int scale);

// Whether Graph::kGuardBytes are in front of and behind all tensors.
bool has_guards(const Graph& graph);

Image image_of(const reference::Planes& planes);
reference::Planes planes_of(const Image& image);

}  // namespace raymeld::test
