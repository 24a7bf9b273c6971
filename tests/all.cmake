# scripts/test --all adds tests that take other programs and drivers, or minutes. None of them may be skipped:
# a script that exits with 77, because it cannot test, has failed.

# A unit's skip must be allowed by name.
foreach(name ${unit_tests})
  set_property(TEST ${name} APPEND PROPERTY ENVIRONMENT
    RAYMELD_ALLOWED_SKIPS=${CMAKE_CURRENT_SOURCE_DIR}/allowed-skips.txt)
endforeach()

# The benchmark is built, and measures one convolution by its fastest kernel.
add_test(NAME bench COMMAND raymeld_bench --benchmark_filter=^conv2d/3x3/128x128/40-16/F.4
  --benchmark_min_time=0.01)
set_tests_properties(bench PROPERTIES PASS_REGULAR_EXPRESSION "F.4, 3..*FLOP/s=")

# Sources are as clang-format leaves them.
find_program(CLANG_FORMAT clang-format REQUIRED)
add_test(NAME format COMMAND ${PYTHON_EXECUTABLE} ${PROJECT_SOURCE_DIR}/scripts/lint --format)

# A project outside raymeld's tree uses the installed package.
add_test(NAME package COMMAND ${CMAKE_COMMAND} -DCPACK=${CMAKE_CPACK_COMMAND} -DBUILD=${PROJECT_BINARY_DIR}
  -DLIBDIR=${CMAKE_INSTALL_LIBDIR}
  -DSOURCE=${CMAKE_CURRENT_SOURCE_DIR}/package -DMODEL=${PROJECT_SOURCE_DIR}/tests/golden/tiny-x2.safetensors
  -P ${CMAKE_CURRENT_SOURCE_DIR}/package/run.cmake)

# The add-on renders in a Blender without a window.
find_program(BLENDER blender REQUIRED)
add_test(NAME blender COMMAND ${BLENDER} --background --factory-startup
  --python ${PROJECT_SOURCE_DIR}/blender/test_addon.py -- $<TARGET_FILE:raymeld>)
set_tests_properties(blender PROPERTIES ENVIRONMENT HOME=${CMAKE_CURRENT_BINARY_DIR})

# Training pairs and the measures of image quality must give known answers; the measures must also agree with
# the program.
add_test(NAME training COMMAND /usr/bin/python3 ${PROJECT_SOURCE_DIR}/training/self_test.py)
add_test(NAME evaluation COMMAND /usr/bin/python3 ${PROJECT_SOURCE_DIR}/training/evaluation/self_test.py
  $<TARGET_FILE:raymeld> ${PROJECT_SOURCE_DIR}/tests/golden/tiny-x4.safetensors)

# Tests two versions of lavapipe, and SwiftShader, unpacked beside the installed driver, and then cooperative
# matrices on a driver that has them.
add_test(NAME drivers COMMAND ${PROJECT_SOURCE_DIR}/scripts/test-drivers --quick)
set_tests_properties(drivers PROPERTIES ENVIRONMENT RAYMELD=$<TARGET_FILE:raymeld>
  FIXTURES_SETUP sid COST 300)
add_test(NAME matrix COMMAND ${PROJECT_SOURCE_DIR}/scripts/test-matrix)
set_tests_properties(matrix PROPERTIES FIXTURES_REQUIRED sid COST 200)

# The compilers of GPUs compile what the stock models run on them, with no card in the machine.
add_test(NAME gpus COMMAND ${PROJECT_SOURCE_DIR}/scripts/test-gpus)
set_tests_properties(gpus PROPERTIES ENVIRONMENT RAYMELD=$<TARGET_FILE:raymeld>
  FIXTURES_REQUIRED sid COST 60)

# libraymeld and its portable tests are compiled for Windows, and run under Wine. They start after the long
# units, whose kernels they find in the driver's cache.
add_test(NAME windows COMMAND ${PROJECT_SOURCE_DIR}/scripts/test-windows)
set_tests_properties(windows PROPERTIES COST 50)

# Runs libFuzzer and a few units under sanitizers, in one build with clang.
add_test(NAME sanitize COMMAND ${PROJECT_SOURCE_DIR}/scripts/sanitize --some)
set_tests_properties(sanitize PROPERTIES RUN_SERIAL TRUE)

set_tests_properties(bench format package blender training evaluation drivers matrix gpus windows sanitize
  slurm soak trade_page PROPERTIES LABELS all)
# A machine may be busy, and some of these tests build.
set_tests_properties(${unit_tests} drivers matrix gpus windows sanitize package evaluation training
  blender PROPERTIES TIMEOUT 3000)
