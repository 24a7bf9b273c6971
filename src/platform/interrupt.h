#pragma once

namespace raymeld {

// Makes the first SIGINT or SIGTERM only set a flag; the second ends the program as usual. A write beyond a
// file size limit, or to a pipe that nobody reads, then fails like any other instead of ending the program.
void catch_signals();

bool interrupted();

// Throws Cancelled after a signal.
void check_interrupted();

}  // namespace raymeld
