# Compiles shaders/*.comp with glslang, once for each storage type and, where a shader has DATA_BY_ADDRESS or FRAME_IMAGE, with
# and without that; checks them with spirv-val and embeds them in the static library raymeld_shaders. conv2d_matrix.comp, which
# Debian 12's glslang does not know the extensions of, is there as SPIR-V: see scripts/compile-matrix.
find_program(GLSLANG glslangValidator REQUIRED)
find_program(SPIRV_VAL spirv-val REQUIRED)

set(shader_dir ${PROJECT_SOURCE_DIR}/shaders)
file(GLOB shader_sources CONFIGURE_DEPENDS ${shader_dir}/*.comp)
file(GLOB shader_includes CONFIGURE_DEPENDS ${shader_dir}/*.glsl ${shader_dir}/*.h)
file(MAKE_DIRECTORY ${CMAKE_BINARY_DIR}/shaders)

# Appends to `objects` the C++ source that has the SPIR-V as k_VARIANT; further arguments are macros.
function(embed_shader objects source variant)
  set(spirv ${CMAKE_BINARY_DIR}/shaders/${variant}.spv)
  set(embedded ${CMAKE_BINARY_DIR}/shaders/${variant}.cpp)
  list(TRANSFORM ARGN PREPEND -D)
  add_custom_command(
    OUTPUT ${embedded}
    BYPRODUCTS ${spirv}
    COMMAND ${GLSLANG} -V --target-env vulkan1.1 --quiet ${ARGN} -I${shader_dir} -o ${spirv} ${source}
    COMMAND ${SPIRV_VAL} --target-env vulkan1.1 ${spirv}
    COMMAND ${CMAKE_COMMAND} -DSPIRV=${spirv} -DOUTPUT=${embedded} -DSYMBOL=k_${variant}
            -P ${PROJECT_SOURCE_DIR}/cmake/EmbedSpirv.cmake
    DEPENDS ${source} ${shader_includes} ${PROJECT_SOURCE_DIR}/cmake/EmbedSpirv.cmake
    COMMENT "Shader ${variant}")
  set(${objects} ${${objects}} ${embedded} PARENT_SCOPE)
endfunction()

set(matrix_source ${CMAKE_BINARY_DIR}/shaders/conv2d_matrix.cpp)
add_custom_command(
  OUTPUT ${matrix_source}
  COMMAND ${CMAKE_COMMAND} -DSPIRV=${shader_dir}/conv2d_matrix.spv -DOUTPUT=${matrix_source} -DSYMBOL=k_conv2d_matrix
          -P ${PROJECT_SOURCE_DIR}/cmake/EmbedSpirv.cmake
  DEPENDS ${shader_dir}/conv2d_matrix.spv ${PROJECT_SOURCE_DIR}/cmake/EmbedSpirv.cmake
  COMMENT "Shader conv2d_matrix")
list(APPEND shader_objects ${matrix_source})
list(REMOVE_ITEM shader_sources ${shader_dir}/conv2d_matrix.comp)

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
    embed_shader(shader_objects ${source} ${variant}_buffers_f32 ${macros})
    embed_shader(shader_objects ${source} ${variant}_buffers_f16 ${macros} STORAGE_F16)
    if(by_address)
      embed_shader(shader_objects ${source} ${variant}_addresses_f32 ${macros} DATA_BY_ADDRESS)
      embed_shader(shader_objects ${source} ${variant}_addresses_f16 ${macros} DATA_BY_ADDRESS STORAGE_F16)
    endif()
  endforeach()
endforeach()
add_library(raymeld_shaders STATIC ${shader_objects})
