#include "fuser.h"

#include <algorithm>
#include <chrono>
#include <cstring>

#include "network.h"

namespace raymeld {
namespace {

constexpr uint32_t kHostSet = Fuser::kFramesInFlight;  // the descriptor set of fuse()'s own recordings

Graph build_graph(const Model& model, TileSize tile, const FuserOptions& options) {
  Graph graph(options.storage);
  network(graph, model, tile.height, tile.width, options.phase);
  graph.plan(!options.keep_activations);
  return graph;
}

Shape lrhs_shape(TileSize tile) { return {tile.height, tile.width, 3}; }

Shape full_shape(const Model& model, TileSize tile, uint32_t channels) {
  const uint32_t s = model.architecture().scale;
  return {s * tile.height, s * tile.width, channels};
}

uint32_t hrls_channels(const Model& model) {
  return static_cast<uint32_t>(3 * model.architecture().hrls_layers.size());
}

uint64_t float_bytes(const Shape& shape) { return shape.pixels() * shape.channels * sizeof(float); }

FrameBuffer dense_view(const Buffer& buffer, const Shape& shape) {
  return {buffer.handle(), 0, 1, shape.width, static_cast<uint32_t>(shape.pixels())};
}

FusePlan describe(const Graph& graph, const Model& model, const Tiling& tiling) {
  FusePlan plan;
  plan.tiling = tiling;
  plan.constant_bytes = graph.constant_bytes();
  plan.activation_bytes = graph.activation_bytes();
  plan.unaliased_bytes = graph.unaliased_bytes();
  plan.frame_bytes = float_bytes(lrhs_shape(tiling.tile)) +
                     float_bytes(full_shape(model, tiling.tile, hrls_channels(model) + 3)) + sizeof(Status);
  for (const Pass& pass : graph.passes()) plan.flop += pass.flop * tiling.count();
  return plan;
}

void copy_rows(const float* from, size_t from_stride, float* to, size_t to_stride, uint32_t width,
               uint32_t height) {
  for (uint32_t y = 0; y < height; ++y) {
    std::memcpy(to + y * to_stride, from + y * from_stride, width * sizeof(float));
  }
}

}  // namespace

Storage storage_for(Precision precision, const DeviceInfo& device) {
  const bool half = precision == Precision::kFp16 ||
                    (precision == Precision::kAuto && !device.is_cpu && device.storage_16bit);
  return half ? Storage::kFloat16 : Storage::kFloat32;
}

float lrhs_phase(bool centered, uint32_t scale) {
  return centered ? (static_cast<float>(scale) - 1.0f) / 2.0f : 0.0f;
}

FusePlan plan_fusion(const Model& model, uint32_t height, uint32_t width, const DeviceInfo& device,
                     const FuserOptions& options) {
  // A driver that tells no budget still shares its heap with others.
  const uint64_t most_bytes =
      options.max_memory_bytes ? options.max_memory_bytes : device.memory_bytes / 5 * 4;
  const TileSize frame{height, width};
  uint64_t needed_bytes = 0;
  const auto fits = [&](TileSize tile) {
    const Graph graph = build_graph(model, tile, options);
    const FusePlan plan = describe(graph, model, make_tiling(tile, 1, 1, 0));
    needed_bytes = plan.peak_bytes();
    const uint64_t frame_image_bytes = float_bytes(full_shape(model, tile, hrls_channels(model)));
    return plan.peak_bytes() <= most_bytes && plan.activation_bytes <= device.max_allocation_bytes &&
           std::max(graph.largest_binding_bytes(), frame_image_bytes) <= device.max_storage_range_bytes;
  };
  const Tiling tiling = choose_tiling(frame, receptive_halo(model.architecture()), fits);
  if (tiling.count() == 0) {
    throw Error("model {}: even the smallest tile needs {:.1f} MiB, more than the {:.1f} MiB allowed",
                model.name(), needed_bytes / 1048576.0, most_bytes / 1048576.0);
  }
  if (options.keep_activations && tiling.count() > 1) {
    throw Error("keeping every layer's output needs the frame in one tile, which takes more than {:.1f} MiB",
                most_bytes / 1048576.0);
  }
  return describe(build_graph(model, tiling.tile, options), model, tiling);
}

Fuser::Fuser(const Device& device, const Model& model, uint32_t height, uint32_t width,
             const FuserOptions& options, const std::filesystem::path& cache_folder)
    : device_(device),
      model_(model),
      options_(options),
      plan_(plan_fusion(model, height, width, device.info(), options)),
      cache_(device, cache_folder),
      graph_(build_graph(model, plan_.tiling.tile, options)),
      program_(device, graph_, cache_, kFramesInFlight + 1) {
  if (options.profile && device.info().timestamp_period_ns == 0) {
    throw Error("device {} has no timestamps to profile with", device.info().name);
  }
  cache_.save();
}

Fuser::Host::~Host() {
  if (queries) device.vk().DestroyQueryPool(device.handle(), queries, nullptr);
}

uint64_t Fuser::allocated_bytes() const {
  const uint64_t frame_bytes =
      host_ ? host_->lrhs.size_bytes() + host_->hrls.size_bytes() + host_->fused.size_bytes() : 0;
  return program_.allocated_bytes() + frame_bytes;
}

FrameBindings Fuser::bindings(const FrameBuffer& lrhs, const FrameBuffer& hrls,
                              const FrameBuffer& fused) const {
  const TileSize tile = plan_.tiling.tile;
  return {FrameBinding{lrhs, lrhs_shape(tile)},
          FrameBinding{hrls, full_shape(model_, tile, hrls_channels(model_))},
          FrameBinding{fused, full_shape(model_, tile, 3)}};
}

void Fuser::record(VkCommandBuffer commands, const FrameBuffer& lrhs, const FrameBuffer& hrls,
                   const FrameBuffer& fused) {
  program_.bind(next_set_, bindings(lrhs, hrls, fused));
  program_.record(commands, next_set_, 0, graph_.passes().size());
  next_set_ = (next_set_ + 1) % kFramesInFlight;
}

void Fuser::prepare_host() {
  if (host_) return;
  host_.emplace(device_);
  const TileSize tile = plan_.tiling.tile;
  const Shape lrhs = lrhs_shape(tile), hrls = full_shape(model_, tile, hrls_channels(model_));
  const Shape fused = full_shape(model_, tile, 3);
  host_->lrhs = Buffer(device_, float_bytes(lrhs), Memory::kUpload, "lrhs");
  host_->hrls = Buffer(device_, float_bytes(hrls), Memory::kUpload, "hrls");
  host_->fused = Buffer(device_, float_bytes(fused), Memory::kReadback, "fused");
  program_.bind(kHostSet, bindings(dense_view(host_->lrhs, lrhs), dense_view(host_->hrls, hrls),
                                   dense_view(host_->fused, fused)));
  const VulkanFunctions& vk = device_.vk();
  if (options_.profile) {
    auto info = vk_struct<VkQueryPoolCreateInfo>(VK_STRUCTURE_TYPE_QUERY_POOL_CREATE_INFO);
    info.queryType = VK_QUERY_TYPE_TIMESTAMP;
    info.queryCount = static_cast<uint32_t>(graph_.passes().size()) + 1;
    check(vk.CreateQueryPool(device_.handle(), &info, nullptr, &host_->queries), "creating a query pool");
  }
  const auto passes = graph_.passes();
  for (size_t first = 0; first < passes.size();) {
    double work = passes[first].flop + passes[first].bytes;
    size_t last = first + 1;
    while (last < passes.size() &&
           work + passes[last].flop + passes[last].bytes <= program_.max_submit_flop()) {
      work += passes[last].flop + passes[last].bytes;
      ++last;
    }
    VkCommandBuffer commands = host_->pool.begin(fmt::format("passes {} to {}", first, last - 1));
    program_.record(commands, kHostSet, first, last, host_->queries);
    if (last == passes.size()) {
      auto barrier = vk_struct<VkMemoryBarrier>(VK_STRUCTURE_TYPE_MEMORY_BARRIER);
      barrier.srcAccessMask = VK_ACCESS_SHADER_WRITE_BIT;
      barrier.dstAccessMask = VK_ACCESS_HOST_READ_BIT;
      vk.CmdPipelineBarrier(commands, VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT, VK_PIPELINE_STAGE_HOST_BIT, 0, 1,
                            &barrier, 0, nullptr, 0, nullptr);
    }
    host_->pool.end(commands);
    host_->chunks.push_back(commands);
    first = last;
  }
}

void Fuser::check_sizes(const Image& lrhs, const Image& hrls) const {
  const auto [height, width] = plan_.tiling.frame;
  const uint32_t s = model_.architecture().scale;
  const auto is = [](const Image& image, uint32_t h, uint32_t w, uint32_t c) {
    return image.height == static_cast<int>(h) && image.width == static_cast<int>(w) &&
           image.channels == static_cast<int>(c);
  };
  if (!is(lrhs, height, width, 3)) {
    throw Error("LRHS is {}x{} with {} channels, expected {}x{} with 3", lrhs.width, lrhs.height,
                lrhs.channels, width, height);
  }
  if (!is(hrls, s * height, s * width, hrls_channels(model_))) {
    throw Error("HRLS is {}x{} with {} channels, expected {}x{} with {}", hrls.width, hrls.height,
                hrls.channels, s * width, s * height, hrls_channels(model_));
  }
}

FuseReport Fuser::fuse(const Image& lrhs, const Image& hrls, Image& fused, const Progress& progress) {
  check_sizes(lrhs, hrls);
  if (fused.width != hrls.width || fused.height != hrls.height || fused.channels != 3) {
    fused = Image(hrls.width, hrls.height, 3);
  }
  return fuse(lrhs.data.data(), hrls.data.data(), fused.data.data(), progress);
}

FuseReport Fuser::fuse(const float* lrhs, const float* hrls, float* fused, const Progress& progress) {
  prepare_host();
  FuseReport report;
  program_.reset_status();
  const double steps = static_cast<double>(plan_.tiling.count() * host_->chunks.size());
  double done = 0;
  for (uint32_t index = 0; index < plan_.tiling.count(); ++index) {
    const Tile at = plan_.tiling.at(index);
    upload(lrhs, hrls, at);
    for (VkCommandBuffer chunk : host_->chunks) {
      const auto start = std::chrono::steady_clock::now();
      device_.submit_and_wait(chunk);
      const std::chrono::duration<double, std::milli> time = std::chrono::steady_clock::now() - start;
      report.device_ms += time.count();
      if (progress && !progress(++done / steps)) throw Cancelled();
    }
    download(fused, at);
    if (options_.profile) add_pass_times(report);
  }
  report.status = program_.status();
  if (report.status.not_finite > 0) {
    throw Error("model {} gave {} values that are not finite; the image is of no use", model_.name(),
                report.status.not_finite);
  }
  return report;
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
  for (size_t c = 0; c < hrls_channels(model_); ++c) {
    copy_rows(hrls + s * s * c * frame_plane + s * at.y * s * frame.width + s * at.x, s * frame.width,
              hrls_out + s * s * c * tile_plane, s * tile.width, s * tile.width, s * tile.height);
  }
}

void Fuser::download(float* fused, const Tile& at) {
  const auto [frame, tile] = std::pair(plan_.tiling.frame, plan_.tiling.tile);
  const size_t s = model_.architecture().scale;
  host_->fused.invalidate();
  const auto* in = static_cast<const float*>(host_->fused.mapped());
  for (size_t c = 0; c < 3; ++c) {
    const size_t from = s * s * c * tile.height * tile.width + s * (at.core_y - at.y) * s * tile.width +
                        s * (at.core_x - at.x);
    const size_t to =
        s * s * c * frame.height * frame.width + s * at.core_y * s * frame.width + s * at.core_x;
    copy_rows(in + from, s * tile.width, fused + to, s * frame.width, s * at.core.width, s * at.core.height);
  }
}

void Fuser::add_pass_times(FuseReport& report) const {
  const auto passes = graph_.passes();
  std::vector<uint64_t> ticks(passes.size() + 1);
  check(device_.vk().GetQueryPoolResults(device_.handle(), host_->queries, 0,
                                         static_cast<uint32_t>(ticks.size()), ticks.size() * sizeof(uint64_t),
                                         ticks.data(), sizeof(uint64_t),
                                         VK_QUERY_RESULT_64_BIT | VK_QUERY_RESULT_WAIT_BIT),
        "reading timestamps");
  report.passes.resize(passes.size());
  for (size_t i = 0; i < passes.size(); ++i) {
    PassTime& time = report.passes[i];
    time.name = passes[i].name;
    time.time_ms += static_cast<double>(ticks[i + 1] - ticks[i]) * device_.info().timestamp_period_ns * 1e-6;
    time.flop += passes[i].flop;
    time.bytes += passes[i].bytes;
  }
}

}  // namespace raymeld
