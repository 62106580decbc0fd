# Compiler settings of every package of the suite.
if(NOT CMAKE_BUILD_TYPE)
  set(CMAKE_BUILD_TYPE Release)
endif()
set(CMAKE_CXX_STANDARD 17)
set(CMAKE_CXX_STANDARD_REQUIRED ON)
set(CMAKE_CXX_EXTENSIONS OFF)
get_directory_property(pi_node_options COMPILE_OPTIONS)
if(NOT "-Wpedantic" IN_LIST pi_node_options)  # a folder may look for pi_node more than once
  add_compile_options(-Wall -Wextra -Wpedantic)
endif()
# Programs find the libraries of their package in the install space without its setup.sh.
set(CMAKE_INSTALL_RPATH "$ORIGIN;$ORIGIN/..")
