#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "bridge/peer.h"
#include "event_loop/event_loop.h"
#include "shm/file_descriptor.h"
#include "wire/frame_transport.h"

namespace pi_os_transport
{

/// One TCP connection between a service client and its server on another device, carried by the bridges. Bytes arrive
/// complete and in order, also after an interruption of the session. A side that does not read blocks only its own
/// tunnel.
class Tunnel : public FrameSource, public std::enable_shared_from_this<Tunnel>
{
public:
  enum class Side
  {
    CLIENT,
    SERVER,
  };
  /// Frames from the client's side carry the id of the tunnel; frames from the server's side add this bit.
  static constexpr uint32_t SERVER_BIT = 1u << 31;

  /// @param socket  connected, or being connected (server's side); owned from now on.
  /// @param on_closed  called once, when the tunnel has ended; may destroy the tunnel.
  Tunnel(EventLoop* loop, Peer* peer, uint32_t id, Side side, FileDescriptor socket, std::string target,
         std::function<void()> on_closed);
  ~Tunnel() override;

  void start();

  // Frames of the peer. Each returns false if the frame is not acceptable; the tunnel is then closed.
  bool onData(const FrameHeader& header, const uint8_t* payload, uint32_t length);
  bool onCredit(const FrameHeader& header);
  void onClose(const FrameHeader& header);

  /// The session was interrupted: sends again what the peer has not acknowledged.
  void rewind();
  /// Ends the tunnel at once.
  void finish();

  bool sendNext(Peer* peer, Lane* lane) override;
  Traffic traffic() const override { return traffic_; }

  const std::string& target() const { return target_; }
  const char* state() const { return connected_ ? (end_known_ ? "closing" : "open") : "connecting"; }
  uint64_t sentBytes() const { return read_; }
  uint64_t receivedBytes() const { return received_; }
  /// Bytes received and not written to the socket yet.
  uint64_t waitingBytes() const { return received_ - written_; }

private:
  struct Chunk
  {
    uint64_t offset;
    std::vector<uint8_t> bytes;
  };
  void onSocket(uint32_t events);
  void onReadable();
  void onWritable();
  void updateEvents();
  void sendCredit();
  void sendClose(bool at_once, const std::string& reason);
  void onAcknowledged();
  FrameHeader headerOf(FrameType type, uint64_t offset = 0) const;

  EventLoop* const loop_;
  Peer* const peer_;
  const uint32_t id_;
  const Side side_;
  FileDescriptor socket_;
  const std::string target_;
  std::function<void()> on_closed_;
  Traffic traffic_ = Traffic::EXPRESS;
  bool connected_;
  bool local_end_ = false;  ///< the local process has closed its end
  uint32_t events_ = 0;

  // From the local process to the peer [B].
  uint64_t read_ = 0;    ///< from the socket
  uint64_t credit_ = 0;  ///< delivered by the peer
  std::shared_ptr<Chunk> next_;
  std::deque<std::shared_ptr<Chunk>> resend_;
  std::deque<std::shared_ptr<Chunk>> unacked_;

  // From the peer to the local process [B].
  uint64_t received_ = 0;
  uint64_t written_ = 0;
  uint64_t credited_ = 0;
  std::deque<std::vector<uint8_t>> to_write_;
  size_t first_offset_ = 0;  ///< of to_write_.front(), already written
  bool end_known_ = false;   ///< the peer sends end_ bytes in total
  uint64_t end_ = 0;
};

}  // namespace pi_os_transport
