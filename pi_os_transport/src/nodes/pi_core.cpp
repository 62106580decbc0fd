// Replaces roscore: master, parameter server and rosout in one process.

#include "core/core_program.h"

int main(int argc, char** argv)
{
  return pi_os_transport::runCore(pi_os_transport::CoreProgram::CORE, argc, argv);
}
