#pragma once

#include <array>
#include <chrono>
#include <memory>
#include <unordered_map>

#include "event_loop/event_loop.h"
#include "shm/file_descriptor.h"
#include "wire/frame_transport.h"
#include "wire/sp_socket.h"

namespace pi_os_transport
{

/// The outgoing half of SpTransport: connections to other bridges, and the frames sent on them.
class SpSender
{
public:
  using ConnectionId = FrameTransport::ConnectionId;

  SpSender(EventLoop* loop, FrameTransport::Listener* listener) : loop_(loop), listener_(listener) {}
  ~SpSender();

  // As in FrameTransport.
  ConnectionId connect(const Endpoint& endpoint);
  void close(ConnectionId connection);
  bool writable(ConnectionId connection) const;
  bool send(ConnectionId id, const FrameHeader& header, const iovec* payload, size_t pieces, bool more);

private:
  struct Connection
  {
    enum class State
    {
      CONNECTING,
      GREETING,  ///< TCP has connected
      OPEN,
      BROKEN,  ///< send() failed; onClosed() follows
    };

    ConnectionId id = 0;
    FileDescriptor socket;
    State state = State::CONNECTING;
    bool closed = false;  ///< pending events must ignore this connection
    Timer timer;
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
  void shut(Connection* connection);

  EventLoop* const loop_;
  FrameTransport::Listener* const listener_;
  std::unordered_map<ConnectionId, ConnectionPointer> connections_;
  uint32_t attempts_ = 0;
  ConnectionId next_connection_ = 1;
};

}  // namespace pi_os_transport
