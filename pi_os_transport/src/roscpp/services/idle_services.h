#pragma once

#include <ros/service_server_link.h>

#include <chrono>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "roscpp/services/service_caller.h"

namespace pi_os_transport
{

/// A connection of a single-shot client to a service, with the shared memory beside it.
struct IdleService
{
  ros::ServiceServerLinkPtr link;
  std::shared_ptr<ServiceCaller> caller;
};

/// Connections of single-shot clients to services, kept for a while after a call: the next one finds its shared memory
/// ready. A connection serves one call at a time. Thread safe.
class IdleServices
{
public:
  static IdleServices& instance();

  /// A connection that was kept under `key` and whose shared memory is ready, most recently used first; empty if there
  /// is none.
  IdleService take(const std::string& key);
  /// True if a connection is kept under `key` whose shared memory is not ready yet.
  bool negotiates(const std::string& key);
  /// Keeps a connection under its caller's key; drops the one unused for longest if there are too many.
  void put(const IdleService& service);

private:
  using Clock = std::chrono::steady_clock;
  struct Idle
  {
    IdleService service;
    Clock::time_point since;
  };

  IdleServices() = default;
  void dropOld();

  std::mutex mutex_;
  std::vector<Idle> idle_;  ///< by rising time
  bool polling_ = false;
};

}  // namespace pi_os_transport
