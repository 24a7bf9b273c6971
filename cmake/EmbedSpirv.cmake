# Writes SPIRV as the C++ array SYMBOL (little-endian words) to OUTPUT.
file(READ ${SPIRV} hex HEX)
string(REGEX REPLACE "(..)(..)(..)(..)" "0x\\4\\3\\2\\1," words "${hex}")
string(LENGTH "${hex}" digits)
math(EXPR count "${digits} / 8")
file(WRITE ${OUTPUT} "#include <cstdint>\n#include <span>\n"
  "static const uint32_t words[${count}] = {${words}};\n"
  "extern const std::span<const uint32_t> ${SYMBOL};\n"
  "const std::span<const uint32_t> ${SYMBOL}(words);\n")
