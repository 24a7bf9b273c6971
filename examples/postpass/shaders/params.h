// Declares what the host and the shaders share; C++ and GLSL include it.
#ifndef POSTPASS_PARAMS_H
#define POSTPASS_PARAMS_H

#ifdef __cplusplus
#include <cstdint>
namespace postpass {
using uint = uint32_t;
struct vec4 {
  float x = 0, y = 0, z = 0, w = 0;
};
#endif

// Lists the bindings of the one descriptor set. Images are floats.
const uint kConstants = 0;
const uint kLrhs = 1;         // (3, height / scale, width / scale)
const uint kHrls = 2;         // (15, height, width): color, albedo, normal, diffuse, specular
const uint kMotion = 3;       // (4, height, width): raymeld_frame::motion, with depths
const uint kFused = 4;        // (3, height, width)
const uint kAccumulated = 5;  // (3, height, width): the sum of HRLS colors
const uint kShown = 6;        // a storage image: sRGB
const uint kBindings = 7;

const uint kGroup = 8;  // workgroups are square

const uint kColor = 0, kAlbedo = 3, kNormal = 6, kDiffuse = 9, kSpecular = 12;
const uint kHrlsChannels = 15;

// Lists the views that can be shown.
const uint kViewLrhs = 0, kViewHrls = 1, kViewFused = 2, kViewConverged = 3;

const uint kTextColumns = 32, kTextRows = 12;

struct Camera {
  vec4 position;
  vec4 right;  // right and up lead from the image's centre to its edges, in the plane at distance 1
  vec4 up;
  vec4 forward;
};

struct Constants {
  Camera camera;
  Camera last_camera;
  uint width;  // the width of HRLS, a multiple of scale
  uint height;
  uint scale;
  uint lrhs_samples;
  uint hrls_samples;
  uint frame;  // the seed of the frame's noise
  uint accumulated_frames;  // frames accumulated before this one
  uint text_rows;
  uint has_motion;  // whether kMotion is written
  float scene_s, last_scene_s;  // the time of what moves, in this frame and in the last one
  uint text[kTextRows * kTextColumns / 4];  // ASCII, four characters in each, the first in the lowest byte
};

#ifdef __cplusplus
}  // namespace postpass
#endif
#endif
