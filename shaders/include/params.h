// Declares the push constants, which the shaders and C++ read. Sizes count elements; a plane is the number of
// elements from one channel to the next.
#ifndef RAYMELD_PARAMS_H
#define RAYMELD_PARAMS_H

#ifdef __cplusplus
#include <cstdint>
namespace raymeld::params {
using uint = uint32_t;
#endif

// Says where an image of floats lies in its binding: element (c, y, x) is at
// offset + c * channel_stride + y * row_stride + x * pixel_stride.
struct FrameView {
  uint offset;
  uint pixel_stride;
  uint row_stride;
  uint channel_stride;
  uint unused;  // makes it as large as a TextureView
};

// Says where an image of Vulkan starts and how it is read: texel (x, y) is the first, and a texel
// stands for value * scale + bias.
struct TextureView {
  uint x;
  uint y;
  float scale;
  float bias;
  uint octahedral;  // 0: the value is read as it is; else its first two channels are a folded normal
};

// FRAME_VIEW is the view of the image that a pass reads or writes. The image may be smaller than the tensor
// that belongs to it: its last row and column are repeated, and what lies beyond them is not written.
#ifdef FRAME_IMAGE
#define FRAME_VIEW TextureView
#else
#define FRAME_VIEW FrameView
#endif

// Describes a convolution between the shuffles; the planes are those of the bound tensors.
struct Conv2d {
  uint height;
  uint width;
  uint plane_in;
  uint plane_out;
  uint channels_in;
  uint channels_first;  // channels of the first input
  uint channels_out;
};

// Describes one part of a 1x1 convolution of a band of pixels.
struct Pointwise {
  uint plane_in;
  uint plane_out;
  uint channels_in;
  uint first_channel;  // the part's first channel, at which the bound source starts
  uint channels_out;
  uint blocks;
  uint first_pixel;  // the band's first pixel
  uint pixels;       // pixels of the whole image before the shuffle
  uint width;        // the image's width before the shuffle
};

// Describes a 1x1 convolution of unshuffled pixels. plane and width are the image's; the output
// has plane_out and `rows` rows.
struct PointwiseUnshuffled {
  uint plane;
  uint width;
  uint plane_out;
  uint rows;
  uint channels_out;
};

// Describes the steps of a Winograd convolution, one band of rows at a time: see winograd.glsl. plane
// belongs to the bound tensor, whose row y is at y & rows_mask; height and width are the
// convolution's; tiles_x is even.
struct WinogradInput {
  uint height;
  uint width;
  uint plane;
  uint rows_mask;
  uint tiles_x;
  uint first_tile_row;
  uint channels;
  uint first_channel;  // the source's first channel, counted in the convolution
  uint position_stride;
  uint first_y, first_x;  // the first pixel that a tile reads, from its own; they wrap around
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
};

struct WinogradOutput {
  uint height;       // rows up to the end of the band
  uint width;
  uint plane;
  uint rows_mask;
  uint residual_plane;
  uint residual_rows_mask;
  uint tiles_x;
  uint first_tile_row;
  uint channels;  // a multiple of a block's channels
  uint position_stride;
};

struct ExposureSums {
  FRAME_VIEW frame;
  uint height;
  uint width;
  uint stride;  // distance of the pixels that an invocation takes, counted over the whole image
};

struct FoundExposure {
  uint sums;
  float root;  // the square root of the key, times the number of pixels
};

struct Encode {
  FRAME_VIEW frame;
  uint height;
  uint width;
  uint frame_height;
  uint frame_width;
  uint plane;
  uint log_transfer;  // 0: linear
  float clip;
  uint channels[8];    // a byte for each: the kind in two bits, and above them the image's channel
  float constants[8];  // values of channels from RAYMELD_FIRST_CONSTANT on
};

struct Variance {
  FRAME_VIEW frame;
  uint height;
  uint width;
  uint frame_height;
  uint frame_width;
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

// height, width and plane are of the full size, to which an image of the LRHS size is upsampled.
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

struct Remodulate {
  uint height;
  uint width;
  uint plane;
  uint log_transfer;  // 0: linear
};

struct KernelFilter {
  uint height;
  uint width;
  uint plane;
  uint coarse_height;
  uint coarse_width;
  uint coarse_plane;
};

// height, width and plane are those of the smaller image.
struct Pool {
  uint height;
  uint width;
  uint plane;
  uint plane_large;
  uint skipped;  // channels between light and guides
  float share;   // how much of the other image takes the place of the light; 0: no other image is read
};

// Says which part of a frame a recording computes, in full-size pixels. It follows the exposure, as floats,
// which hold these numbers exactly.
struct Place {
  uint y, x;           // the first pixel of the recording in the frame
  uint height, width;  // of the frame
  uint core_y, core_x, core_height, core_width;  // the pixels, from the first one, whose history is kept
};

// A history has `planes` planes of the frame's size, and then six of the size of LRHS: color, deviation, the
// change that is left, and a count. height, width and plane are those of LRHS, of which the frame has
// frame_height x frame_width.
struct LightChange {
  FRAME_VIEW motion;
  uint height;
  uint width;
  uint frame_height;
  uint frame_width;
  uint plane;
  uint scale;
  uint planes;
  uint log_transfer;   // 0: linear
  float mean_of_cell;  // 1 / scale^3, by which a cell's motions become their mean in pixels of LRHS
};

// The first `channels` channels of HRLS are accumulated; the count is written to count_channel.
struct Accumulate {
  FRAME_VIEW motion;
  uint height;
  uint width;
  uint frame_height;
  uint frame_width;
  uint plane;
  uint channels;
  uint count_channel;
  uint has_depth;  // 0: motion has two channels
  uint change_height;
  uint change_width;
  uint change_plane;
  float inverse_scale;  // 0: nothing is said of the light
  uint log_transfer;  // 0: linear
  float clip;
  float spp;  // samples of a pixel of this frame
};

// The history has the fused image in the planes from `first` on.
struct Settle {
  FRAME_VIEW motion;
  uint height;
  uint width;
  uint frame_height;
  uint frame_width;
  uint plane;
  uint first;
  uint log_transfer;  // 0: linear
  float clip;
  float spp;  // samples of a pixel of this frame
};

struct ColorVariance {
  uint height;
  uint width;
  uint frame_height;
  uint frame_width;
  uint plane;
  uint log_transfer;  // 0: linear
  float clip;
};

struct CellShare {
  uint height;
  uint width;
  uint plane_large;
  uint scale;
  float certainty;  // of a pixel of LRHS, where a sample of HRLS has 1
};

struct Light {
  uint height;
  uint width;
  uint plane;
  uint lrhs_plane;
  uint log_transfer;     // 0: linear
  float lrhs_certainty;  // the certainty of a pixel of LRHS, where one of HRLS has 1
};

// height, width and plane are of the LRHS size; plane_large and scale lead to the full size.
struct CellLight {
  uint height;
  uint width;
  uint plane;
  uint plane_large;
  uint scale;
  uint covered;       // the side of the pixels that a sample of LRHS is the mean of: scale, or 1
  uint log_transfer;  // 0: linear
};

struct ChannelMeans {
  uint pixels;
  uint plane_in;
  uint plane;
};

struct Gradients {
  uint height;
  uint width;
  uint plane;
  uint channels;
};

struct Remainder {
  uint height;
  uint width;
  uint plane;
  uint log_transfer;  // 0: linear
};

struct Attend {
  uint height;
  uint width;
  uint plane;
  uint plane_logits;
};

struct Decode {
  FRAME_VIEW frame;
  uint frame_height;
  uint frame_width;
  Upsampled upsampled;
  uint bilinear_base;  // 0: none
  float clip;          // radiance above it is added; 0: none is
};

#ifdef __cplusplus
}  // namespace raymeld::params
#endif

// Demodulated radiance is radiance / (albedo + ALBEDO_FLOOR). A pixel brighter than FIREFLY times its second
// brightest neighbour + FIREFLY_FLOOR is a firefly.
#define RAYMELD_ALBEDO_FLOOR 0.4
#define RAYMELD_COMPRESS 0.2  // log(1 + COMPRESS x) / COMPRESS is filtered
#define RAYMELD_FIREFLY 20.0
#define RAYMELD_FIREFLY_FLOOR 1e-3

// A predicted kernel's logits lose the squared differences of albedo and normal times these, and times the
// factors that the network predicts.
#define RAYMELD_ALBEDO_AFFINITY 6.25
#define RAYMELD_NORMAL_AFFINITY 2.25

// A history joins as far as its albedo, normal and depth are those around the pixel: by exp() of their
// squared distances times these. The distance of depths is that of their logarithms beyond DEPTH_TOLERANCE,
// from the range of those pixels whose motion is the same but for the square root of DEPTH_MOTION.
#define RAYMELD_HISTORY_ALBEDO 40.0
#define RAYMELD_HISTORY_NORMAL 10.0
#define RAYMELD_HISTORY_DEPTH 40.0
#define RAYMELD_DEPTH_TOLERANCE 0.05
#define RAYMELD_DEPTH_MOTION 0.25
// Motion is steady by exp() of the squared distance of two motions times the first. The second is the part of
// the other distances that counts where it is.
#define RAYMELD_HISTORY_MOTION 16.0
#define RAYMELD_HISTORY_STEADY 0.05
#define RAYMELD_NOWHERE 1e9  // pixels of a motion that leads out of every frame
#define RAYMELD_SHARPENED_SHARE 0.25  // of a new albedo or normal, where reading blurs the last ones
#define RAYMELD_MOST_FRAMES 64.0  // that a pixel is the mean of
#define RAYMELD_MOST_LRHS_FRAMES 16.0
// A change of the logarithm of the light is noise up to LIGHT_NOISE and LIGHT_ERRORS standard errors. The
// variance of the noise is LIGHT_SPREAD times the squared mean absolute deviation in the last frames, but at
// least what neighbours say, and at most LIGHT_MOST_VARIANCE times that.
#define RAYMELD_LIGHT_FLOOR 0.02  // added to luminance before its logarithm
#define RAYMELD_LIGHT_NOISE 0.01
#define RAYMELD_LIGHT_ERRORS 1.85
#define RAYMELD_LIGHT_SPREAD 2.0
#define RAYMELD_LIGHT_MOST_VARIANCE 12.0
// A deviation counts up to the first times the mean one, and the second over the frames behind that but one.
#define RAYMELD_LIGHT_OUTLIER 2.0
#define RAYMELD_LIGHT_FIRST 0.002
// A new change c shortens the history of HRLS to exp(-c (LIGHT_CHANGE + LIGHT_LARGE c)) of its frames.
#define RAYMELD_LIGHT_CHANGE 8.0
#define RAYMELD_LIGHT_LARGE 20.0
#define RAYMELD_LIGHT_MOST 1.0  // the largest change by which a history's radiance is corrected
#define RAYMELD_SETTLED 0.6        // most of the last fused image in the next
#define RAYMELD_SETTLED_BLUR 0.8   // how much less that is where reading blurs it
#define RAYMELD_SETTLED_MARGIN 1.01  // a logarithm in 16 bits makes samples a little too many
#define RAYMELD_MOST_SAMPLES 16.0  // that networks were trained with

// A workgroup of conv2d_matrix.comp is this many pixels wide.
#define RAYMELD_MATRIX_COLUMNS 32

// The scratch of winograd_*.comp and pointwise.comp holds one channel of so many tiles or pixels side by
// side. The length of a vector divides this number: see vector.glsl.
#define RAYMELD_LANES 16

#define RAYMELD_STRIP 4  // see strip.glsl

#define RAYMELD_SUMMANDS 128  // see workgroup_sum.glsl

#define RAYMELD_FIRST_CONSTANT 56  // channels of encode.comp from here on are constants
// A kind says how an input channel is encoded.
#define RAYMELD_RADIANCE 0  // multiplied by the exposure, clamped to [0, clip], then encoded
#define RAYMELD_ALBEDO 1    // clamped to [0, 1]
#define RAYMELD_NORMAL 2    // clamped to [-1, 1]
#define RAYMELD_VARIANCE 3  // encoded like radiance, but multiplied by the square of the exposure

#endif
