#pragma once

#include <sys/uio.h>

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "wire/wire_frame.h"

namespace pi_os_transport
{

class EventLoop;
class TlsKeys;

/// Where a bridge listens, or another one does.
struct Endpoint
{
  std::string address;  ///< numeric IPv4 address
  uint16_t port = 0;

  std::string toString() const { return address + ":" + std::to_string(port); }
  bool operator==(const Endpoint& other) const { return address == other.address && port == other.port; }
  bool operator<(const Endpoint& other) const
  {
    return address != other.address ? address < other.address : port < other.port;
  }
};

/// Whether a device may connect.
struct Verdict
{
  std::string refusal;      ///< why not; empty if it may
  bool is_revoked = false;  ///< the device is told so
};

/// Why a connection ended.
enum class CloseReason
{
  REFUSED,      ///< nobody listens there, but the machine answers
  PEER_CLOSED,  ///< the process at the other end has ended, or closed the connection
  UNREACHABLE,  ///< no answer, or no route
  SILENT,       ///< the machine accepts the connection, but the process does not speak
  MALFORMED,    ///< received data are not a frame of this protocol
  UNTRUSTED,    ///< the ends have not proved to each other who they are; onUntrusted() came before
};

/// Carries frames between bridges in nanomsg's pipeline pattern (SP protocol over TCP, PUSH to PULL). Each connection
/// has one direction. Frames arrive whole and in order, or not at all. Two implementations are compatible on the wire:
/// SpTransport (own sockets) and NanomsgTransport (libnanomsg).
///
/// Everything runs on the thread of the event loop. Callbacks may call the transport, also close().
class FrameTransport
{
public:
  using ConnectionId = uint32_t;  ///< outgoing; never 0, never reused
  using SourceId = uint32_t;      ///< incoming; never reused. 0: this transport cannot distinguish its sources

  class Listener
  {
  public:
    virtual ~Listener() = default;
    /// An outgoing connection is established.
    virtual void onConnected(ConnectionId connection) = 0;
    /// The last frame was sent completely: its payload can be freed, and the next frame be sent.
    virtual void onWritable(ConnectionId connection) = 0;
    /// An outgoing connection has ended or failed; its id is invalid now. Not called by close().
    virtual void onClosed(ConnectionId connection, CloseReason reason) = 0;

    /// @param address  numeric. @return true if this machine may connect.
    virtual bool onAccept(const std::string& address) = 0;
    /// A frame header of a known version was received; at most MAX_PAYLOAD bytes follow.
    /// @return where to put the `length` bytes of payload (not used for length 0). Null refuses the frame, and ends the
    ///         connection if the transport has one per source.
    virtual uint8_t* onHeader(SourceId source, const FrameHeader& header, uint32_t length) = 0;
    /// The frame is complete. Its payload is where onHeader() asked for it.
    virtual void onFrame(SourceId source, const FrameHeader& header, uint8_t* payload, uint32_t length) = 0;
    /// A protected connection: the other end has proved who it is.
    /// The first argument is where this bridge connected to; for an incoming connection its port is 0. Must call
    /// nothing of the transport.
    virtual Verdict onIdentity(const Endpoint&, const std::string&) { return {}; }
    /// The ends have not proved to each other who they are, or only one of them protects its connections.
    /// The first argument is that of onIdentity(), the second is the reason.
    virtual void onUntrusted(const Endpoint&, const std::string&) {}
    /// An incoming connection has ended; an incomplete frame is lost. For MALFORMED, `detail` tells why.
    virtual void onSourceClosed(SourceId source, CloseReason reason, const std::string& detail) = 0;
  };

  virtual ~FrameTransport() = default;

  /// Listens on a numeric address; port 0 takes any free one. @return false with `*error` set on failure.
  virtual bool listen(const Endpoint& endpoint, std::string* error) = 0;
  /// The port of the first endpoint listened on.
  virtual uint16_t port() const = 0;

  /// Begins to connect. onConnected() or onClosed() follows, after this call has returned.
  virtual ConnectionId connect(const Endpoint& endpoint) = 0;
  virtual void close(ConnectionId connection) = 0;
  /// True if onConnected() means that the other machine has accepted the connection.
  virtual bool tellsConnected() const = 0;
  /// Ends an incoming connection. Does nothing for source 0.
  virtual void closeSource(SourceId source) = 0;
  /// Numeric address of the machine that sends; empty if unknown.
  virtual std::string addressOf(SourceId source) const = 0;

  /// The name or key id that this source has proved to have; empty without protection.
  virtual std::string identityOf(SourceId) const { return {}; }
  /// The time of a round trip between the two machines at present, without what the processes add. Empty if this
  /// transport cannot tell.
  virtual std::optional<std::chrono::microseconds> roundTrip(ConnectionId connection) const = 0;

  /// True if send() accepts a frame now.
  virtual bool writable(ConnectionId connection) const = 0;
  /// Sends one frame. The header is copied. The pieces of payload (at most 2, together at most MAX_PAYLOAD) must stay
  /// valid until writable() is true again or the connection ends. If the frame is sent at once, the connection stays
  /// writable and no event follows. Never blocks and calls no callback.
  /// @param more  another frame follows at once, so both may share a packet.
  /// @return false if the connection is not writable or is gone.
  virtual bool send(ConnectionId connection, const FrameHeader& header, const iovec* payload = nullptr,
                    size_t pieces = 0, bool more = false) = 0;
};

/// SP over TCP with own sockets: TCP_NODELAY, payloads without copies, known source addresses, and connections that can
/// be ended one by one.
std::unique_ptr<FrameTransport> makeSpTransport(EventLoop* loop, FrameTransport::Listener* listener);
/// The same inside TLS: both ends prove who they are.
std::unique_ptr<FrameTransport> makeProtectedTransport(EventLoop* loop, FrameTransport::Listener* listener,
                                                       std::shared_ptr<const TlsKeys> keys);
/// The same through libnanomsg.
std::unique_ptr<FrameTransport> makeNanomsgTransport(EventLoop* loop, FrameTransport::Listener* listener);

}  // namespace pi_os_transport
