#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "event_loop/event_loop.h"
#include "wire/frame_transport.h"
#include "bridge/peer.h"
#include "shm/file_descriptor.h"

namespace pi_os_transport
{

/// One TCP connection between processes of two devices, carried by the bridges: a service client here and its server
/// there, or the other way round. Bytes arrive whole and in order, also after an interruption of the session; a side
/// that does not read holds up only its own tunnel.
class Tunnel : public FrameSource, public std::enable_shared_from_this<Tunnel>
{
public:
  enum class Side
  {
    CLIENT,
    SERVER,
  };
  /// Frames about a tunnel that its client's side asked for carry its id; those in the other direction add this bit.
  static constexpr uint32_t SERVER_BIT = 1u << 31;

  /// @param socket  connected, or being connected (server's side). Taken over.
  /// @param on_closed  called once, when the tunnel has ended; may destroy it.
  Tunnel(EventLoop* loop, Peer* peer, uint32_t id, Side side, FileDescriptor socket, std::string target,
         std::function<void()> on_closed);
  ~Tunnel() override;

  void start();

  // Frames of the peer. Each returns false if the frame is not acceptable; the tunnel is then closed.
  bool onData(const FrameHeader& header, const uint8_t* payload, uint32_t length);
  bool onCredit(const FrameHeader& header);
  void onClose(const FrameHeader& header);

  /// What the peer has not acknowledged will be sent again.
  void rewind();
  /// Ends the tunnel without a word to the peer.
  void abort();

  bool sendNext(Peer* peer, Lane* lane) override;
  Traffic traffic() const override { return traffic_; }

  Peer* peer() const { return peer_; }
  uint32_t id() const { return id_; }
  Side side() const { return side_; }
  const std::string& target() const { return target_; }
  const char* state() const { return connected_ ? (end_known_ ? "closing" : "open") : "connecting"; }
  uint64_t sentBytes() const { return read_; }
  uint64_t receivedBytes() const { return received_; }
  /// Bytes of the peer that the process here has not taken yet.
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
  void sendCredit(bool now);
  void sendClose(bool at_once, const std::string& reason);
  void onAcknowledged();
  void finish();
  FrameHeader headerOf(FrameType type) const;

  EventLoop* const loop_;
  Peer* const peer_;
  const uint32_t id_;
  const Side side_;
  FileDescriptor socket_;
  const std::string target_;
  std::function<void()> on_closed_;
  Traffic traffic_ = Traffic::EXPRESS;
  bool connected_;
  bool local_end_ = false;  ///< the process here has closed its end
  uint32_t events_ = 0;

  // From the process here to the peer, in bytes of this direction.
  uint64_t read_ = 0;    ///< from the socket
  uint64_t credit_ = 0;  ///< handed on by the peer
  std::shared_ptr<Chunk> next_;
  std::deque<std::shared_ptr<Chunk>> resend_;
  std::deque<std::shared_ptr<Chunk>> unacked_;

  // From the peer to the process here, in bytes of that direction.
  uint64_t received_ = 0;
  uint64_t written_ = 0;
  uint64_t credited_ = 0;
  std::deque<std::vector<uint8_t>> to_write_;
  size_t first_offset_ = 0;  ///< of to_write_.front(), already written
  bool end_known_ = false;   ///< the peer sends no more than end_ bytes
  uint64_t end_ = 0;
};

}  // namespace pi_os_transport
