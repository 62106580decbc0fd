#pragma once

#include <netinet/in.h>

#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <unordered_map>
#include <vector>

#include "event_loop/event_loop.h"
#include "shm/file_descriptor.h"
#include "wire/frame_transport.h"
#include "wire/sp_socket.h"

namespace pi_os_transport
{

/// Timeout of a connection attempt. TCP would wait a second before it sends again; the next attempt sends at once.
constexpr std::chrono::milliseconds SP_CONNECT_TIME{300};
/// Every third attempt waits longer, for distant peers.
constexpr std::chrono::milliseconds SP_CONNECT_TIME_FAR{700};
/// Timeout for the SP header of a peer that this bridge connected to. Only a hanging peer exceeds it.
constexpr std::chrono::milliseconds SP_ANSWER_TIME{500};
/// Timeout for the SP header of a peer that connected to this bridge.
constexpr std::chrono::milliseconds SP_GREETING_TIME{2000};
/// Sent data must be acknowledged in this time, else the peer counts as unreachable. This includes a peer that runs but
/// reads nothing.
constexpr std::chrono::milliseconds SP_ACKNOWLEDGE_TIME{5000};
/// Most incoming connections; more are closed at once.
constexpr size_t SP_MAX_SOURCES = 256;
/// Bytes read from one source before other descriptors have their turn.
constexpr size_t SP_BYTES_PER_TURN = 1024 * 1024;

/// Why an incoming connection was closed, for counters.
enum class SourceFault
{
  MALFORMED,      ///< no SP header, or no frame of this protocol
  OVERSIZED,      ///< announced a frame that is too large
  WRONG_VERSION,  ///< a bridge of another version
  REFUSED,        ///< onHeader() refused a frame, or there were too many connections
};

// The `detail` of Listener::onSourceClosed() begins with one of these.
constexpr char NO_FRAME_DETAIL[] = "no frame of ours";
constexpr char NO_GREETING_DETAIL[] = "no SP header of a PUSH socket";
constexpr char OVERSIZED_DETAIL[] = "oversized frame";
constexpr char WRONG_VERSION_DETAIL[] = "wire version ";
constexpr char FRAME_REFUSED_DETAIL[] = "frame refused";
constexpr char TOO_MANY_DETAIL[] = "too many connections";

/// The fault that the `detail` of Listener::onSourceClosed() describes.
inline SourceFault faultOf(const std::string& detail)
{
  const auto begins = [&detail](const char* words) { return detail.rfind(words, 0) == 0; };
  if (begins(OVERSIZED_DETAIL))
  {
    return SourceFault::OVERSIZED;
  }
  if (begins(WRONG_VERSION_DETAIL))
  {
    return SourceFault::WRONG_VERSION;
  }
  if (begins(FRAME_REFUSED_DETAIL) || begins(TOO_MANY_DETAIL))
  {
    return SourceFault::REFUSED;
  }
  return SourceFault::MALFORMED;
}

/// @return why an SP message of `length` bytes cannot be a frame; empty if it can.
inline std::string faultOfLength(uint64_t length)
{
  if (length > FrameHeader::BYTES + MAX_PAYLOAD)
  {
    return OVERSIZED_DETAIL + (" of " + std::to_string(length)) + " bytes";
  }
  return length < FrameHeader::BYTES ? NO_FRAME_DETAIL : std::string();
}

/// Decodes the header at the start of an SP message. @return what is wrong with the header; empty if nothing.
inline std::string decodeHeader(const uint8_t* bytes, FrameHeader* header)
{
  if (!FrameHeader::decode(bytes, header))
  {
    return NO_FRAME_DETAIL;
  }
  if (header->version != WIRE_VERSION)
  {
    return WRONG_VERSION_DETAIL + std::to_string(header->version) + ", this bridge speaks " +
           std::to_string(WIRE_VERSION);
  }
  return {};
}

/// SP over TCP, see makeSpTransport(). Own sockets: a round trip of 1 kB takes 18 us instead of 38 us with libnanomsg
/// (docs/design/device_bridge.md).
class SpTransport : public FrameTransport
{
public:
  SpTransport(EventLoop* loop, Listener* listener) : loop_(loop), listener_(listener), buffer_(BUFFER_BYTES) {}
  ~SpTransport() override;

  bool listen(const Endpoint& endpoint, std::string* error) override;
  uint16_t port() const override { return acceptors_.empty() ? uint16_t{0} : acceptors_.front()->port; }
  ConnectionId connect(const Endpoint& endpoint) override;
  void close(ConnectionId connection) override;
  bool tellsConnected() const override { return true; }
  std::optional<std::chrono::microseconds> roundTrip(ConnectionId connection) const override;
  void closeSource(SourceId source) override;
  std::string addressOf(SourceId source) const override;
  bool writable(ConnectionId connection) const override;
  bool send(ConnectionId id, const FrameHeader& header, const iovec* payload, size_t pieces, bool more) override;

private:
  static constexpr size_t BUFFER_BYTES = 64 * 1024;

  struct Channel
  {
    FileDescriptor socket;
    bool closed = false;  ///< pending events must ignore this channel
    Timer timer;
  };
  void shut(Channel* channel);

  // Connections to other bridges, and the frames sent on them: sp_sender.cpp.
  struct Connection : Channel
  {
    enum class State
    {
      CONNECTING,
      GREETING,  ///< TCP has connected
      OPEN,
      BROKEN,  ///< send() failed; onClosed() follows
    };

    ConnectionId id = 0;
    State state = State::CONNECTING;
    std::array<uint8_t, GREETING_BYTES> greeting;
    size_t greeting_bytes = 0;
    std::array<uint8_t, HEAD_BYTES> head;  ///< length and header of the frame being sent
    std::array<iovec, 3> pieces;           ///< what is left to send: pieces [next_piece, pieces_end)
    size_t next_piece = 0;
    size_t pieces_end = 0;
    bool more = false;  ///< another frame follows the one that is being sent
  };

  // Handlers hold their own pointer: callbacks may close the connection.
  using ConnectionPointer = std::shared_ptr<Connection>;

  void onConnectionEvent(const ConnectionPointer& connection, uint32_t events);
  void onTcpConnected(const ConnectionPointer& connection);
  void readGreeting(const ConnectionPointer& connection);
  void readEnd(const ConnectionPointer& connection);
  static int sendPieces(Connection* connection);
  void setTimer(const ConnectionPointer& connection, std::chrono::milliseconds time);
  void failLater(const ConnectionPointer& connection, CloseReason reason);
  void fail(const ConnectionPointer& connection, CloseReason reason);

  // Connections of other bridges, and the frames received on them: sp_receiver.cpp.
  struct Acceptor
  {
    FileDescriptor socket;
    uint16_t port = 0;
    Timer pause;
  };

  struct Source : Channel
  {
    enum class Stage
    {
      GREETING,
      LENGTH,
      HEADER,
      PAYLOAD,
    };

    SourceId id = 0;
    std::string address;
    Stage stage = Stage::GREETING;
    std::array<uint8_t, FrameHeader::BYTES> head;  ///< of the stage before the payload
    size_t head_bytes = 0;
    FrameHeader header;
    uint32_t length = 0;  ///< of the payload
    uint32_t received = 0;
    uint8_t* payload = nullptr;
  };

  using SourcePointer = std::shared_ptr<Source>;

  void onAcceptorEvent(Acceptor* acceptor);
  void addSource(FileDescriptor socket, const sockaddr_in& address);
  void onSourceEvent(const SourcePointer& source);
  void takeBytes(const SourcePointer& source, const uint8_t* bytes, size_t count);
  void onHeadBytes(const SourcePointer& source, size_t count);
  void onHeader(const SourcePointer& source);
  void onPayloadBytes(const SourcePointer& source, size_t count);
  void fail(const SourcePointer& source, CloseReason reason, const std::string& detail);

  EventLoop* const loop_;
  Listener* const listener_;
  std::unordered_map<ConnectionId, ConnectionPointer> connections_;
  uint32_t attempts_ = 0;
  ConnectionId next_connection_ = 1;
  std::vector<std::unique_ptr<Acceptor>> acceptors_;
  std::unordered_map<SourceId, SourcePointer> sources_;
  SourceId next_source_ = 1;
  std::vector<uint8_t> buffer_;  ///< empty between events
};

}  // namespace pi_os_transport
