// Opens an OpenEXR file, maps and loads its layers, and reads its channels both as floats and as stored.
#include "io/exr.h"

#include "fuzz/memory_file.h"
#include "fuzz/read_or_refuse.h"
#include "io/layers_from_exr.h"

namespace {

using namespace raymeld;

void load_all_layers(ExrFile& file) {
  const LayerMap map = map_layers(file, {});
  std::vector<std::string> layers;
  for (const auto& [layer, source] : map.layers) layers.push_back(layer);
  load_layers(file, map, layers);
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using test::read_or_refuse;
  const test::MemoryFile content({data, size});
  read_or_refuse([&] {
    ExrFile file(content.path());
    read_or_refuse([&] { load_all_layers(file); });
    read_or_refuse([&] { file.read(file.channel_names()); });
    const size_t few = std::min<size_t>(file.channels().size(), 6);
    for (size_t i = 0; i < few; ++i) {
      const std::string& name = file.channels()[i].name;
      read_or_refuse([&] { file.read(std::array{name}); });
      read_or_refuse([&] { file.read_raw(name); });
    }
  });
  return 0;
}
