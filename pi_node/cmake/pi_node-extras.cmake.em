# What every package of the suite has in common. find_package(pi_node) applies the settings to the calling folder.
@[if DEVELSPACE]@
set(pi_node_RUN_UNITTESTS "@(PROJECT_SOURCE_DIR)/cmake/run_unittests.py")
include("@(PROJECT_SOURCE_DIR)/cmake/package_settings.cmake")
@[else]@
set(pi_node_RUN_UNITTESTS "${pi_node_DIR}/run_unittests.py")
include("${pi_node_DIR}/package_settings.cmake")
@[end if]@

# pi_node_add_unittests(NAME FOLDER [ENVIRONMENT VARIABLE=VALUE...] [DEPENDENCIES TARGET...])
#
# Runs the Python unit tests FOLDER/test_*.py. Debian has no nose, which catkin_add_nosetests needs.
function(pi_node_add_unittests name folder)
  cmake_parse_arguments(arg "" "" "ENVIRONMENT;DEPENDENCIES" ${ARGN})
  list(JOIN arg_ENVIRONMENT " " environment)
  catkin_run_tests_target(unittest ${name} ${name}.xml
    COMMAND "env ${environment} ${PYTHON_EXECUTABLE} ${pi_node_RUN_UNITTESTS} ${folder} ${CATKIN_TEST_RESULTS_DIR}/${PROJECT_NAME}/${name}.xml"
    DEPENDENCIES ${arg_DEPENDENCIES}
    WORKING_DIRECTORY ${folder}
  )
endfunction()

# pi_node_add_program(NAME SOURCE LIBRARY...): builds and installs the program NAME of this package.
function(pi_node_add_program name source)
  add_executable(${PROJECT_NAME}_${name} ${source})
  set_target_properties(${PROJECT_NAME}_${name} PROPERTIES OUTPUT_NAME ${name})
  target_link_libraries(${PROJECT_NAME}_${name} PRIVATE ${ARGN})
  install(TARGETS ${PROJECT_NAME}_${name} RUNTIME DESTINATION ${CATKIN_PACKAGE_BIN_DESTINATION})
endfunction()

# pi_node_precompile(HEADERS <header>... LIBRARIES LIBRARY...), at the end of a folder of tests.
#
# Compiles the headers once for all test programs of this folder, with the include folders of the libraries, and the tests
# themselves with -O1: both shorten "make check" more than they cost in running time. The libraries under test keep the
# optimisation that ships.
function(pi_node_precompile)
  cmake_parse_arguments(arg "" "" "HEADERS;LIBRARIES" ${ARGN})
  get_property(targets DIRECTORY PROPERTY BUILDSYSTEM_TARGETS)
  set(programs)
  foreach(target ${targets})
    get_target_property(type ${target} TYPE)
    if(type STREQUAL EXECUTABLE)
      list(APPEND programs ${target})
    endif()
  endforeach()
  set(carrier ${PROJECT_NAME}_precompiled)
  set(source ${CMAKE_CURRENT_BINARY_DIR}/${carrier}.cpp)
  file(WRITE ${source}.new "// Empty: its target carries the precompiled headers of this folder.\n")
  file(COPY_FILE ${source}.new ${source} ONLY_IF_DIFFERENT)
  add_library(${carrier} OBJECT EXCLUDE_FROM_ALL ${source})
  target_link_libraries(${carrier} PRIVATE ${arg_LIBRARIES} gtest)
  add_dependencies(${carrier} ${${PROJECT_NAME}_EXPORTED_TARGETS} ${catkin_EXPORTED_TARGETS})
  target_precompile_headers(${carrier} PRIVATE <gtest/gtest.h> ${arg_HEADERS})
  foreach(target ${carrier} ${programs})
    target_compile_options(${target} PRIVATE -O1)
  endforeach()
  foreach(program ${programs})
    target_precompile_headers(${program} REUSE_FROM ${carrier})
  endforeach()
endfunction()
