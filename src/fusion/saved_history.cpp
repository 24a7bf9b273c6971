// Saves the history of a sequence for another Fuser, and loads it there.
#include <algorithm>
#include <array>
#include <cstring>

#include "fusion/fuser.h"
#include "networks/network.h"

namespace raymeld {
namespace {

// Begins a saved history; its floats follow.
struct Header {
  std::array<char, 8> kind{'r', 'a', 'y', 'm', 'e', 'l', 'd', '1'};
  uint32_t scale = 0, channels = 0;
  TileSize frame = {}, last = {};  // the largest frame, and the last one: of no pixels where there was none

  bool fits(const Header& other) const {
    return kind == other.kind && scale == other.scale && channels == other.channels && frame == other.frame;
  }
  std::string text() const {
    return fmt::format("{} channels, a scale of {} and frames of {} x {} LRHS pixels", channels, scale,
                       frame.width, frame.height);
  }
};

static_assert(sizeof(Header) == 32);  // no padding, whose bytes would be any

Header header_of(const Model& model, const FuserOptions& options, TileSize frame) {
  if (!options.temporal) throw HistoryError("a history to save or load, expected a fusion that keeps one");
  return {.scale = model.architecture().scale,
          .channels = history_channels(model, options.phase, options.compute_variance),
          .frame = frame};
}

}  // namespace

uint64_t Fuser::saved_history_bytes() const {
  const uint64_t bytes = history_bytes(model_, plan_.tiling.frame, device_.info(), options_);
  return bytes > 0 ? sizeof(Header) + bytes : 0;
}

void Fuser::save_history(std::span<std::byte> to, size_t sequence) {
  Header header = header_of(model_, options_, plan_.tiling.frame);
  expect_saved_size(to.size());
  const History& known = history(sequence);
  const std::span<std::byte> floats = to.subspan(sizeof(Header));
  if (known.is_empty) {
    std::ranges::fill(floats, std::byte{0});
  } else {
    header.last = known.size;
    const Buffer host(device_, floats.size(), Memory::kReadback, "saved history");
    copy_now(device_, known.last.handle(), host.handle(), {0, 0, floats.size()}, "save the history");
    host.invalidate();
    std::memcpy(floats.data(), host.mapped(), floats.size());
  }
  std::memcpy(to.data(), &header, sizeof(Header));
}

void Fuser::load_history(std::span<const std::byte> from, size_t sequence) {
  const Header expected = header_of(model_, options_, plan_.tiling.frame);
  expect_saved_size(from.size());
  Header header;
  std::memcpy(&header, from.data(), sizeof(Header));
  if (header.kind != expected.kind) throw HistoryError("a history to load: the bytes are no saved history");
  if (!header.fits(expected))
    throw HistoryError("a history to load has {}, expected {}", header.text(), expected.text());
  History& known = history(sequence);
  const std::span<const std::byte> floats = from.subspan(sizeof(Header));
  const Buffer host(device_, floats.size(), Memory::kUpload, "saved history");
  std::memcpy(host.mapped(), floats.data(), floats.size());
  host.flush();
  copy_now(device_, host.handle(), known.last.handle(), {0, 0, floats.size()}, "load a history");
  known.size = header.last;
  known.is_empty = header.last == TileSize{};
}

void Fuser::expect_saved_size(size_t bytes) const {
  if (bytes != saved_history_bytes())
    throw HistoryError("a saved history of {} bytes, expected {}", bytes, saved_history_bytes());
}

}  // namespace raymeld
