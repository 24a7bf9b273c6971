#include "io/label.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cctype>
#include <set>

namespace raymeld {
namespace {

Picture grey(int width, int height) {
  return {width, height, std::vector<uint8_t>(size_t(width) * size_t(height) * 3, 128)};
}

// Returns the top left of the picture as text: # for white, . for black, and a blank for anything else.
std::string drawn(const Picture& picture, int width, int height) {
  std::string text;
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const uint8_t value = picture.rgb[3 * (size_t(y) * size_t(picture.width) + size_t(x))];
      text += value == 255 ? '#' : value == 0 ? '.' : ' ';
    }
    text += '\n';
  }
  return text;
}

TEST(Label, IsWhiteOnABlackBox) {
  Picture picture = grey(20, 13);
  add_label(picture, "HL");
  EXPECT_EQ(drawn(picture, 16, 12),
            "............... \n"
            "............... \n"
            "..#...#.#...... \n"
            "..#...#.#...... \n"
            "..#...#.#...... \n"
            "..#####.#...... \n"
            "..#...#.#...... \n"
            "..#...#.#...... \n"
            "..#...#.#####.. \n"
            "............... \n"
            "............... \n"
            "                \n");
}

TEST(Label, GrowsWithThePicture) {
  Picture small = grey(60, 255), large = grey(60, 512);
  add_label(small, "F");
  add_label(large, "F");
  EXPECT_EQ(std::ranges::count(large.rgb, 255), 4 * std::ranges::count(small.rgb, 255));
}

TEST(Label, HasALookForEachLetterOfTheLabels) {
  std::set<std::string> looks;
  const std::string_view letters =
      "ABCDEFHILNOPRSU";  // of bicubic, LRHS, HRLS, fused, denoised, upscaled, reference
  for (const char letter : letters) {
    Picture large = grey(9, 11), small = large;
    add_label(large, std::string(1, letter));
    add_label(small, std::string(1, char(std::tolower(letter))));
    EXPECT_EQ(large.rgb, small.rgb);
    looks.insert(drawn(large, 9, 11));
  }
  EXPECT_EQ(looks.size(), letters.size());
}

TEST(Label, IsCutWhereItDoesNotFit) {
  Picture picture = grey(3, 4);
  add_label(picture, "REFERENCE");
  EXPECT_EQ(drawn(picture, 3, 4), "...\n...\n..#\n..#\n");
}

}  // namespace
}  // namespace raymeld
