#pragma once

#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sys/socket.h>
#include <sys/uio.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <cstring>

namespace pi_os_transport
{

// SP over TCP, the wire of nanomsg (rfc/sp-tcp-mapping-01.txt): each end first sends an SP header with the number of
// its socket type. Each message is its length (64 bits, network byte order) and its bytes. SpReader and SpWriter are
// the two halves of a connection. Who connects, accepts and waits for the socket is their owner's affair. They take the
// bytes from, and give them to, an SpSocket or an object with the same functions, which may protect them.

/// The number of a socket type.
enum class SpType : uint16_t
{
  REQ = 0x30,
  REP = 0x31,
  PUSH = 0x50,
  PULL = 0x51,
};

constexpr size_t SP_HEADER_BYTES = 8;
constexpr size_t SP_LENGTH_BYTES = 8;

/// Writes an unsigned number as sizeof(Number) bytes, the highest byte first.
template <typename Number>
void storeBigEndian(uint8_t* out, Number value)
{
  for (size_t byte = 0; byte < sizeof(Number); ++byte)
  {
    out[byte] = static_cast<uint8_t>(value >> (8 * (sizeof(Number) - 1 - byte)));
  }
}

/// Reads what storeBigEndian() wrote.
template <typename Number>
Number loadBigEndian(const uint8_t* in)
{
  Number value = 0;
  for (size_t byte = 0; byte < sizeof(Number); ++byte)
  {
    value = static_cast<Number>(value << 8U | in[byte]);
  }
  return value;
}

constexpr std::array<uint8_t, SP_HEADER_BYTES> spHeader(SpType type)
{
  const auto number = static_cast<uint16_t>(type);
  return {0, 'S', 'P', 0, static_cast<uint8_t>(number >> 8U), static_cast<uint8_t>(number & 0xffU), 0, 0};
}

/// The bytes of a connection that nothing protects.
struct SpSocket
{
  int socket;

  /// Like recvmsg() without waiting.
  ssize_t receive(const iovec* places, size_t count) const
  {
    if (count == 1)
    {
      return recv(socket, places->iov_base, places->iov_len, MSG_DONTWAIT);
    }
    msghdr message{};
    message.msg_iov = const_cast<iovec*>(places);
    message.msg_iovlen = count;
    return recvmsg(socket, &message, MSG_DONTWAIT);
  }
  /// Like sendmsg() without waiting or a signal. @param more  more bytes follow at once and may share a packet
  ssize_t send(const iovec* pieces, size_t count, bool more) const
  {
    const int flags = MSG_NOSIGNAL | MSG_DONTWAIT | (more ? MSG_MORE : 0);
    if (count == 1)
    {
      return ::send(socket, pieces->iov_base, pieces->iov_len, flags);
    }
    msghdr message{};
    message.msg_iov = const_cast<iovec*>(pieces);
    message.msg_iovlen = count;
    return sendmsg(socket, &message, flags);
  }
};

/// Sends the own header, for which a new connection always has room. @return error number, 0 for none.
template <typename Bytes>
int sendSpHeader(const Bytes& bytes, SpType type)
{
  auto header = spHeader(type);
  const iovec piece{header.data(), header.size()};
  const ssize_t sent = bytes.send(&piece, 1, false);
  return sent < 0 ? errno : sent < static_cast<ssize_t>(header.size()) ? ENOBUFS : 0;
}

/// Whether the call can be repeated on the same connection.
inline bool isTemporary(int error)
{
  return error == EAGAIN || error == EWOULDBLOCK || error == EINTR;
}

/// No Nagle. With keep-alive, a dead machine or link is noticed although nothing is sent.
/// @param acknowledge  data without an acknowledgement for longer end the connection; 0: as long as TCP tries.
inline void setSpOptions(int socket, std::chrono::duration<double> acknowledge)
{
  const auto set = [socket](int level, int name, int value)
  {
    setsockopt(socket, level, name, &value, sizeof(value));  // an improvement; the connection works without it
  };
  set(IPPROTO_TCP, TCP_NODELAY, 1);
  set(SOL_SOCKET, SO_KEEPALIVE, 1);
  set(IPPROTO_TCP, TCP_KEEPIDLE, 2);
  set(IPPROTO_TCP, TCP_KEEPINTVL, 1);
  set(IPPROTO_TCP, TCP_KEEPCNT, 3);
  set(IPPROTO_TCP, TCP_USER_TIMEOUT, static_cast<int>(1e3 * acknowledge.count()));
}

/// The receiving half of a connection: checks the SP header of the peer and cuts what follows into messages. The bytes
/// of a large message are received at their final place. Not thread safe. Allocates nothing.
class SpReader
{
public:
  /// Takes the messages. A method that refuses ends the reading, and is the last one called; so it may end the
  /// connection, too.
  class Sink
  {
  public:
    virtual ~Sink() = default;
    /// A message of `length` bytes begins. @return false: refused.
    virtual bool onLength(uint64_t length) = 0;
    /// @param missing  bytes of the message that are still to come, at least 1.
    /// @return where to put the first of them; the next call follows when that is full. Empty: refused.
    virtual iovec place(size_t missing) = 0;
    /// The message is complete. @return false: refused.
    virtual bool onMessage() = 0;
  };

  enum class End
  {
    NONE,
    CLOSED,   ///< by the peer
    FAILED,   ///< by `error`
    NO_PEER,  ///< no SP header of the type that fits
    REFUSED,  ///< by the sink
  };
  struct Result
  {
    End end = End::NONE;
    int error = 0;
  };

  /// @param peer  the socket type that the other end must have.
  /// @param ahead_bytes  read beyond the end of a large message: as much as begins each message, so at least
  ///                     SP_LENGTH_BYTES.
  SpReader(SpType peer, size_t ahead_bytes) : peer_header_(spHeader(peer)), ahead_bytes_(ahead_bytes) {}

  /// Reads what is there, up to a budget, so that other connections have their turn.
  /// @param scratch  room of `scratch_bytes` for small messages; keeps nothing between calls.
  template <typename Bytes>
  Result receive(const Bytes& bytes, uint8_t* scratch, size_t scratch_bytes, size_t budget, Sink* sink);

  /// The peer's header was received.
  bool greeted() const { return greeted_; }
  /// Nothing of a next message was received.
  bool betweenMessages() const { return greeted_ && room_.iov_len == 0 && head_bytes_ == 0; }
  /// Of what the peer sent instead of its header.
  uint8_t firstByte() const { return head_[0]; }

private:
  /// After a message of this size little is read ahead: more would have to be copied, which costs more than the system
  /// call it saves.
  static constexpr size_t LARGE_MESSAGE = 16 * 1024;

  End take(const uint8_t* bytes, size_t count, Sink* sink);
  End onHeadBytes(Sink* sink);
  End onMessageBytes(size_t count, Sink* sink);

  const std::array<uint8_t, SP_HEADER_BYTES> peer_header_;
  const size_t ahead_bytes_;
  bool greeted_ = false;
  std::array<uint8_t, 8> head_{};  ///< of the SP header or a length
  size_t head_bytes_ = 0;
  size_t length_ = 0;    ///< of the message, or of the last one
  size_t received_ = 0;  ///< of the message
  iovec room_{};         ///< for the next bytes of the message; empty outside of messages
};

template <typename Bytes>
SpReader::Result SpReader::receive(const Bytes& bytes, uint8_t* scratch, size_t scratch_bytes, size_t budget, Sink* sink)
{
  for (size_t turn_bytes = 0; turn_bytes < budget;)
  {
    const size_t ahead = length_ >= LARGE_MESSAGE ? std::min(ahead_bytes_, scratch_bytes) : scratch_bytes;
    const std::array<iovec, 2> places{{room_, {scratch, ahead}}};
    const ssize_t result = room_.iov_len == 0 ? bytes.receive(&places[1], 1) : bytes.receive(places.data(), 2);
    if (result == 0)
    {
      return {End::CLOSED, 0};
    }
    if (result < 0)
    {
      return isTemporary(errno) ? Result() : Result{End::FAILED, errno};
    }
    const auto count = static_cast<size_t>(result);
    const size_t asked = room_.iov_len + ahead;
    const size_t placed = std::min(count, room_.iov_len);
    turn_bytes += count;
    End end = placed != 0 ? onMessageBytes(placed, sink) : End::NONE;
    if (end == End::NONE)
    {
      end = take(scratch, count - placed, sink);
    }
    if (end != End::NONE)
    {
      return {end, 0};
    }
    if (count < asked)
    {
      return {};  // everything was read
    }
  }
  return {};
}

inline SpReader::End SpReader::take(const uint8_t* bytes, size_t count, Sink* sink)
{
  End end = End::NONE;
  while (count != 0 && end == End::NONE)
  {
    const bool in_message = room_.iov_len != 0;
    const size_t taken = std::min(count, in_message ? room_.iov_len : head_.size() - head_bytes_);
    if (in_message)
    {
      std::memcpy(room_.iov_base, bytes, taken);
      end = onMessageBytes(taken, sink);
    }
    else
    {
      std::memcpy(&head_[head_bytes_], bytes, taken);
      head_bytes_ += taken;
      end = onHeadBytes(sink);
    }
    bytes += taken;
    count -= taken;
  }
  return end;
}

inline SpReader::End SpReader::onHeadBytes(Sink* sink)
{
  if (!greeted_ && std::memcmp(head_.data(), peer_header_.data(), head_bytes_) != 0)
  {
    return End::NO_PEER;
  }
  if (head_bytes_ < head_.size())
  {
    return End::NONE;
  }
  head_bytes_ = 0;
  if (!greeted_)
  {
    greeted_ = true;
    return End::NONE;
  }
  const auto length = loadBigEndian<uint64_t>(head_.data());
  if (!sink->onLength(length))
  {
    return End::REFUSED;
  }
  length_ = length;
  received_ = 0;
  return onMessageBytes(0, sink);
}

/// `count` more bytes of the message are in their place.
inline SpReader::End SpReader::onMessageBytes(size_t count, Sink* sink)
{
  received_ += count;
  room_ = {static_cast<uint8_t*>(room_.iov_base) + count, room_.iov_len - count};
  const size_t missing = length_ - received_;
  if (missing == 0)
  {
    room_ = {};
    return sink->onMessage() ? End::NONE : End::REFUSED;
  }
  if (room_.iov_len == 0)
  {
    room_ = sink->place(missing);
    room_.iov_len = std::min(room_.iov_len, missing);
  }
  return room_.iov_len != 0 ? End::NONE : End::REFUSED;
}

/// The sending half of a connection: one message at a time, from its owner's memory. Not thread safe.
class SpWriter
{
public:
  static constexpr size_t MAX_PIECES = 3;

  /// The last message was sent completely.
  bool idle() const { return next_ == end_; }
  size_t unsentBytes() const
  {
    size_t bytes = 0;
    for (size_t piece = next_; piece != end_; ++piece)
    {
      bytes += pieces_[piece].iov_len;
    }
    return bytes;
  }

  /// Sends a message as far as the socket takes it; resume() sends the rest. Only while idle.
  /// @param pieces  at most MAX_PIECES, beginning with the length. Their memory must stay until the writer is idle.
  /// @param more  another message follows at once, so both may share a packet.
  /// @return error number, 0 for none.
  template <typename Bytes>
  int begin(const Bytes& bytes, const iovec* pieces, size_t count, bool more = false)
  {
    std::copy_n(pieces, count, pieces_.begin());
    next_ = 0;
    end_ = count;
    more_ = more;
    return resume(bytes);
  }

  /// @return error number, 0 for none.
  template <typename Bytes>
  int resume(const Bytes& bytes)
  {
    const ssize_t result = bytes.send(&pieces_[next_], end_ - next_, more_);
    if (result < 0)
    {
      return isTemporary(errno) ? 0 : errno;
    }
    auto sent = static_cast<size_t>(result);
    while (next_ != end_ && sent >= pieces_[next_].iov_len)
    {
      sent -= pieces_[next_++].iov_len;
    }
    if (next_ != end_)
    {
      pieces_[next_] = {static_cast<uint8_t*>(pieces_[next_].iov_base) + sent, pieces_[next_].iov_len - sent};
    }
    return 0;
  }

private:
  std::array<iovec, MAX_PIECES> pieces_{};
  size_t next_ = 0;
  size_t end_ = 0;
  bool more_ = false;
};

}  // namespace pi_os_transport
