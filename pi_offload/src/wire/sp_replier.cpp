#include "wire/sp_socket.h"

#include <pi_node/durations.h>
#include <pi_node/option_check.h>
#include <pi_node/unique_fd.h>

#include <sys/epoll.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <condition_variable>
#include <exception>
#include <map>
#include <mutex>
#include <stdexcept>
#include <thread>
#include <utility>

#include "wire/socket_tools.h"
#include "wire/sp_connection.h"
#include "wire/trusted_interfaces.h"

namespace pi_offload
{
namespace
{

/// Most devices between a vehicle and the node, as nanomsg's NN_MAXTTL.
constexpr size_t MAX_IDS = 9;
constexpr int EVENTS_PER_ROUND = 64;
constexpr int ACCEPTED_PER_ROUND = 64;
/// epoll's data of the other descriptors; connections have their number.
constexpr uint64_t WAKE = 0;
constexpr uint64_t LISTENER = 1;
constexpr uint64_t FIRST_CONNECTION = 2;

}  // namespace

void SpReplier::Options::validate() const
{
  const pi_node::OptionCheck check("replier");
  check.range<size_t>("max_connections", max_connections, 1, 100000);
  check.range<size_t>("max_message_bytes", max_message_bytes, 16, 1U << 30U);
  check.range<size_t>("max_queued_bytes", max_queued_bytes, 1024, 1U << 30U);
  check.range("handshake_timeout_s", handshake_timeout_s, 0.01, 600.0);
  check.range("idle_timeout_s", idle_timeout_s, 0.01, 86400.0);
  check.range("acknowledge_timeout_s", acknowledge_timeout_s, 0.1, 600.0);
  check.range<size_t>("max_receiving_bytes", max_receiving_bytes, max_message_bytes, size_t{1} << 40U);
}

struct SpReplier::Impl
{
  struct Connection
  {
    Connection(pi_node::UniqueFd fd, const Options& options, std::string address)
      : sp(std::move(fd), SpConnection::Type::REP, SpConnection::Type::REQ, options.max_message_bytes,
           options.max_queued_bytes)
      , address(std::move(address))
    {
    }

    SpConnection sp;
    const std::string address;
    // Of the thread only:
    int64_t until_ns = 0;  ///< limit of the handshake or of the next request
    bool greeted = false;
    size_t receiving_bytes = 0;
    // Under the mutex:
    bool broken = false;  ///< the thread must close it
    std::string reason;
    uint32_t events = 0;  ///< watched by epoll
  };

  Impl(const Options& options, Callbacks callbacks)
    : options(options), callbacks(std::move(callbacks)), trusted(options.trusted_interfaces)
  {
  }

  bool control(int operation, int fd, uint64_t id, uint32_t events) const
  {
    epoll_event event{};
    event.events = events;
    event.data.u64 = id;
    return epoll_ctl(epoll.get(), operation, fd, &event) == 0;
  }
  void watch(uint64_t id, Connection* connection);
  void run();
  void onEvent(uint64_t id, uint32_t events);
  void acceptAll();
  void closeDue();
  void closeNow(uint64_t id, const std::string& reason);
  void breakOff(Connection* connection, const std::string& reason);
  bool onMessage(uint64_t id, Connection* connection, std::vector<uint8_t> message, std::string* reason);
  int waitMilliseconds() const;

  const Options options;
  const Callbacks callbacks;
  const TrustedInterfaces trusted;
  WakeEvent wake;
  pi_node::UniqueFd listener;
  pi_node::UniqueFd epoll;
  uint16_t port = 0;

  std::mutex mutex;
  std::condition_variable sent;
  std::map<uint64_t, std::unique_ptr<Connection>> connections;  ///< changed by the thread only, under the mutex
  bool stop = false;

  // Of the thread only:
  uint64_t next_id = FIRST_CONNECTION;
  int64_t accept_again_ns = 0;  ///< 0: it accepts
  size_t receiving_bytes = 0;   ///< of all connections

  std::thread thread;
};

/// Under the mutex.
void SpReplier::Impl::watch(uint64_t id, Connection* connection)
{
  const uint32_t wanted = EPOLLIN | (connection->sp.wantsToWrite() ? static_cast<uint32_t>(EPOLLOUT) : 0U);
  if (wanted == connection->events)
  {
    return;
  }
  if (!control(connection->events == 0 ? EPOLL_CTL_ADD : EPOLL_CTL_MOD, connection->sp.fd(), id, wanted))
  {
    breakOff(connection, "cannot be watched: " + errorText(errno));
    return;
  }
  connection->events = wanted;
}

/// Under the mutex.
void SpReplier::Impl::breakOff(Connection* connection, const std::string& reason)
{
  if (!connection->broken)
  {
    connection->broken = true;
    connection->reason = reason;
  }
}

void SpReplier::Impl::closeNow(uint64_t id, const std::string& reason)
{
  const auto found = connections.find(id);
  if (found == connections.end())
  {
    return;
  }
  const bool greeted = found->second->greeted;
  receiving_bytes -= found->second->receiving_bytes;
  {
    const std::lock_guard<std::mutex> lock(mutex);
    connections.erase(found);
  }
  sent.notify_all();
  if (greeted && callbacks.closed)
  {
    callbacks.closed(id, reason);
  }
}

/// Closes what is broken or late.
void SpReplier::Impl::closeDue()
{
  const int64_t now_ns = pi_node::monotonicNs();
  std::vector<std::pair<uint64_t, std::string>> due;
  {
    const std::lock_guard<std::mutex> lock(mutex);
    for (const auto& [id, connection] : connections)
    {
      if (connection->broken)
      {
        due.emplace_back(id, connection->reason);
      }
      else if (now_ns >= connection->until_ns)
      {
        due.emplace_back(id, connection->greeted ? "no request for too long" : "no SP header in time");
      }
    }
  }
  for (const auto& [id, reason] : due)
  {
    closeNow(id, reason);
  }
}

void SpReplier::Impl::acceptAll()
{
  for (int count = 0; count < ACCEPTED_PER_ROUND; ++count)
  {
    SocketAddress address;
    address.length = sizeof(address.storage);
    pi_node::UniqueFd fd(accept4(listener.get(), reinterpret_cast<sockaddr*>(&address.storage), &address.length,
                                 SOCK_NONBLOCK | SOCK_CLOEXEC));
    if (!fd)
    {
      if (isShortage(errno))
      {
        // The caller stays in the kernel's queue; the listener is not watched for a while.
        control(EPOLL_CTL_MOD, listener.get(), LISTENER, 0);
        accept_again_ns = pi_node::monotonicNs() + pi_node::nanoseconds(ACCEPT_PAUSE_S);
      }
      return;  // the caller has left; further callers bring another event
    }
    const std::string refusal = trusted.admitIncoming(fd.get(), address);
    if (!refusal.empty() && callbacks.problem)
    {
      callbacks.problem(refusal);
    }
    if (!refusal.empty() || connections.size() >= options.max_connections)
    {
      continue;
    }
    pi_os_transport::setSpOptions(fd.get(), std::chrono::duration<double>(options.acknowledge_timeout_s));
    const uint64_t id = next_id++;
    auto connection = std::make_unique<Connection>(std::move(fd), options, toText(address));
    connection->until_ns = pi_node::monotonicNs() + pi_node::nanoseconds(options.handshake_timeout_s);
    const std::lock_guard<std::mutex> lock(mutex);
    std::string reason;
    if (!connection->sp.greet(&reason))
    {
      breakOff(connection.get(), reason);
    }
    watch(id, connection.get());
    connections[id] = std::move(connection);
  }
}

bool SpReplier::Impl::onMessage(uint64_t id, Connection* connection, std::vector<uint8_t> message, std::string* reason)
{
  Peer peer;
  if (!takeIds(&message, MAX_IDS, &peer.route))
  {
    *reason = "a request without its number";
    return false;
  }
  peer.connection = id;
  peer.address = connection->address;
  const int64_t now_ns = pi_node::monotonicNs();
  connection->until_ns = now_ns + pi_node::nanoseconds(options.idle_timeout_s);
  try
  {
    if (callbacks.request)
    {
      callbacks.request(peer, std::move(message), now_ns);
    }
  }
  catch (const std::exception& error)
  {
    *reason = std::string("the handler of a request failed: ") + error.what();
    return false;
  }
  const std::lock_guard<std::mutex> lock(mutex);
  *reason = connection->reason;
  return !connection->broken;
}

void SpReplier::Impl::onEvent(uint64_t id, uint32_t events)
{
  const auto found = connections.find(id);
  if (found == connections.end())
  {
    return;
  }
  Connection* connection = found->second.get();
  std::string reason;
  if ((events & ~static_cast<uint32_t>(EPOLLOUT)) != 0)
  {
    const bool fine = connection->sp.receive([&](std::vector<uint8_t> message, std::string* why)
                                             { return onMessage(id, connection, std::move(message), why); },
                                             &reason);
    receiving_bytes += connection->sp.incomingBytes() - connection->receiving_bytes;
    connection->receiving_bytes = connection->sp.incomingBytes();
    if (!connection->greeted && connection->sp.greeted())
    {
      connection->greeted = true;
      connection->until_ns = pi_node::monotonicNs() + pi_node::nanoseconds(options.idle_timeout_s);
    }
    if (fine && receiving_bytes > options.max_receiving_bytes)
    {
      closeNow(id, "too much is being received on all connections");
      return;
    }
    if (!fine)
    {
      closeNow(id, reason);
      return;
    }
  }
  const std::lock_guard<std::mutex> lock(mutex);
  if ((events & EPOLLOUT) != 0 && !connection->sp.flush(&reason))
  {
    breakOff(connection, reason);
    return;
  }
  if (!connection->sp.wantsToWrite())
  {
    sent.notify_all();
  }
  watch(id, connection);
}

int SpReplier::Impl::waitMilliseconds() const
{
  int64_t next_ns = accept_again_ns != 0 ? accept_again_ns : INT64_MAX;
  for (const auto& entry : connections)
  {
    next_ns = std::min(next_ns, entry.second->until_ns);
  }
  return pollTimeout(next_ns);
}

void SpReplier::Impl::run()
{
  std::array<epoll_event, EVENTS_PER_ROUND> events;
  for (;;)
  {
    closeDue();
    const int count = epoll_wait(epoll.get(), events.data(), EVENTS_PER_ROUND, waitMilliseconds());
    for (int index = 0; index < count; ++index)
    {
      const epoll_event& event = events[static_cast<size_t>(index)];
      if (event.data.u64 == WAKE)
      {
        wake.clear();
      }
      else if (event.data.u64 == LISTENER)
      {
        acceptAll();
      }
      else
      {
        onEvent(event.data.u64, event.events);
      }
    }
    {
      const std::lock_guard<std::mutex> lock(mutex);
      if (stop)
      {
        return;
      }
    }
    if (accept_again_ns != 0 && pi_node::monotonicNs() >= accept_again_ns)
    {
      accept_again_ns = 0;
      control(EPOLL_CTL_MOD, listener.get(), LISTENER, EPOLLIN);
    }
  }
}

SpReplier::SpReplier(const Options& options, Callbacks callbacks)
{
  options.validate();
  impl_ = std::make_unique<Impl>(options, std::move(callbacks));
  impl_->port = options.port;
  impl_->listener = listenOn(options.host, &impl_->port);
  const std::string refusal = impl_->trusted.admitListener(impl_->listener.get());
  if (!refusal.empty())
  {
    throw std::runtime_error(refusal);
  }
  impl_->epoll = pi_node::UniqueFd(epoll_create1(EPOLL_CLOEXEC));
  if (!impl_->epoll || !impl_->control(EPOLL_CTL_ADD, impl_->wake.fd(), WAKE, EPOLLIN) ||
      !impl_->control(EPOLL_CTL_ADD, impl_->listener.get(), LISTENER, EPOLLIN))
  {
    throw std::runtime_error("cannot listen on " + options.host + ":" + std::to_string(impl_->port) + ": " +
                             errorText(errno));
  }
  impl_->thread = std::thread([impl = impl_.get()] { impl->run(); });
}

SpReplier::~SpReplier()
{
  {
    const std::lock_guard<std::mutex> lock(impl_->mutex);
    impl_->stop = true;
  }
  impl_->wake.wake();
  impl_->thread.join();
}

uint16_t SpReplier::port() const
{
  return impl_->port;
}

bool SpReplier::reply(const Peer& peer, const std::vector<uint8_t>& body)
{
  const std::lock_guard<std::mutex> lock(impl_->mutex);
  const auto found = impl_->connections.find(peer.connection);
  if (found == impl_->connections.end() || found->second->broken)
  {
    return false;
  }
  Impl::Connection* connection = found->second.get();
  std::string reason;
  const bool was_empty = !connection->sp.wantsToWrite();
  if (!connection->sp.enqueue(peer.route, body))
  {
    impl_->breakOff(connection, "it does not read its replies");
  }
  else if (was_empty && !connection->sp.flush(&reason))
  {
    impl_->breakOff(connection, reason);
  }
  else
  {
    impl_->watch(peer.connection, connection);
  }
  if (connection->broken)
  {
    impl_->wake.wake();
    return false;
  }
  return true;
}

void SpReplier::close(uint64_t connection, const std::string& reason)
{
  const std::lock_guard<std::mutex> lock(impl_->mutex);
  const auto found = impl_->connections.find(connection);
  if (found != impl_->connections.end())
  {
    impl_->breakOff(found->second.get(), reason);
    impl_->wake.wake();
  }
}

bool SpReplier::flush(double timeout_s)
{
  std::unique_lock<std::mutex> lock(impl_->mutex);
  return impl_->sent.wait_for(lock, std::chrono::duration<double>(timeout_s),
                              [&]
                              {
                                return std::none_of(impl_->connections.begin(), impl_->connections.end(),
                                                    [](const auto& entry) { return entry.second->sp.wantsToWrite(); });
                              });
}

size_t SpReplier::connections() const
{
  const std::lock_guard<std::mutex> lock(impl_->mutex);
  return impl_->connections.size();
}

}  // namespace pi_offload
