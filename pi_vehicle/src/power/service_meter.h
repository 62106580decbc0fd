#pragma once

#include "power/process_files.h"

#include <cstdint>
#include <map>
#include <string>
#include <vector>

namespace pi_vehicle::power
{

/// A service, and where it runs: in processes of its own, or by threads of processes that it shares with others.
struct ServiceDescription
{
  std::string name;
  std::vector<std::string> nodes;    ///< their processes are the service's; of a nodelet the manager counts
  std::vector<std::string> threads;  ///< patterns with * and ?: its own where several services share a process
  bool optional = false;             ///< nobody is told when none of its nodes is there

  /// @throws std::invalid_argument naming what is wrong and the way out.
  void validate() const;
};

/// @throws std::invalid_argument for a service that is wrong, or two of one name.
void validateServices(const std::vector<ServiceDescription>& services);

/// The table of config/power.yaml.
std::vector<ServiceDescription> defaultServices();

struct ServiceUse
{
  std::string name;
  bool running = false;            ///< a process of its own is there, or one that it shares and has threads in
  std::vector<std::string> nodes;  ///< those that are there
  double cores = 0.0;              ///< CPU time per time: 1.0 is one core
  double memory = 0.0;             ///< [bytes] proportional; of a process that it shares none. NaN: cannot be read
};

struct MachineUse
{
  double period_s = 0.0;             ///< that the figures are the mean of; 0: nothing is known yet
  uint32_t cores = 0;                ///< of the computer
  double busy_cores = 0.0;           ///< of all processes of the computer
  std::vector<ServiceUse> services;  ///< in the order of the descriptions
  ServiceUse shared;                 ///< processes that services share, without the threads that are a service's own
  ServiceUse other;                  ///< the rest of the computer; its memory is not measured (NaN)
};

/// CPU time and memory of services. Not thread safe.
class ServiceMeter
{
public:
  /// @param memory_period_s  between two readings of memory, which cost more.
  /// @throws std::invalid_argument as validateServices().
  ServiceMeter(std::vector<ServiceDescription> services, ProcessFiles files, double memory_period_s = 5.0);

  /// Between the call before and this one. A process that is seen for the first time counts from now on.
  /// @param now_ns  of a clock that never goes back.
  /// @param pids    by the names of nodes; those that have ended may be among them.
  MachineUse update(int64_t now_ns, const std::map<std::string, int32_t>& pids);

private:
  struct Seen
  {
    ProcessTime time;
    std::map<int32_t, double> threads;  ///< [s] by their number
    double memory = 0.0;
  };
  struct Spent
  {
    double process_s = 0.0;
    std::vector<std::pair<std::string, double>> threads;  ///< name and time [s]
    double memory = 0.0;
  };

  Spent spent(int32_t pid, bool threads, bool memory, std::map<int32_t, Seen>* seen) const;

  const std::vector<ServiceDescription> services_;
  const ProcessFiles files_;
  const int64_t memory_period_ns_;
  std::map<int32_t, Seen> seen_;
  double busy_s_ = -1.0;  ///< of the computer at the update before; below 0: not known
  int64_t updated_ns_ = 0;
  int64_t memory_ns_ = 0;
};

}  // namespace pi_vehicle::power
