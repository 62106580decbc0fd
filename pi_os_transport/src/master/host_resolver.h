#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <string>
#include <unordered_map>
#include <vector>

#include "event_loop/event_loop.h"
#include "master/network_address.h"

namespace pi_os_transport
{

/// Finds the address of a host without blocking the loop. Names are resolved on at most MOST_THREADS threads, which
/// exist only during requests. Answers are kept for 30 s, failures for 2 s.
class HostResolver
{
public:
  /// `address` without size: the host is not known.
  using Resolved = std::function<void(const SocketAddress& address)>;

  explicit HostResolver(EventLoop* loop);
  ~HostResolver();
  HostResolver(const HostResolver&) = delete;
  HostResolver& operator=(const HostResolver&) = delete;

  /// Calls `resolved` at once if the answer is known, else later from the loop.
  void resolve(const std::string& host, uint16_t port, Resolved resolved);

private:
  static constexpr int MOST_THREADS = 4;
  struct Answers;  ///< shared with the threads, which may outlive this object
  struct Known
  {
    SocketAddress address;
    SteadyTime until;
  };
  struct Waiting
  {
    uint16_t port;
    Resolved resolved;
  };
  void startThreads();
  void takeAnswers();

  EventLoop* loop_;
  std::shared_ptr<Answers> answers_;
  std::unordered_map<std::string, Known> known_;
  std::unordered_map<std::string, std::vector<Waiting>> waiting_;
  std::deque<std::string> queue_;
  int threads_ = 0;
};

}  // namespace pi_os_transport
