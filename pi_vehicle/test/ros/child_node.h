#pragma once

#include <sys/mman.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <csignal>
#include <stdexcept>
#include <string>

namespace pi_vehicle::test
{

/// A node as a process of its own; it ends with the object.
class ChildNode
{
public:
  /// @param keep_errors  what it writes to stderr goes to errors() in place of the terminal.
  ChildNode(const char* program, const std::string& name, bool keep_errors = false)
  {
    const std::string argument = "__name:=" + name;
    errors_ = keep_errors ? ::memfd_create("errors", 0) : -1;
    child_ = ::fork();
    if (child_ == 0)
    {
      if (keep_errors)
      {
        ::dup2(errors_, STDERR_FILENO);
      }
      ::execl(program, program, argument.c_str(), static_cast<char*>(nullptr));
      ::_exit(127);
    }
    if (child_ < 0)
    {
      throw std::runtime_error("no process for " + name);
    }
  }
  ~ChildNode()
  {
    end(SIGKILL);
    if (errors_ >= 0)
    {
      ::close(errors_);
    }
  }
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

  std::string errors() const
  {
    std::string text(static_cast<size_t>(::lseek(errors_, 0, SEEK_END)), '\0');
    const ssize_t length = ::pread(errors_, text.data(), text.size(), 0);
    text.resize(static_cast<size_t>(std::max<ssize_t>(0, length)));
    return text;
  }

private:
  pid_t child_ = -1;
  int errors_ = -1;
};

}  // namespace pi_vehicle::test
