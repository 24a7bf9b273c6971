// Lists the values of --precision.
#pragma once

#include <map>
#include <string>

#include "fusion/plan.h"

namespace raymeld::cli {

inline const std::map<std::string, Precision> kPrecisions = {
    {"auto", Precision::kAuto}, {"fp32", Precision::kFp32}, {"fp16", Precision::kFp16}};

}  // namespace raymeld::cli
