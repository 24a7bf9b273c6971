# Writes the files in SPIRV to OUTPUT as C++: NAME.spv becomes the array k_NAME of its little-endian words.
set(text "#include <cstdint>\n#include <span>\n")
foreach(file ${SPIRV})
  cmake_path(GET file STEM name)
  file(READ ${file} hex HEX)
  string(REGEX REPLACE "(..)(..)(..)(..)" "0x\\4\\3\\2\\1," words "${hex}")
  string(APPEND text "static const uint32_t words_of_${name}[] = {${words}};\n"
    "extern const std::span<const uint32_t> k_${name};\n"
    "const std::span<const uint32_t> k_${name}(words_of_${name});\n")
endforeach()
file(WRITE ${OUTPUT} "${text}")
