# `cpack -G DEB` in the build folder makes the Debian packages libraymeld0.1, libraymeld-dev, raymeld,
# raymeld-models and, where the Python module was built, python3-raymeld.
set(CPACK_PACKAGE_NAME raymeld)
set(CPACK_PACKAGE_CONTACT "the raymeld developers <raymeld@localhost>")
set(CPACK_PACKAGE_DESCRIPTION_SUMMARY "fuses two cheap renders into a good one")
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_STRIP_FILES ON)
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_COMPONENTS_ALL library dev models)
if(RAYMELD_PROGRAM)
  list(APPEND CPACK_COMPONENTS_ALL tools)
endif()
if(TARGET raymeld_python)
  list(APPEND CPACK_COMPONENTS_ALL python)
endif()
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_ENABLE_COMPONENT_DEPENDS OFF)

set(library_package libraymeld${PROJECT_VERSION_MAJOR}.${PROJECT_VERSION_MINOR})
set(CPACK_DEBIAN_LIBRARY_PACKAGE_NAME ${library_package})
set(CPACK_DEBIAN_LIBRARY_PACKAGE_SECTION libs)
set(CPACK_DEBIAN_LIBRARY_PACKAGE_RECOMMENDS "libvulkan1, raymeld-models")
set(CPACK_DEBIAN_LIBRARY_DESCRIPTION "Fusion of two renders on Vulkan devices, for programs")
# This trigger has dpkg renew the cache of libraries once at the end.
file(WRITE ${CMAKE_CURRENT_BINARY_DIR}/triggers "activate-noawait ldconfig\n")
set(CPACK_DEBIAN_LIBRARY_PACKAGE_CONTROL_EXTRA ${CMAKE_CURRENT_BINARY_DIR}/triggers)

set(CPACK_DEBIAN_DEV_PACKAGE_NAME libraymeld-dev)
set(CPACK_DEBIAN_DEV_PACKAGE_SECTION libdevel)
set(CPACK_DEBIAN_DEV_PACKAGE_DEPENDS "${library_package} (= ${PROJECT_VERSION}), libvulkan-dev")
set(CPACK_DEBIAN_DEV_DESCRIPTION "Headers of libraymeld, for CMake and pkg-config")

set(CPACK_DEBIAN_TOOLS_PACKAGE_NAME raymeld)
set(CPACK_DEBIAN_TOOLS_PACKAGE_SECTION graphics)
set(CPACK_DEBIAN_TOOLS_PACKAGE_DEPENDS "raymeld-models (= ${PROJECT_VERSION}), libvulkan1")
set(CPACK_DEBIAN_TOOLS_PACKAGE_RECOMMENDS "mesa-vulkan-drivers")
set(CPACK_DEBIAN_TOOLS_DESCRIPTION "Fusion of two renders in OpenEXR on Vulkan devices")

set(CPACK_DEBIAN_MODELS_PACKAGE_NAME raymeld-models)
set(CPACK_DEBIAN_MODELS_PACKAGE_SECTION graphics)
set(CPACK_DEBIAN_MODELS_PACKAGE_ARCHITECTURE all)
set(CPACK_DEBIAN_MODELS_PACKAGE_SHLIBDEPS OFF)
set(CPACK_DEBIAN_MODELS_DESCRIPTION "The trained networks of raymeld")

set(CPACK_DEBIAN_PYTHON_PACKAGE_NAME python3-raymeld)
set(CPACK_DEBIAN_PYTHON_PACKAGE_SECTION python)
# The module needs no library but raymeld's, whose package depends on the C++ runtime as well.
set(CPACK_DEBIAN_PYTHON_PACKAGE_SHLIBDEPS OFF)
set(CPACK_DEBIAN_PYTHON_PACKAGE_DEPENDS
  "${library_package} (= ${PROJECT_VERSION}), python3-numpy, ${python_version}")
set(CPACK_DEBIAN_PYTHON_DESCRIPTION "Fusion of two renders on Vulkan devices, for Python")
include(CPack)
