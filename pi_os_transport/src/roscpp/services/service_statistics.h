#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <string>

#include "roscpp/fallback.h"
#include "shm/latency_histogram.h"

namespace pi_os_transport
{

/// Counts the calls of one service in this process, over all connections.
struct ServiceCounts
{
  uint64_t memory = 0;                 ///< calls through shared memory
  uint64_t tcp = 0;                    ///< calls over TCPROS of clients that asked for shared memory
  uint64_t failed = 0;                 ///< failed calls of both kinds
  uint64_t pool_full = 0;              ///< requests or answers that found the pool full
  Fallback fallback = Fallback::NONE;  ///< why the last call used TCPROS
  LatencyHistogram durations;          ///< client: calls through shared memory; server: callbacks with waiting
};

/// ServiceCounts of one service. Thread safe.
class ServiceStatistics
{
public:
  template <typename Change>
  void update(Change change)
  {
    std::lock_guard<std::mutex> lock(mutex_);
    change(&counts_);
  }
  ServiceCounts counts() const
  {
    std::lock_guard<std::mutex> lock(mutex_);
    return counts_;
  }

private:
  mutable std::mutex mutex_;
  ServiceCounts counts_;
};

/// The statistics of all services that a process calls, or serves. Thread safe.
class ServiceStatisticsTable
{
public:
  std::shared_ptr<ServiceStatistics> of(const std::string& service)
  {
    std::lock_guard<std::mutex> lock(mutex_);
    std::shared_ptr<ServiceStatistics>& found = services_[service];
    if (!found)
    {
      found = std::make_shared<ServiceStatistics>();
    }
    return found;
  }
  std::map<std::string, std::shared_ptr<ServiceStatistics>> all() const
  {
    std::lock_guard<std::mutex> lock(mutex_);
    return services_;
  }

private:
  mutable std::mutex mutex_;
  std::map<std::string, std::shared_ptr<ServiceStatistics>> services_;
};

}  // namespace pi_os_transport
