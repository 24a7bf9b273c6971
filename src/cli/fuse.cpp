#include "cli/fuse.h"

#include "cli/interrupt.h"

namespace raymeld::cli {

void run_fuse(const FuseArguments& arguments) {
  const Stopwatch watch;
  Console console(arguments.notes());
  LastModel models;
  if (arguments.dry_run) {
    FuseFiles files = open_files(arguments, models);
    const auto device = Device::create({.selector = arguments.device});
    return print(arguments.json ? json_text(plan_json(arguments, files, *device, console))
                                : plan_text(arguments, files, *device, console));
  }
  const auto frame = open_frame(arguments, console, models);
  console.note(describe(arguments, frame->files));
  load_frame(*frame);
  check_interrupted();

  const auto device = Device::create({.selector = arguments.device});
  {
    ProgressBar bar(console);
    FrameFuser(*device).fuse(*frame, [&](double share) {
      bar.update(share);
      return !interrupted();
    });
  }
  const QualityTable quality = stage_outputs(*frame);
  print(arguments.json ? json_text(frame_json(*frame, device->info(), quality, watch.ms()))
                       : frame_text(*frame, quality));
  publish_frame(*frame, watch.ms());
}

}  // namespace raymeld::cli
