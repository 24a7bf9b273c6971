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
  uint32_t scale = 0, channels = 0;
  TileSize frame = {}, last = {};  // the largest frame, and the last one: of no pixels where there was none

  bool is_empty() const { return last == TileSize{}; }
  // Returns the floats that the last frame left.
  uint64_t floats() const {
    return is_empty() ? 0 : history_floats(scale * last.height, scale * last.width, channels, scale);
  }
  bool is_sound() const {
    const bool fits = last.height <= frame.height && last.width <= frame.width;
    return kind == Header{}.kind && fits && (is_empty() || (last.height > 0 && last.width > 0));
  }
};
// Padding would be saved too, and hold any bytes.
static_assert(sizeof(Header) == 32);

// Holds what all histories of a Fuser have in common.
struct Format {
  Header header;
  std::string layers;

  size_t begin() const { return sizeof(Header) + layers.size(); }
  std::string text() const {
    return fmt::format("the layers {} and frames of {} x {} LRHS pixels at a scale of {}", layers,
                       header.frame.width, header.frame.height, header.scale);
  }
};

Format format_of(const Model& model, const FuserOptions& options, TileSize frame) {
  const Architecture& a = model.architecture();
  const uint32_t channels = history_channels(model, options.phase, options.compute_variance);
  const std::span layers(a.hrls_layers.begin(), channels / 3);
  return {{.scale = a.scale, .channels = channels, .frame = frame},
          fmt::format("{}", fmt::join(layers, ","))};
}

}  // namespace

uint64_t Fuser::saved_history_bytes() const {
  const uint64_t bytes = history_bytes(model_, plan_.tiling.frame, device_.info(), options_);
  return bytes > 0 ? format_of(model_, options_, plan_.tiling.frame).begin() + bytes : 0;
}

void Fuser::expect_history() const {
  if (!options_.temporal) throw HistoryError("a history to save or load, expected a fusion that keeps one");
}

void Fuser::save_history(std::span<std::byte> to, size_t sequence) {
  expect_history();
  if (to.size() != saved_history_bytes())
    throw HistoryError("{} bytes for a history, expected {}", to.size(), saved_history_bytes());
  Format format = format_of(model_, options_, plan_.tiling.frame);
  const History& known = history(sequence);
  if (!known.is_empty) format.header.last = known.size;
  const uint64_t bytes = sizeof(float) * format.header.floats();
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
  expect_history();
  const Format expected = format_of(model_, options_, plan_.tiling.frame);
  Format given;
  if (from.size() >= sizeof(Header)) std::memcpy(&given.header, from.data(), sizeof(Header));
  if (from.size() < sizeof(Header) || !given.header.is_sound())
    throw HistoryError("a history to load: the bytes are no saved history");
  const auto layers = from.subspan(sizeof(Header), std::min(from.size(), expected.begin()) - sizeof(Header));
  given.layers.assign(reinterpret_cast<const char*>(layers.data()), layers.size());
  const bool fits = given.header.channels == expected.header.channels && given.text() == expected.text();
  if (!fits) throw HistoryError("a history to load has {}, expected {}", given.text(), expected.text());
  if (from.size() != saved_history_bytes())
    throw HistoryError("a history to load of {} bytes, expected {}", from.size(), saved_history_bytes());
  History& known = history(sequence);
  if (const uint64_t bytes = sizeof(float) * given.header.floats(); bytes > 0) {
    const Buffer host(device_, bytes, Memory::kUpload, "saved history");
    std::memcpy(host.mapped(), from.data() + expected.begin(), bytes);
    host.flush();
    copy_now(device_, host.handle(), known.next.handle(), {0, 0, bytes}, "load a history");
  }
  known.go_on(given.header.last);
  known.is_empty = given.header.is_empty();
}

}  // namespace raymeld
