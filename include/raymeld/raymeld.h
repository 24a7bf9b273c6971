/* raymeld as a library. It fuses a small render with many samples a pixel (LRHS) and a full-size render with
 * few (HRLS) into the image that a full-size render with many would have given, on a Vulkan device.
 *
 * Every function that may fail returns a raymeld_result; raymeld_error() then says what raymeld was doing and
 * what it expected. A function that fails leaves nothing behind, and leaves its out parameters as they were,
 * unless its comment says otherwise. Any function may return RAYMELD_ERROR_INVALID_ARGUMENT,
 * RAYMELD_ERROR_OUT_OF_MEMORY or RAYMELD_ERROR_INTERNAL. Its comment names the other results that it returns.
 *
 * Every structure begins with its size: struct_size = sizeof(the structure). The library sees from it with
 * which version of the structure a program was compiled. Any other member may be zero, which asks for the
 * default; in C++ all members have initializers. Reserved members must be zero.
 *
 * Handles may be destroyed in any order: an object keeps what it needs of the objects that it was made with.
 * Vulkan objects and memory of the caller must outlive the objects that are made with them. A fusion must not
 * be destroyed while one of its recordings in the caller's command buffers is pending. Several threads may
 * use a context or a model at once, but only one thread at a time may use a fusion. */
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
#if defined(_WIN32) && defined(RAYMELD_BUILDING)
#define RAYMELD_API __declspec(dllexport)
#elif defined(_WIN32)
#define RAYMELD_API __declspec(dllimport)
#elif defined(__GNUC__)
#define RAYMELD_API __attribute__((visibility("default")))
#else
#define RAYMELD_API
#endif

typedef enum raymeld_result {
  RAYMELD_SUCCESS = 0,
  RAYMELD_ERROR_INVALID_ARGUMENT = 1, /* an argument is not what its description says */
  RAYMELD_ERROR_MODEL = 2,            /* the file or memory is not a model */
  RAYMELD_ERROR_DEVICE = 3,           /* the device cannot do it, or a call of Vulkan failed */
  RAYMELD_ERROR_OUT_OF_MEMORY = 4,    /* the device or the host has no memory left */
  RAYMELD_ERROR_DEVICE_LOST = 5,      /* objects that were made on the device can no longer be used */
  RAYMELD_ERROR_NOT_FINITE = 6,       /* the network's output is not finite; the image is of no use */
  RAYMELD_ERROR_INTERNAL = 7,         /* a fault in raymeld */
  RAYMELD_ERROR_CANCELLED = 8         /* a callback of the caller's asked to stop */
} raymeld_result;

/* Returns the message of this thread's last failure, in English and UTF-8, or "" if no function has failed.
 * The text lives until the thread's next failure. */
RAYMELD_API const char* raymeld_error(void);

/* Returns the library's version: major << 16 | minor << 8 | patch. A library serves all programs that were
 * compiled with the same major and minor version and with the same or an older patch. */
RAYMELD_API uint32_t raymeld_version(void);

/* ---- Features of a device ---- */

/* Names the features beyond Vulkan 1.1 that raymeld can use. None of them is required. */
typedef enum raymeld_feature_bits {
  RAYMELD_FEATURE_STORAGE_16BIT = 1,
  RAYMELD_FEATURE_BUFFER_DEVICE_ADDRESS = 2,
  RAYMELD_FEATURE_COOPERATIVE_MATRIX = 4,
  RAYMELD_FEATURE_IMAGE_WRITES = 8,
  RAYMELD_FEATURE_TIMELINE_SEMAPHORE = 16,
  RAYMELD_FEATURE_EXTERNAL_MEMORY_FD = 32,
  RAYMELD_FEATURE_FLOAT_CONTROLS = 64,
  RAYMELD_FEATURE_HALF_DOTS = 128
} raymeld_feature_bits;

/* Describes a feature. Its extensions and its members of feature structures must be enabled all together, or
 * none of them. The texts belong to the library and live for ever. */
typedef struct raymeld_feature {
  size_t struct_size RAYMELD_IS(sizeof(raymeld_feature));
  uint32_t bit RAYMELD_IS(0);              /* one of raymeld_feature_bits */
  VkBool32 supported RAYMELD_IS(VK_FALSE); /* VK_TRUE: the physical device supports it */
  uint32_t extension_count RAYMELD_IS(0);
  uint32_t member_count RAYMELD_IS(0);
  const char* const* extensions RAYMELD_IS(NULL); /* names of device extensions */
  const char* const* members RAYMELD_IS(NULL);    /* such as "VkPhysicalDeviceFeatures::shaderInt64" */
  const char* without RAYMELD_IS(NULL);           /* the effect of not enabling it, in English */
} raymeld_feature;

/* Lists the features for a physical device. `features` may be NULL; else it has room for *count elements,
 * each of the size that the first one's struct_size gives. Writes as many features as there is room for, and
 * sets *count to the number of features there are. Returns RAYMELD_ERROR_DEVICE if the instance lacks a
 * function of Vulkan 1.1. */
RAYMELD_API raymeld_result raymeld_list_features(PFN_vkGetInstanceProcAddr get_instance_proc_addr,
                                                 VkInstance instance, VkPhysicalDevice physical_device,
                                                 uint32_t* count, raymeld_feature* features);

/* Says what to create a device with, in addition to the chain of features. */
typedef struct raymeld_enabled_features {
  size_t struct_size RAYMELD_IS(sizeof(raymeld_enabled_features));
  uint32_t bits RAYMELD_IS(0); /* the value for raymeld_context_desc::enabled_features */
  uint32_t extension_count RAYMELD_IS(0);
  /* Names the extensions to enable in VkDeviceCreateInfo, in addition to the caller's own. The texts belong
   * to the library and live for ever. */
  const char* const* extensions RAYMELD_IS(NULL);
} raymeld_enabled_features;

/* Enables the features of raymeld_list_features(): sets members of structures in the caller's own chain, with
 * which the caller then creates the device (VkDeviceCreateInfo::pNext). A feature is enabled if the device
 * supports it and the chain has a structure for each of its members: the listed structure or one like
 * VkPhysicalDeviceVulkan11Features. All else in the chain stays as it is. raymeld is slow without
 * VkPhysicalDevice16BitStorageFeatures and VkPhysicalDeviceBufferDeviceAddressFeatures or, with Vulkan 1.2,
 * VkPhysicalDeviceVulkan11Features and VkPhysicalDeviceVulkan12Features. Returns RAYMELD_ERROR_DEVICE as
 * raymeld_list_features() does. */
RAYMELD_API raymeld_result raymeld_enable_features(PFN_vkGetInstanceProcAddr get_instance_proc_addr,
                                                   VkInstance instance, VkPhysicalDevice physical_device,
                                                   VkPhysicalDeviceFeatures2* features,
                                                   raymeld_enabled_features* enabled);

/* ---- A device ---- */

typedef struct raymeld_context_t* raymeld_context;

typedef struct raymeld_context_desc {
  size_t struct_size RAYMELD_IS(sizeof(raymeld_context_desc));
  /* These name the caller's device, of Vulkan 1.1 or newer; give all of them and `queue`. If all are NULL,
   * raymeld makes a device of its own. */
  PFN_vkGetInstanceProcAddr get_instance_proc_addr RAYMELD_IS(NULL);
  VkInstance instance RAYMELD_IS(VK_NULL_HANDLE);
  VkPhysicalDevice physical_device RAYMELD_IS(VK_NULL_HANDLE);
  VkDevice device RAYMELD_IS(VK_NULL_HANDLE);
  /* Names a queue of queue_family, which supports compute. Functions that submit, which say so, take turns in
   * all threads; the caller must not use the queue at the same time as they do. */
  VkQueue queue RAYMELD_IS(VK_NULL_HANDLE);
  uint32_t queue_family RAYMELD_IS(0);
  uint32_t enabled_features RAYMELD_IS(0); /* raymeld_feature_bits that `device` was created with */
  /* Gives the allocator for all of raymeld's objects on the caller's device; the structure is copied. NULL:
   * the driver's allocator. */
  const VkAllocationCallbacks* allocation_callbacks RAYMELD_IS(NULL);
  /* Gives a cache on the caller's device for all pipelines. With it raymeld keeps none on the disk. */
  VkPipelineCache pipeline_cache RAYMELD_IS(VK_NULL_HANDLE);
  /* Names the folder that keeps pipelines and the results of raymeld_tune() between runs. NULL:
   * $XDG_CACHE_HOME/raymeld or $HOME/.cache/raymeld, and on Windows %LOCALAPPDATA%\raymeld. "": nothing is
   * kept. */
  const char* cache_folder RAYMELD_IS(NULL);
  /* Selects a device of raymeld's own by an index, a UUID or part of the name. NULL: the first GPU, else a
   * driver for CPUs. */
  const char* selector RAYMELD_IS(NULL);
  /* Names a folder with tunings that the application brings along: files of raymeld_tune() from this or other
   * devices. Of one for this device and driver counts what the one of cache_folder lacks. NULL: there are
   * none. */
  const char* tuning_folder RAYMELD_IS(NULL);
} raymeld_context_desc;

/* Lists the names of the system's devices in the order of the indices that raymeld_context_desc::selector
 * takes. `names` may be NULL; else it has room for *count names. Writes as many names as there is room for,
 * and sets *count to the number of devices there are. The texts belong to the library and live for ever.
 * Returns RAYMELD_ERROR_DEVICE if there is no device of Vulkan 1.1. */
RAYMELD_API raymeld_result raymeld_list_devices(uint32_t* count, const char** names);

/* Makes a context; a NULL `desc` asks for the defaults. Returns RAYMELD_ERROR_DEVICE if there is no such
 * device or it cannot be used. */
RAYMELD_API raymeld_result raymeld_context_create(const raymeld_context_desc* desc, raymeld_context* context);
RAYMELD_API void raymeld_context_destroy(raymeld_context context); /* ignores NULL */

/* ---- Memory of other devices, APIs and processes ---- */

typedef struct raymeld_buffer_t* raymeld_buffer;

/* Describes memory that was exported as a file descriptor, and where the buffer lies in it. */
typedef struct raymeld_import_desc {
  size_t struct_size RAYMELD_IS(sizeof(raymeld_import_desc));
  int fd RAYMELD_IS(-1);
  /* Is VK_EXTERNAL_MEMORY_HANDLE_TYPE_OPAQUE_FD_BIT for memory of the same device and driver (see deviceUUID
   * and driverUUID of VkPhysicalDeviceIDProperties), or VK_EXTERNAL_MEMORY_HANDLE_TYPE_DMA_BUF_BIT_EXT, which
   * needs VK_EXT_external_memory_dma_buf enabled on the caller's device. */
  uint32_t handle_type RAYMELD_IS(0);
  VkDeviceSize memory_size_bytes RAYMELD_IS(0); /* the size of the allocation */
  uint32_t memory_type_index RAYMELD_IS(0);     /* the type of the allocation; not read for a dma_buf */
  /* VK_TRUE: the memory was allocated with VkMemoryDedicatedAllocateInfo, for a buffer of size_bytes with the
   * usages STORAGE_BUFFER, TRANSFER_SRC and TRANSFER_DST that takes all of it. */
  VkBool32 dedicated RAYMELD_IS(VK_FALSE);
  VkDeviceSize offset_bytes RAYMELD_IS(0); /* the buffer's place in the memory */
  VkDeviceSize size_bytes RAYMELD_IS(0);
} raymeld_import_desc;

/* Makes a buffer for storage and transfer in that memory, on the context's device. The device must have
 * RAYMELD_FEATURE_EXTERNAL_MEMORY_FD enabled; a device of raymeld's own has it where it is supported. On
 * success raymeld owns the descriptor; on failure it stays the caller's. raymeld_submit() acquires such
 * buffers from VK_QUEUE_FAMILY_EXTERNAL and releases them to it, which suits memory that the same physical
 * device exported. For memory of other devices, and with raymeld_record(), the caller records these
 * transfers. Returns RAYMELD_ERROR_DEVICE if the device cannot import the memory. */
RAYMELD_API raymeld_result raymeld_import_buffer(raymeld_context context, const raymeld_import_desc* desc,
                                                 raymeld_buffer* buffer);
/* Ignores NULL. No frame that uses the buffer may be pending. */
RAYMELD_API void raymeld_buffer_destroy(raymeld_buffer buffer);

typedef struct raymeld_buffer_info {
  size_t struct_size RAYMELD_IS(sizeof(raymeld_buffer_info));
  VkBuffer buffer RAYMELD_IS(VK_NULL_HANDLE); /* the value for raymeld_image::buffer */
  VkDeviceSize size_bytes RAYMELD_IS(0);
} raymeld_buffer_info;

/* Writes the buffer's Vulkan handle and its size. */
RAYMELD_API raymeld_result raymeld_buffer_get_info(raymeld_buffer buffer, raymeld_buffer_info* info);

/* ---- A model: a network and its weights ----
 *
 * A model may read one of the renders alone. raymeld_fuse() and raymeld_frame then take NULL for the other. A
 * model that reads HRLS alone denoises it. Its scale is 1, and what is said of the size of LRHS and of its
 * brightness holds for HRLS and its color. A model that reads LRHS alone upscales it, and has no layers. */

typedef struct raymeld_model_t* raymeld_model;

/* Loads a model. `file` is the path of a safetensors file or the name of a stock model, such as "x4-fast". A
 * text that names a folder, ends in ".safetensors" or is the path of a file is not a name. Stock models are
 * looked for in the folder $RAYMELD_MODELS, then where they are installed with the library, wherever both
 * were moved to. Returns RAYMELD_ERROR_MODEL if there is no such model or the file is not a model. */
RAYMELD_API raymeld_result raymeld_model_load(const char* file, raymeld_model* model);

/* Lists the names of the stock models, in alphabetical order. `names` may be NULL; else it has room for
 * *count names. Writes as many names as there is room for, and sets *count to the number of models there are.
 * The texts belong to the library and live for ever. */
RAYMELD_API raymeld_result raymeld_list_models(uint32_t* count, const char** names);

/* Makes a model from the bytes of a safetensors file, which are copied. Messages call it `name`, or "model in
 * memory" if `name` is NULL. Returns RAYMELD_ERROR_MODEL if the bytes are not a model. */
RAYMELD_API raymeld_result raymeld_model_read(const void* bytes, size_t size_bytes, const char* name,
                                              raymeld_model* model);
RAYMELD_API void raymeld_model_destroy(raymeld_model model); /* ignores NULL */

/* Describes a model. The texts live as long as the model. */
typedef struct raymeld_model_info {
  size_t struct_size RAYMELD_IS(sizeof(raymeld_model_info));
  const char* name RAYMELD_IS(NULL);
  uint32_t scale RAYMELD_IS(0);       /* full-size pixels per LRHS pixel in each direction: 1, 2, 4 or 8 */
  uint32_t layer_count RAYMELD_IS(0); /* the number of HRLS layers, three channels each */
  uint32_t optional_layer_count RAYMELD_IS(0);
  VkBool32 knows_spp RAYMELD_IS(VK_FALSE); /* VK_TRUE: raymeld_fusion_desc::lrhs_spp and hrls_spp matter */
  /* Lists the layers by channel: color first, then any of albedo, normal, diffuse, specular, variance. */
  const char* const* layers RAYMELD_IS(NULL);
  const char* const* optional_layers RAYMELD_IS(NULL); /* layers that the model was trained to do without */
  uint64_t parameters RAYMELD_IS(0);                   /* the number of weights and biases */
  VkBool32 reads_lrhs RAYMELD_IS(VK_FALSE);            /* VK_TRUE: the scale is not 1 */
  VkBool32 reads_hrls RAYMELD_IS(VK_FALSE);            /* VK_TRUE: there are layers */
} raymeld_model_info;

/* Writes the description of a model. */
RAYMELD_API raymeld_result raymeld_model_get_info(raymeld_model model, raymeld_model_info* info);

/* ---- A fusion: a model made ready for frames of one size on one device ---- */

typedef struct raymeld_fusion_t* raymeld_fusion;

/* Chooses how values within the network are stored. */
typedef enum raymeld_precision {
  /* Takes fp16 on GPUs with 16-bit storage for models that fit it, else fp32. raymeld_fuse() computes a tile
   * again in fp32 if fp16 cannot hold its values. */
  RAYMELD_PRECISION_AUTO = 0,
  RAYMELD_PRECISION_FP32 = 1,
  RAYMELD_PRECISION_FP16 = 2 /* 16-bit storage, 32-bit sums; an error without RAYMELD_FEATURE_STORAGE_16BIT */
} raymeld_precision;

/* Chooses how convolutions are computed. */
typedef enum raymeld_kernels {
  /* Takes the fastest kernels on the device: those that raymeld_tune() measured, else those for its kind. */
  RAYMELD_KERNELS_AUTO = 0,
  /* Computes the plain sums of the definition, which are slower but give the same bits for all tile sizes. */
  RAYMELD_KERNELS_DIRECT = 1
} raymeld_kernels;

/* Says where LRHS samples lie in the s x s full-size pixels that they stand for. */
typedef enum raymeld_sampling {
  RAYMELD_SAMPLING_MODEL = 0,   /* the place in the images that the model was trained on */
  RAYMELD_SAMPLING_NEAREST = 1, /* the top-left pixel: LRHS is every s-th pixel of a full-size render */
  RAYMELD_SAMPLING_CENTERED = 2 /* the centre: LRHS is a render at low resolution */
} raymeld_sampling;

/* Describes a fusion that is to be made. */
typedef struct raymeld_fusion_desc {
  size_t struct_size RAYMELD_IS(sizeof(raymeld_fusion_desc));
  uint32_t height RAYMELD_IS(0); /* the height of LRHS in pixels, from 1 to 65536 */
  uint32_t width RAYMELD_IS(0);  /* the width of LRHS in pixels, from 1 to 65536 */
  raymeld_precision precision RAYMELD_IS(RAYMELD_PRECISION_AUTO);
  raymeld_kernels kernels RAYMELD_IS(RAYMELD_KERNELS_AUTO);
  raymeld_sampling lrhs_sampling RAYMELD_IS(RAYMELD_SAMPLING_MODEL);
  /* Say how many samples a pixel of each render has, for models that know it (raymeld_model_info). 0: as many
   * as usual, scale^2 and 1. Counts are clamped to 1 to 256 and 1 to 16. */
  float lrhs_spp RAYMELD_IS(0);
  float hrls_spp RAYMELD_IS(0);
  /* VK_TRUE: HRLS does not hold "variance"; the device computes it from the color if the model reads it. */
  VkBool32 compute_variance RAYMELD_IS(VK_FALSE);
  /* Limits the memory that the fusion takes on the device, with what lies in `memory` and `history_memory`.
   * 0: as much as the device has. */
  uint64_t max_memory_bytes RAYMELD_IS(0);
  /* Gives the factor by which radiance is multiplied for the network and the output is divided, from 2^-24 to
   * 2^24. 0: the factor that suits the model, computed from each frame's LRHS. raymeld_fuse() computes it on
   * the host (see raymeld_exposure()), raymeld_record() and raymeld_submit() on the device. */
  float exposure RAYMELD_IS(0);
  /* VK_TRUE: LRHS and HRLS (input_images) or the fused image (output_image) of a frame are Vulkan images;
   * else they are buffers. With either, raymeld_fuse() fails, as it takes no Vulkan images. */
  VkBool32 input_images RAYMELD_IS(VK_FALSE);
  VkBool32 output_image RAYMELD_IS(VK_FALSE); /* an error without RAYMELD_FEATURE_IMAGE_WRITES */
  /* VK_TRUE: raymeld_fuse() keeps its inputs and its output, which takes more host memory. It computes only
   * the tiles of which an input bit has changed since the last call, and takes the others from the last
   * output. The result has the same bits as that of a first call. Everything is computed after a failure, and
   * if the exposure has changed, so give an exposure. raymeld_record() and raymeld_submit() fail. */
  VkBool32 skip_unchanged RAYMELD_IS(VK_FALSE);
  /* Names the optional layers of the model that HRLS does not have. They count as 0, and nothing is read. */
  uint32_t absent_layer_count RAYMELD_IS(0);
  /* VK_TRUE: each frame is joined with the ones before it, whose light it takes over where motion leads, so
   * that frames of few samples add up. A frame then needs its motion: see raymeld_frame and
   * raymeld_fuse_next(). Takes two buffers for what is kept, of (3 for each layer but the variance, and 7)
   * floats a full-size pixel and 6 a pixel of LRHS. For pyramid networks that know the samples of a pixel
   * (raymeld_model_info), with an ordinary small render as LRHS and with compute_variance if the model reads
   * the variance. No tile is computed again in fp32. */
  VkBool32 temporal RAYMELD_IS(VK_FALSE);
  const char* const* absent_layers RAYMELD_IS(NULL);
  /* Gives the caller's memory for the activations, memory_size_bytes from memory_offset_bytes on, as
   * raymeld_get_memory_needs() asks for it. A frame reads and writes it in
   * VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT. Between frames it may serve other purposes, if barriers of the
   * caller make frames and these uses wait for each other. VK_NULL_HANDLE: raymeld allocates the memory. */
  VkDeviceMemory memory RAYMELD_IS(VK_NULL_HANDLE);
  VkDeviceSize memory_offset_bytes RAYMELD_IS(0);
  VkDeviceSize memory_size_bytes RAYMELD_IS(0);
  /* Gives the caller's memory for what is kept with `temporal`, history_memory_size_bytes from
   * history_memory_offset_bytes on, as raymeld_get_memory_needs() asks for it. It belongs to the fusion for
   * as long as that lives. VK_NULL_HANDLE: raymeld allocates the memory. */
  VkDeviceMemory history_memory RAYMELD_IS(VK_NULL_HANDLE);
  VkDeviceSize history_memory_offset_bytes RAYMELD_IS(0);
  VkDeviceSize history_memory_size_bytes RAYMELD_IS(0);
  /* VK_TRUE, with `temporal`: motion has four channels; see raymeld_frame. Depths tell surfaces apart that
   * have one albedo and one normal. */
  VkBool32 motion_depth RAYMELD_IS(VK_FALSE);
  uint32_t reserved RAYMELD_IS(0);
} raymeld_fusion_desc;

/* Says what raymeld_tune() measures. */
typedef struct raymeld_tune_desc {
  size_t struct_size RAYMELD_IS(sizeof(raymeld_tune_desc));
  uint32_t height RAYMELD_IS(0); /* the size of LRHS in pixels, as in raymeld_fusion_desc */
  uint32_t width RAYMELD_IS(0);
  raymeld_precision precision RAYMELD_IS(RAYMELD_PRECISION_AUTO);
  VkBool32 again RAYMELD_IS(VK_FALSE); /* VK_TRUE: what is known already is measured anew */
  /* Names the folder that the result is written to, such as one to be shipped as tuning_folder. NULL: the
   * context's cache folder. */
  const char* folder RAYMELD_IS(NULL);
  /* Is called in the caller's thread at the start and after each layer, with the share that is done, from 0
   * to 1, and `user`. Returns VK_FALSE to stop; what was measured is kept. NULL: nothing is called. */
  VkBool32 (*progress)(void* user, float done) RAYMELD_IS(NULL);
  void* user RAYMELD_IS(NULL);
} raymeld_tune_desc;

/* Measures which kernels are fastest for a model on the context's device, from the layer of the most work to
 * that of the least, and writes them to a file that names the device and its driver. Fusions that are made
 * later use them, if `folder` is the context's cache folder or its tuning_folder. Submits to the queue and
 * waits. Takes seconds on a GPU and minutes on a CPU; nothing else should use the device. Returns
 * RAYMELD_ERROR_CANCELLED if `progress` said so before the end, and RAYMELD_ERROR_DEVICE or
 * RAYMELD_ERROR_DEVICE_LOST if a call of Vulkan fails or there is no folder to write to. */
RAYMELD_API raymeld_result raymeld_tune(raymeld_context context, raymeld_model model,
                                        const raymeld_tune_desc* desc);

/* Says what memory a fusion's activations need, and what it keeps with `temporal`. They are most of what it
 * takes on the device. */
typedef struct raymeld_memory_needs {
  size_t struct_size RAYMELD_IS(sizeof(raymeld_memory_needs));
  VkDeviceSize size_bytes RAYMELD_IS(0);
  VkDeviceSize alignment_bytes RAYMELD_IS(0);
  /* Holds the memory types as in VkMemoryRequirements; device-local types are the fast ones. */
  uint32_t memory_type_bits RAYMELD_IS(0);
  /* VK_TRUE: the memory must be allocated with VK_MEMORY_ALLOCATE_DEVICE_ADDRESS_BIT. */
  VkBool32 device_address RAYMELD_IS(VK_FALSE);
  /* Holds the bytes of what is kept, whose alignment and memory types are the same; 0 without `temporal`. */
  VkDeviceSize history_size_bytes RAYMELD_IS(0);
} raymeld_memory_needs;

/* Computes the memory needs of the fusion that raymeld_fusion_create() would make of the same arguments.
 * Allocates nothing on the device. Returns RAYMELD_ERROR_DEVICE if not even the smallest tile fits. */
RAYMELD_API raymeld_result raymeld_get_memory_needs(raymeld_context context, raymeld_model model,
                                                    const raymeld_fusion_desc* desc,
                                                    raymeld_memory_needs* needs);

/* Makes a fusion: allocates all that frames need and compiles the pipelines that the cache does not have. May
 * submit to the queue, and waits. Fusions of one context that have the same weights on the device, such as
 * those of one model in several sizes, share them. Returns RAYMELD_ERROR_DEVICE or RAYMELD_ERROR_DEVICE_LOST
 * if the device cannot do it. */
RAYMELD_API raymeld_result raymeld_fusion_create(raymeld_context context, raymeld_model model,
                                                 const raymeld_fusion_desc* desc, raymeld_fusion* fusion);
RAYMELD_API void raymeld_fusion_destroy(raymeld_fusion fusion); /* ignores NULL */

/* Describes a fusion. The texts live as long as the fusion. */
typedef struct raymeld_fusion_info {
  size_t struct_size RAYMELD_IS(sizeof(raymeld_fusion_info));
  raymeld_precision precision RAYMELD_IS(RAYMELD_PRECISION_AUTO); /* the precision in use, never AUTO */
  uint32_t scale RAYMELD_IS(0);
  /* Counts the layers that HRLS holds, three channels each, without absent ones or a computed variance. */
  uint32_t layer_count RAYMELD_IS(0);
  uint32_t frames_in_flight RAYMELD_IS(0); /* the most recordings that may be pending */
  const char* const* layers RAYMELD_IS(NULL);
  /* Hold the LRHS size that one recording computes: that of the description, unless memory or limits of the
   * device force tiles. A raymeld_fuse() that finds the device out of memory makes it smaller, unless
   * raymeld_record(), raymeld_submit() or, for another size, raymeld_prepare_size() was called before. */
  uint32_t tile_height RAYMELD_IS(0);
  uint32_t tile_width RAYMELD_IS(0);
  uint64_t memory_bytes RAYMELD_IS(0);  /* memory that the fusion has allocated on the device so far */
  uint64_t history_bytes RAYMELD_IS(0); /* the size of a saved history; 0 without temporal */
} raymeld_fusion_info;

/* Writes the description of a fusion. */
RAYMELD_API raymeld_result raymeld_fusion_get_info(raymeld_fusion fusion, raymeld_fusion_info* info);

/* Says how a texel is read. */
typedef enum raymeld_texels {
  RAYMELD_TEXELS_PLAIN = 0, /* the first three channels are the values */
  /* Normals: the first two channels, in [-1, 1], are x and y of (x, y, z) / (|x| + |y| + |z|) for a unit
   * vector (x, y, z). Where z < 0 they are folded over, to (1 - |y|, 1 - |x|) with the signs of x and y. */
  RAYMELD_TEXELS_OCTAHEDRAL = 1
} raymeld_texels;

/* Names a storage buffer or a Vulkan image, as the fusion's description says.
 *
 * A storage buffer holds floats. Element (c, y, x) is at
 * offset_bytes / 4 + c * channel_stride + y * row_stride + x * pixel_stride, where strides count floats. A
 * stride of 0 means that of a dense planar image: first the pixels of a row, then rows, then channels.
 *
 * A Vulkan image is given by a 2D view of one level and of the colour aspect. Inputs have
 * VK_IMAGE_USAGE_SAMPLED_BIT and any format that is sampled as floats, such as R16G16B16A16_SFLOAT,
 * B10G11R11_UFLOAT, A2B10G10R10_UNORM or R8G8B8A8_SRGB. Their values are those of the texels times
 * value_scale plus value_bias. The output has VK_IMAGE_USAGE_STORAGE_BIT and a format that can be stored to.
 * Its alpha becomes 1, and values that its format cannot hold are converted as Vulkan defines. */
typedef struct raymeld_image {
  size_t struct_size RAYMELD_IS(sizeof(raymeld_image));
  VkBuffer buffer RAYMELD_IS(VK_NULL_HANDLE); /* has VK_BUFFER_USAGE_STORAGE_BUFFER_BIT */
  VkDeviceSize offset_bytes RAYMELD_IS(0);    /* a multiple of 4 */
  uint32_t pixel_stride RAYMELD_IS(0);
  uint32_t row_stride RAYMELD_IS(0);
  uint32_t channel_stride RAYMELD_IS(0);
  /* Names the layout in which a Vulkan image is when the recording runs, and in which it is left: GENERAL or,
   * for inputs, SHADER_READ_ONLY_OPTIMAL. UNDEFINED stands for GENERAL. */
  VkImageLayout layout RAYMELD_IS(VK_IMAGE_LAYOUT_UNDEFINED);
  VkImageView view RAYMELD_IS(VK_NULL_HANDLE);
  uint32_t x RAYMELD_IS(0); /* (x, y) is the texel of the first pixel */
  uint32_t y RAYMELD_IS(0);
  /* Apply to inputs only; a scale of 0 stands for 1. Normals in [0, 1] need a scale of 2 and a bias of -1. */
  float value_scale RAYMELD_IS(0);
  float value_bias RAYMELD_IS(0);
  raymeld_texels texels RAYMELD_IS(RAYMELD_TEXELS_PLAIN); /* inputs only */
  uint32_t reserved RAYMELD_IS(0);
} raymeld_image;

/* Describes a frame. Its images are scene linear, row 0 is the top, and they have the tile size: lrhs
 * (tile_height, tile_width, 3), hrls s times as large with 3 channels for each of the fusion's layers, and
 * fused s times as large with 3 channels. If the inputs are Vulkan images, hrls is an array of one image for
 * each of the fusion's layers, all of one struct_size.
 *
 * The stock models were trained on layers as Cycles writes them:
 * - color: radiance, as in LRHS
 * - albedo: that of the first surface that neither mirrors nor refracts; for a lamp its light, up to 1
 * - normal: that of the same surface, of length 1, in the camera's space (x to the right, y up, z away from
 *   the camera), or 0
 * - diffuse: the part of color that was first reflected diffusely, multiplied by the albedo
 * - specular: the part of color that was first mirrored, refracted or glossy, multiplied by its colour
 * - variance: that of color; for each channel the mean square less the squared mean over 3x3 pixels, where
 *   pixels beyond a border are the nearest pixel; see compute_variance
 *
 * NaN is read as 0. Radiance and variance are clamped to at least 0 and at most what the model was trained
 * for, albedo to [0, 1] and normals to [-1, 1]. */
typedef struct raymeld_frame {
  size_t struct_size RAYMELD_IS(sizeof(raymeld_frame));
  const raymeld_image* lrhs RAYMELD_IS(NULL);
  const raymeld_image* hrls RAYMELD_IS(NULL);
  const raymeld_image* fused RAYMELD_IS(NULL);
  /* Is this frame's exposure, as in raymeld_fusion_desc. 0: the description's. If that is 0 too, the device
   * computes in the same recording what raymeld_exposure() would, to within 0.01 % for up to 10 million LRHS
   * pixels and with the same bits each time. Parts of a larger frame need the exposure of the whole frame: a
   * fusion whose tile size is not the description's size refuses 0 for models that ask for an exposure. */
  float exposure RAYMELD_IS(0);
  /* Give the LRHS size of this frame; 0 stands for tile_height and tile_width. Another size must have been
   * given to raymeld_prepare_size(), and determines the sizes of the images. */
  uint32_t height RAYMELD_IS(0);
  uint32_t width RAYMELD_IS(0);
  uint32_t reserved RAYMELD_IS(0);
  /* Leads from each full-size pixel to the same point in the last frame, in pixels to the right and
   * downwards: two channels, as large as hrls, and without what a jittered camera moves. Needed with
   * temporal, and NULL without. Where it is not finite there is no such point. If the inputs are Vulkan
   * images, it is one. With motion_depth it has two more channels: the depth of the point, and the depth that
   * it had in the last frame, both in one unit, along the ray or along the view. Where only the first is
   * known it may serve as both. What is not positive and finite says nothing. The value_scale of an image
   * counts for depths as well, so it must be positive, and value_bias 0. */
  const raymeld_image* motion RAYMELD_IS(NULL);
} raymeld_frame;

/* Makes ready what is needed to record frames with another LRHS size, for dynamic resolution. The fusion must
 * not be in tiles, and the size is at most (tile_height, tile_width). Such frames use the memory, the weights
 * and the pipelines of the fusion, so that sizes may change from frame to frame. They have the bits of a
 * fusion of that size with the same kernels. The first call for a size takes some milliseconds of the host,
 * and may compile if one of the two widths is even and the other odd. It does not wait, and recordings may be
 * pending. raymeld_fuse() always takes the description's size. Returns RAYMELD_ERROR_DEVICE if a call of
 * Vulkan fails. */
RAYMELD_API raymeld_result raymeld_prepare_size(raymeld_fusion fusion, uint32_t height, uint32_t width);

/* Records a frame into the caller's command buffer, outside of a render pass. Never submits, allocates on the
 * device or waits, unless an earlier raymeld_fuse() failed for lack of memory; then everything is made anew.
 *
 * The inputs must be visible to VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT with VK_ACCESS_SHADER_READ_BIT, and the
 * output must be ready to be written there. The output is written in that stage with
 * VK_ACCESS_SHADER_WRITE_BIT, and is made visible to the host, as is what raymeld_take_status() reads. All
 * other readers of the output must wait for that stage and access. All layouts stay. At most frames_in_flight
 * recordings may be pending, on one queue, each submitted once; this is not checked. The next recording takes
 * the place of the oldest, whether that was submitted or not.
 *
 * With `temporal` a recording goes on with the frame of the one before, so all must be submitted, in the
 * order in which they were recorded. A frame of another size than the last one is the first of a sequence. A
 * fusion whose tile size is not the description's size returns RAYMELD_ERROR_DEVICE.
 *
 * The command buffer is a primary one, for the context's queue family. Images and buffers that are not shared
 * between families must belong to that family. The pipeline, the descriptor sets and the push constants that
 * were bound for compute are replaced. raymeld's own memory needs no barriers between recordings. `frame` is
 * read during this call only. The objects that it names must live until the recording is done, and inputs may
 * be overwritten after VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT.
 *
 * Vulkan images have one sample, at least (y + height, x + width) texels, and a format with the feature
 * SAMPLED_IMAGE or, for the output, STORAGE_IMAGE. The output's view has no swizzle. Vulkan's validation
 * layer finds mistakes in these; raymeld does not.
 *
 * RAYMELD_ERROR_INVALID_ARGUMENT says that an argument or its size is wrong, and that nothing was recorded.
 * After other errors, such as RAYMELD_ERROR_DEVICE, the command buffer may hold a part of the frame. */
RAYMELD_API raymeld_result raymeld_record(raymeld_fusion fusion, VkCommandBuffer commands,
                                          const raymeld_frame* frame);

/* Names semaphores of the caller's device that a submit waits for and signals. */
typedef struct raymeld_semaphores {
  size_t struct_size RAYMELD_IS(sizeof(raymeld_semaphores));
  uint32_t wait_count RAYMELD_IS(0);
  uint32_t signal_count RAYMELD_IS(0);
  const VkSemaphore* wait RAYMELD_IS(NULL);
  /* Holds the values of timeline semaphores, which need RAYMELD_FEATURE_TIMELINE_SEMAPHORE; 0 for a binary
   * semaphore. NULL: all are binary. */
  const uint64_t* wait_values RAYMELD_IS(NULL);
  const VkSemaphore* signal RAYMELD_IS(NULL);
  const uint64_t* signal_values RAYMELD_IS(NULL);
} raymeld_semaphores;

/* Records a frame as raymeld_record() does, into a command buffer of raymeld's own, and submits it to the
 * queue. Does not wait for that frame, but waits on the host for the one that was submitted frames_in_flight
 * frames before, if it is not done. Frames of raymeld_record() count among these, but the caller must wait
 * for them. The first call allocates. The whole frame runs after the semaphores that it waits for.
 * `semaphores` may be NULL. raymeld_take_status(), raymeld_fuse(), raymeld_save_history(),
 * raymeld_load_history() and raymeld_fusion_destroy() wait for all submitted frames. Returns
 * RAYMELD_ERROR_DEVICE or RAYMELD_ERROR_DEVICE_LOST if a call of Vulkan fails. */
RAYMELD_API raymeld_result raymeld_submit(raymeld_fusion fusion, const raymeld_frame* frame,
                                          const raymeld_semaphores* semaphores);

/* Holds what the device counted. For a frame that can be trusted, saturated and not_finite are zero. */
typedef struct raymeld_status {
  size_t struct_size RAYMELD_IS(sizeof(raymeld_status));
  /* Counts values within the network that 16 bits cannot hold; the largest value is stored. fp16 only. */
  uint32_t saturated RAYMELD_IS(0);
  uint32_t not_finite RAYMELD_IS(0); /* output values that were NaN or infinite, written as 0 */
  /* Counts tiles that fp16 could not hold, so that raymeld_fuse() computed them again in fp32.
   * RAYMELD_PRECISION_AUTO only. */
  uint32_t redone_tiles RAYMELD_IS(0);
  /* Is the share of the frame's work that was skipped, from 0 to 1, because nothing changed there since the
   * last frame. raymeld_fuse() with skip_unchanged only. */
  float skipped_share RAYMELD_IS(0);
} raymeld_status;

/* Writes the counts of the frames that were recorded and submitted since the last call or the last
 * raymeld_fuse(). Waits for submitted frames; those of raymeld_record() must be done. Returns
 * RAYMELD_ERROR_DEVICE or RAYMELD_ERROR_DEVICE_LOST if a call of Vulkan fails. */
RAYMELD_API raymeld_result raymeld_take_status(raymeld_fusion fusion, raymeld_status* status);

/* Fuses one frame of host memory, planar and dense: lrhs (3, h, w), if the model reads it, and hrls (3 for
 * each of the fusion's layers, s h, s w) to fused (3, s h, s w), where (h, w) is the description's size.
 * Works tile by tile if it must, submits to the queue and waits. No recorded frame may be pending. `status`
 * may be NULL. Returns RAYMELD_ERROR_NOT_FINITE if the network's output is not finite, and
 * RAYMELD_ERROR_DEVICE or RAYMELD_ERROR_DEVICE_LOST if a call of Vulkan fails. `fused` may hold some of the
 * tiles after a failure. */
RAYMELD_API raymeld_result raymeld_fuse(raymeld_fusion fusion, const float* lrhs, const float* hrls,
                                        float* fused, raymeld_status* status);

/* Does the same for the next frame of a sequence, with `temporal`: `motion` (2, s h, s w), or (4, s h, s w)
 * with `motion_depth`, is that of raymeld_frame. A frame that fails leaves what is kept as it was. */
RAYMELD_API raymeld_result raymeld_fuse_next(raymeld_fusion fusion, const float* lrhs, const float* hrls,
                                             const float* motion, float* fused, raymeld_status* status);

/* Makes the next frame the first one of a sequence, as after a cut; with `temporal`. Frames that were
 * recorded before may be pending. */
RAYMELD_API raymeld_result raymeld_reset_history(raymeld_fusion fusion);

/* Copies to `data` what the last frame left for the next one, with `temporal`. size_bytes is the
 * history_bytes of raymeld_fusion_info. Waits for submitted frames; those of raymeld_record() must be done.
 * Returns RAYMELD_ERROR_DEVICE or RAYMELD_ERROR_DEVICE_LOST if a call of Vulkan fails. */
RAYMELD_API raymeld_result raymeld_save_history(raymeld_fusion fusion, void* data, uint64_t size_bytes);

/* Makes the next frame go on with a saved history, of a fusion for frames of the same size, scale and layers,
 * also of another process, on a computer of the same byte order. Whatever else is given is
 * RAYMELD_ERROR_INVALID_ARGUMENT. All else is as for raymeld_save_history(). */
RAYMELD_API raymeld_result raymeld_load_history(raymeld_fusion fusion, const void* data, uint64_t size_bytes);

/* Computes the exposure that raymeld_fuse() would use for lrhs (3, h, w) in host memory, planar and dense.
 * For a model of scale 1, lrhs is the color of HRLS. This is the description's exposure or, if that is 0, the
 * factor that brings LRHS to the brightness that the model was trained at: k / m^2, clamped to [2^-24, 2^24].
 * Here m is the mean over LRHS of the square root of luminance (Rec. 709), with colors clamped to [0, 65504]
 * and NaN as 0, and k is the model's exposure_key. The exposure is 1 if LRHS is black or the model has no
 * key. */
RAYMELD_API raymeld_result raymeld_exposure(raymeld_fusion fusion, const float* lrhs, float* exposure);

#ifdef __cplusplus
}
#endif
#endif
