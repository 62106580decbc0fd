#pragma once

#include <string>
#include <vector>

namespace pi_node
{

/// How a program ended.
struct ChildResult
{
  bool in_time = true;  ///< false: it was killed
  int status = 0;       ///< of waitpid()
  std::string output;   ///< the first 4096 bytes

  /// Whether SIGINT, SIGTERM or SIGHUP ended it (Ctrl-C, roslaunch). This is no error of the program.
  bool wasInterrupted() const;
};

struct ChildOptions
{
  double timeout_s = 60.0;
  int input = -1;           ///< descriptor of its standard input; -1: it has none
  bool take_errors = true;  ///< its standard error goes to the output; false: to /dev/null
};

/// Runs a program and kills it after the timeout. The program gets the environment without LD_PRELOAD.
/// @throws std::runtime_error naming the program, if it cannot be started.
ChildResult runChild(const std::string& program, std::vector<std::string> arguments, const ChildOptions& options);

}  // namespace pi_node
