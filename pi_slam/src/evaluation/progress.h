#pragma once

#include <chrono>
#include <cstddef>

namespace pi_slam
{

/// Pairs done, their rate and the time left, on one line of stderr. Says nothing where stderr is no terminal.
class Progress
{
public:
  /// @param total  pairs to be expected.
  explicit Progress(size_t total, bool quiet);
  /// Leaves the line.
  ~Progress();
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  void show(size_t done);

private:
  const size_t total_;
  const bool shown_;
  const std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
  std::chrono::steady_clock::time_point last_;
  size_t done_ = 0;
};

}  // namespace pi_slam
