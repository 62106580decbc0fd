#pragma once

#include <netinet/in.h>
#include <sys/socket.h>

#include <cstdint>
#include <memory>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

namespace pi_offload
{

/// Owns a descriptor; -1: none. Not thread safe.
class UniqueFd
{
public:
  UniqueFd() = default;
  explicit UniqueFd(int fd) : fd_(fd) {}
  ~UniqueFd() { reset(); }
  UniqueFd(UniqueFd&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}
  UniqueFd& operator=(UniqueFd&& other) noexcept
  {
    if (this != &other)
    {
      reset();
      fd_ = std::exchange(other.fd_, -1);
    }
    return *this;
  }
  UniqueFd(const UniqueFd&) = delete;
  UniqueFd& operator=(const UniqueFd&) = delete;
  int get() const { return fd_; }
  explicit operator bool() const { return fd_ >= 0; }
  void reset();

private:
  int fd_ = -1;
};

/// Wakes a thread that polls its descriptor. wake() is thread safe.
class WakeEvent
{
public:
  /// @throws std::runtime_error without descriptors.
  WakeEvent();
  int fd() const { return fd_.get(); }
  void wake() const;
  void clear() const;

private:
  UniqueFd fd_;
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

/// Looks names up in a thread of its own: a name server that does not answer stops nobody. Numbers need no thread.
/// Thread safe; a look-up that is still under way when this ends is left to end on its own.
class Resolver
{
public:
  struct Answer
  {
    bool done = false;
    std::vector<SocketAddress> addresses;
    std::string error;
  };
  /// @param wake  woken when a look-up has ended; may be null.
  explicit Resolver(std::shared_ptr<WakeEvent> wake);
  /// Begins to look up, if nothing is under way. The answer to numbers is there at once.
  void start(const HostPort& name);
  Answer take();
  /// Waits for an answer. @return one that is not done after the time.
  Answer waitFor(double seconds);

private:
  struct State;
  std::shared_ptr<State> state_;
  std::shared_ptr<WakeEvent> wake_;
};

/// No Nagle, keepalive after 2 s, and data that nobody acknowledges ends the connection after `acknowledge_s`.
void setConnectionOptions(int fd, double acknowledge_s);

/// @param host  name or number; empty: all.
/// @return a listening socket that does not block, and its port in `port`.
/// @throws std::runtime_error naming host, port and reason.
UniqueFd listenOn(const std::string& host, uint16_t* port);

/// Not to be taken for the end of a connection.
bool isTemporary(int error);
/// Accept again later: descriptors or memory are used up.
bool isShortage(int error);
std::string errorText(int error);

/// Of the monotonic clock.
int64_t monotonicNs();

}  // namespace pi_offload
