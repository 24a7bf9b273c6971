#include "cli/fuse/fuse.h"

#include "cli/fuse/choice.h"
#include "cli/fuse/fuse_report.h"
#include "platform/interrupt.h"

namespace raymeld::cli {

void run_fuse(const FuseArguments& given) {
  const Stopwatch watch;
  FuseArguments arguments = given;
  Console console(arguments.notes());
  LastModel models;
  std::unique_ptr<Device> device;
  const auto create_device = [&] {
    if (!device) device = Device::create({.selector = arguments.device});
  };
  if (arguments.request) {
    create_device();
    arguments.take(choose_model(arguments, false, *device, models, console));
  }
  if (arguments.dry_run) {
    FuseFiles files = open_files(arguments, models);
    create_device();
    return print(arguments.json ? json_text(plan_json(arguments, files, *device, console))
                                : plan_text(arguments, files, *device, console));
  }
  const auto frame = open_frame(arguments, console, models);
  if (arguments.verbose) console.note(channels_text(arguments, frame->files));
  {
    const PhaseTimer timer(*frame, "device");
    create_device();
  }
  FrameFuser fuser(*device);
  fuser.prepare(*frame);
  load_frame(*frame);
  check_interrupted();

  for (const std::string& line : opening_lines(arguments, *frame, device->info())) console.note(line);
  {
    ProgressBar bar(console);
    fuser.fuse(*frame, [&](double share) {
      bar.update(share);
      return !interrupted();
    });
    frame->drop_inputs();
  }
  const QualityTable quality = stage_outputs(*frame);
  print(arguments.json ? json_text(frame_json(*frame, device->info(), quality, watch.ms()))
                       : frame_text(*frame, quality));
  frame->staged.commit();
  console.note("took " + took_text(*frame, watch.ms()));
  console.note("wrote " + written_text(arguments));
}

}  // namespace raymeld::cli
