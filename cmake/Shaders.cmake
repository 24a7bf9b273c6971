# Compiles shaders/*/*.comp with glslang, once for each storage type and, where a shader has DATA_BY_ADDRESS or FRAME_IMAGE, with
# and without that; checks them with spirv-val and embeds them in the static library raymeld_shaders. conv2d_matrix.comp, which
# Debian 12's glslang does not know the extensions of, is there as SPIR-V: see scripts/compile-matrix.
find_program(GLSLANG glslangValidator REQUIRED)
find_program(SPIRV_VAL spirv-val REQUIRED)

set(shader_dir ${PROJECT_SOURCE_DIR}/shaders)
set(shader_folders include conv2d llvmpipe)  # of what is included
file(GLOB_RECURSE shader_sources CONFIGURE_DEPENDS ${shader_dir}/*.comp)
file(GLOB_RECURSE shader_includes CONFIGURE_DEPENDS ${shader_dir}/*.glsl ${shader_dir}/*.h)
list(TRANSFORM shader_folders PREPEND -I${shader_dir}/ OUTPUT_VARIABLE shader_include_options)
file(MAKE_DIRECTORY ${CMAKE_BINARY_DIR}/shaders)

# Appends to `list` the file of the SPIR-V of a variant; further arguments are macros.
function(compile_shader list source variant)
  set(output ${CMAKE_BINARY_DIR}/shaders/${variant}.spv)
  list(TRANSFORM ARGN PREPEND -D)
  add_custom_command(
    OUTPUT ${output}
    COMMAND ${GLSLANG} -V --target-env vulkan1.1 --quiet ${ARGN} ${shader_include_options} -o ${output} ${source}
    COMMAND ${SPIRV_VAL} --target-env vulkan1.1 ${output}
    DEPENDS ${source} ${shader_includes}
    COMMENT "Shader ${variant}")
  set(${list} ${${list}} ${output} PARENT_SCOPE)
endfunction()

# Makes one C++ source of files of SPIR-V: NAME.spv is its k_NAME. One for all compiles in a second, one for each in twenty.
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
  file(STRINGS ${source} by_address REGEX DATA_BY_ADDRESS)
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
embed_spirv(${CMAKE_BINARY_DIR}/shaders/shaders.cpp ${spirv})
add_library(raymeld_shaders STATIC ${CMAKE_BINARY_DIR}/shaders/shaders.cpp)
