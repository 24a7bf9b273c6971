// Says how far a network reaches, which is how far tiles must overlap.
#pragma once

#include "model/model.h"

namespace raymeld {

// Returns on how many LRHS pixels in each direction the s x s output pixels of an LRHS pixel can depend.
uint32_t receptive_halo(const Architecture& architecture, bool compute_variance = false);

}  // namespace raymeld
