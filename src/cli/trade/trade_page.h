#pragma once

namespace raymeld::cli {

// src/cli/trade/trade.html.
extern const char* const kTradePage;

}  // namespace raymeld::cli
