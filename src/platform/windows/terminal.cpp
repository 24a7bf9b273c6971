#include "platform/terminal.h"

#include <io.h>

#include <cstdio>

namespace raymeld {

bool is_stderr_terminal() { return _isatty(_fileno(stderr)) != 0; }

}  // namespace raymeld
