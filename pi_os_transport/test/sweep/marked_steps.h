#pragma once

#include <sys/types.h>

#include <cstdint>
#include <map>
#include <set>
#include <string>
#include <vector>

/// The steps that are marked in one file (src/shm/step_mark.h), and where that file lies in a process.
class MarkedSteps
{
public:
  /// @throws std::runtime_error if `file` is not an ELF file of this machine.
  explicit MarkedSteps(const std::string& file);

  /// Addresses in the process `pid` -> name; empty if the code is not mapped there yet.
  std::map<uint64_t, std::string> locate(pid_t pid) const;
  std::set<std::string> names() const;

private:
  struct Step
  {
    uint64_t address;  ///< as linked
    std::string name;
  };

  std::string path_;
  uint64_t code_address_ = 0;  ///< of the executable part, as linked
  uint64_t code_offset_ = 0;   ///< and in the file
  std::vector<Step> steps_;
};
