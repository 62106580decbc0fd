// Replaces rosmaster: master and parameter server.

#include "core/core_program.h"

int main(int argc, char** argv)
{
  return pi_os_transport::runCore(pi_os_transport::CoreProgram::MASTER, argc, argv);
}
