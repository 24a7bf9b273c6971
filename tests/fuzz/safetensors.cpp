// Reads a model, first as a safetensors file alone and then as a network.
#include "io/safetensors.h"

#include "fuzz/memory_file.h"
#include "fuzz/read_or_refuse.h"
#include "networks/model.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace raymeld;
  const test::MemoryFile content({data, size});
  test::read_or_refuse([&] { read_safetensors(content.path()); });
  test::read_or_refuse([&] { Model model(content.path()); });
  return 0;
}
