#pragma once

#include <ros/service_server_link.h>

#include <chrono>
#include <mutex>
#include <string>
#include <vector>

namespace pi_os_transport
{

/// Connections of single-shot clients to services, kept for a while after a call: the next one finds its shared memory
/// ready. A connection serves one call at a time. Thread safe.
class IdleServices
{
public:
  static IdleServices& instance();

  /// A connection that was kept under `key` and still stands, most recently used first; null if there is none.
  ros::ServiceServerLinkPtr take(const std::string& key);
  /// Keeps a connection; drops the one unused for longest if there are too many.
  void put(const std::string& key, const ros::ServiceServerLinkPtr& link);

private:
  using Clock = std::chrono::steady_clock;
  struct Idle
  {
    std::string key;
    ros::ServiceServerLinkPtr link;
    Clock::time_point since;
  };

  IdleServices() = default;
  void dropOld();

  std::mutex mutex_;
  std::vector<Idle> idle_;  ///< by rising time
  bool polling_ = false;
};

}  // namespace pi_os_transport
