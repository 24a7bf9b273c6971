#pragma once

#include <set>
#include <string>

namespace raymeld::test {

// The names of files in a log of sync_log/. Fails the test unless the disk had each file before it got its
// name, and its folder afterwards: then a power cut leaves whole files.
std::set<std::string> names_on_disk(const std::string& log);

}  // namespace raymeld::test
