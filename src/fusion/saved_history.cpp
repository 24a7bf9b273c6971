// Saves the history of a sequence for another Fuser, and loads it there. A saved history is a Header, the
// names of the layers in the history, and its floats.
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <span>
#include <string>

#include "fusion/fuser.h"
#include "layers/layers.h"
#include "networks/network.h"

namespace raymeld {
namespace {

struct Header {
  std::array<char, 8> kind{'r', 'a', 'y', 'm', 'e', 'l', 'd', '1'};
  uint32_t scale = 0;
  TileSize frame = {}, last = {};  // the largest frame, and the last one: of no pixels where there was none

  bool is_empty() const { return last == TileSize{}; }
  bool is_sound() const {
    const bool fits = last.height <= frame.height && last.width <= frame.width;
    return kind == Header{}.kind && fits && (is_empty() || (last.height > 0 && last.width > 0));
  }
  std::string frames() const {
    return fmt::format("{} x {} LRHS pixels at a scale of {}", frame.width, frame.height, scale);
  }
};
// Padding would be saved too, and hold any bytes.
static_assert(sizeof(Header) == 28);

// Holds what all histories of a Fuser have in common.
struct Format {
  Header header;
  std::string layers;
  uint32_t channels = 0;

  size_t begin() const { return sizeof(Header) + layers.size(); }
  // Returns the bytes of floats that a frame of this size left.
  uint64_t bytes(TileSize of) const {
    const uint32_t scale = header.scale;
    return sizeof(float) * history_floats(scale * of.height, scale * of.width, channels, scale);
  }
};

// Throws HistoryError where no history is kept.
Format format_of(const Model& model, const FuserOptions& options, TileSize frame) {
  if (!options.temporal) throw HistoryError("a history to save or load, expected a fusion that keeps one");
  const Architecture& a = model.architecture();
  const uint32_t channels = history_channels(model, options.phase, options.compute_variance);
  const std::span layers(a.hrls_layers.begin(), channels / 3);
  return {{.scale = a.scale, .frame = frame}, fmt::format("{}", fmt::join(layers, ",")), channels};
}

}  // namespace

uint64_t Fuser::saved_history_bytes() const {
  const uint64_t bytes = history_bytes(model_, plan_.tiling.frame, device_.info(), options_);
  return bytes > 0 ? format_of(model_, options_, plan_.tiling.frame).begin() + bytes : 0;
}

void Fuser::save_history(std::span<std::byte> to, size_t sequence) {
  Format format = format_of(model_, options_, plan_.tiling.frame);
  if (to.size() != saved_history_bytes())
    throw HistoryError("{} bytes for a history, expected {}", to.size(), saved_history_bytes());
  const History& known = history(sequence);
  if (!known.is_empty) format.header.last = known.size;
  const uint64_t bytes = format.bytes(format.header.last);
  const std::span<std::byte> content = to.subspan(format.begin());
  if (bytes > 0) {
    const Buffer host(device_, bytes, Memory::kReadback, "saved history");
    copy_now(device_, known.last.handle(), host.handle(), {0, 0, bytes}, "save the history");
    host.invalidate();
    std::memcpy(content.data(), host.mapped(), bytes);
  }
  std::ranges::fill(content.subspan(bytes), std::byte{0});
  std::memcpy(to.data(), &format.header, sizeof(Header));
  std::ranges::copy(std::as_bytes(std::span(format.layers)), to.begin() + sizeof(Header));
}

void Fuser::load_history(std::span<const std::byte> from, size_t sequence) {
  const Format expected = format_of(model_, options_, plan_.tiling.frame);
  Header given;
  if (from.size() >= sizeof(Header)) std::memcpy(&given, from.data(), sizeof(Header));
  if (from.size() < sizeof(Header) || !given.is_sound())
    throw HistoryError("a history to load: the bytes are no saved history");
  if (given.frames() != expected.header.frames())
    throw HistoryError("a history to load is of {}, expected {}", given.frames(), expected.header.frames());
  if (from.size() != saved_history_bytes())
    throw HistoryError("a history to load of {} bytes, expected {}", from.size(), saved_history_bytes());
  const auto layers = std::as_bytes(std::span(expected.layers));
  if (!std::ranges::equal(from.subspan(sizeof(Header), layers.size()), layers))
    throw HistoryError("a history to load is of other layers, expected {}", expected.layers);
  History& known = history(sequence);
  if (const uint64_t bytes = expected.bytes(given.last); bytes > 0) {
    const Buffer host(device_, bytes, Memory::kUpload, "saved history");
    std::memcpy(host.mapped(), from.data() + expected.begin(), bytes);
    host.flush();
    copy_now(device_, host.handle(), known.next.handle(), {0, 0, bytes}, "load a history");
  }
  known.go_on(given.last);
  known.is_empty = given.is_empty();
}

}  // namespace raymeld
