#pragma once

#include "params.h"

namespace postpass {

// Returns the camera on its way through the room; `aspect` is the image's width over its height.
Camera camera_at(double time_s, double aspect);

}  // namespace postpass
