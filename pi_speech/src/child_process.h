#pragma once

#include <string>
#include <vector>

namespace pi_speech
{

/// How a program ended.
struct ChildResult
{
  bool in_time = true;  ///< else it was killed
  int status = 0;       ///< as waitpid() says
  std::string output;   ///< of both its outputs; the first 4096 bytes
};

/// Runs a program until it ends or its time is over; then it is killed. No process is left behind.
/// @param input  descriptor of its standard input.
/// @throws std::runtime_error naming the program, if it cannot be started.
ChildResult runChild(const std::string& program, std::vector<std::string> arguments, int input, double timeout_s);

}  // namespace pi_speech
