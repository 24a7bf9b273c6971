#include <OpenEXR/ImfStringAttribute.h>

#include <algorithm>

#include "cli/fuse.h"
#include "cli/interrupt.h"
#include "io/png.h"

namespace raymeld::cli {
namespace {

namespace fs = std::filesystem;

Image first_three(const Image& image) {
  Image color(image.width, image.height, 3);
  std::copy_n(image.data.begin(), color.data.size(), color.data.begin());
  return color;
}

Imf::PixelType output_type(const std::string& wanted, Imf::PixelType of_hrls) {
  if (wanted == "auto") return of_hrls == Imf::HALF ? Imf::HALF : Imf::FLOAT;
  return wanted == "half" ? Imf::HALF : Imf::FLOAT;
}

Imf::Header output_header(const FuseFiles& files, Storage storage) {
  Imf::Header header = files.hrls.header(files.hrls_color().part);
  const auto set = [&](const char* name, const std::string& value) {
    header.insert(name, Imf::StringAttribute(value));
  };
  header.erase("raymeldSampling");  // true of HRLS, not of what became of it
  set("raymeldVersion", RAYMELD_VERSION);
  set("raymeldPrecision", precision_name(storage));
  const auto& metadata = files.model.metadata();
  const auto version = metadata.find("version");
  set("raymeldModel",
      version == metadata.end() ? files.model.name() : files.model.name() + " version " + version->second);
  return header;
}

// A grey colour has no three names of its own.
ChannelTriple color_names(const FuseFiles& files, bool keep_layers) {
  const ChannelTriple& own = files.hrls_map.layers.at("color").terms[0];
  return keep_layers && own[0] != own[1] ? own : ChannelTriple{"R", "G", "B"};
}

void write_image(const FuseArguments& arguments, const FuseFiles& files, FuseImages& images,
                 const FuseResult& result, Console& console, StagedFiles& staged) {
  ExrOutput output;
  output.source = output_header(files, result.storage);
  output.pass_through = std::move(images.passed);
  if (!arguments.keep_layers && !output.pass_through.empty()) output.pass_through[0].name.assign(1, 'A');
  const ChannelTriple names = color_names(files, arguments.keep_layers);
  const Imf::PixelType type = output_type(arguments.output_type, files.hrls_color().type);
  for (int c = 0; c < 3; ++c) output.planes.push_back({names[size_t(c)], type, result.fused.plane(c)});
  check_interrupted();
  size_t clamped = 0;
  staged.add(arguments.output, [&](AtomicFile& file) { clamped = write_exr(file, output); });
  if (clamped > 0)
    console.warn(fmt::format("'{}': {} values passed the largest half, 65504, and were clamped",
                             arguments.output, clamped),
                 clamped);
}

}  // namespace

std::vector<std::string> passed_channels(const FuseFiles& files, bool keep_layers) {
  std::vector<std::string> names;
  const auto& alpha = files.hrls_map.alpha;
  const ChannelTriple& color = files.hrls_map.layers.at("color").terms[0];
  for (const std::string& name : files.hrls.channel_names()) {
    if (keep_layers ? std::ranges::find(color, name) == color.end() : name == alpha) names.push_back(name);
  }
  return names;
}

Comparison make_comparison(const FuseFiles& files, const FuseImages& images) {
  const auto as_written = [&](Image image) {
    return seen_through(std::move(image), files.canvas.hrls, files.hrls_windows.data);
  };
  return {as_written(upsample_bicubic(images.lrhs, files.canvas.scale, files.phase)),
          as_written(first_three(images.hrls))};
}

// The image itself comes last: it is renamed only when everything else is there.
void write_outputs(const FuseArguments& arguments, const FuseFiles& files, FuseImages& images,
                   const std::optional<Comparison>& comparison, const FuseResult& result, Console& console,
                   StagedFiles& staged) {
  const auto picture = [&](const Image& image) { return to_srgb(image, arguments.exposure_stops); };
  const auto write = [&](const std::string& target, const Picture& content) {
    staged.add(target, [&](AtomicFile& file) { write_png(file, content); });
  };
  if (!arguments.preview.empty()) write(arguments.preview, picture(result.fused));
  if (!arguments.before_after.empty()) {
    std::vector<Picture> pictures = {picture(comparison->bicubic), picture(comparison->hrls),
                                     picture(result.fused)};
    if (images.reference) pictures.push_back(picture(*images.reference));
    write(arguments.before_after, side_by_side(pictures));
  }
  write_image(arguments, files, images, result, console, staged);
}

}  // namespace raymeld::cli
