# Compiles shaders/*.comp with glslang, once for each storage type, checks them with spirv-val and embeds them
# in the static library raymeld_shaders.
find_program(GLSLANG glslangValidator REQUIRED)
find_program(SPIRV_VAL spirv-val REQUIRED)

set(shader_dir ${PROJECT_SOURCE_DIR}/shaders)
file(GLOB shader_sources CONFIGURE_DEPENDS ${shader_dir}/*.comp)
file(GLOB shader_includes CONFIGURE_DEPENDS ${shader_dir}/*.glsl ${shader_dir}/*.h)
set(shader_objects)
file(MAKE_DIRECTORY ${CMAKE_BINARY_DIR}/shaders)
foreach(source ${shader_sources})
  get_filename_component(name ${source} NAME_WE)
  foreach(storage f32 f16)
    set(spirv ${CMAKE_BINARY_DIR}/shaders/${name}.${storage}.spv)
    set(embedded ${CMAKE_BINARY_DIR}/shaders/${name}.${storage}.cpp)
    if(storage STREQUAL f16)
      set(defines -DSTORAGE_F16)
    else()
      set(defines)
    endif()
    add_custom_command(
      OUTPUT ${embedded}
      BYPRODUCTS ${spirv}
      COMMAND ${GLSLANG} -V --target-env vulkan1.1 --quiet ${defines} -I${shader_dir} -o ${spirv} ${source}
      COMMAND ${SPIRV_VAL} --target-env vulkan1.1 ${spirv}
      COMMAND ${CMAKE_COMMAND} -DSPIRV=${spirv} -DOUTPUT=${embedded} -DSYMBOL=k_${name}_${storage}
              -P ${PROJECT_SOURCE_DIR}/cmake/EmbedSpirv.cmake
      DEPENDS ${source} ${shader_includes} ${PROJECT_SOURCE_DIR}/cmake/EmbedSpirv.cmake
      COMMENT "Shader ${name} ${storage}")
    list(APPEND shader_objects ${embedded})
  endforeach()
endforeach()
add_library(raymeld_shaders STATIC ${shader_objects})
