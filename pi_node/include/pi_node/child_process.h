#pragma once

#include <string>
#include <vector>

namespace pi_node
{

/// How a program ended.
struct ChildResult
{
  bool in_time = true;  ///< else it was killed
  int status = 0;       ///< as waitpid() says
  std::string output;   ///< the first 4096 bytes

  /// Whether somebody ended it (Ctrl-C, roslaunch), which says nothing about what it worked on.
  bool wasInterrupted() const;
};

struct ChildOptions
{
  double timeout_s = 60.0;
  int input = -1;           ///< descriptor of its standard input; -1: it has none
  bool take_errors = true;  ///< what it writes to its standard error belongs to the output; false: is thrown away
};

/// Runs a program until it ends or its time is over; then it is killed. No process is left behind. It gets the
/// environment but for libraries to preload, which it has no use for.
/// @throws std::runtime_error naming the program, if it cannot be started.
ChildResult runChild(const std::string& program, std::vector<std::string> arguments, const ChildOptions& options);

}  // namespace pi_node
