# Compiles shaders/*/*.comp with glslang for 32-bit and 16-bit storage: with activations in buffers and, where
# a shader includes memory.glsl, by address; where it includes frame.glsl, also for frames that are images.
# Shaders of shaders/llvmpipe only exist by address, and some of them only for 32 bits. conv2d.comp has a form
# for devices with dot products of halves, conv2d_dots. All are embedded in the library raymeld_shaders.
# Debian 12's glslang lacks the extensions of conv2d_matrix.comp, whose SPIR-V is committed: see
# scripts/compile-matrix. Its spirv-val checks all others but conv2d_dots, whose instruction it does not know:
# see scripts/test-matrix.
find_program(GLSLANG glslangValidator REQUIRED)
find_program(SPIRV_VAL spirv-val REQUIRED)

set(shader_dir ${PROJECT_SOURCE_DIR}/shaders)
set(shader_folders include conv2d llvmpipe pyramid)  # folders of included files
file(GLOB_RECURSE shader_sources CONFIGURE_DEPENDS ${shader_dir}/*.comp)
file(GLOB_RECURSE shader_includes CONFIGURE_DEPENDS ${shader_dir}/*.glsl ${shader_dir}/*.h)
list(TRANSFORM shader_folders PREPEND -I${shader_dir}/ OUTPUT_VARIABLE shader_include_options)
file(MAKE_DIRECTORY ${CMAKE_BINARY_DIR}/shaders)

# Compiles a variant of a shader and appends its SPIR-V file to `list`; further arguments are macros to
# define.
function(compile_shader list source variant)
  set(output ${CMAKE_BINARY_DIR}/shaders/${variant}.spv)
  set(check COMMAND ${SPIRV_VAL} --target-env vulkan1.1 ${output})
  if(HALF_DOTS IN_LIST ARGN)
    set(check)
  endif()
  list(TRANSFORM ARGN PREPEND -D)
  add_custom_command(
    OUTPUT ${output}
    COMMAND ${GLSLANG} -V --target-env vulkan1.1 --quiet ${ARGN} ${shader_include_options}
      -o ${output} ${source}
    ${check}
    DEPENDS ${source} ${shader_includes}
    COMMENT "Shader ${variant}")
  set(${list} ${${list}} ${output} PARENT_SCOPE)
endfunction()

# Makes one C++ source of SPIR-V files, in which NAME.spv is k_NAME. One source for all of them compiles in a
# second, a source for each in twenty.
function(embed_spirv output)
  set(embed ${PROJECT_SOURCE_DIR}/cmake/EmbedSpirv.cmake)
  add_custom_command(
    OUTPUT ${output}
    COMMAND ${CMAKE_COMMAND} "-DSPIRV=${ARGN}" -DOUTPUT=${output} -P ${embed}
    DEPENDS ${ARGN} ${embed}
    COMMENT "Shaders as C++"
    VERBATIM)
endfunction()

set(spirv ${shader_dir}/conv2d/conv2d_matrix.spv)
list(REMOVE_ITEM shader_sources ${shader_dir}/conv2d/conv2d_matrix.comp)

set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS ${shader_sources})
foreach(source ${shader_sources})
  get_filename_component(name ${source} NAME_WE)
  if(source MATCHES "/llvmpipe/")
    compile_shader(spirv ${source} ${name}_f32 DATA_BY_ADDRESS)
    if(name MATCHES "^(pointwise|winograd_output)_vectors$")
      compile_shader(spirv ${source} ${name}_f16 DATA_BY_ADDRESS STORAGE_F16)
    endif()
    continue()
  endif()
  file(STRINGS ${source} by_address REGEX "memory.glsl")
  file(STRINGS ${source} of_frame REGEX "FRAME_IMAGE|frame.glsl")
  set(variants ${name})
  if(of_frame)
    list(APPEND variants ${name}_image)
  endif()
  foreach(variant ${variants})
    set(macros)
    if(NOT variant STREQUAL name)
      set(macros FRAME_IMAGE)
    endif()
    compile_shader(spirv ${source} ${variant}_buffers_f32 ${macros})
    compile_shader(spirv ${source} ${variant}_buffers_f16 ${macros} STORAGE_F16)
    if(by_address)
      compile_shader(spirv ${source} ${variant}_addresses_f32 ${macros} DATA_BY_ADDRESS)
      compile_shader(spirv ${source} ${variant}_addresses_f16 ${macros} DATA_BY_ADDRESS STORAGE_F16)
    endif()
  endforeach()
endforeach()
compile_shader(spirv ${shader_dir}/conv2d/conv2d.comp conv2d_dots STORAGE_F16 HALF_DOTS)
embed_spirv(${CMAKE_BINARY_DIR}/shaders/shaders.cpp ${spirv})
add_library(raymeld_shaders STATIC ${CMAKE_BINARY_DIR}/shaders/shaders.cpp)
