#pragma once

#include <chrono>
#include <cstddef>
#include <string>
#include <utility>

namespace pi_node
{

/// Writes progress, rate and time left of a tool to stderr: on a terminal one line that changes, elsewhere a line for
/// each tenth.
class Progress
{
public:
  /// @param unit  what is counted: "pairs".
  Progress(std::string unit, bool quiet) : unit_(std::move(unit)), quiet_(quiet) {}
  /// Ends the line.
  ~Progress();
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  /// @param total  expected number; may be too small.
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
