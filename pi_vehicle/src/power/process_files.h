#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace pi_vehicle::power
{

struct ThreadTime
{
  int32_t tid = 0;
  std::string name;    ///< at most 15 bytes
  double cpu_s = 0.0;  ///< user and system time since it began [s]
};

struct ProcessTime
{
  uint64_t start_ticks = 0;  ///< when it began; another value is another process with the same number
  double cpu_s = 0.0;        ///< user and system time since it began, of ended threads as well [s]
};

struct MachineTime
{
  double busy_s = 0.0;  ///< of all cores together, since the start: neither idle nor waiting for a disk [s]
  uint32_t cores = 0;
};

/// What the kernel says of processes in /proc. The clock of its times has steps of 10 ms. What cannot be read, as the
/// process has ended, is a zombie, or is another user's, is missing. Thread safe.
class ProcessFiles
{
public:
  /// @param root  where procfs is mounted. @param ticks_per_s  of its times; 0: those of this system.
  explicit ProcessFiles(std::string root = "/proc", double ticks_per_s = 0.0);

  std::optional<ProcessTime> process(int32_t pid) const;
  std::vector<ThreadTime> threads(int32_t pid) const;
  /// Proportional set size [bytes]: shared pages count by the number of processes that share them. Takes milliseconds.
  std::optional<double> memory(int32_t pid) const;
  std::optional<MachineTime> machine() const;

private:
  const std::string root_;
  const double ticks_per_s_;
};

}  // namespace pi_vehicle::power
