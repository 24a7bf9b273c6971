# Compiles shaders/*.comp with glslang, once for each storage type and, where a shader has DATA_BY_ADDRESS, with and
# without that; checks them with spirv-val and embeds them in the static library raymeld_shaders.
find_program(GLSLANG glslangValidator REQUIRED)
find_program(SPIRV_VAL spirv-val REQUIRED)

set(shader_dir ${PROJECT_SOURCE_DIR}/shaders)
file(GLOB shader_sources CONFIGURE_DEPENDS ${shader_dir}/*.comp)
file(GLOB shader_includes CONFIGURE_DEPENDS ${shader_dir}/*.glsl ${shader_dir}/*.h)
set(shader_objects)
file(MAKE_DIRECTORY ${CMAKE_BINARY_DIR}/shaders)
foreach(source ${shader_sources})
  get_filename_component(name ${source} NAME_WE)
  file(STRINGS ${source} by_address REGEX DATA_BY_ADDRESS)
  set(forms buffers)
  if(by_address)
    list(APPEND forms addresses)
  endif()
  foreach(form ${forms})
    foreach(storage f32 f16)
      set(variant ${name}_${form}_${storage})
      set(spirv ${CMAKE_BINARY_DIR}/shaders/${variant}.spv)
      set(embedded ${CMAKE_BINARY_DIR}/shaders/${variant}.cpp)
      set(defines)
      if(form STREQUAL addresses)
        list(APPEND defines -DDATA_BY_ADDRESS)
      endif()
      if(storage STREQUAL f16)
        list(APPEND defines -DSTORAGE_F16)
      endif()
      add_custom_command(
        OUTPUT ${embedded}
        BYPRODUCTS ${spirv}
        COMMAND ${GLSLANG} -V --target-env vulkan1.1 --quiet ${defines} -I${shader_dir} -o ${spirv} ${source}
        COMMAND ${SPIRV_VAL} --target-env vulkan1.1 ${spirv}
        COMMAND ${CMAKE_COMMAND} -DSPIRV=${spirv} -DOUTPUT=${embedded} -DSYMBOL=k_${variant}
                -P ${PROJECT_SOURCE_DIR}/cmake/EmbedSpirv.cmake
        DEPENDS ${source} ${shader_includes} ${PROJECT_SOURCE_DIR}/cmake/EmbedSpirv.cmake
        COMMENT "Shader ${variant}")
      list(APPEND shader_objects ${embedded})
    endforeach()
  endforeach()
endforeach()
add_library(raymeld_shaders STATIC ${shader_objects})
