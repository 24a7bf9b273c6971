// Loads a pipeline cache from disk three times: as it is, with a correct checksum, and with the device's own
// header too, so that the driver reads it. Each time there must then be a cache that can be saved.
#include "engine/pipeline_cache.h"

#include <cstdlib>

#include "sealed_cache.h"
#include "support.h"

namespace {

using namespace raymeld;

void load_and_save(const Device& device, const std::filesystem::path& folder, std::string_view content) {
  const std::filesystem::path file = PipelineCache(device, folder).file();
  test::write_file(file, content);
  PipelineCache cache(device, folder);
  if (!cache.handle() || !cache.save()) std::abort();
  if (!PipelineCache(device, folder).loaded()) std::abort();
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  static const std::unique_ptr<Device> device = Device::create();
  static const test::TemporaryDirectory folder;
  const std::string content(data, data + size);
  load_and_save(*device, folder.path(), content);
  load_and_save(*device, folder.path(), test::sealed_cache(content));
  load_and_save(*device, folder.path(),
                test::sealed_cache(test::cache_header(device->properties()) + content));
  return 0;
}
