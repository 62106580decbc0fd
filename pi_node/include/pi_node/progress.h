#pragma once

#include <chrono>
#include <cstddef>
#include <string>
#include <utility>

namespace pi_node
{

/// How far a tool is, its rate and the time left, on stderr: one line that changes on a terminal, a line every tenth
/// elsewhere.
class Progress
{
public:
  /// @param unit  what is counted: "pairs".
  Progress(std::string unit, bool quiet) : unit_(std::move(unit)), quiet_(quiet) {}
  /// Leaves the line.
  ~Progress();
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  /// @param total  to be expected; it may turn out too small.
  void show(size_t done, size_t total);
  double seconds() const;  ///< since construction

private:
  const std::string unit_;
  const bool quiet_;
  const std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
  std::chrono::steady_clock::time_point last_;
  bool line_open_ = false;
  size_t tenth_ = 0;
};

}  // namespace pi_node
