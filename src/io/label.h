// Writes words on pictures.
#pragma once

#include <string_view>

#include "io/png.h"

namespace raymeld {

// Writes white capitals, whatever the text has, on a black box into the top left corner, larger on larger
// pictures. Text that does not fit is cut off, and letters that the font lacks are spaces.
void add_label(Picture& picture, std::string_view text);

}  // namespace raymeld
