#pragma once

namespace pi_os_transport
{

enum class CoreProgram
{
  MASTER,  ///< Master and Parameter Server, like rosmaster
  CORE,    ///< also the rosout node and roscore's parameters
};

/// Runs pi_master or pi_core until SIGINT, SIGTERM or a call of shutdown().
/// @return status of the process; errors were written to stderr
int runCore(CoreProgram program, int argc, char** argv);

}  // namespace pi_os_transport
