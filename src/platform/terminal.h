#pragma once

namespace raymeld {

// Returns whether stderr is a terminal, on which a line can be written over.
bool is_stderr_terminal();

}  // namespace raymeld
