#include <OpenEXR/ImfStringAttribute.h>

#include <array>
#include <cstring>

#include "cli/common/commands.h"
#include "cli/common/help.h"
#include "cli/common/outputs.h"
#include "error.h"
#include "io/exr.h"
#include "io/exr_window.h"
#include "platform/interrupt.h"

namespace raymeld::cli {
namespace {

namespace fs = std::filesystem;

struct DegradeArguments {
  std::string input, output;
  int scale = 0;
};

// Returns the top-left pixel of each scale x scale block (Hou et al. 2021, section 3.3), bit by bit.
ExrRawChannel degraded(const ExrRawChannel& channel, int scale, const Imath::Box2i& window) {
  ExrRawChannel low{channel.name, channel.type, 1, 1, window, {}};
  const size_t bytes = size_bytes_of(channel.type);
  const size_t width = size_t(width_of(window)), row_bytes = bytes * size_t(width_of(channel.data_window));
  low.bytes.resize(bytes * width * size_t(height_of(window)));
  char* to = low.bytes.data();
  for (size_t y = 0; y < size_t(height_of(window)); ++y) {
    const char* row = channel.bytes.data() + y * size_t(scale) * row_bytes;
    for (size_t x = 0; x < width; ++x, to += bytes) std::memcpy(to, row + x * size_t(scale) * bytes, bytes);
  }
  return low;
}

void check_channel(const ExrRawChannel& channel, int scale, const Imath::Box2i& window,
                   const fs::path& path) {
  if (channel.x_sampling != 1 || channel.y_sampling != 1 || channel.data_window != window) {
    throw Error("cannot degrade '{}': channel '{}' has another size than the first one", path.string(),
                channel.name);
  }
  if (width_of(window) % scale != 0 || height_of(window) % scale != 0) {
    throw Error("cannot degrade '{}': its size, {} x {}, is not a multiple of {}", path.string(),
                width_of(window), height_of(window), scale);
  }
}

void degrade(const DegradeArguments& arguments) {
  const std::array<fs::path, 1> inputs = {arguments.input}, outputs = {arguments.output};
  check_outputs(outputs, inputs);
  ExrFile file(arguments.input);
  ExrOutput output;
  output.source = degraded_header(file.header(), arguments.scale);
  output.source.insert("raymeldSampling", Imf::StringAttribute("nearest"));
  for (const ExrChannel& channel : file.channels()) {
    const ExrRawChannel full = file.read_raw(channel.name);
    check_channel(full, arguments.scale, file.header().dataWindow(), file.path());
    output.pass_through.push_back(degraded(full, arguments.scale, output.source.dataWindow()));
    check_interrupted();
  }
  write_exr(arguments.output, output);
}

}  // namespace

void add_degrade(CLI::App& app) {
  auto arguments = std::make_shared<DegradeArguments>();
  CLI::App* command = app.add_subcommand(
      "degrade", "Makes an LRHS image from a full-size one: every scale-th pixel of all channels");
  command->add_option("IMAGE", arguments->input, "Reads the full-size image from this OpenEXR file")
      ->required();
  command
      ->add_option("--scale", arguments->scale, "Keeps one pixel of this many in each direction: 2, 4 or 8")
      ->required()
      ->check(CLI::IsMember({2, 4, 8}));
  command->add_option("-o,--output", arguments->output, "Writes the small image to this OpenEXR file")
      ->required()
      ->check(ends_in(".exr"));
  command->footer(
      "The top-left pixel of each block is kept, as in the paper. The attribute raymeldSampling says so to "
      "fuse.\n\nExample:\n  raymeld degrade full.exr --scale 4 -o low.exr");
  command->callback([arguments] { degrade(*arguments); });
}

}  // namespace raymeld::cli
