// Push constants, read by the shaders and by C++. Sizes count elements; a plane is the number of elements from
// one channel to the next.
#ifndef RAYMELD_PARAMS_H
#define RAYMELD_PARAMS_H

#ifdef __cplusplus
#include <cstdint>
namespace raymeld::params {
using uint = uint32_t;
#endif

// Where an image of floats lies in its binding: element (c, y, x) is at
// offset + c * channel_stride + y * row_stride + x * pixel_stride.
struct FrameView {
  uint offset;
  uint pixel_stride;
  uint row_stride;
  uint channel_stride;
  uint unused;  // as large as a TextureView
};

// And of an image: texel (x, y) is the first one, and what it holds is value * scale + bias.
struct TextureView {
  uint x;
  uint y;
  float scale;
  float bias;
  uint octahedral;  // 0: the value is what is meant; else its first two channels are a normal
};

// What a pass has of the image that it touches.
#ifdef FRAME_IMAGE
#define FRAME_VIEW TextureView
#else
#define FRAME_VIEW FrameView
#endif

struct Conv2d {
  uint height;
  uint width;
  uint plane;
  uint channels_in;
  uint channels_first;  // of the first of two inputs
  uint channels_out;
};

// Of the convolution between the shuffles; the planes are those of the tensors bound.
struct Conv2dMatrix {
  uint height;
  uint width;
  uint plane_in;
  uint plane_out;
  uint channels_in;
  uint channels_first;  // of the first of two inputs
  uint channels_out;
};

// One part of a 1x1 convolution, of a band of pixels.
struct Pointwise {
  uint plane;
  uint channels_in;
  uint first_channel;  // of the part, whose first one is bound
  uint channels_out;
  uint blocks;
  uint first_pixel;  // of the band
  uint pixels;       // of the image
  uint digits[4];    // 0 to 3: see uniform.glsl
};

// A 1x1 convolution of unshuffled cells; plane and width are of the image, plane_out of the output, which has `rows` rows.
struct PointwiseUnshuffled {
  uint plane;
  uint width;
  uint plane_out;
  uint rows;
  uint channels_out;
  uint digits[4];  // 0 to 3: see uniform.glsl
};

// The steps of a convolution by tiles, one band of rows at a time: see winograd.glsl. plane is that of the tensor bound,
// its row y is at y & rows_mask;
// height and width are those of the convolution; tiles_x is even.
struct WinogradInput {
  uint height;
  uint width;
  uint plane;
  uint rows_mask;
  uint tiles_x;
  uint first_tile_row;
  uint channels;
  uint first_channel;  // of those of the source
  uint position_stride;
  uint digits[4];  // 0 to 3: see uniform.glsl
};

struct WinogradWeights {
  uint count;
};

struct WinogradMultiply {
  uint channels_in;
  uint first_channel;
  uint blocks;
  uint weights_stride;
  uint transformed_stride;
  uint products_stride;
  uint digits[4];  // 0 to 3: see uniform.glsl
};

struct WinogradOutput {
  uint height;       // up to the end of the band
  uint full_height;  // of the convolution
  uint width;
  uint plane;
  uint rows_mask;
  uint residual_plane;
  uint residual_rows_mask;
  uint tiles_x;
  uint first_tile_row;
  uint channels;  // a multiple of what a block has
  uint position_stride;
  uint digits[4];  // 0 to 3: see uniform.glsl
};

// Of the smaller image and of the larger one, whose sides are r times as long.
struct Shuffle {
  uint height;
  uint width;
  uint plane;
  uint plane_large;
};

struct ExposureSums {
  FRAME_VIEW frame;
  uint height;
  uint width;
  uint stride;  // from one pixel of an invocation to its next, in all of the image
};

struct FoundExposure {
  uint sums;
  float root;  // of the key, times the number of pixels
};

struct Encode {
  FRAME_VIEW frame;
  uint height;
  uint width;
  uint plane;
  uint log_transfer;  // 0: linear
  float clip;
  uint channels[8];    // a byte for each: its kind in two bits, and above them the channel of the image it is read from
  float constants[8];  // what channels are that are from RAYMELD_FIRST_CONSTANT and further
};

struct Variance {
  FRAME_VIEW frame;
  uint height;
  uint width;
  uint plane;
  uint log_transfer;  // 0: linear
  float clip;
};

struct AboveClip {
  FRAME_VIEW frame;
  uint height;
  uint width;
  uint plane;
  float clip;
};

// Of the LRHS size; plane_large and scale of the full one.
struct Irradiance {
  uint height;
  uint width;
  uint plane;
  uint plane_large;
  uint scale;
  uint centered;      // albedo and normal are the mean of the cell; 0: those of its top-left pixel
  uint log_transfer;  // 0: linear
};

// Of the full size, and of an image of the LRHS size that is upsampled.
struct Upsampled {
  uint height;
  uint width;
  uint plane;
  uint lrhs_height;
  uint lrhs_width;
  uint lrhs_plane;
  uint log_transfer;  // 0: linear
  float inverse_scale;
  float phase;
};

struct Demodulate {
  Upsampled of;
  uint scale;            // a power of two
  float lrhs_certainty;  // of a full-size pixel that LRHS tells of; HRLS has 1
};

struct JointFilter {
  uint height;
  uint width;
  uint plane;
  uint step;       // a power of two
  uint digits[4];  // 0 to 3: see uniform.glsl
};

struct Remodulate {
  uint height;
  uint width;
  uint plane;
  uint log_transfer;  // 0: linear
};

struct Decode {
  FRAME_VIEW frame;
  Upsampled of;
  uint bilinear_base;  // 0: none
  float clip;          // beyond it there are highlights; 0: there are none
};

#ifdef __cplusplus
}  // namespace raymeld::params
#endif

// Of the joint base: what is added to an albedo before light is divided by it; what is filtered is
// log(1 + COMPRESS x) / COMPRESS; the widths of the filter's guides, of which the brightness is encoded; a pixel brighter
// than FIREFLY times its second brightest neighbour and FIREFLY_FLOOR is a firefly.
#define RAYMELD_ALBEDO_FLOOR 0.4
#define RAYMELD_COMPRESS 0.2
#define RAYMELD_ALBEDO_WIDTH 1.5
#define RAYMELD_NORMAL_WIDTH 1.2
#define RAYMELD_BRIGHTNESS_WIDTH 0.0667
#define RAYMELD_JOINT_STRIP 4 // pixels that an invocation of the joint filter makes
#define RAYMELD_FIREFLY 20.0
#define RAYMELD_FIREFLY_FLOOR 1e-3

// The width of a workgroup's pixels in conv2d_matrix.comp.
#define RAYMELD_MATRIX_COLUMNS 32

// Tiles or pixels whose values of one channel lie side by side in the scratch of winograd_*.comp and pointwise.comp. Vectors
// divide it: see vector.glsl.
#define RAYMELD_LANES 16

#define RAYMELD_STRIP 4  // see strip.glsl

#define RAYMELD_SUMMANDS 128  // see workgroup_sum.glsl

// Which borders of the image a pixel touches; biases may depend on it, see border.glsl.
#define RAYMELD_TOP 1
#define RAYMELD_BOTTOM 2
#define RAYMELD_LEFT 4
#define RAYMELD_RIGHT 8
#define RAYMELD_BORDER_CASES 16

#define RAYMELD_FIRST_CONSTANT 56  // of the channels that encode.comp reads
// How an input channel is encoded.
#define RAYMELD_RADIANCE 0  // times the exposure, clamped to [0, clip], then the transfer function
#define RAYMELD_ALBEDO 1    // clamped to [0, 1]
#define RAYMELD_NORMAL 2    // clamped to [-1, 1]
#define RAYMELD_VARIANCE 3  // as radiance, but times the square of the exposure

#endif
