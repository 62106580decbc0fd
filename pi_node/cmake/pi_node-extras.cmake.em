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
