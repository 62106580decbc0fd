#pragma once

#include <netinet/in.h>

#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <unordered_map>
#include <utility>
#include <vector>

#include "event_loop/event_loop.h"
#include "shm/file_descriptor.h"
#include "wire/frame_transport.h"
#include "wire/sp_socket.h"
#include "wire/tls_keys.h"
#include "wire/tls_session.h"

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
/// The same when the ends also prove to each other who they are.
constexpr std::chrono::milliseconds SP_PROOF_TIME{2000};
/// Most incoming connections of one machine that have not proved who they are; more are closed at once.
constexpr size_t SP_MAX_UNPROVED = 16;
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
/// First byte of a record of TLS: handshake, alert.
constexpr uint8_t TLS_HANDSHAKE = 22;
constexpr uint8_t TLS_ALERT = 21;
constexpr char ONLY_OTHER_PROTECTS[] = "it speaks TLS: set secure: tls on both devices";

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
  SpTransport(EventLoop* loop, Listener* listener, std::shared_ptr<const TlsKeys> keys)
    : loop_(loop), listener_(listener), keys_(std::move(keys)), buffer_(BUFFER_BYTES)
  {
  }
  ~SpTransport() override;

  bool listen(const Endpoint& endpoint, std::string* error) override;
  uint16_t port() const override { return acceptors_.empty() ? uint16_t{0} : acceptors_.front()->port; }
  ConnectionId connect(const Endpoint& endpoint) override;
  void close(ConnectionId connection) override;
  bool tellsConnected() const override { return true; }
  std::optional<std::chrono::microseconds> roundTrip(ConnectionId connection) const override;
  void closeSource(SourceId source) override;
  std::string addressOf(SourceId source) const override;
  std::string identityOf(SourceId source) const override;
  bool writable(ConnectionId connection) const override;
  bool send(ConnectionId id, const FrameHeader& header, const iovec* payload, size_t pieces, bool more) override;

private:
  static constexpr size_t BUFFER_BYTES = 64 * 1024;

  struct Channel
  {
    FileDescriptor socket;
    std::unique_ptr<TlsSession> tls;  ///< null: not protected
    bool closed = false;              ///< pending events must ignore this channel
    Timer timer;

    // The connection's bytes for SpReader and SpWriter, protected or not: sp_channel.cpp.
    ssize_t receive(const iovec* places, size_t count) const;
    ssize_t send(const iovec* pieces, size_t count, bool more) const;
  };
  void shut(Channel* channel);
  static CloseReason reasonOfChannel(const Channel& channel, int error);
  static CloseReason reasonOfChannel(const Channel& channel, const SpReader& reader, const SpReader::Result& result);

  // Connections to other bridges, and the frames sent on them: sp_sender.cpp.
  struct Connection : Channel, SpReader::Sink
  {
    enum class State
    {
      CONNECTING,
      PROVING,  ///< TCP has connected; the ends prove who they are
      GREETING,
      OPEN,
      BROKEN,  ///< send() failed; onClosed() follows
    };

    // A PULL socket sends no messages.
    bool onLength(uint64_t) override { return false; }
    iovec place(size_t) override { return {}; }
    bool onMessage() override { return false; }

    ConnectionId id = 0;
    Endpoint at;
    State state = State::CONNECTING;
    SpReader reader{SpType::PULL, SP_LENGTH_BYTES};
    SpWriter writer;
    std::array<uint8_t, HEAD_BYTES> head;  ///< length and header of the frame being sent
  };

  // Handlers hold their own pointer: callbacks may close the connection.
  using ConnectionPointer = std::shared_ptr<Connection>;

  void onConnectionEvent(const ConnectionPointer& connection, uint32_t events);
  void onTcpConnected(const ConnectionPointer& connection);
  void prove(const ConnectionPointer& connection);
  void greet(const ConnectionPointer& connection);
  void readGreeting(const ConnectionPointer& connection);
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

  struct Source : Channel, SpReader::Sink
  {
    explicit Source(Listener* listener) : listener(listener) {}
    bool onLength(uint64_t length) override;
    iovec place(size_t missing) override;
    bool onMessage() override;
    bool beginPayload();

    Listener* const listener;
    SourceId id = 0;
    std::string address;
    bool proving = false;  ///< the ends prove who they are
    SpReader reader{SpType::PUSH, HEAD_BYTES};
    std::array<uint8_t, FrameHeader::BYTES> head;
    FrameHeader header;
    uint32_t length = 0;  ///< of the payload
    uint8_t* payload = nullptr;
    std::string fault;  ///< why a frame is refused
  };

  using SourcePointer = std::shared_ptr<Source>;

  void onAcceptorEvent(Acceptor* acceptor);
  void addSource(FileDescriptor socket, const sockaddr_in& address);
  bool prove(const SourcePointer& source);
  bool knocksTooOften(const std::string& address) const;
  void onSourceEvent(const SourcePointer& source);
  void fail(const SourcePointer& source, CloseReason reason, const std::string& detail);

  EventLoop* const loop_;
  Listener* const listener_;
  const std::shared_ptr<const TlsKeys> keys_;
  std::unordered_map<ConnectionId, ConnectionPointer> connections_;
  uint32_t attempts_ = 0;
  ConnectionId next_connection_ = 1;
  std::vector<std::unique_ptr<Acceptor>> acceptors_;
  std::unordered_map<SourceId, SourcePointer> sources_;
  SourceId next_source_ = 1;
  std::vector<uint8_t> buffer_;  ///< empty between events
};

}  // namespace pi_os_transport
