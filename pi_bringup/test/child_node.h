#pragma once

#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <stdexcept>
#include <string>

namespace pi_bringup::test
{

/// A node as a process of its own; it ends with the object.
class ChildNode
{
public:
  ChildNode(const char* program, const std::string& name)
  {
    const std::string argument = "__name:=" + name;
    child_ = ::fork();
    if (child_ == 0)
    {
      ::execl(program, program, argument.c_str(), static_cast<char*>(nullptr));
      ::_exit(127);
    }
    if (child_ < 0)
    {
      throw std::runtime_error("no process for " + name);
    }
  }
  ~ChildNode() { end(SIGKILL); }
  ChildNode(const ChildNode&) = delete;
  ChildNode& operator=(const ChildNode&) = delete;

  /// Waits for its end. @return what it ended with; -1: by the signal.
  int end(int signal)
  {
    if (child_ <= 0)
    {
      return -1;
    }
    ::kill(child_, signal);
    int status = 0;
    ::waitpid(child_, &status, 0);
    child_ = -1;
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  }

  /// Waits until it ends by itself. @return what it ended with; -1: by a signal.
  int wait() { return end(0); }

private:
  pid_t child_ = -1;
};

}  // namespace pi_bringup::test
