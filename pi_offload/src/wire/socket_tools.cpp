#include "wire/socket_tools.h"

#include <netdb.h>
#include <pi_node/durations.h>
#include <pi_node/unique_fd.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <chrono>
#include <condition_variable>
#include <stdexcept>
#include <system_error>
#include <thread>

namespace pi_offload
{
namespace
{

constexpr int BACKLOG = 128;
/// Longest look-up of the name to listen on.
constexpr double RESOLVE_S = 5.0;

Resolver::Answer lookUp(const HostPort& name, int flags)
{
  addrinfo hints{};
  hints.ai_family = AF_UNSPEC;
  hints.ai_socktype = SOCK_STREAM;
  hints.ai_flags = flags;
  addrinfo* found = nullptr;
  const int error =
      getaddrinfo(name.host.empty() ? nullptr : name.host.c_str(), std::to_string(name.port).c_str(), &hints, &found);
  Resolver::Answer answer;
  answer.done = true;
  if (error != 0)
  {
    answer.error =
        "cannot resolve '" + name.host + "': " + (error == EAI_SYSTEM ? errorText(errno) : gai_strerror(error));
    return answer;
  }
  for (const addrinfo* entry = found; entry != nullptr; entry = entry->ai_next)
  {
    SocketAddress address;
    address.length = entry->ai_addrlen;
    std::copy_n(reinterpret_cast<const char*>(entry->ai_addr), entry->ai_addrlen,
                reinterpret_cast<char*>(&address.storage));
    answer.addresses.push_back(address);
  }
  freeaddrinfo(found);
  return answer;
}

}  // namespace

WakeEvent::WakeEvent() : fd_(eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC))
{
  if (!fd_)
  {
    throw std::runtime_error("cannot make an event: " + errorText(errno));
  }
}

void WakeEvent::wake() const
{
  const uint64_t one = 1;
  // A failure means that the counter is full, so the thread is awake.
  [[maybe_unused]] const ssize_t written = ::write(fd_.get(), &one, sizeof(one));
}

void WakeEvent::clear() const
{
  uint64_t count;
  [[maybe_unused]] const ssize_t read = ::read(fd_.get(), &count, sizeof(count));
}

HostPort parseHostPort(const std::string& field, const std::string& address)
{
  const auto fail = [&](const std::string& what)
  { throw std::invalid_argument(field + " = '" + address + "': " + what + "; must be host:port"); };
  const size_t colon = address.rfind(':');
  if (colon == std::string::npos)
  {
    fail("no port");
  }
  HostPort result;
  result.host = address.substr(0, colon);
  if (result.host.size() >= 2 && result.host.front() == '[' && result.host.back() == ']')
  {
    result.host = result.host.substr(1, result.host.size() - 2);
  }
  else if (result.host.find(':') != std::string::npos)
  {
    fail("an IPv6 address needs brackets");
  }
  if (result.host.empty())
  {
    fail("no host");
  }
  const char* begin = address.data() + colon + 1;
  const char* end = address.data() + address.size();
  const auto parsed = std::from_chars(begin, end, result.port);
  if (parsed.ec != std::errc() || parsed.ptr != end || result.port == 0)
  {
    fail("the port must be in [1, 65535]");
  }
  return result;
}

std::string toText(const SocketAddress& address)
{
  char host[NI_MAXHOST] = "";
  char port[NI_MAXSERV] = "";
  if (getnameinfo(reinterpret_cast<const sockaddr*>(&address.storage), address.length, host, sizeof(host), port,
                  sizeof(port), NI_NUMERICHOST | NI_NUMERICSERV) != 0)
  {
    return "unknown";
  }
  return address.family() == AF_INET6 ? "[" + std::string(host) + "]:" + port : std::string(host) + ":" + port;
}

struct Resolver::State
{
  std::mutex mutex;
  std::condition_variable changed;
  bool busy = false;
  Answer answer;
};

Resolver::Resolver(std::shared_ptr<WakeEvent> wake) : state_(std::make_shared<State>()), wake_(std::move(wake)) {}

void Resolver::start(const HostPort& name)
{
  Answer numeric = lookUp(name, AI_NUMERICHOST | AI_NUMERICSERV);
  const std::lock_guard<std::mutex> lock(state_->mutex);
  if (state_->busy)
  {
    return;
  }
  if (!numeric.addresses.empty())
  {
    state_->answer = std::move(numeric);
    return;
  }
  state_->answer = Answer();
  state_->busy = true;
  std::thread(
      [state = state_, wake = wake_, name]
      {
        Answer answer = lookUp(name, AI_ADDRCONFIG | AI_NUMERICSERV);
        {
          const std::lock_guard<std::mutex> guard(state->mutex);
          state->answer = std::move(answer);
          state->busy = false;
        }
        state->changed.notify_all();
        if (wake)
        {
          wake->wake();
        }
      })
      .detach();
}

Resolver::Answer Resolver::take()
{
  const std::lock_guard<std::mutex> lock(state_->mutex);
  return std::exchange(state_->answer, Answer());
}

Resolver::Answer Resolver::waitFor(double seconds)
{
  std::unique_lock<std::mutex> lock(state_->mutex);
  state_->changed.wait_for(lock, std::chrono::duration<double>(seconds), [&] { return state_->answer.done; });
  return std::exchange(state_->answer, Answer());
}

pi_node::UniqueFd listenOn(const std::string& host, uint16_t* port)
{
  const auto fail = [&](const std::string& what) -> std::runtime_error
  { return std::runtime_error("cannot listen on " + host + ":" + std::to_string(*port) + ": " + what); };
  Resolver::Answer answer;
  if (host.empty())
  {
    answer = lookUp({host, *port}, AI_PASSIVE | AI_NUMERICSERV);
  }
  else
  {
    Resolver resolver(nullptr);
    resolver.start({host, *port});
    answer = resolver.waitFor(RESOLVE_S);
  }
  if (answer.addresses.empty())
  {
    throw fail(!answer.error.empty() ? answer.error : "its name was not resolved in time");
  }
  const SocketAddress& address = answer.addresses.front();
  pi_node::UniqueFd fd(socket(address.family(), SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0));
  if (!fd)
  {
    throw fail(errorText(errno));
  }
  const int again = 1;
  setsockopt(fd.get(), SOL_SOCKET, SO_REUSEADDR, &again, sizeof(again));
  SocketAddress bound;
  bound.length = sizeof(bound.storage);
  if (bind(fd.get(), reinterpret_cast<const sockaddr*>(&address.storage), address.length) != 0 ||
      listen(fd.get(), BACKLOG) != 0 ||
      getsockname(fd.get(), reinterpret_cast<sockaddr*>(&bound.storage), &bound.length) != 0)
  {
    throw fail(errorText(errno));
  }
  *port = ntohs(bound.family() == AF_INET6 ? reinterpret_cast<const sockaddr_in6*>(&bound.storage)->sin6_port
                                           : reinterpret_cast<const sockaddr_in*>(&bound.storage)->sin_port);
  return fd;
}

bool isShortage(int error)
{
  return error == EMFILE || error == ENFILE || error == ENOBUFS || error == ENOMEM;
}

int pollTimeout(int64_t until_ns)
{
  if (until_ns == INT64_MAX)
  {
    return -1;
  }
  const int64_t left_ns = std::max<int64_t>(0, until_ns - pi_node::monotonicNs());
  return static_cast<int>(std::min<int64_t>((left_ns + 999999) / 1000000, 3600 * 1000));
}

std::string errorText(int error)
{
  return std::generic_category().message(error);
}

}  // namespace pi_offload
