// Writes the frame's text over the image, on a darker ground.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "frame.glsl"

// Each character from '!' to '_' has a glyph of 3x5 pixels: five rows of three bits, top row first, in octal.
const uint kFirst = 33, kLast = 95;
const uint kGlyphs[] = uint[](
    022202u, 055000u, 057575u, 036236u, 041241u, 025253u, 022000u,           // ! " # $ % & '
    012221u, 042224u, 005250u, 002720u, 000024u, 000700u, 000002u, 011244u,  // ( ) * + , - . /
    075557u, 026227u, 071747u, 071317u, 055711u, 074717u, 074757u, 071122u,  // 0 to 7
    075757u, 075717u, 002020u, 002024u, 012421u, 007070u, 042124u, 071202u,  // 8 9 : ; < = > ?
    075743u, 025755u, 065656u, 034443u, 065556u, 074647u, 074644u, 034553u,  // @ A to G
    055755u, 072227u, 011152u, 055655u, 044447u, 057755u, 065555u, 025552u,  // H to O
    065644u, 025563u, 065655u, 034216u, 072222u, 055557u, 055552u, 055775u,  // P to W
    055255u, 055222u, 071247u, 064446u, 044211u, 031113u, 025000u, 000007u   // X Y Z [ \ ] ^ _
);

void main() {
  const ivec2 pixel = ivec2(gl_GlobalInvocationID.xy), size = imageSize(shown);
  const int zoom = max(1, min(size.x / int(4 * kTextColumns), size.y / int(8 * kTextRows)));
  const ivec2 dot_at = pixel / zoom - 2;  // a line is 7 high, a glyph 4 wide
  const ivec2 cell = ivec2(dot_at.x / 4, dot_at.y / 7), within = ivec2(dot_at.x % 4, dot_at.y % 7);
  if (!inside(pixel, size) || any(lessThan(pixel / zoom, ivec2(1)))) return;
  if (cell.x >= int(kTextColumns) || cell.y >= int(constants.text_rows)) return;
  const vec4 color = imageLoad(shown, pixel);
  bool lit = false;
  if (all(greaterThanEqual(dot_at, ivec2(0))) && within.x < 3 && within.y < 5) {
    const uint place = cell.y * kTextColumns + cell.x;
    const uint code = constants.text[place / 4] >> (8 * (place % 4)) & 255u;
    if (code >= kFirst && code <= kLast)
      lit = (kGlyphs[code - kFirst] >> (14 - 3 * within.y - within.x) & 1u) != 0;
  }
  imageStore(shown, pixel, lit ? vec4(1) : vec4(0.35 * color.rgb, 1));
}
