#include "io/label.h"

#include <algorithm>
#include <array>
#include <cctype>

namespace raymeld {
namespace {

constexpr int kWidth = 5, kHeight = 7, kMargin = 2;

// Holds rows from top to bottom; the left pixel is the highest of five bits.
struct Glyph {
  char letter;
  std::array<uint8_t, kHeight> rows;
};

// Has the letters of "BICUBIC LRHS", "HRLS", "FUSED", "DENOISED", "UPSCALED" and "REFERENCE".
constexpr std::array<Glyph, 15> kFont = {{{'A', {0x0e, 0x11, 0x11, 0x1f, 0x11, 0x11, 0x11}},
                                          {'B', {0x1e, 0x11, 0x11, 0x1e, 0x11, 0x11, 0x1e}},
                                          {'C', {0x0e, 0x11, 0x10, 0x10, 0x10, 0x11, 0x0e}},
                                          {'D', {0x1e, 0x11, 0x11, 0x11, 0x11, 0x11, 0x1e}},
                                          {'E', {0x1f, 0x10, 0x10, 0x1e, 0x10, 0x10, 0x1f}},
                                          {'F', {0x1f, 0x10, 0x10, 0x1e, 0x10, 0x10, 0x10}},
                                          {'H', {0x11, 0x11, 0x11, 0x1f, 0x11, 0x11, 0x11}},
                                          {'I', {0x0e, 0x04, 0x04, 0x04, 0x04, 0x04, 0x0e}},
                                          {'L', {0x10, 0x10, 0x10, 0x10, 0x10, 0x10, 0x1f}},
                                          {'N', {0x11, 0x19, 0x15, 0x13, 0x11, 0x11, 0x11}},
                                          {'O', {0x0e, 0x11, 0x11, 0x11, 0x11, 0x11, 0x0e}},
                                          {'P', {0x1e, 0x11, 0x11, 0x1e, 0x10, 0x10, 0x10}},
                                          {'R', {0x1e, 0x11, 0x11, 0x1e, 0x14, 0x12, 0x11}},
                                          {'S', {0x0f, 0x10, 0x10, 0x0e, 0x01, 0x01, 0x1e}},
                                          {'U', {0x11, 0x11, 0x11, 0x11, 0x11, 0x11, 0x0e}}}};

// Returns whether the label has ink at this pixel of its box, before the label is enlarged.
bool has_ink(std::string_view text, int x, int y) {
  const int column = x - kMargin, row = y - kMargin;
  if (column < 0 || row < 0 || row >= kHeight || column % (kWidth + 1) == kWidth) return false;
  const auto letter = size_t(column / (kWidth + 1));
  if (letter >= text.size()) return false;
  const auto glyph = std::ranges::find(kFont, std::toupper(text[letter]), &Glyph::letter);
  return glyph != kFont.end() && (glyph->rows[size_t(row)] >> (kWidth - 1 - column % (kWidth + 1)) & 1) != 0;
}

}  // namespace

void add_label(Picture& picture, std::string_view text) {
  const int zoom = std::max(1, picture.height / 256);
  const int width = zoom * (2 * kMargin + (kWidth + 1) * int(text.size()) - 1);
  const int height = zoom * (2 * kMargin + kHeight);
  for (int y = 0; y < std::min(height, picture.height); ++y) {
    for (int x = 0; x < std::min(width, picture.width); ++x) {
      const size_t pixel = size_t(y) * size_t(picture.width) + size_t(x);
      std::fill_n(&picture.rgb[3 * pixel], 3, has_ink(text, x / zoom, y / zoom) ? 255 : 0);
    }
  }
}

}  // namespace raymeld
