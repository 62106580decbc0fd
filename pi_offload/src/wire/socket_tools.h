#pragma once

#include <netinet/in.h>
#include <pi_node/unique_fd.h>
#include <sys/socket.h>

#include <cstdint>
#include <memory>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

namespace pi_offload
{

/// Wakes a thread that polls its descriptor. wake() is thread safe.
class WakeEvent
{
public:
  /// @throws std::runtime_error if no descriptor is free.
  WakeEvent();
  int fd() const { return fd_.get(); }
  void wake() const;
  void clear() const;

private:
  pi_node::UniqueFd fd_;
};

struct HostPort
{
  std::string host;  ///< without the brackets of IPv6
  uint16_t port = 0;
};
/// @param address  "host:port", "[v6 address]:port".
/// @throws std::invalid_argument naming `field` and what is wrong.
HostPort parseHostPort(const std::string& field, const std::string& address);

struct SocketAddress
{
  sockaddr_storage storage{};
  socklen_t length = 0;
  int family() const { return storage.ss_family; }
};
/// "host:port" in numbers.
std::string toText(const SocketAddress& address);

/// Looks names up on a thread of its own, so that a silent name server blocks nobody; numeric addresses need no thread.
/// Thread safe. A look-up that outlives this object ends on its own.
class Resolver
{
public:
  struct Answer
  {
    bool done = false;
    std::vector<SocketAddress> addresses;
    std::string error;
  };
  /// @param wake  woken after a look-up; may be null.
  explicit Resolver(std::shared_ptr<WakeEvent> wake);
  /// Begins a look-up unless one is under way. A numeric address is answered at once.
  void start(const HostPort& name);
  Answer take();
  /// Waits for an answer. After a timeout its `done` is false.
  Answer waitFor(double seconds);

private:
  struct State;
  std::shared_ptr<State> state_;
  std::shared_ptr<WakeEvent> wake_;
};

/// @param host  name or numeric address; empty: all addresses. @param[in,out] port  0 becomes the chosen port.
/// @return a listening socket that does not block.
/// @throws std::runtime_error naming host, port and reason.
pi_node::UniqueFd listenOn(const std::string& host, uint16_t* port);

/// Whether descriptors or memory are used up; accept again after this pause.
bool isShortage(int error);
constexpr double ACCEPT_PAUSE_S = 0.1;
/// Timeout of poll and epoll_wait until an instant of the monotonic clock, an hour at most; INT64_MAX: never.
int pollTimeout(int64_t until_ns);
std::string errorText(int error);

}  // namespace pi_offload
