# What scripts/test --all adds: tests that take other programs and drivers, or minutes. None of them may be skipped: a
# script that exits with 77, as it cannot test, has failed.

# Every combination of what a unit tries, where quick tests try each value once; a skip must be allowed by name.
foreach(name ${unit_tests})
  set_property(TEST ${name} APPEND PROPERTY ENVIRONMENT RAYMELD_TEST_EXTENT=full
    RAYMELD_ALLOWED_SKIPS=${CMAKE_CURRENT_SOURCE_DIR}/allowed-skips.txt)
endforeach()

# The installed package serves a project of somebody else's.
add_test(NAME package COMMAND ${CMAKE_COMMAND} -DCPACK=${CMAKE_CPACK_COMMAND} -DBUILD=${PROJECT_BINARY_DIR} -DLIBDIR=${CMAKE_INSTALL_LIBDIR}
  -DSOURCE=${CMAKE_CURRENT_SOURCE_DIR}/package -DMODEL=${PROJECT_SOURCE_DIR}/tests/golden/tiny-x2.safetensors
  -P ${CMAKE_CURRENT_SOURCE_DIR}/package/run.cmake)

# The add-on renders in a Blender without a window.
find_program(BLENDER blender REQUIRED)
add_test(NAME blender COMMAND ${BLENDER} --background --factory-startup --python ${PROJECT_SOURCE_DIR}/blender/test_addon.py
  -- $<TARGET_FILE:raymeld>)
set_tests_properties(blender PROPERTIES ENVIRONMENT HOME=${CMAKE_CURRENT_BINARY_DIR})

# Training pairs, and what measures image quality, are held to known answers; the latter also to the program.
add_test(NAME training COMMAND /usr/bin/python3 ${PROJECT_SOURCE_DIR}/training/self_test.py)
add_test(NAME evaluation COMMAND /usr/bin/python3 ${PROJECT_SOURCE_DIR}/training/evaluation/self_test.py
  $<TARGET_FILE:raymeld> ${PROJECT_SOURCE_DIR}/tests/golden/tiny-x4.safetensors)

# Independent drivers, unpacked beside the installed one; then what takes cooperative matrices, on one that has them.
add_test(NAME drivers COMMAND ${PROJECT_SOURCE_DIR}/scripts/test-drivers --quick)
set_tests_properties(drivers PROPERTIES ENVIRONMENT RAYMELD=$<TARGET_FILE:raymeld> FIXTURES_SETUP sid COST 300)
add_test(NAME matrix COMMAND ${PROJECT_SOURCE_DIR}/scripts/test-matrix)
set_tests_properties(matrix PROPERTIES FIXTURES_REQUIRED sid COST 200)

# libFuzzer, and a few units under sanitizers, of one build with clang.
add_test(NAME sanitize COMMAND ${PROJECT_SOURCE_DIR}/scripts/sanitize --some)
set_tests_properties(sanitize PROPERTIES RUN_SERIAL TRUE)

set_tests_properties(package blender training evaluation drivers matrix sanitize slurm soak trade_page
  PROPERTIES LABELS all)
# A machine may be busy, and some of these build.
set_tests_properties(${unit_tests} drivers matrix sanitize package evaluation training blender PROPERTIES TIMEOUT 3000)
