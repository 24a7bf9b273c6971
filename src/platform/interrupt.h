#pragma once

namespace raymeld {

// From now on the first SIGINT or SIGTERM only sets a flag, and the second ends the program as usual. A write
// beyond a file size limit, or to a pipe that nobody reads, fails like any other instead of ending the
// program.
void catch_signals();

bool interrupted();

// Throws Cancelled after a signal.
void check_interrupted();

}  // namespace raymeld
