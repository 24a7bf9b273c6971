#include <CLI/CLI.hpp>
#include <cstdio>

#include "demo.h"
#include "measure.h"

namespace {

using namespace postpass;

void print(const char* what, const FrameAllocations& counted) {
  using Number = unsigned long long;
  std::printf("%s %llu frames: %llu of the host, %llu for Vulkan objects\n", what, Number(counted.frames),
              Number(counted.made.host), Number(counted.made.vulkan));
}

int run_demo(const DemoOptions& options, bool check_allocations) {
  Demo demo(options);
  demo.run();
  demo.times().print(stdout);
  print("allocations in the first", demo.first_allocations());
  print("allocations in", demo.allocations());
  if (options.validate) std::printf("validation messages: %u\n", demo.validation_messages());
  const bool allocates = check_allocations && demo.allocations().made != Allocations{};
  return allocates || demo.validation_messages() > 0 ? 1 : 0;
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("A path tracer whose frames raymeld finishes.");
  DemoOptions options;
  std::string size = "256x256", script;
  bool check_allocations = false;
  options.models = POSTPASS_MODELS;
  app.add_option("--models", options.models, "folder of models")->capture_default_str();
  app.add_option("--model", options.model, "model of that folder, without .safetensors")
      ->capture_default_str();
  app.add_option("--size", size, "size of the image")->capture_default_str();
  app.add_flag("--headless", options.headless, "no window");
  app.add_option("--zoom", options.zoom, "window pixels for one pixel of the image, in each direction")
      ->check(CLI::Range(1, 16))
      ->capture_default_str();
  app.add_option("--frames", options.frames,
                 "number of frames; 0: until the window is closed, or 60 with --headless")
      ->capture_default_str();
  app.add_option("--in-flight", options.in_flight, "frames in flight")
      ->check(CLI::Range(2, 3))
      ->capture_default_str();
  app.add_option("--device", options.device, "index of the device")->capture_default_str();
  app.add_flag("--history", options.renderer.history, "join each frame with the ones before it");
  app.add_flag("--still", options.still, "the camera does not move");
  app.add_flag("--moving", options.moving, "the red ball and the lamp move");
  app.add_flag("--validate", options.validate, "use the validation layer; any message of it is a failure");
  app.add_flag("!--no-overlay", options.overlay, "no text over the image");
  app.add_option("--script", script, "events such as 60:key=h,120:resize=320x256,180:minimise,200:restore");
  app.add_option("--png", options.png, "file for the last frame");
  app.add_option("--y4m", options.y4m, "file for all frames, which must have one size, as YUV4MPEG2");
  app.add_option("--lrhs-samples", options.renderer.lrhs_samples,
                 "samples a pixel of LRHS; 0: the square of the scale")
      ->check(CLI::Range(0, 4096));
  app.add_option("--hrls-samples", options.renderer.hrls_samples, "samples a pixel of HRLS")
      ->check(CLI::Range(1, 1024));
  app.add_flag("--check-allocations", check_allocations, "any allocation within a frame is a failure");
  MeasureOptions measure_options;
  bool measures = false;
  app.add_flag(
      "--measure", measures,
      "print flicker and PSNR of a still and a moving camera and of a moving scene, with and without "
      "history");
  app.add_option("--measure-frames", measure_options.frames)->capture_default_str();
  app.add_option("--measure-samples", measure_options.converged_samples,
                 "samples a pixel of a converged image")
      ->capture_default_str();
  app.add_option("--reference-samples", measure_options.reference_samples,
                 "samples a pixel of the reference for a moving frame")
      ->capture_default_str();
  app.add_option("--images", measure_options.images,
                 "folder for pictures of the last frame that is measured");
  CLI11_PARSE(app, argc, argv);
  try {
    options.size = parse_size(size);
    options.script = parse_script(script);
    if (options.headless && options.frames == 0) options.frames = 60;
    if (measures) return measure(options, measure_options) > 0 ? 1 : 0;
    return run_demo(options, check_allocations);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "postpass: %s\n", error.what());
    return 1;
  }
}
