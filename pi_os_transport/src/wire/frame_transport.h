#pragma once

#include <sys/uio.h>

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>

#include "wire/wire_frame.h"

namespace pi_os_transport
{

class EventLoop;

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

/// Why a connection ended.
enum class CloseReason
{
  REFUSED,      ///< nobody listens there, but the machine answers
  PEER_CLOSED,  ///< the process at the other end has ended or closed it
  UNREACHABLE,  ///< no answer, or no route
  SILENT,       ///< the machine accepts the connection, but the process does not speak
  MALFORMED,    ///< what came is no frame of ours
};

/// Carries frames between bridges in nanomsg's pipeline pattern (SP protocol over TCP, PUSH to PULL): one direction per
/// connection, frames whole and in order, or not at all. Two implementations are wire compatible with each other:
/// SpTransport (own sockets) and NanomsgTransport (libnanomsg).
///
/// Everything happens on the thread of the event loop. Callbacks may call back into the transport, close() included.
class FrameTransport
{
public:
  using ConnectionId = uint32_t;  ///< outgoing; never 0, never reused
  using SourceId = uint32_t;      ///< incoming; never reused. 0: this transport cannot tell its sources apart

  class Listener
  {
  public:
    virtual ~Listener() = default;
    /// An outgoing connection stands.
    virtual void onConnected(ConnectionId connection) = 0;
    /// The last frame has left this process: the next one can be sent, and the last one's payload be freed.
    virtual void onWritable(ConnectionId connection) = 0;
    /// An outgoing connection has ended, or did not come about; its id is gone. Not called by close().
    virtual void onClosed(ConnectionId connection, CloseReason reason) = 0;

    /// Asks whether a machine may connect. `address` is numeric.
    virtual bool onAccept(const std::string& address) = 0;
    /// The header of a frame has come, of a version this bridge speaks, with at most MAX_PAYLOAD bytes to follow.
    /// @return where to put the `length` bytes of payload (never used for length 0); null to refuse the frame, which
    ///         also ends the connection where there is one per source.
    virtual uint8_t* onHeader(SourceId source, const FrameHeader& header, uint32_t length) = 0;
    /// The frame is complete, its payload where onHeader() wanted it.
    virtual void onFrame(SourceId source, const FrameHeader& header, uint8_t* payload, uint32_t length) = 0;
    /// An incoming connection has ended; a frame begun on it will not be completed. For MALFORMED, `detail` says why.
    virtual void onSourceClosed(SourceId source, CloseReason reason, const std::string& detail) = 0;
  };

  virtual ~FrameTransport() = default;

  /// Listens on a numeric address. @return false with `*error` set. Port 0 takes any free one.
  virtual bool listen(const Endpoint& endpoint, std::string* error) = 0;
  /// The port of the first endpoint listened on.
  virtual uint16_t port() const = 0;

  /// Begins to connect; onConnected() or onClosed() follows, never from within this call.
  virtual ConnectionId connect(const Endpoint& endpoint) = 0;
  virtual void close(ConnectionId connection) = 0;
  /// True if onConnected() shows that the other machine has accepted the connection.
  virtual bool tellsConnected() const = 0;
  /// Ends an incoming connection. Does nothing for source 0.
  virtual void closeSource(SourceId source) = 0;
  /// Numeric address of the machine behind a source; empty if unknown.
  virtual std::string addressOf(SourceId source) const = 0;

  /// True if send() would take a frame now.
  virtual bool writable(ConnectionId connection) const = 0;
  /// Sends one frame. The header is copied; the pieces of payload (at most 2, together at most MAX_PAYLOAD) must stay
  /// valid until writable() is true again or the connection ends.
  /// A frame that leaves at once keeps the connection writable, and no event follows. Never blocks, calls nothing back.
  /// @param more  another frame follows at once: this one may travel with it.
  /// @return false if the connection is not writable or is gone.
  virtual bool send(ConnectionId connection, const FrameHeader& header, const iovec* payload = nullptr,
                    size_t pieces = 0, bool more = false) = 0;
};

/// SP over TCP with sockets of our own: TCP_NODELAY, payloads read straight to where they belong and sent from where
/// they lie, sources known by address, one connection per source ended without harm to others.
std::unique_ptr<FrameTransport> makeSpTransport(EventLoop* loop, FrameTransport::Listener* listener);
/// The same through libnanomsg.
std::unique_ptr<FrameTransport> makeNanomsgTransport(EventLoop* loop, FrameTransport::Listener* listener);

}  // namespace pi_os_transport
