#pragma once

#include <sys/socket.h>

#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <string>
#include <unordered_map>
#include <vector>

#include "event_loop/event_loop.h"

namespace pi_os_transport
{

/// A socket address of any family.
struct SocketAddress
{
  sockaddr_storage storage{};
  socklen_t size = 0;  ///< 0: none
};

/// Finds the address of a host without making the loop wait: what is no number is asked for on threads, of which there
/// are never more than MOST_THREADS and between questions none. An answer is kept for a while.
class HostResolver
{
public:
  /// `address` without size: the host is not known.
  using Resolved = std::function<void(const SocketAddress& address)>;

  explicit HostResolver(EventLoop* loop);
  ~HostResolver();
  HostResolver(const HostResolver&) = delete;
  HostResolver& operator=(const HostResolver&) = delete;

  /// Calls `resolved` before it returns if the answer is at hand, else later from the loop.
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
