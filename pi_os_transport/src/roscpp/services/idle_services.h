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

/// A connection of a single-shot client to a service, with its shared memory.
struct IdleService
{
  ros::ServiceServerLinkPtr link;
  std::shared_ptr<ServiceCaller> caller;
};

/// Keeps the connections of single-shot clients for 5 s after a call, so that the next call finds shared memory ready.
/// A connection serves one call at a time. Thread safe.
class IdleServices
{
public:
  static IdleServices& instance();

  /// The most recently used connection under `key` with ready shared memory; empty if there is none.
  IdleService take(const std::string& key);
  /// True if a connection under `key` has, or is about to get, shared memory.
  bool negotiates(const std::string& key);
  /// Keeps a connection under its caller's key. Drops the oldest one if there are too many.
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
