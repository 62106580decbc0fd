#include <nanomsg/nn.h>
#include <nanomsg/pipeline.h>
#include <nanomsg/tcp.h>
#include <sys/socket.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <stdexcept>
#include <unordered_map>
#include <utility>

#include "event_loop/event_loop.h"
#include "wire/frame_transport.h"
#include "wire/ipv4.h"
#include "wire/sp_transport.h"

namespace pi_os_transport
{
namespace
{

constexpr int KERNEL_BUFFER_BYTES = 1024 * 1024;
constexpr int RECONNECT_INTERVAL_MS = 100;
/// Another process may take a free port before libnanomsg does.
constexpr int FREE_PORT_TRIES = 20;

/// A socket of libnanomsg; empty if it could not be made.
class NanomsgSocket
{
public:
  explicit NanomsgSocket(int protocol) : socket_(nn_socket(AF_SP, protocol)) {}
  ~NanomsgSocket()
  {
    if (socket_ >= 0)
    {
      nn_close(socket_);  // waits until its connections are closed, but not until all data are sent
    }
  }
  NanomsgSocket(const NanomsgSocket&) = delete;
  NanomsgSocket& operator=(const NanomsgSocket&) = delete;

  int get() const { return socket_; }
  explicit operator bool() const { return socket_ >= 0; }

  bool set(int level, int option, int value)
  {
    return nn_setsockopt(socket_, level, option, &value, sizeof(value)) == 0;
  }
  /// A descriptor that is readable while the socket can send (NN_SNDFD) or receive (NN_RCVFD).
  int signal(int option) const
  {
    int fd = -1;
    size_t length = sizeof(fd);
    return nn_getsockopt(socket_, NN_SOL_SOCKET, option, &fd, &length) == 0 ? fd : -1;
  }

private:
  const int socket_;
};

std::string urlOf(const Endpoint& endpoint)
{
  return "tcp://" + endpoint.toString();
}

/// A port that is free now; 0 if there is none. libnanomsg does not tell which port it uses.
uint16_t freePort(const std::string& address)
{
  sockaddr_in wanted = socketAddress(address, 0);
  socklen_t length = sizeof(wanted);
  const FileDescriptor probe(socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0));
  if (!probe || bind(probe.get(), reinterpret_cast<const sockaddr*>(&wanted), length) != 0 ||
      getsockname(probe.get(), reinterpret_cast<sockaddr*>(&wanted), &length) != 0)
  {
    return 0;
  }
  return ntohs(wanted.sin_port);
}

/// libnanomsg connects, accepts and reconnects without telling its user. Therefore
/// - a connection counts as connected at once and is never closed by the peer. Frames may wait, and frames in the
///   kernel's buffers may be lost when a peer is replaced by another one;
/// - all sources are 0, addresses are unknown, onAccept() is not called, and closeSource() does nothing;
/// - a malformed frame is reported by onSourceClosed(0, MALFORMED, ...), although nothing is closed. For an oversized
///   frame, libnanomsg closes the connection without a report;
/// - close() drops what is not sent yet.
class NanomsgTransport : public FrameTransport
{
public:
  NanomsgTransport(EventLoop* loop, Listener* listener) : loop_(loop), listener_(listener) {}
  ~NanomsgTransport() override;

  bool listen(const Endpoint& endpoint, std::string* error) override;
  uint16_t port() const override { return port_; }
  ConnectionId connect(const Endpoint& endpoint) override;
  void close(ConnectionId connection) override;
  void closeSource(SourceId) override {}
  std::string addressOf(SourceId) const override { return {}; }
  bool tellsConnected() const override { return false; }
  std::optional<std::chrono::microseconds> roundTrip(ConnectionId) const override { return std::nullopt; }
  bool writable(ConnectionId connection) const override;
  bool send(ConnectionId connection, const FrameHeader& header, const iovec* payload, size_t pieces,
            bool /*more*/) override;

private:
  struct Connection
  {
    NanomsgSocket socket{NN_PUSH};
    int signal = -1;
    bool connected = false;
    bool closed = false;      ///< pending events must ignore this connection
    void* waiting = nullptr;  ///< message that the socket does not accept yet

    ~Connection()
    {
      if (waiting != nullptr)
      {
        nn_freemsg(waiting);
      }
    }
  };
  using ConnectionPointer = std::shared_ptr<Connection>;

  bool openReceiver();
  static bool connectSocket(Connection* connection, const Endpoint& endpoint);
  static bool sendWaiting(Connection* connection);
  void onSendSignal(ConnectionId id, const ConnectionPointer& connection);
  void onReceiveSignal();
  void onMessage(const uint8_t* body, size_t length);
  void shut(Connection* connection);

  EventLoop* const loop_;
  Listener* const listener_;
  std::unique_ptr<NanomsgSocket> receiver_;
  int receive_signal_ = -1;
  uint16_t port_ = 0;
  std::unordered_map<ConnectionId, ConnectionPointer> connections_;
  ConnectionId next_connection_ = 1;
};

NanomsgTransport::~NanomsgTransport()
{
  for (const auto& connection : connections_)
  {
    shut(connection.second.get());
  }
  loop_->remove(receive_signal_);
}

bool NanomsgTransport::listen(const Endpoint& endpoint, std::string* error)
{
  const auto failed = [&](const std::string& what)
  {
    *error = endpoint.toString() + ": " + what;
    return false;
  };
  if (!parseIpv4(endpoint.address))
  {
    return failed("not a numeric IPv4 address");
  }
  if (receiver_ == nullptr && !openReceiver())
  {
    return failed(nn_strerror(nn_errno()));
  }
  Endpoint bound = endpoint;
  bool done = false;
  for (int attempt = 0; attempt < FREE_PORT_TRIES && !done; ++attempt)
  {
    if (endpoint.port == 0)
    {
      bound.port = freePort(endpoint.address);
    }
    done = bound.port != 0 && nn_bind(receiver_->get(), urlOf(bound).c_str()) >= 0;
    if (endpoint.port != 0)
    {
      break;
    }
  }
  if (!done)
  {
    return failed(nn_strerror(nn_errno()));
  }
  if (port_ == 0)
  {
    port_ = bound.port;
  }
  return true;
}

bool NanomsgTransport::openReceiver()
{
  auto receiver = std::make_unique<NanomsgSocket>(NN_PULL);
  if (!*receiver || !receiver->set(NN_SOL_SOCKET, NN_RCVMAXSIZE, FrameHeader::BYTES + MAX_PAYLOAD) ||
      !receiver->set(NN_SOL_SOCKET, NN_RCVBUF, KERNEL_BUFFER_BYTES))
  {
    return false;
  }
  receive_signal_ = receiver->signal(NN_RCVFD);
  if (receive_signal_ < 0)
  {
    return false;
  }
  receiver_ = std::move(receiver);
  loop_->add(receive_signal_, EPOLLIN, [this](uint32_t) { onReceiveSignal(); });
  return true;
}

bool NanomsgTransport::connectSocket(Connection* connection, const Endpoint& endpoint)
{
  NanomsgSocket& socket = connection->socket;
  if (!socket || !parseIpv4(endpoint.address) || !socket.set(NN_TCP, NN_TCP_NODELAY, 1) ||
      !socket.set(NN_SOL_SOCKET, NN_SNDBUF, KERNEL_BUFFER_BYTES) ||
      !socket.set(NN_SOL_SOCKET, NN_RECONNECT_IVL, RECONNECT_INTERVAL_MS))
  {
    return false;
  }
  connection->signal = socket.signal(NN_SNDFD);
  return connection->signal >= 0 && nn_connect(socket.get(), urlOf(endpoint).c_str()) >= 0;
}

FrameTransport::ConnectionId NanomsgTransport::connect(const Endpoint& endpoint)
{
  const ConnectionId id = next_connection_++;
  const auto connection = std::make_shared<Connection>();
  connections_[id] = connection;
  const bool possible = connectSocket(connection.get(), endpoint);
  loop_->defer(
      [this, id, connection, possible]
      {
        if (connection->closed)
        {
          return;
        }
        if (possible)
        {
          connection->connected = true;
          listener_->onConnected(id);
        }
        else
        {
          close(id);
          listener_->onClosed(id, CloseReason::UNREACHABLE);
        }
      });
  return id;
}

void NanomsgTransport::close(ConnectionId connection)
{
  const auto found = connections_.find(connection);
  if (found != connections_.end())
  {
    shut(found->second.get());
    connections_.erase(found);
  }
}

void NanomsgTransport::shut(Connection* connection)
{
  connection->closed = true;
  if (connection->waiting != nullptr)
  {
    loop_->remove(connection->signal);
  }
}

bool NanomsgTransport::writable(ConnectionId connection) const
{
  const auto found = connections_.find(connection);
  return found != connections_.end() && found->second->connected && found->second->waiting == nullptr;
}

bool NanomsgTransport::send(ConnectionId id, const FrameHeader& header, const iovec* payload, size_t pieces,
                            bool /*more*/)
{
  if (!writable(id))
  {
    return false;
  }
  size_t length = FrameHeader::BYTES;
  for (size_t piece = 0; piece < pieces; ++piece)
  {
    length += payload[piece].iov_len;
  }
  if (length > FrameHeader::BYTES + MAX_PAYLOAD)
  {
    throw std::invalid_argument("payload of " + std::to_string(length - FrameHeader::BYTES) +
                                " bytes, must be in [0, " + std::to_string(MAX_PAYLOAD) + "]");
  }
  void* const message = nn_allocmsg(length, 0);
  if (message == nullptr)
  {
    return false;
  }
  const auto encoded = header.encode();
  auto* place = std::copy(encoded.begin(), encoded.end(), static_cast<uint8_t*>(message));
  for (size_t piece = 0; piece < pieces; ++piece)
  {
    const auto* bytes = static_cast<const uint8_t*>(payload[piece].iov_base);
    place = std::copy(bytes, bytes + payload[piece].iov_len, place);
  }
  const ConnectionPointer connection = connections_.at(id);
  connection->waiting = message;
  if (!sendWaiting(connection.get()))
  {
    // Watched only while a message waits: otherwise the socket would always be ready.
    loop_->add(connection->signal, EPOLLIN, [this, id, connection](uint32_t) { onSendSignal(id, connection); });
  }
  return true;
}

/// @return true if libnanomsg has taken the message.
bool NanomsgTransport::sendWaiting(Connection* connection)
{
  if (nn_send(connection->socket.get(), &connection->waiting, NN_MSG, NN_DONTWAIT) < 0)
  {
    return false;
  }
  connection->waiting = nullptr;
  return true;
}

void NanomsgTransport::onSendSignal(ConnectionId id, const ConnectionPointer& connection)
{
  if (!connection->closed && sendWaiting(connection.get()))
  {
    loop_->remove(connection->signal);
    listener_->onWritable(id);
  }
}

void NanomsgTransport::onReceiveSignal()
{
  for (size_t turn_bytes = 0; turn_bytes < SP_BYTES_PER_TURN;)
  {
    void* message = nullptr;
    const int length = nn_recv(receiver_->get(), &message, NN_MSG, NN_DONTWAIT);
    if (length < 0)
    {
      return;  // nothing left, or an error that is reported again
    }
    turn_bytes += static_cast<size_t>(length) + FrameHeader::BYTES;
    onMessage(static_cast<const uint8_t*>(message), static_cast<size_t>(length));
    nn_freemsg(message);
  }
}

void NanomsgTransport::onMessage(const uint8_t* body, size_t length)
{
  FrameHeader header;
  std::string fault = faultOfLength(length);
  if (fault.empty())
  {
    fault = decodeHeader(body, &header);
  }
  if (fault.empty())
  {
    const auto payload_length = static_cast<uint32_t>(length - FrameHeader::BYTES);
    uint8_t* const payload = listener_->onHeader(0, header, payload_length);
    if (payload != nullptr)
    {
      std::copy(body + FrameHeader::BYTES, body + length, payload);
      listener_->onFrame(0, header, payload, payload_length);
      return;
    }
    fault = FRAME_REFUSED_DETAIL;
  }
  listener_->onSourceClosed(0, CloseReason::MALFORMED, fault);
}

}  // namespace

std::unique_ptr<FrameTransport> makeNanomsgTransport(EventLoop* loop, FrameTransport::Listener* listener)
{
  return std::make_unique<NanomsgTransport>(loop, listener);
}

}  // namespace pi_os_transport
