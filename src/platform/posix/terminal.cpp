#include "platform/terminal.h"

#include <unistd.h>

namespace raymeld {

bool is_stderr_terminal() { return isatty(STDERR_FILENO) != 0; }

}  // namespace raymeld
