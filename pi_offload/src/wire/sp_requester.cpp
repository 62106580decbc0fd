#include "wire/sp_socket.h"

#include <pi_node/durations.h>
#include <pi_node/option_check.h>
#include <pi_node/unique_fd.h>

#include <poll.h>
#include <sys/socket.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <exception>
#include <mutex>
#include <stdexcept>
#include <thread>
#include <utility>

#include "wire/socket_tools.h"
#include "wire/sp_connection.h"
#include "wire/trusted_interfaces.h"

namespace pi_offload
{
void SpRequester::Options::validate() const
{
  const pi_node::OptionCheck check("requester");
  parseHostPort("requester/address", address);
  check.range("connect_timeout_s", connect_timeout_s, 0.01, 600.0);
  check.range("acknowledge_timeout_s", acknowledge_timeout_s, 0.1, 600.0);
  check.range("reconnect_s", reconnect_s, 0.001, 600.0);
  check.range("max_reconnect_s", max_reconnect_s, reconnect_s, 3600.0);
  check.range<size_t>("max_queued_bytes", max_queued_bytes, 1024, 1U << 30U);
  check.range<size_t>("max_message_bytes", max_message_bytes, 16, 1U << 30U);
}

/// States of the thread in their order: pause, name look-up, connection, handshake, open.
struct SpRequester::Impl
{
  enum class State
  {
    PAUSE,
    RESOLVING,
    CONNECTING,
    GREETING,
    OPEN,
  };

  Impl(const Options& options, Callbacks callbacks)
    : options(options)
    , name(parseHostPort("requester/address", options.address))
    , callbacks(std::move(callbacks))
    , trusted(options.trusted_interfaces)
    , wake(std::make_shared<WakeEvent>())
    , resolver(wake)
    , pause_s(options.reconnect_s)
  {
  }

  void run();
  void step(int64_t now_ns, short events);
  void startAttempt(int64_t now_ns);
  void connectToNext(int64_t now_ns);
  void onConnected(int64_t now_ns);
  void onReadable();
  void lose(const std::string& reason, bool at_once);
  void tell(bool up, const std::string& reason);
  bool onMessage(std::vector<uint8_t> message, std::string* reason);

  const Options options;
  const HostPort name;
  const Callbacks callbacks;
  const TrustedInterfaces trusted;
  const std::shared_ptr<WakeEvent> wake;

  std::mutex mutex;
  std::unique_ptr<SpConnection> connection;  ///< replaced by the thread only, under the mutex
  bool open = false;                         ///< under the mutex
  bool stop = false;                         ///< under the mutex
  bool reconnect = false;                    ///< under the mutex
  std::string reconnect_reason;              ///< under the mutex

  // Of the thread only:
  Resolver resolver;
  State state = State::PAUSE;
  int64_t until_ns = 0;  ///< of the state, except OPEN
  double pause_s;
  std::vector<SocketAddress> addresses;
  size_t next_address = 0;
  pi_node::UniqueFd connecting;
  bool told_up = false;
  std::string told_reason;

  std::thread thread;
};

void SpRequester::Impl::tell(bool up, const std::string& reason)
{
  if (up == told_up && reason == told_reason)
  {
    return;
  }
  told_up = up;
  told_reason = reason;
  if (callbacks.link)
  {
    callbacks.link(up, reason);
  }
}

/// Ends the connection or attempt. @param at_once  connect again without a pause.
void SpRequester::Impl::lose(const std::string& reason, bool at_once)
{
  {
    const std::lock_guard<std::mutex> lock(mutex);
    connection.reset();
    open = false;
    reconnect = false;
  }
  connecting.reset();
  state = State::PAUSE;
  const int64_t now_ns = pi_node::monotonicNs();
  until_ns = at_once ? now_ns : now_ns + pi_node::nanoseconds(pause_s);
  pause_s = at_once ? options.reconnect_s : std::min(2.0 * pause_s, options.max_reconnect_s);
  tell(false, reason);
}

void SpRequester::Impl::startAttempt(int64_t now_ns)
{
  if (next_address < addresses.size())
  {
    connectToNext(now_ns);
    return;
  }
  state = State::RESOLVING;
  until_ns = now_ns + pi_node::nanoseconds(options.connect_timeout_s);
  resolver.start(name);
  wake->wake();  // a numeric address is answered already
}

void SpRequester::Impl::connectToNext(int64_t now_ns)
{
  const SocketAddress address = addresses[next_address++];
  pi_node::UniqueFd fd(socket(address.family(), SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0));
  if (!fd)
  {
    lose("no socket: " + errorText(errno), false);
    return;
  }
  const std::string refusal = trusted.admitOutgoing(fd.get(), address);
  if (!refusal.empty())
  {
    lose(refusal, false);
    return;
  }
  pi_os_transport::setSpOptions(fd.get(), std::chrono::duration<double>(options.acknowledge_timeout_s));
  if (::connect(fd.get(), reinterpret_cast<const sockaddr*>(&address.storage), address.length) != 0 &&
      errno != EINPROGRESS)
  {
    lose(toText(address) + ": " + errorText(errno), false);
    return;
  }
  connecting = std::move(fd);
  state = State::CONNECTING;
  until_ns = now_ns + pi_node::nanoseconds(options.connect_timeout_s);
}

void SpRequester::Impl::onConnected(int64_t now_ns)
{
  int error = 0;
  socklen_t length = sizeof(error);
  getsockopt(connecting.get(), SOL_SOCKET, SO_ERROR, &error, &length);
  if (error != 0)
  {
    lose(options.address + ": " + errorText(error), false);
    return;
  }
  std::string reason;
  auto connected =
      std::make_unique<SpConnection>(std::move(connecting), SpConnection::Type::REQ, SpConnection::Type::REP,
                                     options.max_message_bytes, options.max_queued_bytes);
  if (!connected->greet(&reason))
  {
    lose(options.address + ": " + reason, false);
    return;
  }
  {
    const std::lock_guard<std::mutex> lock(mutex);
    connection = std::move(connected);
  }
  state = State::GREETING;
  until_ns = now_ns + pi_node::nanoseconds(options.connect_timeout_s);
}

bool SpRequester::Impl::onMessage(std::vector<uint8_t> message, std::string* reason)
{
  std::vector<uint32_t> ids;
  if (!takeIds(&message, 1, &ids))
  {
    *reason = "a reply without the number of a request";
    return false;
  }
  {
    const std::lock_guard<std::mutex> lock(mutex);
    if (reconnect || stop)
    {
      return true;  // the connection is given up
    }
  }
  try
  {
    if (callbacks.reply)
    {
      callbacks.reply(ids.front() & ~SpConnection::LAST_ID, std::move(message), pi_node::monotonicNs());
    }
  }
  catch (const std::exception& error)
  {
    *reason = std::string("the handler of a reply failed: ") + error.what();
    return false;
  }
  return true;
}

void SpRequester::Impl::onReadable()
{
  std::string reason;
  const bool fine = connection->receive(
      [this](std::vector<uint8_t> message, std::string* why) { return onMessage(std::move(message), why); }, &reason);
  if (state == State::GREETING && connection->greeted())
  {
    state = State::OPEN;
    pause_s = options.reconnect_s;
    next_address = 0;
    addresses.clear();  // the next connection looks them up again
    {
      const std::lock_guard<std::mutex> lock(mutex);
      open = !reconnect;
    }
    tell(true, "");
  }
  if (!fine)
  {
    lose(options.address + ": " + reason, false);
  }
}

/// @param events  of the socket.
void SpRequester::Impl::step(int64_t now_ns, short events)
{
  {
    std::unique_lock<std::mutex> lock(mutex);
    if (reconnect)
    {
      const std::string reason = reconnect_reason;
      lock.unlock();
      lose(reason, true);
    }
  }
  switch (state)
  {
    case State::PAUSE:
      if (now_ns >= until_ns)
      {
        startAttempt(now_ns);
      }
      return;
    case State::RESOLVING:
    {
      Resolver::Answer answer = resolver.take();
      if (answer.done && !answer.addresses.empty())
      {
        addresses = std::move(answer.addresses);
        next_address = 0;
        connectToNext(now_ns);
      }
      else if (answer.done || now_ns >= until_ns)
      {
        lose(answer.done ? answer.error : "cannot resolve '" + name.host + "': no answer in time", false);
      }
      return;
    }
    case State::CONNECTING:
      if ((events & (POLLOUT | POLLERR | POLLHUP)) != 0)
      {
        onConnected(now_ns);
      }
      else if (now_ns >= until_ns)
      {
        lose(options.address + ": no connection in time", false);
      }
      return;
    case State::GREETING:
    case State::OPEN:
      if ((events & POLLOUT) != 0)
      {
        std::string reason;
        std::unique_lock<std::mutex> lock(mutex);
        const bool fine = connection->flush(&reason);
        lock.unlock();
        if (!fine)
        {
          lose(options.address + ": " + reason, false);
          return;
        }
      }
      if ((events & (POLLIN | POLLERR | POLLHUP)) != 0)
      {
        onReadable();
      }
      if (state == State::GREETING && now_ns >= until_ns)
      {
        lose(options.address + ": it does not speak SP", false);
      }
      return;
  }
}

void SpRequester::Impl::run()
{
  short events = 0;
  for (;;)
  {
    step(pi_node::monotonicNs(), events);
    pollfd watched[2] = {{wake->fd(), POLLIN, 0}, {-1, 0, 0}};
    {
      const std::lock_guard<std::mutex> lock(mutex);
      if (stop)
      {
        return;
      }
      if (state == State::CONNECTING)
      {
        watched[1] = {connecting.get(), POLLOUT, 0};
      }
      else if (connection)
      {
        watched[1] = {connection->fd(), static_cast<short>(POLLIN | (connection->wantsToWrite() ? POLLOUT : 0)), 0};
      }
    }
    const int count = poll(watched, 2, pollTimeout(state == State::OPEN ? INT64_MAX : until_ns));
    events = count > 0 ? watched[1].revents : static_cast<short>(0);
    if (count > 0 && watched[0].revents != 0)
    {
      wake->clear();
    }
  }
}

SpRequester::SpRequester(const Options& options, Callbacks callbacks)
{
  options.validate();
  impl_ = std::make_unique<Impl>(options, std::move(callbacks));
  impl_->thread = std::thread([impl = impl_.get()] { impl->run(); });
}

SpRequester::~SpRequester()
{
  {
    const std::lock_guard<std::mutex> lock(impl_->mutex);
    impl_->stop = true;
    impl_->open = false;
  }
  impl_->wake->wake();
  impl_->thread.join();
}

bool SpRequester::send(uint32_t id, const std::vector<uint8_t>& body)
{
  if ((id & SpConnection::LAST_ID) != 0)
  {
    throw std::invalid_argument("request id " + std::to_string(id) + ", must be below 2^31");
  }
  const std::lock_guard<std::mutex> lock(impl_->mutex);
  if (!impl_->open)
  {
    return false;
  }
  const bool was_empty = !impl_->connection->wantsToWrite();
  if (!impl_->connection->enqueue({id | SpConnection::LAST_ID}, body))
  {
    return false;
  }
  std::string reason;
  // Sending here saves waking the thread, which will see an error itself.
  if (was_empty)
  {
    impl_->connection->flush(&reason);
    if (impl_->connection->wantsToWrite())
    {
      impl_->wake->wake();
    }
  }
  return true;
}

void SpRequester::reconnect(const std::string& reason)
{
  {
    const std::lock_guard<std::mutex> lock(impl_->mutex);
    impl_->reconnect = true;
    impl_->reconnect_reason = reason;
    impl_->open = false;
  }
  impl_->wake->wake();
}

bool SpRequester::connected() const
{
  const std::lock_guard<std::mutex> lock(impl_->mutex);
  return impl_->open;
}

}  // namespace pi_offload
