/* raymeld as a library: fuses a small render with many samples a pixel (LRHS) and a full-size one with few
 * (HRLS) into the image that full size and many samples would have given, on a Vulkan device.
 *
 * Every function that may fail returns a raymeld_result; raymeld_error() then says what was being done, and
 * what was expected. Nothing is left behind by a function that failed, and out parameters are as they were.
 *
 * Structures begin with their size, by which a library knows which version of them a program was compiled
 * with: struct_size = sizeof(the structure). All else may be zero, which asks for the default; in C++ all
 * members have initializers. Reserved members must be zero.
 *
 * Handles may be destroyed in any order: what is made with another one keeps what it needs of it. What
 * belongs to the caller (Vulkan objects and memory) must outlive what is made with it, and destroying a
 * fusion is for when none of its recordings in the caller's command buffers is pending. Threads: a context
 * and a model may be used by several at once; a fusion by one at a time. */
#ifndef RAYMELD_RAYMELD_H
#define RAYMELD_RAYMELD_H

#include <stddef.h>
#include <stdint.h>
#include <vulkan/vulkan_core.h>

#ifdef __cplusplus
#define RAYMELD_IS(value) = value
extern "C" {
#else
#define RAYMELD_IS(value)
#endif
#if defined(__GNUC__)
#define RAYMELD_API __attribute__((visibility("default")))
#else
#define RAYMELD_API
#endif

typedef enum raymeld_result {
  RAYMELD_SUCCESS = 0,
  RAYMELD_ERROR_INVALID_ARGUMENT = 1, /* an argument is not what its description says */
  RAYMELD_ERROR_MODEL = 2,            /* a file or memory that is no model */
  RAYMELD_ERROR_DEVICE = 3,           /* the device cannot do it, or a call of Vulkan failed */
  RAYMELD_ERROR_OUT_OF_MEMORY = 4,    /* of the device or the host */
  RAYMELD_ERROR_DEVICE_LOST = 5,      /* all that was made on the device is of no more use */
  RAYMELD_ERROR_NOT_FINITE = 6,       /* the network's output; the image is of no use */
  RAYMELD_ERROR_INTERNAL = 7          /* a fault of raymeld's own */
} raymeld_result;

/* What the last function of this thread that failed has to say, in English, UTF-8; "" before any did. The
 * text lives until the thread's next failure. */
RAYMELD_API const char* raymeld_error(void);

/* That of the library: major << 16 | minor << 8 | patch. Libraries of one major and minor version serve all
 * programs that were compiled with an older patch of it. */
RAYMELD_API uint32_t raymeld_version(void);

/* ---- Before a device is created ---- */

/* What a device may have for raymeld beyond Vulkan 1.1. Nothing of it is required. */
typedef enum raymeld_feature_bits {
  RAYMELD_FEATURE_STORAGE_16BIT = 1,
  RAYMELD_FEATURE_BUFFER_DEVICE_ADDRESS = 2,
  RAYMELD_FEATURE_COOPERATIVE_MATRIX = 4,
  RAYMELD_FEATURE_IMAGE_WRITES = 8,
  RAYMELD_FEATURE_TIMELINE_SEMAPHORE = 16,
  RAYMELD_FEATURE_EXTERNAL_MEMORY_FD = 32
} raymeld_feature_bits;

/* All of a feature's extensions and members of feature structures are to be enabled, or none. The texts are
 * the library's, for ever. */
typedef struct raymeld_feature {
  size_t struct_size RAYMELD_IS(sizeof(raymeld_feature));
  uint32_t bit RAYMELD_IS(0);              /* of raymeld_feature_bits */
  VkBool32 supported RAYMELD_IS(VK_FALSE); /* by the device that was asked */
  uint32_t extension_count RAYMELD_IS(0);
  uint32_t member_count RAYMELD_IS(0);
  const char* const* extensions RAYMELD_IS(NULL); /* of the device */
  const char* const* members RAYMELD_IS(NULL);    /* as "VkPhysicalDeviceFeatures::shaderInt64" */
  const char* without RAYMELD_IS(NULL);           /* what happens where it is not enabled */
} raymeld_feature;

/* Lists them, of a physical device. `features` may be NULL; else it has room for *count, each of the size
 * that the first one says. *count becomes the number of features there are, of which those that there was
 * room for are written. */
RAYMELD_API raymeld_result raymeld_list_features(PFN_vkGetInstanceProcAddr get_instance_proc_addr,
                                                 VkInstance instance, VkPhysicalDevice physical_device,
                                                 uint32_t* count, raymeld_feature* features);

/* What a device is created with beside a chain of features. */
typedef struct raymeld_enabled_features {
  size_t struct_size RAYMELD_IS(sizeof(raymeld_enabled_features));
  uint32_t bits RAYMELD_IS(0); /* raymeld_context_desc::enabled_features */
  uint32_t extension_count RAYMELD_IS(0);
  /* All that are to be named in VkDeviceCreateInfo, beside the caller's own; the library's, for ever. */
  const char* const* extensions RAYMELD_IS(NULL);
} raymeld_enabled_features;

/* Does what raymeld_list_features() lists: sets members of structures in the caller's own chain, with which
 * it then creates the device (VkDeviceCreateInfo::pNext). A feature is enabled where the device supports it
 * and the chain has a structure for each of its members: the one that is listed or
 * VkPhysicalDeviceVulkan11Features and the like. All else in the chain stays as it is. Speed needs
 * VkPhysicalDevice16BitStorageFeatures and VkPhysicalDeviceBufferDeviceAddressFeatures or, of Vulkan 1.2,
 * VkPhysicalDeviceVulkan11Features and VkPhysicalDeviceVulkan12Features. */
RAYMELD_API raymeld_result raymeld_enable_features(PFN_vkGetInstanceProcAddr get_instance_proc_addr,
                                                   VkInstance instance, VkPhysicalDevice physical_device,
                                                   VkPhysicalDeviceFeatures2* features,
                                                   raymeld_enabled_features* enabled);

/* ---- A device ---- */

typedef struct raymeld_context_t* raymeld_context;

typedef struct raymeld_context_desc {
  size_t struct_size RAYMELD_IS(sizeof(raymeld_context_desc));
  /* The caller's device, of Vulkan 1.1 or newer: all of these. Or none: raymeld makes a device of its own. */
  PFN_vkGetInstanceProcAddr get_instance_proc_addr RAYMELD_IS(NULL);
  VkInstance instance RAYMELD_IS(VK_NULL_HANDLE);
  VkPhysicalDevice physical_device RAYMELD_IS(VK_NULL_HANDLE);
  VkDevice device RAYMELD_IS(VK_NULL_HANDLE);
  /* Of queue_family, which does compute. Functions that submit, which say so, take turns in all threads; the
   * caller's own use of it must not coincide with them. */
  VkQueue queue RAYMELD_IS(VK_NULL_HANDLE);
  uint32_t queue_family RAYMELD_IS(0);
  uint32_t enabled_features RAYMELD_IS(0); /* raymeld_feature_bits that `device` was created with */
  /* For all of raymeld's objects on the caller's device; copied. NULL: the driver's own. */
  const VkAllocationCallbacks* allocation_callbacks RAYMELD_IS(NULL);
  /* Of the caller's device, for all pipelines; raymeld keeps none on the disk then. */
  VkPipelineCache pipeline_cache RAYMELD_IS(VK_NULL_HANDLE);
  /* Where pipelines, and what `raymeld tune` measured, are kept between runs. NULL: $XDG_CACHE_HOME/raymeld
   * or $HOME/.cache/raymeld. "": nowhere. */
  const char* cache_folder RAYMELD_IS(NULL);
  /* Of a device of raymeld's own: an index, a UUID or part of the name. NULL: the first GPU, else a driver
   * for CPUs. */
  const char* selector RAYMELD_IS(NULL);
} raymeld_context_desc;

/* Lists the names of the system's devices in the order of the indices that raymeld_context_desc::selector
 * takes. `names` may be NULL; else it has room for *count. *count becomes the number of devices there are, of
 * which those that there was room for are written. The texts are the library's, for ever. */
RAYMELD_API raymeld_result raymeld_list_devices(uint32_t* count, const char** names);

/* `desc` may be NULL. */
RAYMELD_API raymeld_result raymeld_context_create(const raymeld_context_desc* desc, raymeld_context* context);
RAYMELD_API void raymeld_context_destroy(raymeld_context context); /* NULL is none */

/* ---- Memory of other devices, APIs and processes ---- */

typedef struct raymeld_buffer_t* raymeld_buffer;

/* What was exported as a file descriptor, and where the buffer lies in it. */
typedef struct raymeld_import_desc {
  size_t struct_size RAYMELD_IS(sizeof(raymeld_import_desc));
  int fd RAYMELD_IS(-1);
  /* VK_EXTERNAL_MEMORY_HANDLE_TYPE_OPAQUE_FD_BIT, of the same device and driver (see deviceUUID and
   * driverUUID of VkPhysicalDeviceIDProperties). Or VK_EXTERNAL_MEMORY_HANDLE_TYPE_DMA_BUF_BIT_EXT, for which
   * the caller's device has VK_EXT_external_memory_dma_buf enabled. */
  uint32_t handle_type RAYMELD_IS(0);
  VkDeviceSize memory_size_bytes RAYMELD_IS(0); /* what was allocated */
  uint32_t memory_type_index RAYMELD_IS(0);     /* what it was allocated as; not of a dma_buf */
  /* Whether with VkMemoryDedicatedAllocateInfo, of a buffer of size_bytes with the usages STORAGE_BUFFER,
   * TRANSFER_SRC and TRANSFER_DST, all the memory being its. */
  VkBool32 dedicated RAYMELD_IS(VK_FALSE);
  VkDeviceSize offset_bytes RAYMELD_IS(0); /* of the buffer */
  VkDeviceSize size_bytes RAYMELD_IS(0);
} raymeld_import_desc;

/* A buffer for storage and transfer in that memory, on the context's device, which has
 * RAYMELD_FEATURE_EXTERNAL_MEMORY_FD enabled; one of raymeld's own has where there is such a feature. The
 * descriptor is raymeld's from then on, and stays the caller's when the import fails. raymeld_submit()
 * acquires such buffers from VK_QUEUE_FAMILY_EXTERNAL and releases them to it, which is for what the same
 * physical device exported; of others, and where raymeld_record() is used, that is for the caller to record.
 */
RAYMELD_API raymeld_result raymeld_import_buffer(raymeld_context context, const raymeld_import_desc* desc,
                                                 raymeld_buffer* buffer);
RAYMELD_API void raymeld_buffer_destroy(raymeld_buffer buffer); /* NULL is none; no frame may be pending */

typedef struct raymeld_buffer_info {
  size_t struct_size RAYMELD_IS(sizeof(raymeld_buffer_info));
  VkBuffer buffer RAYMELD_IS(VK_NULL_HANDLE); /* for raymeld_image::buffer */
  VkDeviceSize size_bytes RAYMELD_IS(0);
} raymeld_buffer_info;

RAYMELD_API raymeld_result raymeld_buffer_get_info(raymeld_buffer buffer, raymeld_buffer_info* info);

/* ---- A model: a network and its weights ---- */

typedef struct raymeld_model_t* raymeld_model;

/* `file`: a safetensors file, or the name of a stock model, as "x4-fast". A text that has a '/', ends in
 * ".safetensors" or is the path of a file is no name. Stock models are looked for in the folder
 * $RAYMELD_MODELS, then where they are installed with the library, wherever both were moved to. */
RAYMELD_API raymeld_result raymeld_model_load(const char* file, raymeld_model* model);

/* The names of the stock models, in alphabetical order. `names` may be NULL; else it has room for *count.
 * *count becomes the number of models there are, of which those that there was room for are written. The
 * texts are the library's, for ever. */
RAYMELD_API raymeld_result raymeld_list_models(uint32_t* count, const char** names);

/* From what a safetensors file holds, which is copied; errors call it `name`. */
RAYMELD_API raymeld_result raymeld_model_read(const void* bytes, size_t size_bytes, const char* name,
                                              raymeld_model* model);
RAYMELD_API void raymeld_model_destroy(raymeld_model model); /* NULL is none */

/* Texts live as long as the model. */
typedef struct raymeld_model_info {
  size_t struct_size RAYMELD_IS(sizeof(raymeld_model_info));
  const char* name RAYMELD_IS(NULL);
  uint32_t scale RAYMELD_IS(0);       /* full-size pixels to one of LRHS, in each direction: 2, 4 or 8 */
  uint32_t layer_count RAYMELD_IS(0); /* of HRLS, three channels each */
  uint32_t optional_layer_count RAYMELD_IS(0);
  uint32_t reserved RAYMELD_IS(0);
  /* In order: color, albedo, normal, diffuse, specular, variance or some of them. */
  const char* const* layers RAYMELD_IS(NULL);
  const char* const* optional_layers RAYMELD_IS(NULL); /* that it was trained to do without */
  uint64_t parameters RAYMELD_IS(0);
} raymeld_model_info;

RAYMELD_API raymeld_result raymeld_model_get_info(raymeld_model model, raymeld_model_info* info);

/* ---- A fusion: a model made ready for frames of one size on one device ---- */

typedef struct raymeld_fusion_t* raymeld_fusion;

typedef enum raymeld_precision {
  /* fp16 on GPUs with 16-bit storage for models that fit it, else fp32; what fp16 cannot hold, raymeld_fuse()
   * computes again in fp32. */
  RAYMELD_PRECISION_AUTO = 0,
  RAYMELD_PRECISION_FP32 = 1,
  RAYMELD_PRECISION_FP16 = 2 /* 16-bit storage, 32-bit sums; an error without RAYMELD_FEATURE_STORAGE_16BIT */
} raymeld_precision;

/* How convolutions are computed. */
typedef enum raymeld_kernels {
  /* What is fastest on the device: as `raymeld tune` measured, else by its kind. */
  RAYMELD_KERNELS_AUTO = 0,
  /* By the plain sums of their definition, slower: the same bits whatever the tiles. */
  RAYMELD_KERNELS_DIRECT = 1
} raymeld_kernels;

/* Where LRHS samples lie in the s x s full-size pixels they stand for. */
typedef enum raymeld_sampling {
  RAYMELD_SAMPLING_MODEL = 0,   /* as in the images that the model was trained on */
  RAYMELD_SAMPLING_NEAREST = 1, /* the top-left pixel: LRHS is every s-th pixel of a full-size render */
  RAYMELD_SAMPLING_CENTERED = 2 /* the centre: LRHS is a render at low resolution */
} raymeld_sampling;

typedef struct raymeld_fusion_desc {
  size_t struct_size RAYMELD_IS(sizeof(raymeld_fusion_desc));
  uint32_t height RAYMELD_IS(0); /* of LRHS, in pixels; from 1 to 65536 */
  uint32_t width RAYMELD_IS(0);
  raymeld_precision precision RAYMELD_IS(RAYMELD_PRECISION_AUTO);
  raymeld_kernels kernels RAYMELD_IS(RAYMELD_KERNELS_AUTO);
  raymeld_sampling lrhs_sampling RAYMELD_IS(RAYMELD_SAMPLING_MODEL);
  /* HRLS does not hold "variance": the device computes that layer of the color, where the model reads it. */
  VkBool32 compute_variance RAYMELD_IS(VK_FALSE);
  /* Of all that is made on the device, and of the activations in `memory` as well; 0: what it has to give. */
  uint64_t max_memory_bytes RAYMELD_IS(0);
  /* What radiance is multiplied by for the network, from 2^-24 to 2^24, and the output divided by. 0: what
   * suits the model, found of each frame's LRHS: by raymeld_fuse() on the host, see raymeld_exposure(), by
   * raymeld_record() and raymeld_submit() on the device. */
  float exposure RAYMELD_IS(0);
  /* Which of a frame's images are images of Vulkan, LRHS and HRLS as well as the fused one; the others are
   * buffers. Either leaves raymeld_record() alone, as raymeld_fuse() takes buffers. */
  VkBool32 input_images RAYMELD_IS(VK_FALSE);
  VkBool32 output_image RAYMELD_IS(VK_FALSE); /* an error without RAYMELD_FEATURE_IMAGE_WRITES */
  /* raymeld_fuse() keeps its inputs, in host memory, and its output, and computes only the tiles
   * of which a bit has changed since; the others are the last output's. The bits are those of a first call.
   * Everything is computed after a failure, and where the exposure differs: give one. raymeld_record() fails.
   * Takes more memory. */
  VkBool32 changed_only RAYMELD_IS(VK_FALSE);
  /* Those of the model's optional layers that HRLS does not have: nothing is read or computed for them. */
  uint32_t absent_layer_count RAYMELD_IS(0);
  uint32_t reserved RAYMELD_IS(0);
  const char* const* absent_layers RAYMELD_IS(NULL);
  /* The caller's memory for the activations, as raymeld_get_memory_needs() asks for it: size_bytes from
   * memory_offset_bytes on. A frame reads and writes it in VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT;
   * between frames it may serve other purposes, behind barriers of the caller's that make those wait for
   * these and these for those. VK_NULL_HANDLE: raymeld allocates it. */
  VkDeviceMemory memory RAYMELD_IS(VK_NULL_HANDLE);
  VkDeviceSize memory_offset_bytes RAYMELD_IS(0);
  VkDeviceSize memory_size_bytes RAYMELD_IS(0);
} raymeld_fusion_desc;

/* Of a fusion's activations, which are most of what it takes on the device. */
typedef struct raymeld_memory_needs {
  size_t struct_size RAYMELD_IS(sizeof(raymeld_memory_needs));
  VkDeviceSize size_bytes RAYMELD_IS(0);
  VkDeviceSize alignment_bytes RAYMELD_IS(0);
  /* As in VkMemoryRequirements; device-local types are the fast ones. */
  uint32_t memory_type_bits RAYMELD_IS(0);
  /* Whether it must be allocated with VK_MEMORY_ALLOCATE_DEVICE_ADDRESS_BIT. */
  VkBool32 device_address RAYMELD_IS(VK_FALSE);
} raymeld_memory_needs;

/* Of the fusion that raymeld_fusion_create() would make of the same arguments; allocates nothing on the
 * device. */
RAYMELD_API raymeld_result raymeld_get_memory_needs(raymeld_context context, raymeld_model model,
                                                    const raymeld_fusion_desc* desc,
                                                    raymeld_memory_needs* needs);

/* Allocates all that frames need and compiles what the cache does not have. May submit to the queue, and
 * waits. Fusions of one context that have the same weights on the device, as those of one model in several
 * sizes, share them. */
RAYMELD_API raymeld_result raymeld_fusion_create(raymeld_context context, raymeld_model model,
                                                 const raymeld_fusion_desc* desc, raymeld_fusion* fusion);
RAYMELD_API void raymeld_fusion_destroy(raymeld_fusion fusion); /* NULL is none */

/* Texts live as long as the fusion. */
typedef struct raymeld_fusion_info {
  size_t struct_size RAYMELD_IS(sizeof(raymeld_fusion_info));
  raymeld_precision precision RAYMELD_IS(RAYMELD_PRECISION_AUTO); /* never AUTO */
  uint32_t scale RAYMELD_IS(0);
  uint32_t layer_count RAYMELD_IS(0); /* of HRLS, as it is read: without absent ones, three channels each */
  uint32_t frames_in_flight RAYMELD_IS(0); /* that may be recorded and not yet done on the device */
  const char* const* layers RAYMELD_IS(NULL);
  /* The LRHS size that one recording computes: (height, width) of the description unless memory or limits
   * force tiles. A raymeld_fuse() that finds the device out of memory makes it smaller, unless
   * raymeld_record(), raymeld_submit() or, for another size, raymeld_prepare_size() was called before. */
  uint32_t tile_height RAYMELD_IS(0);
  uint32_t tile_width RAYMELD_IS(0);
  uint64_t memory_bytes RAYMELD_IS(0); /* on the device, so far */
} raymeld_fusion_info;

RAYMELD_API raymeld_result raymeld_fusion_get_info(raymeld_fusion fusion, raymeld_fusion_info* info);

/* How a texel is read. */
typedef enum raymeld_texels {
  RAYMELD_TEXELS_PLAIN = 0, /* the first three channels are the values */
  /* Of normals: the first two channels, in [-1, 1], are a unit vector (x, y, z) / (|x| + |y| + |z|), of which
   * the half with z < 0 is folded over: (1 - |y|, 1 - |x|) with the signs of x and y. */
  RAYMELD_TEXELS_OCTAHEDRAL = 1
} raymeld_texels;

/* One of two things, as the fusion's description has it.
 *
 * Floats in a storage buffer: element (c, y, x) is at
 * offset_bytes / 4 + c * channel_stride + y * row_stride + x * pixel_stride; strides count floats. 0: as of a
 * dense planar image, with pixels side by side, rows behind each other, then channels.
 *
 * An image of Vulkan: a 2D view of one level, the colour aspect. Inputs have VK_IMAGE_USAGE_SAMPLED_BIT and
 * any format that is sampled as floats, as R16G16B16A16_SFLOAT, B10G11R11_UFLOAT, A2B10G10R10_UNORM or
 * R8G8B8A8_SRGB; what they hold times value_scale plus value_bias is the value. The output has
 * VK_IMAGE_USAGE_STORAGE_BIT and a format that can be stored to; its alpha becomes 1, and values that its
 * format cannot hold become what the format makes of them. */
typedef struct raymeld_image {
  size_t struct_size RAYMELD_IS(sizeof(raymeld_image));
  VkBuffer buffer RAYMELD_IS(VK_NULL_HANDLE); /* with VK_BUFFER_USAGE_STORAGE_BUFFER_BIT */
  VkDeviceSize offset_bytes RAYMELD_IS(0);    /* a multiple of 4 */
  uint32_t pixel_stride RAYMELD_IS(0);
  uint32_t row_stride RAYMELD_IS(0);
  uint32_t channel_stride RAYMELD_IS(0);
  /* Of an image of Vulkan: what it is in when the recording runs, and left in. GENERAL or, of inputs,
   * SHADER_READ_ONLY_OPTIMAL; UNDEFINED stands for GENERAL. */
  VkImageLayout layout RAYMELD_IS(VK_IMAGE_LAYOUT_UNDEFINED);
  VkImageView view RAYMELD_IS(VK_NULL_HANDLE);
  uint32_t x RAYMELD_IS(0); /* the texel that is the first pixel */
  uint32_t y RAYMELD_IS(0);
  float value_scale RAYMELD_IS(0); /* of inputs; 0 is 1. 2, with a bias of -1, for normals in [0, 1] */
  float value_bias RAYMELD_IS(0);
  raymeld_texels texels RAYMELD_IS(RAYMELD_TEXELS_PLAIN); /* of inputs */
  uint32_t reserved RAYMELD_IS(0);
} raymeld_image;

/* Scene linear; of the tile size: lrhs (tile_height, tile_width, 3), hrls s times as large with 3 channels
 * for each of the fusion's layers, fused s times as large with 3. Row 0 is the top. As images of Vulkan, hrls
 * are as many as the fusion has layers, in an array, all of one struct_size.
 *
 * What layers hold, as Cycles gives them, which the stock models were trained on:
 * - color: radiance, as LRHS has it
 * - albedo: of the first surface that neither mirrors nor refracts; of a lamp its light, up to 1
 * - normal: of that surface, of length 1, in the camera's space (x to the right, y up, z away from it), or 0
 * - diffuse: the part of color that was first reflected diffusely, with the albedo
 * - specular: the part that was first mirrored, refracted or glossy, with its colour
 * - variance: of color; for each channel the mean square less the squared mean over 3x3 pixels, where what
 *   lies beyond a border is the nearest pixel; see compute_variance
 *
 * NaN is read as 0; radiance and variance as no less than 0 and no more than the model was trained for,
 * albedo as in [0, 1], normals in [-1, 1]. */
typedef struct raymeld_frame {
  size_t struct_size RAYMELD_IS(sizeof(raymeld_frame));
  const raymeld_image* lrhs RAYMELD_IS(NULL);
  const raymeld_image* hrls RAYMELD_IS(NULL);
  const raymeld_image* fused RAYMELD_IS(NULL);
  /* As in raymeld_fusion_desc, for this frame; 0: as described there. Where that is 0 too, the device finds
   * in the same recording what raymeld_exposure() would, to within 0.01 % for up to 10 million LRHS pixels,
   * the same bits each time. Parts of a larger frame are given the exposure of all of it: a fusion whose
   * tile_height and tile_width are not the description's refuses 0 for models that ask for an exposure. */
  float exposure RAYMELD_IS(0);
  /* Of LRHS in this frame, where it is not (tile_height, tile_width): a size that raymeld_prepare_size() made
   * ready, to which the images' sizes follow. */
  uint32_t height RAYMELD_IS(0);
  uint32_t width RAYMELD_IS(0);
  uint32_t reserved RAYMELD_IS(0);
} raymeld_frame;

/* For dynamic resolution: makes ready what it takes to record frames with LRHS of another size, at most
 * (tile_height, tile_width) of a fusion that has no tiles. They use the memory, the weights and the pipelines
 * of the fusion, so that sizes may change from frame to frame, and have the bits of a fusion of that size
 * with the same kernels. Takes some milliseconds of the host for each size, once; may compile where of two
 * widths one is even and the other odd; does not wait, and recordings may be pending. raymeld_fuse() has the
 * description's size always. */
RAYMELD_API raymeld_result raymeld_prepare_size(raymeld_fusion fusion, uint32_t height, uint32_t width);

/* Records a frame into the caller's command buffer, outside of a render pass; never submits, allocates on the
 * device or waits, unless a raymeld_fuse() before failed for want of memory, after which everything is made
 * anew. The inputs must be visible to VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT with VK_ACCESS_SHADER_READ_BIT,
 * and the output ready to be written there; it is written in that stage with VK_ACCESS_SHADER_WRITE_BIT, and
 * made visible to the host like what raymeld_take_status() reads; what else reads it waits for that. All
 * layouts stay. At most frames_in_flight recordings may be pending, on one queue, each submitted once, which
 * is not checked; the next recording takes the place of the oldest, whether that was submitted or not.
 *
 * The command buffer is a primary one, for the context's queue family, to which images and buffers belong
 * that are not shared between families. What it has bound for compute (pipeline, descriptor sets, push
 * constants) is not as before. Nothing is needed between recordings for what raymeld keeps itself. `frame` is
 * read here only; what it names lives until the recording is done, and inputs may be overwritten behind
 * VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT.
 *
 * Images have one sample and at least (y + height, x + width) texels, and their formats the features
 * SAMPLED_IMAGE or, of the output, STORAGE_IMAGE; the output's view has no swizzle. Vulkan's validation layer
 * sees such mistakes, raymeld does not.
 *
 * RAYMELD_ERROR_INVALID_ARGUMENT: what was given, or its size, is wrong, and nothing was recorded. Behind
 * other errors the command buffer may hold a part of the frame. */
RAYMELD_API raymeld_result raymeld_record(raymeld_fusion fusion, VkCommandBuffer commands,
                                          const raymeld_frame* frame);

/* Of the caller's device: what a submit waits for and what it signals. */
typedef struct raymeld_semaphores {
  size_t struct_size RAYMELD_IS(sizeof(raymeld_semaphores));
  uint32_t wait_count RAYMELD_IS(0);
  uint32_t signal_count RAYMELD_IS(0);
  const VkSemaphore* wait RAYMELD_IS(NULL);
  /* Of timeline semaphores, for which RAYMELD_FEATURE_TIMELINE_SEMAPHORE is enabled; 0: of a binary one.
   * NULL: all are binary. */
  const uint64_t* wait_values RAYMELD_IS(NULL);
  const VkSemaphore* signal RAYMELD_IS(NULL);
  const uint64_t* signal_values RAYMELD_IS(NULL);
} raymeld_semaphores;

/* Records a frame as raymeld_record() does, into a command buffer of raymeld's own, and submits it to the
 * queue. Does not wait for it, but does, on the host, for the one that was submitted frames_in_flight frames
 * before, unless that is done; those of raymeld_record() count among them, but are the caller's to wait for.
 * The first call allocates. All of the frame comes behind what it waits for. `semaphores` may be NULL.
 * raymeld_take_status(), raymeld_fuse() and raymeld_fusion_destroy() wait for all that was submitted. */
RAYMELD_API raymeld_result raymeld_submit(raymeld_fusion fusion, const raymeld_frame* frame,
                                          const raymeld_semaphores* semaphores);

/* What the device counted; saturated and not_finite are zero for a frame that can be trusted. */
typedef struct raymeld_status {
  size_t struct_size RAYMELD_IS(sizeof(raymeld_status));
  /* With fp16: values within the network beyond 16 bits, stored as the largest. */
  uint32_t saturated RAYMELD_IS(0);
  uint32_t not_finite RAYMELD_IS(0); /* output values that were NaN or infinite, written as 0 */
  /* Of raymeld_fuse(), AUTO: which fp16 could not hold, computed again in fp32. */
  uint32_t redone_tiles RAYMELD_IS(0);
  float kept_share RAYMELD_IS(0); /* of raymeld_fuse(): changed_only */
} raymeld_status;

/* Counts of recorded and submitted frames since the last call or the last raymeld_fuse(); for when those of
 * raymeld_record() are done. */
RAYMELD_API raymeld_result raymeld_take_status(raymeld_fusion fusion, raymeld_status* status);

/* Fuses one frame of host memory, planar and dense: lrhs (3, h, w), hrls (3 for each of the fusion's layers,
 * s h, s w), fused (3, s h, s w). Tiles as needed, submits to the queue and waits. No recorded frame may be
 * pending. `fused` may hold some of the tiles after a failure. `status` may be NULL. */
RAYMELD_API raymeld_result raymeld_fuse(raymeld_fusion fusion, const float* lrhs, const float* hrls,
                                        float* fused, raymeld_status* status);

/* What raymeld_fuse() multiplies radiance by for an LRHS in host memory, as it takes it: the description's
 * exposure, else what brings LRHS to the brightness that the model was trained at. That is k / m^2, from
 * 2^-24 to 2^24, where m is the mean over LRHS of the square root of luminance (Rec. 709), colors being
 * clamped to [0, 65504] and NaN 0, and k the model's exposure_key; 1 where LRHS is black and for models
 * without a key. */
RAYMELD_API raymeld_result raymeld_exposure(raymeld_fusion fusion, const float* lrhs, float* exposure);

#ifdef __cplusplus
}
#endif
#endif
