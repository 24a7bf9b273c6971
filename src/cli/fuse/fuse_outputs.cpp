#include <OpenEXR/ImfStringAttribute.h>

#include <set>

#include "cli/fuse/fuse.h"
#include "io/label.h"
#include "io/png.h"
#include "platform/interrupt.h"

namespace raymeld::cli {
namespace {

namespace fs = std::filesystem;

Imf::PixelType output_type(const std::string& wanted, Imf::PixelType of_hrls) {
  if (wanted == "auto") return of_hrls == Imf::HALF ? Imf::HALF : Imf::FLOAT;
  return wanted == "half" ? Imf::HALF : Imf::FLOAT;
}

// Names the precision of the image, with the number of tiles that were computed in fp32 instead.
std::string precision_text(const FuseResult& result) {
  const std::string name = precision_name(result.storage);
  const uint32_t redone = result.report.redone_tiles;
  if (redone == 0 || result.storage == Storage::kFloat32) return name;
  return fmt::format("{}, {} of {} tiles in fp32", name, redone, result.tiling.count());
}

Imf::Header output_header(const FuseFiles& files, const FuseResult& result) {
  Imf::Header header = files.hrls.header(files.hrls_color().part);
  const auto set = [&](const char* name, const std::string& value) {
    header.insert(name, Imf::StringAttribute(value));
  };
  header.dataWindow() = files.window;
  header.displayWindow() = files.hrls_windows.display;
  header.erase("raymeldSampling");  // true of an input, not of the result
  set("raymeldVersion", RAYMELD_VERSION);
  set("raymeldPrecision", precision_text(result));
  const auto& metadata = files.model->metadata();
  const auto version = metadata.find("version");
  set("raymeldModel",
      version == metadata.end() ? files.model->name() : files.model->name() + " version " + version->second);
  return header;
}

// Returns HRLS's own channel names for --keep-layers, else R, G, B. A grey color does not have three names.
ChannelTriple color_names(const FuseFiles& files, bool keep_layers) {
  const ChannelTriple& own = files.hrls_map.layers.at("color").terms[0];
  return keep_layers && own[0] != own[1] ? own : ChannelTriple{"R", "G", "B"};
}

void stage_image(FuseFrame& frame) {
  const FuseArguments& arguments = frame.arguments;
  const FuseFiles& files = frame.files;
  ExrOutput output;
  output.source = output_header(files, frame.result);
  output.pass_through = std::move(frame.images.passed);
  if (!arguments.keep_layers && !output.pass_through.empty()) output.pass_through[0].name.assign(1, 'A');
  const ChannelTriple names = color_names(files, arguments.keep_layers);
  const Imf::PixelType type = output_type(arguments.output_type, files.hrls_color().type);
  for (int c = 0; c < 3; ++c) output.planes.push_back({names[size_t(c)], type, frame.result.fused.plane(c)});
  for (const auto& [name, image] : frame.result.companions) {
    if (name == kAlpha) {
      const ExrChannel& alpha = files.hrls.channel(*files.hrls_map.alpha);
      output.planes.push_back({arguments.keep_layers ? alpha.name : "A",
                               output_type(arguments.output_type, alpha.type), image.plane(0)});
    } else {
      for (int c = 0; c < 3; ++c) output.planes.push_back({light_channel(name, c), type, image.plane(c)});
    }
  }
  check_interrupted();
  size_t clamped = 0;
  frame.staged.add(arguments.output, [&](AtomicFile& file) { clamped = write_exr(file, output); });
  if (clamped > 0)
    frame.console.warn(fmt::format("'{}': {} values passed the largest half, 65504, and were clamped",
                                   arguments.output, clamped),
                       clamped);
}

void stage_previews(FuseFrame& frame) {
  const FuseArguments& arguments = frame.arguments;
  const Image& fused = frame.result.fused;
  const auto picture = [&](const Image& image) { return to_srgb(image, arguments.exposure_stops); };
  const auto stage = [&](const std::string& target, const Picture& content) {
    frame.staged.add(target, [&](AtomicFile& file) { write_png(file, content); });
  };
  if (!arguments.preview.empty()) stage(arguments.preview, picture(fused));
  if (arguments.before_after.empty()) return;
  std::vector<Picture> pictures;
  const auto add = [&](const Image& image, const char* label) {
    pictures.push_back(picture(image));
    add_label(pictures.back(), label);
  };
  if (frame.files.reads_lrhs()) add(frame.images.shown.bicubic, "BICUBIC LRHS");
  if (frame.files.reads_hrls()) add(frame.images.shown.hrls, "HRLS");
  add(fused, words_of(arguments.task()).done);
  if (frame.images.reference) add(*frame.images.reference, "REFERENCE");
  stage(arguments.before_after, side_by_side(pictures));
}

}  // namespace

std::string light_channel(const std::string& part, int c) { return part + '.' + "RGB"[c]; }

std::vector<std::string> passed_channels(const FuseFiles& files, const FuseArguments& arguments) {
  if (!files.reads_hrls()) return {};
  const auto& alpha = files.hrls_map.alpha;
  if (!arguments.keep_layers) return alpha ? std::vector{*alpha} : std::vector<std::string>{};
  const ChannelTriple& color = files.hrls_map.layers.at("color").terms[0];
  std::set<std::string> fused(color.begin(), color.end());
  for (int c = 0; c < 3 && arguments.layers; ++c)
    for (const std::string& part : kLightParts) fused.insert(light_channel(part, c));
  std::vector<std::string> names = files.hrls.channel_names();
  std::erase_if(names, [&](const std::string& name) { return fused.contains(name); });
  return names;
}

QualityTable stage_outputs(FuseFrame& frame) {
  const PhaseTimer timer(frame, "write");
  stage_previews(frame);
  // The image comes last: it gets its name only when all other files have theirs.
  stage_image(frame);
  if (!frame.images.reference) return {};
  const Image& reference = *frame.images.reference;
  const ShownInputs& shown = frame.images.shown;
  QualityTable quality{{"fused", measure(frame.result.fused, reference)}};
  if (frame.files.reads_lrhs()) quality.push_back({"bicubic_lrhs", measure(shown.bicubic, reference)});
  if (frame.files.reads_hrls()) quality.push_back({"hrls", measure(shown.hrls, reference)});
  return quality;
}

}  // namespace raymeld::cli
