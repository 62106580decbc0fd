#pragma once

#include <sys/types.h>

#include <functional>
#include <string>
#include <thread>

namespace pi_offload_bench
{

/// What stands between two texts; empty if they are not there.
std::string between(const std::string& text, const std::string& before, const std::string& after);

/// A program with a file of configuration in a process of its own, that ends with this object at the latest. Not thread
/// safe.
class Program
{
public:
  /// Starts it and waits until it works.
  /// @param option  that takes the file. @param works  by what it has said so far.
  /// @throws std::runtime_error with what it said if it did not begin to work within 60 s.
  Program(const std::string& program, const std::string& option, const std::string& config,
          const std::function<bool(const std::string& log)>& works);
  ~Program();
  Program(const Program&) = delete;
  Program& operator=(const Program&) = delete;

  pid_t process() const { return process_; }
  const std::string& beginning() const { return log_; }  ///< of what it said
  void kill();                                           ///< at once, if it runs
  /// SIGTERM; waits for its end. @return its exit status; -1: a signal ended it.
  int end();

private:
  void readLog(int from);

  pid_t process_ = -1;
  std::string log_;
  std::thread reader_;
};

}  // namespace pi_offload_bench
