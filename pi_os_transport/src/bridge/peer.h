#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <memory>
#include <string>
#include <vector>

#include "event_loop/event_loop.h"
#include "wire/frame_transport.h"
#include "wire/lane.h"
#include "wire/wire_frame.h"

namespace pi_os_transport
{

class Peer;

/// Something that has frames to send to a peer: a stream or a tunnel.
class FrameSource
{
public:
  virtual ~FrameSource() = default;
  /// Sends at most one frame on `lane`, which is ready.
  /// @return false if there is nothing to send there now; Peer::offer() makes it be asked again.
  virtual bool sendNext(Peer* peer, Lane* lane) = 0;
  /// The class it wants to send on now.
  virtual Traffic traffic() const = 0;
};

/// The session with one other bridge: finds it, keeps two connections to it, recognises it when it comes back, and
/// shares the connections among what wants to send.
///
/// Each side connects to the other and tells it a secret, which the other then puts into its frames: they come from
/// where they say. A side that hears nothing for SILENCE connects anew. What the session carried goes on if the same
/// process answers; it is over if another one does, if the machine answers that nobody listens, or if somebody accepts
/// the connection but does not speak (hung).
class Peer : public std::enable_shared_from_this<Peer>
{
public:
  enum class State
  {
    CONNECTING,  ///< not met yet
    UP,
    SILENT,  ///< was up; nothing comes and nobody answers: the link or the device is down
    HUNG,    ///< its process accepts connections but does not speak
    DOWN,    ///< nobody listens there
  };
  /// What the bridge does on behalf of its peers.
  class Listener
  {
  public:
    virtual ~Listener() = default;
    virtual Hello describe(const Endpoint& towards) = 0;  ///< instance, address, port and name of this bridge
    virtual void onUp(Peer* peer, bool resumed) = 0;
    /// What was under way is lost or has to be sent again, if the same process comes back.
    virtual void onInterrupted(Peer* peer) = 0;
    /// The process at the other end has ended or hangs: all that went through it is over.
    virtual void onLost(Peer* peer, bool hung) = 0;
  };

  Peer(EventLoop* loop, FrameTransport* transport, Listener* listener, Endpoint endpoint);
  ~Peer();

  void start();

  const Endpoint& endpoint() const { return endpoint_; }
  State state() const { return state_; }
  bool up() const { return state_ == State::UP; }
  const std::string& name() const { return name_; }
  /// What it takes at most; known once it is up [B].
  uint32_t maxMessageBytes() const { return max_message_bytes_; }
  uint64_t instance() const { return instance_; }
  uint64_t secret() const { return secret_; }
  /// What belongs into `session` of frames to it.
  uint64_t theirSecret() const { return their_secret_; }
  SteadyTime createdAt() const { return created_at_; }

  Lane& lane(Traffic traffic) { return lanes_[static_cast<size_t>(traffic)]; }
  const Lane& lane(Traffic traffic) const { return lanes_[static_cast<size_t>(traffic)]; }

  /// Sends a control frame as soon as the express lane takes it, in order, before all else. One sent while the session
  /// is interrupted, or shortly before, comes later, possibly twice. Lost if the session is over.
  void control(FrameHeader header, std::vector<uint8_t> payload = {});
  /// `source` has something to send.
  void offer(const std::shared_ptr<FrameSource>& source);
  /// Sends what the lanes take now.
  void pump();

  /// Something is wrong between the two ends: both begin anew, as after an interruption.
  void restart();

  // From the transport.
  void onConnected(FrameTransport::ConnectionId connection);
  void onClosed(FrameTransport::ConnectionId connection, CloseReason reason);
  bool owns(FrameTransport::ConnectionId connection) const;
  /// @return false if it is not acceptable in this state.
  bool onHello(const Hello& hello);
  void onPing() { heard(); }
  bool onAck(const FrameHeader& header);
  /// A counted frame was received and processed.
  /// @param now  the peer waits for the acknowledgement.
  void acknowledge(Traffic traffic, uint32_t bytes, bool now);

  uint64_t receivedBytes() const { return received_bytes_; }

private:
  struct Receiving
  {
    uint64_t frames = 0;
    uint64_t acked_frames = 0;
    uint64_t unacked_bytes = 0;
    bool scheduled = false;
    EventLoop::TimerId timer = 0;
  };

  void connect();
  void reconnect(std::chrono::milliseconds delay);
  void closeConnections();
  void sayHello(Lane* lane);
  void heard() { last_heard_ = SteadyClock::now(); }
  void beUp();
  void interrupt(State next);
  void lose(State next);
  void end(bool hung);
  void tick();
  void sendAck(Traffic traffic);
  bool pumpControl();
  void pumpLane(Traffic traffic);

  EventLoop* const loop_;
  FrameTransport* const transport_;
  Listener* const listener_;
  const Endpoint endpoint_;
  const SteadyTime created_at_ = SteadyClock::now();
  State state_ = State::CONNECTING;
  std::array<Lane, TRAFFIC_CLASSES> lanes_;
  std::array<Receiving, TRAFFIC_CLASSES> receiving_;
  std::array<bool, TRAFFIC_CLASSES> hello_due_{};  ///< a greeting that the connection did not take
  uint64_t secret_;
  uint64_t their_secret_ = 0;
  uint64_t instance_ = 0;
  std::string name_;
  uint32_t max_message_bytes_ = 0;
  bool verified_ = false;  ///< it has shown that it gets what is sent to its address
  bool ever_up_ = false;
  bool carries_ = false;  ///< there may be links that outlive an interruption
  SteadyTime connected_since_;
  SteadyTime last_heard_;
  SteadyTime last_sent_;
  EventLoop::TimerId tick_timer_ = 0;
  EventLoop::TimerId connect_timer_ = 0;
  uint64_t received_bytes_ = 0;

  struct Control
  {
    FrameHeader header;
    std::shared_ptr<std::vector<uint8_t>> payload;
  };
  std::deque<Control> controls_;
  std::deque<Control> unacked_controls_;  ///< sent again if the session is interrupted: all may come twice
  std::array<std::deque<std::weak_ptr<FrameSource>>, TRAFFIC_CLASSES> sources_;
};

}  // namespace pi_os_transport
