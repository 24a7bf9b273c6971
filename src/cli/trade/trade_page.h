#pragma once

namespace raymeld::cli {

// Holds the text of src/cli/trade/trade.html.
extern const char* const kTradePage;

}  // namespace raymeld::cli
