@[if DEVELSPACE]@
set(pi_runtime_RUN_UNITTESTS "@(PROJECT_SOURCE_DIR)/cmake/run_unittests.py")
@[else]@
set(pi_runtime_RUN_UNITTESTS "${pi_runtime_DIR}/run_unittests.py")
@[end if]@

# pi_runtime_add_unittests(NAME FOLDER [ENVIRONMENT VARIABLE=VALUE...] [DEPENDENCIES TARGET...])
#
# Python unit tests of the files FOLDER/test_*.py. Debian has no nose, which catkin_add_nosetests needs.
function(pi_runtime_add_unittests name folder)
  cmake_parse_arguments(arg "" "" "ENVIRONMENT;DEPENDENCIES" ${ARGN})
  list(JOIN arg_ENVIRONMENT " " environment)
  catkin_run_tests_target(unittest ${name} ${name}.xml
    COMMAND "env ${environment} ${PYTHON_EXECUTABLE} ${pi_runtime_RUN_UNITTESTS} ${folder} ${CATKIN_TEST_RESULTS_DIR}/${PROJECT_NAME}/${name}.xml"
    DEPENDENCIES ${arg_DEPENDENCIES}
    WORKING_DIRECTORY ${folder}
  )
endfunction()
