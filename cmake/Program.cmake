# Builds the program raymeld.
file(GLOB_RECURSE cli_sources CONFIGURE_DEPENDS src/cli/*.cpp)
file(READ src/cli/trade/trade.html trade_page)
set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS src/cli/trade/trade.html)
file(CONFIGURE OUTPUT trade_page.cpp @ONLY CONTENT [=[#include "cli/trade/trade_page.h"
const char* const raymeld::cli::kTradePage = R"page(@trade_page@)page";
]=])
add_executable(raymeld ${cli_sources} ${CMAKE_CURRENT_BINARY_DIR}/trade_page.cpp)
target_precompile_headers(raymeld PRIVATE ${precompiled_headers})
# The work is done in the libraries, and CLI11 takes long to compile.
target_compile_options(raymeld PRIVATE -O1)
target_link_libraries(raymeld PRIVATE raymeld_conform raymeld_images CLI11::CLI11
  nlohmann_json::nlohmann_json)
target_compile_definitions(raymeld PRIVATE RAYMELD_VERSION="${PROJECT_VERSION}"
  RAYMELD_DATA_DIR="${PROJECT_SOURCE_DIR}/data")
# The program prints its own manual and completion, from the texts of --help.
if(NOT CMAKE_CROSSCOMPILING)
  add_custom_command(TARGET raymeld POST_BUILD VERBATIM
    COMMAND raymeld man > ${CMAKE_CURRENT_BINARY_DIR}/raymeld.1
    COMMAND raymeld completion > ${CMAKE_CURRENT_BINARY_DIR}/raymeld.bash)
endif()
