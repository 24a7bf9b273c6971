# Installs the program with its licence, its script for render farms, the stock models, the library, and the
# package raymeld with the target raymeld::raymeld.
include(CMakePackageConfigHelpers)

if(RAYMELD_PROGRAM)
  install(TARGETS raymeld RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR} COMPONENT tools)
  install(FILES LICENSE DESTINATION ${CMAKE_INSTALL_DOCDIR} COMPONENT tools)
  install(FILES blender/raymeld_fusion.py DESTINATION ${CMAKE_INSTALL_DATADIR}/raymeld COMPONENT tools)
  install(PROGRAMS scripts/fuse-array.slurm DESTINATION ${CMAKE_INSTALL_DATADIR}/raymeld COMPONENT tools)
  if(NOT CMAKE_CROSSCOMPILING)
    install(FILES ${CMAKE_CURRENT_BINARY_DIR}/raymeld.1
            DESTINATION ${CMAKE_INSTALL_MANDIR}/man1 COMPONENT tools)
    install(FILES ${CMAKE_CURRENT_BINARY_DIR}/raymeld.bash RENAME raymeld
            DESTINATION ${CMAKE_INSTALL_DATADIR}/bash-completion/completions COMPONENT tools)
  endif()
endif()
# The packages that share no files with the program's depend on the library's.
install(FILES LICENSE COMPONENT library
        DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/libraymeld${PROJECT_VERSION_MAJOR}.${PROJECT_VERSION_MINOR})
install(TARGETS raymeld_library EXPORT raymeld
        LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT library NAMELINK_COMPONENT dev
        RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR} COMPONENT library
        ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT dev)
install(DIRECTORY include/raymeld DESTINATION ${CMAKE_INSTALL_INCLUDEDIR} COMPONENT dev)
install(DIRECTORY models/ DESTINATION ${CMAKE_INSTALL_DATADIR}/raymeld/models COMPONENT models)

set(package_dir ${CMAKE_INSTALL_LIBDIR}/cmake/raymeld)
install(EXPORT raymeld NAMESPACE raymeld:: DESTINATION ${package_dir} COMPONENT dev)
file(WRITE ${CMAKE_BINARY_DIR}/raymeldConfig.cmake [=[
# Only Vulkan's headers are needed: the library opens the loader at run time, if at all.
if(NOT TARGET Vulkan::Headers)
  find_path(Vulkan_INCLUDE_DIR vulkan/vulkan_core.h HINTS $ENV{VULKAN_SDK}/include)
  if(NOT Vulkan_INCLUDE_DIR)
    set(raymeld_FOUND FALSE)
    set(raymeld_NOT_FOUND_MESSAGE
      "Vulkan's headers were not found (Vulkan_INCLUDE_DIR); Debian's libvulkan-dev has them")
    return()
  endif()
  add_library(Vulkan::Headers INTERFACE IMPORTED)
  set_target_properties(Vulkan::Headers PROPERTIES INTERFACE_INCLUDE_DIRECTORIES "${Vulkan_INCLUDE_DIR}")
endif()
include(${CMAKE_CURRENT_LIST_DIR}/raymeld.cmake)
]=])
write_basic_package_version_file(${CMAKE_BINARY_DIR}/raymeldConfigVersion.cmake
                                 COMPATIBILITY SameMinorVersion)
install(FILES ${CMAKE_BINARY_DIR}/raymeldConfig.cmake ${CMAKE_BINARY_DIR}/raymeldConfigVersion.cmake
        DESTINATION ${package_dir} COMPONENT dev)

# The prefix is relative to the folder of raymeld.pc, so that the installed tree may be moved.
file(RELATIVE_PATH prefix /${CMAKE_INSTALL_LIBDIR}/pkgconfig /)
file(CONFIGURE OUTPUT raymeld.pc @ONLY CONTENT [=[
prefix=${pcfiledir}/@prefix@
Name: raymeld
Description: Fuses two cheap renders into a good one, on a Vulkan device
Version: @PROJECT_VERSION@
# Vulkan's headers are needed to compile.
Requires.private: vulkan
Cflags: -I${prefix}/@CMAKE_INSTALL_INCLUDEDIR@
Libs: -L${prefix}/@CMAKE_INSTALL_LIBDIR@ -lraymeld
]=])
install(FILES ${CMAKE_CURRENT_BINARY_DIR}/raymeld.pc
        DESTINATION ${CMAKE_INSTALL_LIBDIR}/pkgconfig COMPONENT dev)
