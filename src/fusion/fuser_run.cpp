// Runs a frame through a Fuser, tile by tile.
#include <algorithm>
#include <chrono>
#include <cstring>

#include "fusion/fuser.h"

namespace raymeld {
namespace {

void copy_rows(const float* from, size_t from_stride, float* to, size_t to_stride, uint32_t width,
               uint32_t height) {
  for (uint32_t y = 0; y < height; ++y) {
    std::memcpy(to + y * to_stride, from + y * from_stride, width * sizeof(float));
  }
}

bool is_clean(const Status& status) { return status.saturated == 0 && status.not_finite == 0; }

// Adds the times of a pass to those of the same name.
void add_time(std::vector<PassTime>& times, const PassTime& pass) {
  auto time =
      std::find_if(times.begin(), times.end(), [&](const PassTime& t) { return t.name == pass.name; });
  if (time == times.end()) time = times.insert(time, {.name = pass.name});
  time->time_ms += pass.time_ms;
  time->flop += pass.flop;
  time->bytes += pass.bytes;
}

}  // namespace

void FuseReport::add_times(const FuseReport& run) {
  device_ms += run.device_ms;
  for (const PassTime& layer : run.layers) add_time(layers, layer);
  for (const PassTime& kernel : run.kernels) add_time(kernels, kernel);
}

FuseReport Fuser::run(const float* lrhs, const float* hrls, float* fused, float exposure,
                      const Progress& progress) {
  FuseReport report;
  report.exposure = exposure;
  program_->set_exposure(kHostSet, exposure);
  const Tiling& tiling = plan_.tiling;
  const double count = tiling.count();
  uint64_t skipped = 0;  // LRHS pixels
  for (uint32_t index = 0; index < tiling.count(); ++index) {
    const Tile at = tiling.at(index);
    const auto of_frame = [&](double share) { return !progress || progress((index + share) / count); };
    if (last_frame_ && !last_frame_->has_changed(at, tiling.tile)) {
      skipped += uint64_t{at.core.height} * at.core.width;
      if (!of_frame(1)) throw Cancelled();
      continue;
    }
    upload(lrhs, hrls, at);
    const Status status = run_tile(of_frame, report);
    // The next frame computes this tile even if nothing changes, so that it counts these values as well.
    if (!is_clean(status) && last_frame_) last_frame_->distrust(at, tiling.tile);
    last_redone_ = options_.fp32_kernels && !is_clean(status);
    if (last_redone_) {
      copy_core(redo_tile(of_frame, report).data.data(), fused, at);
      continue;
    }
    host_->fused.invalidate();
    copy_core(static_cast<const float*>(host_->fused.mapped()), fused, at);
    report.status.saturated += status.saturated;
    report.status.not_finite += status.not_finite;
  }
  report.skipped_share = double(skipped) / (double(tiling.frame.height) * tiling.frame.width);
  return report;
}

// Runs the tile that was uploaded. Returns what it counted.
Status Fuser::run_tile(const Progress& progress, FuseReport& report) {
  program_->reset_status();
  double done = 0;
  for (VkCommandBuffer chunk : host_->chunks) {
    const auto start = std::chrono::steady_clock::now();
    device_.submit_and_wait(chunk);
    const std::chrono::duration<double, std::milli> time = std::chrono::steady_clock::now() - start;
    report.device_ms += time.count();
    if (!progress(++done / static_cast<double>(host_->chunks.size()))) throw Cancelled();
  }
  if (options_.profile) add_pass_times(report);
  return program_->status();
}

// Computes the tile that was uploaded again in 32 bits, as a frame of its own.
Image Fuser::redo_tile(const Progress& progress, FuseReport& report) {
  const auto [height, width] = plan_.tiling.tile;
  if (!wide_) {
    const FuserOptions options = wide_options(device_.info(), options_, allocated_bytes());
    wide_ = std::make_unique<Fuser>(device_, model_, height, width, options, cache_folder_);
  }
  const Shape shape = image_shapes(plan_.tiling.tile)[2];
  Image image(static_cast<int>(shape.width), static_cast<int>(shape.height), 3);
  const auto go_on = [&](double) { return progress(1); };
  const FuseReport redone = wide_->run_within_memory(static_cast<const float*>(host_->lrhs.mapped()),
                                                     static_cast<const float*>(host_->hrls.mapped()),
                                                     image.data.data(), report.exposure, go_on);
  report.add_times(redone);
  report.status.not_finite += redone.status.not_finite;
  ++report.redone_tiles;
  if (shortage_.empty()) shortage_ = wide_->shortage();
  return image;
}

void Fuser::upload(const float* lrhs, const float* hrls, const Tile& at) {
  const auto [frame, tile] = std::pair(plan_.tiling.frame, plan_.tiling.tile);
  const size_t s = model_.architecture().scale;
  const size_t frame_plane = size_t{frame.height} * frame.width,
               tile_plane = size_t{tile.height} * tile.width;
  auto* lrhs_out = static_cast<float*>(host_->lrhs.mapped());
  for (size_t c = 0; c < 3; ++c) {
    copy_rows(lrhs + c * frame_plane + size_t{at.y} * frame.width + at.x, frame.width,
              lrhs_out + c * tile_plane, tile.width, tile.width, tile.height);
  }
  auto* hrls_out = static_cast<float*>(host_->hrls.mapped());
  const size_t channels = image_shapes(tile)[1].channels;
  for (size_t c = 0; c < channels; ++c) {
    copy_rows(hrls + s * s * c * frame_plane + s * at.y * s * frame.width + s * at.x, s * frame.width,
              hrls_out + s * s * c * tile_plane, s * tile.width, s * tile.width, s * tile.height);
  }
}

void Fuser::copy_core(const float* tile_image, float* fused, const Tile& at) const {
  const auto [frame, tile] = std::pair(plan_.tiling.frame, plan_.tiling.tile);
  const size_t s = model_.architecture().scale;
  for (size_t c = 0; c < 3; ++c) {
    const size_t from = s * s * c * tile.height * tile.width + s * (at.core_y - at.y) * s * tile.width +
                        s * (at.core_x - at.x);
    const size_t to =
        s * s * c * frame.height * frame.width + s * at.core_y * s * frame.width + s * at.core_x;
    copy_rows(tile_image + from, s * tile.width, fused + to, s * frame.width, s * at.core.width,
              s * at.core.height);
  }
}

void Fuser::add_pass_times(FuseReport& report) const {
  const auto passes = plan_.graph.passes();
  std::vector<uint64_t> ticks(passes.size() + 1);
  check(device_.vk().GetQueryPoolResults(device_.handle(), host_->queries, 0,
                                         static_cast<uint32_t>(ticks.size()), ticks.size() * sizeof(uint64_t),
                                         ticks.data(), sizeof(uint64_t),
                                         VK_QUERY_RESULT_64_BIT | VK_QUERY_RESULT_WAIT_BIT),
        "reading timestamps of " + device_.info().name);
  for (size_t i = 0; i < passes.size(); ++i) {
    const double time_ms =
        static_cast<double>(ticks[i + 1] - ticks[i]) * device_.info().timestamp_period_ns * 1e-6;
    add_time(report.layers, {passes[i].name, time_ms, passes[i].flop, passes[i].bytes});
    add_time(report.kernels, {passes[i].shader->name, time_ms, passes[i].flop, passes[i].bytes});
  }
}

}  // namespace raymeld
