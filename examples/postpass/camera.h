#pragma once

#include "params.h"

namespace postpass {

// The camera's place on its way through the room, for an image of this width over height.
Camera camera_at(double time_s, double aspect);

}  // namespace postpass
