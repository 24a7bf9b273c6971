# Installs BUILD into a folder of its own, moves it, builds the consumers against it, and runs them and the
# installed program. Then checks the Debian packages. CPACK is the program, LIBDIR the folder of installed
# libraries.
set(work ${BUILD}/package-test)
file(REMOVE_RECURSE ${work})
execute_process(COMMAND ${CMAKE_COMMAND} --install ${BUILD} --prefix ${work}/installed OUTPUT_QUIET
                COMMAND_ERROR_IS_FATAL ANY)
file(RENAME ${work}/installed ${work}/prefix)

# The library exports the C interface and nothing else.
set(library ${work}/prefix/${LIBDIR}/libraymeld.so)
execute_process(COMMAND nm --dynamic --defined-only --format=posix ${library} OUTPUT_VARIABLE symbols
                COMMAND_ERROR_IS_FATAL ANY)
string(REGEX MATCHALL "[^\n]+" symbols "${symbols}")
set(others ${symbols})
list(FILTER others EXCLUDE REGEX "^raymeld_")
list(LENGTH symbols count)
if(others OR count LESS 22)
  message(FATAL_ERROR "${library} shows ${count} symbols, among them ${others}")
endif()

# The consumers build without the Vulkan loader.
execute_process(COMMAND ${CMAKE_COMMAND} -E env PKG_CONFIG_PATH=${work}/prefix/${LIBDIR}/pkgconfig
                        ${CMAKE_COMMAND} -G Ninja -S ${SOURCE} -B ${work}/build
                        -DCMAKE_PREFIX_PATH=${work}/prefix -DCMAKE_DISABLE_FIND_PACKAGE_Vulkan=ON
                        -DCMAKE_C_FLAGS=${FLAGS} -DCMAKE_CXX_FLAGS=${FLAGS} COMMAND_ERROR_IS_FATAL ANY)
execute_process(COMMAND ${CMAKE_COMMAND} --build ${work}/build COMMAND_ERROR_IS_FATAL ANY)
foreach(consumer consumer_cpp consumer_c consumer_pkg)
  execute_process(COMMAND ${work}/build/${consumer} ${MODEL} COMMAND_ERROR_IS_FATAL ANY)
endforeach()

# The library finds the stock models beside it, wherever it was moved to. No model of the build tree is called
# "installed".
file(COPY_FILE ${MODEL} ${work}/prefix/share/raymeld/models/installed.safetensors)
foreach(model installed x4-fast)
  execute_process(COMMAND ${CMAKE_COMMAND} -E env --unset=RAYMELD_MODELS ${work}/build/consumer_c ${model}
                  COMMAND_ERROR_IS_FATAL ANY)
  execute_process(COMMAND ${CMAKE_COMMAND} -E env --unset=RAYMELD_MODELS
                          ${work}/prefix/bin/raymeld graph --model ${model} --size 256x256
                  OUTPUT_QUIET COMMAND_ERROR_IS_FATAL ANY)
endforeach()
execute_process(COMMAND ${work}/prefix/bin/raymeld graph --model x4 --size 256x256 OUTPUT_QUIET
                COMMAND_ERROR_IS_FATAL ANY)

# The Debian packages, unpacked over each other, have all files.
execute_process(COMMAND ${CPACK} -G DEB -B ${work}/packages WORKING_DIRECTORY ${BUILD} OUTPUT_QUIET
                COMMAND_ERROR_IS_FATAL ANY)
file(GLOB packages ${work}/packages/*.deb)
list(LENGTH packages count)
if(NOT count EQUAL 5)
  message(FATAL_ERROR "packages: ${packages}")
endif()
foreach(package ${packages})
  execute_process(COMMAND dpkg-deb --extract ${package} ${work}/debian COMMAND_ERROR_IS_FATAL ANY)
  execute_process(COMMAND dpkg-deb --field ${package} Package Depends OUTPUT_VARIABLE fields
                  COMMAND_ERROR_IS_FATAL ANY)
  string(APPEND control "${fields}")
endforeach()
foreach(field "Package: libraymeld0.1\nDepends: [^\n]*libc6 "
              "Depends: libraymeld0.1 \\(= 0.1.0\\), libvulkan-dev"
              "Package: raymeld\nDepends: raymeld-models \\(= 0.1.0\\), libvulkan1, [^\n]*libc6 ")
  if(NOT control MATCHES "${field}")
    message(FATAL_ERROR "no package says ${field}:\n${control}")
  endif()
endforeach()
foreach(file bin/raymeld include/raymeld/raymeld.h ${LIBDIR}/libraymeld.so.0.1 ${LIBDIR}/pkgconfig/raymeld.pc
             lib/python3/dist-packages share/man/man1/raymeld.1 share/bash-completion/completions/raymeld)
  if(NOT EXISTS ${work}/debian/usr/${file})
    message(FATAL_ERROR "no package has usr/${file}")
  endif()
endforeach()
execute_process(COMMAND ${work}/debian/usr/bin/raymeld graph --model x4 --size 256x256 OUTPUT_QUIET
                COMMAND_ERROR_IS_FATAL ANY)
file(COPY_FILE ${MODEL} ${work}/debian/usr/share/raymeld/models/unpacked.safetensors)
execute_process(COMMAND ${CMAKE_COMMAND} -E env --unset=RAYMELD_MODELS
                        LD_LIBRARY_PATH=${work}/debian/usr/${LIBDIR} ${work}/build/consumer_c unpacked
                COMMAND_ERROR_IS_FATAL ANY)
