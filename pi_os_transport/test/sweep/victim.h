#pragma once

#include <sys/types.h>

#include <cstddef>
#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "marked_steps.h"

/// What to run, and where to kill it.
struct Plan
{
  int thread = -1;  ///< to be killed at its stop number `stop`; -1: none
  uint64_t stop = 0;
  std::vector<MarkedSteps> files;
  std::vector<std::string> environment;  ///< NAME=VALUE
  char** command = nullptr;              ///< ends with a null pointer
};

/// A program under ptrace, whose stops are counted: see stop_at.cpp.
class Victim
{
public:
  explicit Victim(const Plan& plan) : plan_(plan) {}

  /// @throws std::runtime_error if the program cannot be started under ptrace.
  void start();
  /// Returns when it has ended. @throws std::runtime_error if a step cannot be watched.
  void run();
  /// One line of JSON.
  std::string report() const;

private:
  struct Thread
  {
    size_t number = 0;
    bool maps_code = false;  ///< the system call that it was in maps executable memory
  };

  [[noreturn]] void become();
  void onStop(pid_t tid, int status);
  void onSystemCall(pid_t tid);
  bool onBreakpoint(pid_t tid);
  void count(pid_t tid, const std::string& what);
  void setBreakpoints();
  void add(pid_t tid);

  const Plan& plan_;
  pid_t pid_ = 0;
  bool executed_ = false;
  bool killed_ = false;
  int status_ = 0;
  std::map<pid_t, Thread> threads_;
  std::vector<uint64_t> stops_;
  std::map<uint64_t, std::string> breakpoints_;
  std::map<std::string, uint64_t> steps_;
  uint64_t calls_ = 0;
  std::string at_;
};
