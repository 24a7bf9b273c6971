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
  if (history_) {
    if (history_->is_empty || history_->size != tiling.frame)
      fill_now(device_, history_->last.handle(), history_->all(), "history");
    bind_host(*host_);
    record_chunks(*host_, fused ? plan_.graph.passes().size() : history_end(next_is_fused_));
  }
  uint64_t skipped = 0;  // LRHS pixels
  for (uint32_t index = 0; index < tiling.count(); ++index) {
    const Tile at = tiling.at(index);
    const auto of_frame = [&](double share) { return !progress || progress((index + share) / count); };
    if (last_frame_ && !last_frame_->has_changed(at, tiling.tile)) {
      skipped += uint64_t{at.core.height} * at.core.width;
      if (!of_frame(1)) throw Cancelled();
      continue;
    }
    const auto [low, high] = windows(lrhs, hrls, at);
    upload(low, host_->lrhs);
    upload(high, host_->hrls);
    if (history_) {
      const Shape shape = motion_shape(image_shapes(tiling.tile)[2], options_);
      upload(window(motion_, shape, model_.architecture().scale, at), host_->motion);
      program_->set_place(kHostSet, place_of(at, tiling.frame));
    }
    if (host_->staging) host_->staging->wait();  // so that no time of the device counts it
    const Status status = run_tile(of_frame, report);
    // The next frame computes this tile even if nothing changes, so that it counts these values as well.
    if (!is_clean(status) && last_frame_) last_frame_->distrust(at, tiling.tile);
    last_redone_ = options_.fp32_kernels && !is_clean(status);
    if (last_redone_) {
      copy_core(redo_tile(low, high, of_frame, report).data.data(), fused, at);
      continue;
    }
    if (!fused) continue;  // see remember()
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
  for (size_t i = 0; i < host_->chunk_count; ++i) {
    const auto start = std::chrono::steady_clock::now();
    device_.submit_and_wait(host_->chunks[i]);
    const std::chrono::duration<double, std::milli> time = std::chrono::steady_clock::now() - start;
    report.device_ms += time.count();
    if (!progress(++done / static_cast<double>(host_->chunk_count))) throw Cancelled();
  }
  if (options_.profile) add_pass_times(report);
  return program_->status();
}

// Computes a tile again in 32 bits, as a frame of its own.
Image Fuser::redo_tile(const ImageWindow& lrhs, const ImageWindow& hrls, const Progress& progress,
                       FuseReport& report) {
  const auto [height, width] = plan_.tiling.tile;
  if (!wide_) {
    const FuserOptions options = wide_options(device_.info(), options_, allocated_bytes());
    wide_ = std::make_unique<Fuser>(device_, model_, height, width, options, cache_folder_);
  }
  std::vector<float> copies[2];
  const auto dense = [](const ImageWindow& window, std::vector<float>& copy) -> const float* {
    const bool is_dense =
        window.row_stride == window.width && window.plane == size_t{window.width} * window.height;
    if (is_dense || window.rows() == 0) return window.values;
    copy.resize(window.rows() * window.width);
    window.copy(0, window.rows(), copy.data());
    return copy.data();
  };
  const Shape shape = image_shapes(plan_.tiling.tile)[2];
  Image image(static_cast<int>(shape.width), static_cast<int>(shape.height), 3);
  const auto go_on = [&](double) { return progress(1); };
  const FuseReport redone = wide_->run_within_memory(dense(lrhs, copies[0]), dense(hrls, copies[1]),
                                                     image.data.data(), report.exposure, go_on);
  report.add_times(redone);
  report.status.not_finite += redone.status.not_finite;
  ++report.redone_tiles;
  if (shortage_.empty()) shortage_ = wide_->shortage();
  return image;
}

void Fuser::ImageWindow::copy(size_t first, size_t last, float* to) const {
  for (size_t row = first; row < last; ++row, to += width)
    std::memcpy(to, values + row / height * plane + row % height * row_stride, width * sizeof(float));
}

Fuser::ImageWindow Fuser::window(const float* image, const Shape& shape, uint32_t scale,
                                 const Tile& at) const {
  const size_t stride = size_t{scale} * plan_.tiling.frame.width;
  return {.values = image ? image + scale * at.y * stride + scale * at.x : nullptr,
          .row_stride = stride,
          .plane = scale * plan_.tiling.frame.height * stride,
          .channels = shape.channels,
          .height = shape.height,
          .width = shape.width};
}

std::array<Fuser::ImageWindow, 2> Fuser::windows(const float* lrhs, const float* hrls, const Tile& at) const {
  const auto shapes = image_shapes(plan_.tiling.tile);
  return {window(lrhs, shapes[0], 1, at), window(hrls, shapes[1], model_.architecture().scale, at)};
}

Place Fuser::place_of(const Tile& at, TileSize frame) const {
  const uint32_t s = model_.architecture().scale;
  const auto [height, width] = frame;
  return {.y = s * at.y,
          .x = s * at.x,
          .height = s * height,
          .width = s * width,
          .core_y = s * (at.core_y - at.y),
          .core_x = s * (at.core_x - at.x),
          .core_height = s * at.core.height,
          .core_width = s * at.core.width};
}

void Fuser::upload(const ImageWindow& window, const Buffer& to) {
  if (window.rows() == 0) return;
  if (to.mapped()) {
    window.copy(0, window.rows(), static_cast<float*>(to.mapped()));
    return to.flush();
  }
  const uint64_t row_bytes = uint64_t{window.width} * sizeof(float);
  const size_t step = host_->staging->piece_bytes() / row_bytes;
  for (size_t first = 0; first < window.rows(); first += step) {
    const size_t last = std::min(first + step, window.rows());
    window.copy(first, last, reinterpret_cast<float*>(host_->staging->next()));
    host_->staging->send(to, first * row_bytes, (last - first) * row_bytes);
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
  const auto times = host_->timestamps->pass_ms();
  if (!times) throw Error("device {} has written no timestamps", device_.info().name);
  for (size_t i = 0; i < passes.size(); ++i) {
    const double time_ms = times->at(i);
    add_time(report.layers, {passes[i].name, time_ms, passes[i].flop, passes[i].bytes});
    add_time(report.kernels, {passes[i].shader->name, time_ms, passes[i].flop, passes[i].bytes});
  }
}

}  // namespace raymeld
