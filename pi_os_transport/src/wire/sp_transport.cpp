#include "wire/sp_transport.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <stdexcept>
#include <system_error>
#include <unordered_map>
#include <utility>
#include <vector>

#include "event_loop/event_loop.h"
#include "wire/frame_transport.h"
#include "shm/file_descriptor.h"

namespace pi_os_transport
{
namespace
{

// SP over TCP (nanomsg, rfc/sp-tcp-mapping-01.txt): each end first sends its SP header with the number of its socket
// type, then a message is its length as 64 bits in network byte order, and its bytes.
constexpr size_t GREETING_BYTES = 8;
constexpr std::array<uint8_t, GREETING_BYTES> PUSH_GREETING{0, 'S', 'P', 0, 0, 0x50, 0, 0};
constexpr std::array<uint8_t, GREETING_BYTES> PULL_GREETING{0, 'S', 'P', 0, 0, 0x51, 0, 0};
constexpr size_t LENGTH_BYTES = 8;
constexpr size_t HEAD_BYTES = LENGTH_BYTES + FrameHeader::BYTES;

constexpr size_t BUFFER_BYTES = 64 * 1024;
/// After a payload of this size only the next frame's head is read ahead: more would have to be copied to where it
/// belongs, and copying costs more than the system call it saves.
constexpr uint32_t LARGE_PAYLOAD = 16 * 1024;
/// What one source may bring before the others have their turn.
constexpr size_t BYTES_PER_TURN = 1024 * 1024;
constexpr int ACCEPTED_PER_TURN = 64;
/// How long nobody is let in after accept() failed for want of descriptors or memory.
constexpr std::chrono::milliseconds ACCEPT_PAUSE{100};

void setOption(int fd, int level, int name, int value)
{
  setsockopt(fd, level, name, &value, sizeof(value));  // all of them are improvements that work without
}

/// For both ends: a peer whose machine or link has died is noticed though nothing is sent.
void setCommonOptions(int fd)
{
  setOption(fd, IPPROTO_TCP, TCP_NODELAY, 1);
  setOption(fd, SOL_SOCKET, SO_KEEPALIVE, 1);
  setOption(fd, IPPROTO_TCP, TCP_KEEPIDLE, 2);
  setOption(fd, IPPROTO_TCP, TCP_KEEPINTVL, 1);
  setOption(fd, IPPROTO_TCP, TCP_KEEPCNT, 3);
}

bool resolve(const Endpoint& endpoint, sockaddr_in* address)
{
  *address = {};
  address->sin_family = AF_INET;
  address->sin_port = htons(endpoint.port);
  return inet_pton(AF_INET, endpoint.address.c_str(), &address->sin_addr) == 1;
}

CloseReason reasonOf(int error)
{
  switch (error)
  {
    case ECONNREFUSED:
      return CloseReason::REFUSED;
    case ECONNRESET:
    case ECONNABORTED:
    case EPIPE:
      return CloseReason::PEER_CLOSED;
    default:
      return CloseReason::UNREACHABLE;
  }
}

bool isTemporary(int error)
{
  return error == EAGAIN || error == EWOULDBLOCK || error == EINTR;
}

bool sendGreeting(int fd, const std::array<uint8_t, GREETING_BYTES>& greeting)
{
  // A new connection always has room for it.
  return send(fd, greeting.data(), greeting.size(), MSG_NOSIGNAL | MSG_DONTWAIT) ==
         static_cast<ssize_t>(greeting.size());
}

class SpTransport : public FrameTransport
{
public:
  SpTransport(EventLoop* loop, Listener* listener) : loop_(loop), listener_(listener), buffer_(BUFFER_BYTES) {}
  ~SpTransport() override;

  bool listen(const Endpoint& endpoint, std::string* error) override;
  uint16_t port() const override { return acceptors_.empty() ? uint16_t{0} : acceptors_.front()->port; }
  ConnectionId connect(const Endpoint& endpoint) override;
  void close(ConnectionId connection) override;
  void closeSource(SourceId source) override;
  std::string addressOf(SourceId source) const override;
  bool tellsConnected() const override { return true; }
  bool writable(ConnectionId connection) const override;
  bool send(ConnectionId connection, const FrameHeader& header, const iovec* payload, size_t pieces,
            bool more) override;

private:
  struct Acceptor
  {
    FileDescriptor socket;
    uint16_t port = 0;
    EventLoop::TimerId pause = 0;
  };

  struct Connection
  {
    enum class State
    {
      CONNECTING,
      GREETING,  ///< TCP has connected
      OPEN,
      BROKEN,  ///< send() failed, the end has not been told yet
    };

    ConnectionId id = 0;
    FileDescriptor socket;
    State state = State::CONNECTING;
    bool closed = false;  ///< events under way must leave it alone
    EventLoop::TimerId timer = 0;
    std::array<uint8_t, GREETING_BYTES> greeting;
    size_t greeting_bytes = 0;
    std::array<uint8_t, HEAD_BYTES> head;  ///< length and header of the frame being sent
    std::array<iovec, 3> pieces;           ///< what is left of it: pieces [next_piece, pieces_end)
    size_t next_piece = 0;
    size_t pieces_end = 0;
    bool more = false;  ///< another frame follows the one that is being sent
  };

  struct Source
  {
    enum class Stage
    {
      GREETING,
      LENGTH,
      HEADER,
      PAYLOAD,
    };

    SourceId id = 0;
    FileDescriptor socket;
    std::string address;
    bool closed = false;
    EventLoop::TimerId timer = 0;
    Stage stage = Stage::GREETING;
    std::array<uint8_t, FrameHeader::BYTES> head;  ///< of the stage before the payload
    size_t head_bytes = 0;
    FrameHeader header;
    uint32_t length = 0;  ///< of the payload
    uint32_t received = 0;
    uint8_t* payload = nullptr;
  };

  // Handlers hold a pointer of their own: callbacks may close what they are working on.
  using ConnectionPointer = std::shared_ptr<Connection>;
  using SourcePointer = std::shared_ptr<Source>;

  void onConnectionEvent(const ConnectionPointer& connection, uint32_t events);
  void onTcpConnected(const ConnectionPointer& connection);
  void readGreeting(const ConnectionPointer& connection);
  void readEnd(const ConnectionPointer& connection);
  static int sendPieces(Connection* connection);
  void setTimer(const ConnectionPointer& connection, std::chrono::milliseconds time);
  void failLater(const ConnectionPointer& connection, CloseReason reason);
  void fail(const ConnectionPointer& connection, CloseReason reason);
  void shut(Connection* connection);

  void onAcceptorEvent(Acceptor* acceptor);
  void addSource(FileDescriptor socket, const sockaddr_in& address);
  void onSourceEvent(const SourcePointer& source);
  void takeBytes(const SourcePointer& source, const uint8_t* bytes, size_t count);
  void onHeadBytes(const SourcePointer& source, size_t count);
  void onPayloadBytes(const SourcePointer& source, size_t count);
  void fail(const SourcePointer& source, CloseReason reason, const std::string& detail);
  void shut(Source* source);

  EventLoop* const loop_;
  Listener* const listener_;
  std::vector<std::unique_ptr<Acceptor>> acceptors_;
  std::unordered_map<ConnectionId, ConnectionPointer> connections_;
  uint32_t attempts_ = 0;
  std::unordered_map<SourceId, SourcePointer> sources_;
  ConnectionId next_connection_ = 1;
  SourceId next_source_ = 1;
  std::vector<uint8_t> buffer_;  ///< empty between events: heads and payloads are kept where they belong
};

SpTransport::~SpTransport()
{
  for (const auto& acceptor : acceptors_)
  {
    loop_->cancel(acceptor->pause);
    loop_->remove(acceptor->socket.get());
  }
  for (const auto& connection : connections_)
  {
    shut(connection.second.get());
  }
  for (const auto& source : sources_)
  {
    shut(source.second.get());
  }
}

bool SpTransport::listen(const Endpoint& endpoint, std::string* error)
{
  const auto failed = [&](const std::string& what)
  {
    *error = endpoint.toString() + ": " + what;
    return false;
  };
  sockaddr_in address;
  if (!resolve(endpoint, &address))
  {
    return failed("not a numeric IPv4 address");
  }
  auto acceptor = std::make_unique<Acceptor>();
  acceptor->socket = FileDescriptor(socket(AF_INET, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0));
  const int fd = acceptor->socket.get();
  if (fd < 0)
  {
    return failed(std::generic_category().message(errno));
  }
  setOption(fd, SOL_SOCKET, SO_REUSEADDR, 1);
  socklen_t length = sizeof(address);
  if (bind(fd, reinterpret_cast<const sockaddr*>(&address), length) != 0 ||
      ::listen(fd, static_cast<int>(SP_MAX_SOURCES)) != 0 ||
      getsockname(fd, reinterpret_cast<sockaddr*>(&address), &length) != 0)
  {
    return failed(std::generic_category().message(errno));
  }
  acceptor->port = ntohs(address.sin_port);
  loop_->add(fd, EPOLLIN, [this, acceptor = acceptor.get()](uint32_t) { onAcceptorEvent(acceptor); });
  acceptors_.push_back(std::move(acceptor));
  return true;
}

FrameTransport::ConnectionId SpTransport::connect(const Endpoint& endpoint)
{
  const auto connection = std::make_shared<Connection>();
  connection->id = next_connection_++;
  connections_[connection->id] = connection;
  sockaddr_in address;
  if (!resolve(endpoint, &address))
  {
    failLater(connection, CloseReason::UNREACHABLE);
    return connection->id;
  }
  connection->socket = FileDescriptor(socket(AF_INET, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0));
  const int fd = connection->socket.get();
  if (fd < 0)
  {
    failLater(connection, reasonOf(errno));
    return connection->id;
  }
  setCommonOptions(fd);
  setOption(fd, IPPROTO_TCP, TCP_USER_TIMEOUT, static_cast<int>(SP_ACKNOWLEDGE_TIME.count()));
  if (::connect(fd, reinterpret_cast<const sockaddr*>(&address), sizeof(address)) != 0 && errno != EINPROGRESS)
  {
    failLater(connection, reasonOf(errno));
    return connection->id;
  }
  // Callers open two connections at a time, which need the same patience.
  setTimer(connection, attempts_++ / 2 % 3 == 2 ? SP_CONNECT_TIME_FAR : SP_CONNECT_TIME);
  loop_->add(fd, EPOLLOUT, [this, connection](uint32_t events) { onConnectionEvent(connection, events); });
  return connection->id;
}

void SpTransport::close(ConnectionId connection)
{
  const auto found = connections_.find(connection);
  if (found != connections_.end())
  {
    shut(found->second.get());
    connections_.erase(found);
  }
}

bool SpTransport::writable(ConnectionId connection) const
{
  const auto found = connections_.find(connection);
  return found != connections_.end() && found->second->state == Connection::State::OPEN &&
         found->second->next_piece == found->second->pieces_end;
}

bool SpTransport::send(ConnectionId id, const FrameHeader& header, const iovec* payload, size_t pieces, bool more)
{
  if (!writable(id))
  {
    return false;
  }
  const ConnectionPointer connection = connections_.at(id);
  if (pieces > connection->pieces.size() - 1)
  {
    throw std::invalid_argument("a frame of " + std::to_string(pieces) + " pieces, must be in [0, 2]");
  }
  uint64_t body = FrameHeader::BYTES;
  connection->pieces[0] = {connection->head.data(), connection->head.size()};
  for (size_t piece = 0; piece < pieces; ++piece)
  {
    connection->pieces[piece + 1] = payload[piece];
    body += payload[piece].iov_len;
  }
  if (body > FrameHeader::BYTES + MAX_PAYLOAD)
  {
    throw std::invalid_argument("payload of " + std::to_string(body - FrameHeader::BYTES) + " bytes, must be in [0, " +
                                std::to_string(MAX_PAYLOAD) + "]");
  }
  for (size_t byte = 0; byte < LENGTH_BYTES; ++byte)
  {
    connection->head[byte] = static_cast<uint8_t>(body >> (8 * (LENGTH_BYTES - 1 - byte)));
  }
  const auto encoded = header.encode();
  std::copy(encoded.begin(), encoded.end(), connection->head.begin() + LENGTH_BYTES);
  connection->next_piece = 0;
  connection->pieces_end = pieces + 1;
  connection->more = more;

  const int error = sendPieces(connection.get());
  if (error != 0)
  {
    failLater(connection, reasonOf(error));
    return false;
  }
  if (connection->next_piece != connection->pieces_end)
  {
    loop_->change(connection->socket.get(), EPOLLIN | EPOLLOUT);
  }
  return true;
}

/// Sends as much as the socket takes. @return error number, 0 for none.
int SpTransport::sendPieces(Connection* connection)
{
  msghdr message{};
  message.msg_iov = &connection->pieces[connection->next_piece];
  message.msg_iovlen = connection->pieces_end - connection->next_piece;
  const ssize_t result =
      sendmsg(connection->socket.get(), &message, MSG_NOSIGNAL | MSG_DONTWAIT | (connection->more ? MSG_MORE : 0));
  if (result < 0)
  {
    return isTemporary(errno) ? 0 : errno;
  }
  auto sent = static_cast<size_t>(result);
  while (connection->next_piece != connection->pieces_end && sent >= connection->pieces[connection->next_piece].iov_len)
  {
    sent -= connection->pieces[connection->next_piece++].iov_len;
  }
  if (connection->next_piece != connection->pieces_end)
  {
    iovec& piece = connection->pieces[connection->next_piece];
    piece = {static_cast<uint8_t*>(piece.iov_base) + sent, piece.iov_len - sent};
  }
  return 0;
}

void SpTransport::onConnectionEvent(const ConnectionPointer& connection, uint32_t events)
{
  using State = Connection::State;
  if (connection->closed || connection->state == State::BROKEN)
  {
    return;
  }
  if (connection->state == State::CONNECTING)
  {
    onTcpConnected(connection);
    return;
  }
  if (connection->state == State::GREETING)
  {
    readGreeting(connection);
    return;
  }
  if ((events & ~static_cast<uint32_t>(EPOLLOUT)) != 0)
  {
    readEnd(connection);
  }
  if (connection->closed || connection->next_piece == connection->pieces_end || (events & EPOLLOUT) == 0)
  {
    return;
  }
  const int error = sendPieces(connection.get());
  if (error != 0)
  {
    fail(connection, reasonOf(error));
  }
  else if (connection->next_piece == connection->pieces_end)
  {
    loop_->change(connection->socket.get(), EPOLLIN);
    listener_->onWritable(connection->id);
  }
}

void SpTransport::onTcpConnected(const ConnectionPointer& connection)
{
  const int fd = connection->socket.get();
  int error = 0;
  socklen_t length = sizeof(error);
  getsockopt(fd, SOL_SOCKET, SO_ERROR, &error, &length);
  if (error != 0)
  {
    fail(connection, reasonOf(error));
    return;
  }
  if (!sendGreeting(fd, PUSH_GREETING))
  {
    fail(connection, CloseReason::PEER_CLOSED);
    return;
  }
  connection->state = Connection::State::GREETING;
  setTimer(connection, SP_ANSWER_TIME);
  loop_->change(fd, EPOLLIN);
}

void SpTransport::readGreeting(const ConnectionPointer& connection)
{
  const ssize_t count = recv(connection->socket.get(), &connection->greeting[connection->greeting_bytes],
                             GREETING_BYTES - connection->greeting_bytes, MSG_DONTWAIT);
  if (count <= 0)
  {
    if (count == 0 || !isTemporary(errno))
    {
      fail(connection, count == 0 ? CloseReason::PEER_CLOSED : reasonOf(errno));
    }
    return;
  }
  connection->greeting_bytes += static_cast<size_t>(count);
  if (std::memcmp(connection->greeting.data(), PULL_GREETING.data(), connection->greeting_bytes) != 0)
  {
    fail(connection, CloseReason::MALFORMED);
    return;
  }
  if (connection->greeting_bytes == GREETING_BYTES)
  {
    loop_->cancel(std::exchange(connection->timer, 0));
    connection->state = Connection::State::OPEN;
    listener_->onConnected(connection->id);
  }
}

/// A PULL socket never says anything, so what there is to read can only be the end.
void SpTransport::readEnd(const ConnectionPointer& connection)
{
  uint8_t byte;
  const ssize_t count = recv(connection->socket.get(), &byte, 1, MSG_DONTWAIT);
  if (count >= 0)
  {
    fail(connection, count == 0 ? CloseReason::PEER_CLOSED : CloseReason::MALFORMED);
  }
  else if (!isTemporary(errno))
  {
    fail(connection, reasonOf(errno));
  }
}

void SpTransport::setTimer(const ConnectionPointer& connection, std::chrono::milliseconds time)
{
  loop_->cancel(connection->timer);
  connection->timer =
      loop_->after(time,
                   [this, connection]
                   {
                     connection->timer = 0;
                     fail(connection, connection->state == Connection::State::GREETING ? CloseReason::SILENT
                                                                                       : CloseReason::UNREACHABLE);
                   });
}

void SpTransport::failLater(const ConnectionPointer& connection, CloseReason reason)
{
  connection->state = Connection::State::BROKEN;
  loop_->defer(
      [this, connection, reason]
      {
        if (!connection->closed)
        {
          fail(connection, reason);
        }
      });
}

void SpTransport::fail(const ConnectionPointer& connection, CloseReason reason)
{
  shut(connection.get());
  connections_.erase(connection->id);
  listener_->onClosed(connection->id, reason);
}

void SpTransport::shut(Connection* connection)
{
  connection->closed = true;
  loop_->cancel(std::exchange(connection->timer, 0));
  loop_->remove(connection->socket.get());
  connection->socket.reset();
}

void SpTransport::onAcceptorEvent(Acceptor* acceptor)
{
  for (int turn = 0; turn < ACCEPTED_PER_TURN; ++turn)
  {
    sockaddr_in address{};
    socklen_t length = sizeof(address);
    const int fd =
        accept4(acceptor->socket.get(), reinterpret_cast<sockaddr*>(&address), &length, SOCK_NONBLOCK | SOCK_CLOEXEC);
    if (fd >= 0)
    {
      addSource(FileDescriptor(fd), address);
      continue;
    }
    if (errno == EMFILE || errno == ENFILE || errno == ENOBUFS || errno == ENOMEM)
    {
      // The caller stays in the queue, and the event with it.
      loop_->change(acceptor->socket.get(), 0);
      acceptor->pause = loop_->after(ACCEPT_PAUSE,
                                     [this, acceptor]
                                     {
                                       acceptor->pause = 0;
                                       loop_->change(acceptor->socket.get(), EPOLLIN);
                                     });
    }
    return;  // others are of a caller that has left; if there is another one, the event comes again
  }
}

void SpTransport::addSource(FileDescriptor socket, const sockaddr_in& address)
{
  char text[INET_ADDRSTRLEN] = "";
  inet_ntop(AF_INET, &address.sin_addr, text, sizeof(text));
  if (sources_.size() >= SP_MAX_SOURCES)
  {
    socket.reset();
    listener_->onSourceClosed(next_source_++, CloseReason::REFUSED, TOO_MANY_DETAIL);
    return;
  }
  if (!listener_->onAccept(text) || !sendGreeting(socket.get(), PULL_GREETING))
  {
    return;
  }
  setCommonOptions(socket.get());
  const auto source = std::make_shared<Source>();
  source->id = next_source_++;
  source->address = text;
  source->socket = std::move(socket);
  source->timer = loop_->after(SP_GREETING_TIME,
                               [this, source]
                               {
                                 source->timer = 0;
                                 fail(source, CloseReason::MALFORMED, std::string(NO_GREETING_DETAIL) + " in time");
                               });
  sources_[source->id] = source;
  loop_->add(source->socket.get(), EPOLLIN, [this, source](uint32_t) { onSourceEvent(source); });
}

void SpTransport::onSourceEvent(const SourcePointer& source)
{
  for (size_t turn_bytes = 0; !source->closed && turn_bytes < BYTES_PER_TURN;)
  {
    // The rest of a payload goes straight to its place, what follows it into the buffer.
    const bool in_payload = source->stage == Source::Stage::PAYLOAD;
    const size_t missing = in_payload ? source->length - source->received : 0;
    const size_t ahead = source->length >= LARGE_PAYLOAD ? HEAD_BYTES : buffer_.size();
    std::array<iovec, 2> places{{{nullptr, 0}, {buffer_.data(), ahead}}};
    if (in_payload)
    {
      places[0] = {source->payload + source->received, missing};
    }
    msghdr message{};
    message.msg_iov = in_payload ? places.data() : &places[1];
    message.msg_iovlen = in_payload ? 2 : 1;
    const ssize_t result = recvmsg(source->socket.get(), &message, MSG_DONTWAIT);
    if (result <= 0)
    {
      if (result == 0 || !isTemporary(errno))
      {
        fail(source, result == 0 ? CloseReason::PEER_CLOSED : reasonOf(errno), "");
      }
      return;
    }
    const auto count = static_cast<size_t>(result);
    turn_bytes += count;
    if (in_payload)
    {
      onPayloadBytes(source, std::min(count, missing));
    }
    if (count > missing)
    {
      takeBytes(source, buffer_.data(), count - missing);
    }
    if (count < missing + ahead)
    {
      return;  // that was all there is
    }
  }
}

void SpTransport::takeBytes(const SourcePointer& source, const uint8_t* bytes, size_t count)
{
  while (count != 0 && !source->closed)
  {
    size_t taken;
    if (source->stage == Source::Stage::PAYLOAD)
    {
      taken = std::min<size_t>(count, source->length - source->received);
      std::memcpy(source->payload + source->received, bytes, taken);
      onPayloadBytes(source, taken);
    }
    else
    {
      const size_t stage_bytes = source->stage == Source::Stage::GREETING ? GREETING_BYTES
                                 : source->stage == Source::Stage::LENGTH ? LENGTH_BYTES
                                                                          : FrameHeader::BYTES;
      taken = std::min(count, stage_bytes - source->head_bytes);
      std::memcpy(&source->head[source->head_bytes], bytes, taken);
      source->head_bytes += taken;
      onHeadBytes(source, stage_bytes);
    }
    bytes += taken;
    count -= taken;
  }
}

/// More of the head has come, which is whole with `stage_bytes`.
void SpTransport::onHeadBytes(const SourcePointer& source, size_t stage_bytes)
{
  using Stage = Source::Stage;
  if (source->stage == Stage::GREETING &&
      std::memcmp(source->head.data(), PUSH_GREETING.data(), source->head_bytes) != 0)
  {
    fail(source, CloseReason::MALFORMED, NO_GREETING_DETAIL);
    return;
  }
  if (source->head_bytes < stage_bytes)
  {
    return;
  }
  source->head_bytes = 0;
  if (source->stage == Stage::GREETING)
  {
    loop_->cancel(std::exchange(source->timer, 0));
    source->stage = Stage::LENGTH;
    return;
  }
  if (source->stage == Stage::LENGTH)
  {
    uint64_t length = 0;
    for (size_t byte = 0; byte < LENGTH_BYTES; ++byte)
    {
      length = length << 8 | source->head[byte];
    }
    const std::string fault = faultOfLength(length);
    if (!fault.empty())
    {
      fail(source, CloseReason::MALFORMED, fault);
      return;
    }
    source->length = static_cast<uint32_t>(length - FrameHeader::BYTES);
    source->stage = Stage::HEADER;
    return;
  }
  const std::string fault = decodeHeader(source->head.data(), &source->header);
  if (!fault.empty())
  {
    fail(source, CloseReason::MALFORMED, fault);
    return;
  }
  source->payload = listener_->onHeader(source->id, source->header, source->length);
  if (source->closed)
  {
    return;
  }
  if (source->payload == nullptr)
  {
    fail(source, CloseReason::MALFORMED, FRAME_REFUSED_DETAIL);
    return;
  }
  source->received = 0;
  source->stage = Stage::PAYLOAD;
  if (source->length == 0)
  {
    onPayloadBytes(source, 0);
  }
}

/// `count` more bytes lie where the payload belongs.
void SpTransport::onPayloadBytes(const SourcePointer& source, size_t count)
{
  source->received += static_cast<uint32_t>(count);
  if (source->received == source->length)
  {
    source->stage = Source::Stage::LENGTH;
    listener_->onFrame(source->id, source->header, source->payload, source->length);
  }
}

void SpTransport::fail(const SourcePointer& source, CloseReason reason, const std::string& detail)
{
  shut(source.get());
  listener_->onSourceClosed(source->id, reason, detail);
  sources_.erase(source->id);  // only now: the listener may want to name its address
}

void SpTransport::closeSource(SourceId source)
{
  const auto found = sources_.find(source);
  if (found != sources_.end() && !found->second->closed)
  {
    shut(found->second.get());
    sources_.erase(found);
  }
}

void SpTransport::shut(Source* source)
{
  source->closed = true;
  loop_->cancel(std::exchange(source->timer, 0));
  loop_->remove(source->socket.get());
  source->socket.reset();
}

std::string SpTransport::addressOf(SourceId source) const
{
  const auto found = sources_.find(source);
  return found != sources_.end() ? found->second->address : std::string();
}

}  // namespace

std::unique_ptr<FrameTransport> makeSpTransport(EventLoop* loop, FrameTransport::Listener* listener)
{
  return std::make_unique<SpTransport>(loop, listener);
}

}  // namespace pi_os_transport
