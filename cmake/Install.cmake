# The program, its script for render farms, the stock models, and the package raymeld with the target raymeld::raymeld.
include(CMakePackageConfigHelpers)

install(TARGETS raymeld RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR})
install(TARGETS raymeld_core raymeld_layers raymeld_shaders raymeld_engine raymeld_io
        EXPORT raymeld ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR})
install(DIRECTORY include/raymeld DESTINATION ${CMAKE_INSTALL_INCLUDEDIR})
install(PROGRAMS scripts/fuse-array.slurm DESTINATION ${CMAKE_INSTALL_DATADIR}/raymeld)
install(DIRECTORY models/ DESTINATION ${CMAKE_INSTALL_DATADIR}/raymeld/models)

set(package_dir ${CMAKE_INSTALL_LIBDIR}/cmake/raymeld)
install(EXPORT raymeld NAMESPACE raymeld:: DESTINATION ${package_dir})
file(WRITE ${CMAKE_BINARY_DIR}/raymeldConfig.cmake [=[
include(CMakeFindDependencyMacro)
find_dependency(fmt)
find_dependency(Imath)
find_dependency(OpenEXR)
find_dependency(PNG)
find_dependency(nlohmann_json)
find_dependency(Vulkan)
include(${CMAKE_CURRENT_LIST_DIR}/raymeld.cmake)
]=])
write_basic_package_version_file(${CMAKE_BINARY_DIR}/raymeldConfigVersion.cmake
                                 COMPATIBILITY SameMinorVersion)
install(FILES ${CMAKE_BINARY_DIR}/raymeldConfig.cmake ${CMAKE_BINARY_DIR}/raymeldConfigVersion.cmake
        DESTINATION ${package_dir})
