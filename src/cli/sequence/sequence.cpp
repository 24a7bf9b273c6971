#include "cli/sequence/sequence.h"

#include <algorithm>
#include <functional>
#include <set>
#include <thread>

#include "cli/common/failure.h"
#include "cli/fuse/choice.h"
#include "cli/fuse/fuse_report.h"
#include "cli/sequence/handover.h"
#include "cli/sequence/sequence_report.h"
#include "platform/interrupt.h"

namespace raymeld::cli {
namespace {

using Json = nlohmann::ordered_json;

// Returns when the file of the model was written that the user named.
FileTime model_time(const FuseArguments& patterns) {
  if (patterns.model.empty()) return FileTime::min();
  return std::filesystem::last_write_time(find_model(patterns.model, patterns.task()));
}

std::vector<Outcome> all_frames(const SequenceArguments& sequence, const FuseArguments& patterns) {
  const FileTime model = model_time(patterns);
  std::vector<Outcome> outcomes;
  for (const int frame : frames_of(sequence.shard, sequence.frames)) {
    const auto is_skipped = [&] {
      const FuseArguments arguments = of_frame(patterns, frame);
      const auto input = newest_input(arguments);
      return input && is_done(arguments, std::max(*input, model));
    };
    const bool skip = sequence.resume && is_skipped();
    outcomes.push_back({.frame = frame, .status = skip ? Status::kSkipped : Status::kUnfinished});
  }
  return outcomes;
}

// Makes skipped frames lead in that a later frame of their shot needs.
void mark_lead_ins(std::vector<Outcome>& outcomes) {
  bool is_needed = false;
  for (size_t i = outcomes.size(); i-- > 0;) {
    Outcome& outcome = outcomes[i];
    if (outcome.status == Status::kUnfinished) {
      is_needed = true;
    } else if (is_needed) {
      outcome.status = Status::kLeadIn;
    }
    if (outcome.begins_shot) is_needed = false;
  }
}

// Returns the frames of a shard where each is joined with those of its shot that come before it, lead-in
// frames included. A frame is done only if all these are, and if its outputs are newer than their inputs.
std::vector<Outcome> all_joined_frames(const SequenceArguments& sequence, const FuseArguments& patterns) {
  const std::vector<int>& frames = sequence.frames;
  const std::set<int> resets(sequence.reset_at.begin(), sequence.reset_at.end());
  const FrameRange own = range_of(sequence.shard, frames.size());
  const FileTime model = model_time(patterns);
  std::vector<Outcome> outcomes;
  FileTime since = model;
  bool is_done_so_far = sequence.resume;
  for (size_t i = 0; i < own.end; ++i) {
    Outcome outcome{.frame = frames[i], .status = Status::kSkipped};
    outcome.begins_shot = i == 0 || frames[i - 1] + 1 != frames[i] || resets.contains(frames[i]);
    if (outcome.begins_shot) since = model, is_done_so_far = sequence.resume;
    if (sequence.resume) {
      const FuseArguments frame = of_frame(patterns, frames[i]);
      const auto input = newest_input(frame);
      since = std::max(since, input.value_or(since));
      if (i >= own.begin) is_done_so_far = is_done_so_far && input && is_done(frame, since);
    }
    if (i >= own.begin && !is_done_so_far) outcome.status = Status::kUnfinished;
    outcomes.push_back(outcome);
  }
  mark_lead_ins(outcomes);
  const auto first = outcomes.begin(), first_own = first + std::ptrdiff_t(own.begin);
  outcomes.erase(std::remove_if(first, first_own,
                                [](const Outcome& outcome) { return outcome.status == Status::kSkipped; }),
                 first_own);
  return outcomes;
}

// Throws Error unless frames can be joined in the order in which they are named.
void check_joined(const SequenceArguments& sequence) {
  const std::vector<int>& frames = sequence.frames;
  if (const auto at = std::ranges::adjacent_find(frames, std::greater()); at != frames.end())
    throw Error("--temporal joins frames in ascending order, and --frames has {} before {}", at[0], at[1]);
  for (const int frame : sequence.reset_at)
    if (!std::ranges::binary_search(frames, frame))
      throw Error("--reset-at {}: there is no such frame in --frames", frame);
}

// Notes the lines that differ from those in `said`, and then stores all lines there.
void note_new(const Console& console, const std::vector<std::string>& lines, std::vector<std::string>& said) {
  said.resize(lines.size());
  for (size_t i = 0; i < lines.size(); ++i) {
    if (lines[i] != said[i]) console.note(lines[i]);
  }
  said = lines;
}

// Runs each of the three steps of a frame in a thread of its own. Two threads share only the frame that one
// hands over to the next, with its outcome.
class Pipeline {
 public:
  Pipeline(const FuseArguments& patterns, const Device& device, LastModel& models,
           std::vector<Outcome>& outcomes)
      : patterns_(patterns),
        device_(device),
        models_(models),
        outcomes_(outcomes),
        fuser_(device),
        console_(patterns.notes()) {}

  void run() {
    std::jthread reader([this] { read(); });
    std::jthread writer([this] { write(); });
    const ClosedAtEnd end_of_reading(read_), end_of_writing(fused_);
    fuse();
  }

 private:
  struct Job {
    Outcome* outcome;
    std::unique_ptr<FuseFrame> frame = nullptr;
    double spent_ms = 0;  // excludes the time in which it waited for its turn
  };

  void read();
  void find_cut(FuseFrame& frame);
  void fuse();
  void write();
  template <typename Step>
  bool attempt(Job& job, const Step& step);

  const FuseArguments& patterns_;
  const Device& device_;
  LastModel& models_;
  std::vector<Outcome>& outcomes_;
  FrameFuser fuser_;
  bool prepared_ = false;  // only read()'s thread uses it, and fuser_ until the first frame is handed over
  Console console_;
  Handover<Job> read_, fused_;
  std::vector<std::string> channels_;  // lines that read()'s thread noted last
  CutFinder cuts_;                     // only read()'s thread uses it, and last_read_
  int last_read_ = 0;
  std::vector<std::string> opening_;  // lines that fuse()'s thread noted last
  bool device_lost_ = false;          // only fuse()'s thread uses it
};

// Returns whether the step was done. An error fails this frame; an interrupt or a lost device ends the run.
template <typename Step>
bool Pipeline::attempt(Job& job, const Step& step) try {
  const Stopwatch watch;
  step();
  job.spent_ms += watch.ms();
  return true;
} catch (const Cancelled&) {
  return false;
} catch (const std::exception& error) {
  if (dynamic_cast<const DeviceLost*>(&error)) device_lost_ = true;
  job.outcome->status = Status::kFailed;
  job.outcome->error = current_failure().message;
  complain(fmt::format("frame {}: {}", job.outcome->frame, job.outcome->error));
  return false;
}

void Pipeline::read() {
  const ClosedAtEnd end(read_);
  for (Outcome& outcome : outcomes_) {
    if (outcome.status == Status::kSkipped) continue;
    if (interrupted()) return;
    Job job{.outcome = &outcome};
    const bool is_read = attempt(job, [&] {
      job.frame = open_frame(of_frame(patterns_, outcome.frame),
                             Console(patterns_.notes(), fmt::format("frame {}: ", outcome.frame)), models_);
      if (patterns_.verbose)
        note_new(job.frame->console, {channels_text(patterns_, job.frame->files)}, channels_);
      if (!std::exchange(prepared_, true)) fuser_.prepare(*job.frame);
      job.frame->time = {.number = outcome.frame,
                         .starts_anew = outcome.begins_shot,
                         .is_lead_in = outcome.status == Status::kLeadIn,
                         .next_is_fused = &outcome != &outcomes_.back() &&
                                          std::next(&outcome)->status == Status::kUnfinished};
      load_frame(*job.frame);
      if (patterns_.temporal) find_cut(*job.frame);
    });
    if (is_read && !read_.put(std::move(job))) return;
  }
}

// Makes a frame start anew if it begins another shot than the one before it, though it was not said to.
void Pipeline::find_cut(FuseFrame& frame) {
  FrameInTime& time = frame.time;
  if (time.starts_anew || last_read_ + 1 != time.number) cuts_.forget();
  last_read_ = time.number;
  if (!is_cut(frame, cuts_)) return;
  time.starts_anew = true;
  frame.console.note("shows something else than the last frame, and starts anew");
}

void Pipeline::fuse() {
  ProgressBar bar(console_);
  while (!device_lost_ && !interrupted()) {
    std::optional<Job> job = read_.take();
    if (!job) return;
    const auto progress = [&](double share) {
      bar.update((double(job->outcome - outcomes_.data()) + share) / double(outcomes_.size()));
      return !interrupted();
    };
    const auto fuse_frame = [&] {
      note_new(job->frame->console, opening_lines(patterns_, *job->frame, device_.info()), opening_);
      fuser_.fuse(*job->frame, progress);
      job->frame->drop_inputs();
    };
    if (attempt(*job, fuse_frame) && !job->frame->time.is_lead_in) fused_.put(std::move(*job));
  }
}

void Pipeline::write() {
  while (std::optional<Job> job = fused_.take()) {
    attempt(*job, [&] {
      const Stopwatch watch;
      FuseFrame& frame = *job->frame;
      Outcome& outcome = *job->outcome;
      const QualityTable quality = stage_outputs(frame);
      const double total_ms = job->spent_ms + watch.ms();
      const std::string text = patterns_.json ? "" : frame_text(frame, quality);
      if (!text.empty()) print(fmt::format("frame {}\n{}", outcome.frame, text));
      frame.staged.commit();
      frame.console.note(
          fmt::format("wrote {}: {}", written_text(frame.arguments), took_text(frame, total_ms)));
      if (patterns_.json) outcome.facts = frame_json(frame, device_.info(), quality, total_ms);
      if (patterns_.json && patterns_.temporal) outcome.facts["starts_anew"] = frame.time.starts_anew;
      outcome.exposure = frame.result.report.exposure;
      outcome.status = Status::kFused;
    });
  }
}

// Checks the folders of one frame's outputs, as all frames have the same folders.
void check_output_folders(const FuseArguments& frame) {
  std::vector<std::filesystem::path> outputs = frame.outputs();
  if (!frame.dump.empty()) outputs.push_back(frame.dump_folder());
  check_folders(outputs);
}

// Prints which frames would be fused and skipped, and the plan for the first one to fuse.
void show_plan(const FuseArguments& patterns, std::span<const Outcome> outcomes, LastModel& models,
               const Device* device) {
  const std::vector<int> frames = frames_that(Status::kUnfinished, outcomes),
                         skipped = frames_that(Status::kSkipped, outcomes),
                         lead_in = frames_that(Status::kLeadIn, outcomes);
  Json json = {{"frames", frames}, {"skipped", skipped}, {"lead-in", lead_in}};
  std::string text = fmt::format("{} frames to fuse ({}), {} to skip ({})", frames.size(),
                                 frames_text(frames), skipped.size(), frames_text(skipped));
  if (!lead_in.empty()) text += fmt::format(", {} to lead in ({})", lead_in.size(), frames_text(lead_in));
  text += '\n';
  if (device) {
    FuseFiles files = open_files(of_frame(patterns, frames.front()), models);
    Console console(patterns.notes());
    if (patterns.json) {
      json["first"] = plan_json(patterns, files, *device, console);
    } else {
      text += fmt::format("frame {}:\n{}", frames.front(), plan_text(patterns, files, *device, console));
    }
  }
  print(patterns.json ? json_text(json) : text);
}

}  // namespace

void run_sequence(const SequenceArguments& sequence, const FuseArguments& given) {
  const Stopwatch watch;
  FuseArguments patterns = given;
  check_patterns(patterns, sequence.frames);
  // Errors that all frames share are reported once, before the first frame.
  for (const auto& map : {patterns.map, patterns.lrhs_map}) parse_layer_choice(map);
  LastModel models;
  if (patterns.temporal) check_joined(sequence);
  const auto load_model = [&] {
    if (patterns.model.empty()) return;
    const auto model = models.load(find_model(patterns.model, patterns.task()));
    if (patterns.temporal) check_keeps_history(*model);
  };
  load_model();
  std::vector<Outcome> outcomes =
      patterns.temporal ? all_joined_frames(sequence, patterns) : all_frames(sequence, patterns);
  const std::vector<int> unfinished = frames_that(Status::kUnfinished, outcomes);
  const auto device = unfinished.empty() ? nullptr : Device::create({.selector = patterns.device});
  if (patterns.request && device) {
    // The model that suits the first frame is used for all.
    Console console(patterns.notes());
    patterns.take(choose_model(of_frame(patterns, unfinished.front()), true, *device, models, console));
    load_model();
  }
  if (patterns.dry_run) return show_plan(patterns, outcomes, models, device.get());
  check_output_folders(of_frame(patterns, sequence.frames.front()));

  if (device) Pipeline(patterns, *device, models, outcomes).run();
  const std::string summary = summary_text(patterns.task(), outcomes, watch.ms());
  const bool stopped = interrupted() && !frames_that(Status::kUnfinished, outcomes).empty();
  const bool failed = !stopped && !frames_that(Status::kFailed, outcomes).empty();
  if (patterns.json) {
    Json json = summary_json(outcomes, watch.ms());
    if (failed) json["error"] = summary;
    print(json_text(json));
  }
  const Console console(patterns.notes());
  if (patterns.input_exposure == 0) {
    if (const std::string hint = exposure_hint(outcomes); !hint.empty()) console.note(hint);
  }
  if (failed) throw Error("{}", summary);
  console.note(summary);
  if (stopped) throw Cancelled();
}

}  // namespace raymeld::cli
