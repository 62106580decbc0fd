#pragma once

namespace pi_os_transport
{

enum class CoreProgram
{
  MASTER,  ///< Master and Parameter Server, as rosmaster
  CORE,    ///< and the rosout node, and the parameters that roscore sets
};

/// What pi_master and pi_core do, from their command line to their end at SIGINT, SIGTERM, or a call of shutdown().
/// @return status of the process; an error was told on stderr.
int runCore(CoreProgram program, int argc, char** argv);

}  // namespace pi_os_transport
