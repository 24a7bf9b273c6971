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
const uint kHrls = 2;         // (18, height, width): color, albedo, normal, diffuse, specular, variance
const uint kFused = 3;        // (3, height, width)
const uint kHistory = 4;      // two of (height, width, 4): toned color and the number of frames in it
const uint kGuides = 5;       // two of (height, width, 4): normal and depth of the pixel's centre
const uint kAccumulated = 6;  // (3, height, width): the sum of HRLS colors
const uint kShown = 7;        // a storage image: sRGB
const uint kBindings = 8;

const uint kGroup = 8;  // workgroups are square
const uint kStrip = 8;  // rows of an invocation of kVariance and kHistory

const uint kColor = 0, kAlbedo = 3, kNormal = 6, kDiffuse = 9, kSpecular = 12, kVariance = 15;
const uint kHrlsChannels = 18;

// Lists the views that can be shown; kViewBlended is kViewFused with the history.
const uint kViewLrhs = 0, kViewHrls = 1, kViewFused = 2, kViewConverged = 3, kViewBlended = 4;

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
  uint slot;   // this frame's slot of history and guides; the other slot is the last frame's
  uint history_frames;      // earlier frames that may be blended in
  uint accumulated_frames;  // frames accumulated before this one
  uint text_rows;
  float history_weight;  // this frame's weight, once there are enough earlier ones
  float history_tolerance;
  uint text[kTextRows * kTextColumns / 4];  // ASCII, four characters in each, the first in the lowest byte
};

#ifdef __cplusplus
}  // namespace postpass
#endif
#endif
