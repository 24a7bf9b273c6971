#pragma once

#include <set>
#include <string>

namespace raymeld::test {

// Returns the names of files in a log of sync_log/. Fails the test unless each file was synced to disk before
// it got its name, and its folder afterwards. A power cut then leaves whole files.
std::set<std::string> names_on_disk(const std::string& log);

}  // namespace raymeld::test
