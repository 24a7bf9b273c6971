#include "measure.h"

#include <cmath>

#include "camera.h"

namespace postpass {
namespace {

using Pixels = std::vector<float>;  // RGBA, sRGB

struct Moment {
  double camera_s = 0, scene_s = 0;
};

// Renders one frame at a time, and waits for each.
class Studio {
 public:
  Studio(const Device& device, const raymeld::SharedModel& model, vk::Extent2D size,
         const RendererOptions& options)
      : renderer_(device, model, size, options),
        frames_(device, renderer_, 1),
        aspect_(double(renderer_.full_size().width) / renderer_.full_size().height) {}

  // Renders a frame; returns it fused.
  Pixels frame(const Moment& moment) { return submit(describe(moment)); }
  // Returns the last frame as another view.
  Pixels again(uint32_t view) {
    Slot& slot = frames_.next();
    renderer_.record_again(slot.begin(), view, slot.queries());
    return submit(slot);
  }
  // Returns the mean of `frames` frames of HRLS.
  Pixels converged(const Moment& moment, uint32_t frames) {
    Frame frame = describe(moment);
    frame.view = kViewConverged;
    Pixels pixels;
    for (uint32_t i = 0; i < frames; ++i) {
      frame.restarts = i == 0;
      pixels = submit(frame);
    }
    return pixels;
  }

  vk::Extent2D size() const { return renderer_.shown().size; }

 private:
  Frame describe(const Moment& moment) const {
    return {.camera = camera_at(moment.camera_s, aspect_), .scene_s = float(moment.scene_s)};
  }
  Pixels submit(const Frame& frame) {
    Slot& slot = frames_.next();
    renderer_.record(slot.begin(), frame, slot.queries());
    return submit(slot);
  }
  Pixels submit(Slot& slot) {
    slot.record_copy();
    slot.submit(nullptr, nullptr);
    const FrameResult result = slot.finish().value();
    return {result.image, result.image + size_t{4} * size().width * size().height};
  }

  Renderer renderer_;
  Frames frames_;
  double aspect_;
};

// Accumulates the mean and the variance of each value over images.
class Moments {
 public:
  void add(const Pixels& image) {
    sum_.resize(image.size());
    squares_.resize(image.size());
    for (size_t i = 0; i < image.size(); ++i) {
      sum_[i] += image[i];
      squares_[i] += double(image[i]) * image[i];
    }
    ++count_;
  }
  Pixels mean() const {
    Pixels mean;
    for (const double sum : sum_) mean.push_back(float(sum / count_));
    return mean;
  }
  double flicker() const {
    double total = 0;
    for (size_t i = 0; i < sum_.size(); ++i) {
      if (i % 4 == 3) continue;
      const double mean = sum_[i] / count_;
      total += std::sqrt(std::max(0.0, squares_[i] - count_ * mean * mean) / (count_ - 1));
    }
    return 255 * total / (double(sum_.size()) * 3 / 4);
  }

 private:
  std::vector<double> sum_, squares_;
  double count_ = 0;
};

double psnr(const Pixels& image, const Pixels& truth) {
  double sum = 0;
  for (size_t i = 0; i < image.size(); ++i)
    if (i % 4 < 3) sum += std::pow(double(image[i]) - truth[i], 2);
  return -10 * std::log10(sum / (double(image.size()) * 3 / 4));
}

constexpr double kStill_s = 1.7;
constexpr uint32_t kTruthSamples = 16;  // samples a pixel in each frame of a converged image

// Holds the studios of the same frames without and with history, and of their truths.
struct Studios {
  Studio plain, joined, truths;
};

void measure_still(Studios& studios, const MeasureOptions& options) {
  constexpr Moment kMoment = {kStill_s, 0};
  Moments converged, fused, blended;
  for (uint32_t i = 0; i < options.frames; ++i)
    converged.add(studios.truths.converged(kMoment, options.converged_samples / kTruthSamples));
  const Pixels truth = converged.mean();
  constexpr uint32_t kWarmUp = 32;
  double lrhs_psnr = 0, hrls_psnr = 0, fused_psnr = 0, blended_psnr = 0;
  for (uint32_t i = 0; i < kWarmUp + options.frames; ++i) {
    const Pixels image = studios.joined.frame(kMoment), plain = studios.plain.frame(kMoment);
    if (i < kWarmUp) continue;
    blended.add(image);
    fused.add(plain);
    blended_psnr += psnr(image, truth) / options.frames;
    fused_psnr += psnr(plain, truth) / options.frames;
    lrhs_psnr += psnr(studios.plain.again(kViewLrhs), truth) / options.frames;
    hrls_psnr += psnr(studios.plain.again(kViewHrls), truth) / options.frames;
  }
  std::printf("still camera, flicker: fused %.3f, with history %.3f, converged (%u samples) %.3f\n",
              fused.flicker(), blended.flicker(), options.converged_samples, converged.flicker());
  std::printf("still camera, PSNR: LRHS, bicubic %.2f, HRLS %.2f, fused %.2f, with history %.2f dB\n",
              lrhs_psnr, hrls_psnr, fused_psnr, blended_psnr);
}

// Measures a moving camera or a moving scene; `what` names it.
void measure_moving(Studios& studios, const MeasureOptions& options, const char* what, bool camera_moves,
                    const std::filesystem::path& images) {
  double fused_sum = 0, blended_sum = 0;
  uint32_t count = 0;
  const uint32_t warm_up = 8;
  for (uint32_t i = 0; i < warm_up + options.frames; ++i) {
    const Moment moment{kStill_s + (camera_moves ? i / 30.0 : 0), camera_moves ? 0 : i / 30.0};
    const Pixels blended = studios.joined.frame(moment), fused = studios.plain.frame(moment);
    if (i < warm_up || (i - warm_up) % options.reference_every > 0) continue;
    const Pixels lrhs = studios.plain.again(kViewLrhs), hrls = studios.plain.again(kViewHrls);
    const uint32_t last = warm_up + (options.frames - 1) / options.reference_every * options.reference_every;
    const Pixels truth = studios.truths.converged(moment, options.reference_samples / kTruthSamples);
    const double fused_psnr = psnr(fused, truth), blended_psnr = psnr(blended, truth);
    std::printf("%s, frame %u, PSNR: fused %.2f, with history %.2f dB\n", what, i, fused_psnr, blended_psnr);
    fused_sum += fused_psnr;
    blended_sum += blended_psnr;
    ++count;
    if (images.empty() || i < last) continue;
    std::filesystem::create_directories(images);
    write_png(images / "lrhs.png", lrhs.data(), studios.plain.size());
    write_png(images / "hrls.png", hrls.data(), studios.plain.size());
    write_png(images / "fused.png", fused.data(), studios.plain.size());
    write_png(images / "history.png", blended.data(), studios.plain.size());
    write_png(images / "converged.png", truth.data(), studios.plain.size());
  }
  std::printf("%s, mean PSNR: fused %.2f, with history %.2f dB\n", what, fused_sum / count,
              blended_sum / count);
}

}  // namespace

uint32_t measure(const DemoOptions& options, const MeasureOptions& measure) {
  const auto fits = [](uint32_t samples) { return samples > 0 && samples % kTruthSamples == 0; };
  if (measure.frames < 2 || !fits(measure.converged_samples) || !fits(measure.reference_samples))
    throw std::runtime_error("measuring takes two frames or more, and multiples of " +
                             std::to_string(kTruthSamples) + " samples");
  const Instance instance({}, options.validate);
  const Device device(instance, options.device, nullptr);
  const Models models(options.models);
  const raymeld::SharedModel& model = models[models.find(options.model)];
  const auto studio = [&](bool history, uint32_t hrls_samples) {
    RendererOptions of_studio = options.renderer;
    of_studio.history = history;
    of_studio.hrls_samples = hrls_samples;
    return Studio(device, model, options.size, of_studio);
  };
  const uint32_t samples = options.renderer.hrls_samples;
  Studios studios{studio(false, samples), studio(true, samples), studio(false, kTruthSamples)};
  measure_still(studios, measure);
  measure_moving(studios, measure, "moving camera", true, measure.images);
  measure_moving(studios, measure, "moving scene", false, {});
  return instance.messages();
}

}  // namespace postpass
