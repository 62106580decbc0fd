#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <memory>

#include "event_loop/event_loop.h"
#include "wire/frame_transport.h"

namespace pi_os_transport
{

/// Traffic classes between two bridges. Each has its own connection.
enum class Traffic : uint32_t
{
  EXPRESS = 0,  ///< control and small messages: never waits for a large one
  BULK = 1,     ///< large messages, in fragments
};
constexpr size_t TRAFFIC_CLASSES = 2;

/// The sending half of one traffic class to one peer. Counts the frames that are not acknowledged and limits them to a
/// window.
///
/// BULK adapts its window to the delay it causes, like TCP Vegas and LEDBAT. The window grows while acknowledgements
/// come as fast as on an idle link, and shrinks when they are late because of queues in the network. So large messages
/// use the whole link, but EXPRESS finds its queues empty.
class Lane
{
public:
  using Acknowledged = std::function<void()>;

  using Clock = SteadyTime (*)();

  Lane(Traffic traffic, FrameTransport* transport, Clock now = &SteadyClock::now)
    : traffic_(traffic), transport_(transport), now_(now)
  {
  }

  void open(FrameTransport::ConnectionId connection) { connection_ = connection; }
  /// Forgets all frames under way.
  void reset();
  FrameTransport::ConnectionId connection() const { return connection_; }
  void setConnected(bool connected) { connected_ = connected; }
  bool connected() const { return connected_; }

  /// True if a frame with payload may be sent now.
  bool ready() const;
  /// Payload size of the next fragment [B].
  uint32_t fragmentBytes() const;

  /// Sends one frame. Call only while ready(); frames that are not counted may be sent while connected.
  /// @param keep  owner of the payload's memory: held until the frame is acknowledged.
  /// @param acknowledged  called when the peer has processed the frame; may be null.
  /// @param more  another frame follows at once.
  /// @return false if the connection accepts nothing now.
  bool send(const FrameHeader& header, const iovec* payload, size_t pieces, std::shared_ptr<const void> keep,
            Acknowledged acknowledged, bool more = false);

  /// The peer has processed `frames` frames of this lane so far.
  /// @return false if this is more than were sent.
  bool onAck(uint64_t frames);

  uint64_t sentBytes() const { return sent_bytes_; }
  uint64_t unackedBytes() const { return unacked_bytes_; }
  uint64_t window() const { return window_; }
  std::chrono::microseconds rtt() const { return rtt_; }

  /// True for frame types that are counted and acknowledged.
  static bool isCounted(FrameType type)
  {
    return type != FrameType::HELLO && type != FrameType::PING && type != FrameType::ACK;
  }

private:
  struct Unacked
  {
    SteadyTime sent_at;
    uint64_t bytes;
    std::shared_ptr<const void> keep;
    Acknowledged acknowledged;
  };
  void adapt(SteadyTime now, std::chrono::microseconds sample);

  const Traffic traffic_;
  FrameTransport* const transport_;
  const Clock now_;
  FrameTransport::ConnectionId connection_ = 0;
  bool connected_ = false;
  std::deque<Unacked> unacked_;
  uint64_t unacked_bytes_ = 0;
  uint64_t acked_frames_ = 0;
  uint64_t since_request_ = 0;  ///< bytes sent since an acknowledgement was last requested
  uint64_t frames_since_request_ = 0;
  uint64_t sent_bytes_ = 0;
  std::shared_ptr<const void> uncounted_payload_;  ///< of the last frame that is not counted

  uint64_t window_ = INITIAL_WINDOW;
  bool limited_ = false;  ///< the window was full in this round
  SteadyTime round_end_;
  std::chrono::microseconds round_min_{std::chrono::microseconds::max()};
  std::chrono::microseconds base_rtt_{std::chrono::microseconds::max()};
  SteadyTime base_until_;
  std::chrono::microseconds network_base_{std::chrono::microseconds::max()};  ///< shortest round trip of the machines
  bool single_ = false;   ///< the last frame met an empty link, apart from one that shares its packet
  bool more_ = false;     ///< the last frame may share a packet with the next one
  bool probing_ = false;  ///< base_rtt_ is measured again: wait until the link is empty, then send a single frame
  std::chrono::microseconds rtt_{0};

  static constexpr uint64_t MIN_WINDOW = 16 << 10;
  static constexpr uint64_t INITIAL_WINDOW = 512 << 10;
  static constexpr uint64_t MAX_WINDOW = 16 << 20;
  static constexpr uint64_t EXPRESS_WINDOW = 1 << 20;
};

}  // namespace pi_os_transport
