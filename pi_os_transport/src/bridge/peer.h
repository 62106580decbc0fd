#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <memory>
#include <string>
#include <vector>

#include "event_loop/event_loop.h"
#include "wire/ack_sender.h"
#include "wire/frame_transport.h"
#include "wire/lane.h"
#include "wire/wire_frame.h"

namespace pi_os_transport
{

class Peer;

/// A sender of frames to a peer: a stream or a tunnel.
class FrameSource
{
public:
  virtual ~FrameSource() = default;
  /// Sends at most one frame on `lane`, which is ready.
  /// @return false if there is nothing to send now; then call Peer::offer() later.
  virtual bool sendNext(Peer* peer, Lane* lane) = 0;
  /// The traffic class of the next frame.
  virtual Traffic traffic() const = 0;
};

/// The session with one other bridge: keeps two connections to it, recognises it after an interruption, and shares the
/// connections among the frame sources.
///
/// Each side connects to the other and sends it a secret. The other side puts the secret into its frames, which proves
/// their origin. A side that receives nothing for SILENCE connects again. The session continues if the same process
/// answers. It is lost if another process answers, if nothing listens there, or if a process accepts the connection but
/// stays silent (hung). A side that did not run itself for a while blames nobody: what the peer sent waits to be read.
class Peer : public std::enable_shared_from_this<Peer>
{
public:
  enum class State
  {
    CONNECTING,  ///< never was up
    UP,
    SILENT,  ///< was up, but does not answer: the link or the device is down
    HUNG,    ///< the process accepts connections but sends nothing
    DOWN,    ///< nothing listens there
  };
  /// Gets the events of a session.
  class Listener
  {
  public:
    virtual ~Listener() = default;
    virtual Hello describe(const Endpoint& towards) = 0;  ///< this bridge as seen from `towards`
    virtual void onUp(Peer* peer, bool resumed) = 0;
    /// The session is interrupted. If the same process comes back, what was under way has to be sent again.
    virtual void onInterrupted(Peer* peer) = 0;
    /// The process at the other end has ended or hangs: the session is lost.
    virtual void onLost(Peer* peer, bool hung) = 0;
    /// Whether messages wait for the peer that nobody else has, because their publisher has ended.
    virtual bool holdsLast(const Peer* peer) const = 0;
  };

  Peer(EventLoop* loop, FrameTransport* transport, Listener* listener, Endpoint endpoint);
  ~Peer();

  void start();

  const Endpoint& endpoint() const { return endpoint_; }
  State state() const { return state_; }
  bool up() const { return state_ == State::UP; }
  const std::string& name() const { return name_; }
  /// The largest message that the peer accepts; known while up [B].
  uint32_t maxMessageBytes() const { return max_message_bytes_; }
  uint64_t instance() const { return instance_; }
  uint64_t secret() const { return secret_; }
  /// The value for `session` of frames to the peer.
  uint64_t theirSecret() const { return their_secret_; }
  SteadyTime createdAt() const { return created_at_; }

  Lane& lane(Traffic traffic) { return lanes_[static_cast<size_t>(traffic)]; }
  const Lane& lane(Traffic traffic) const { return lanes_[static_cast<size_t>(traffic)]; }

  /// Sends a control frame as soon as the express lane accepts it, in order and before all other frames. If the session
  /// is interrupted, the frame is delivered later, maybe twice. Lost if the session is lost.
  void control(FrameHeader header, std::vector<uint8_t> payload = {});
  /// Notes that `source` has something to send.
  void offer(const std::shared_ptr<FrameSource>& source);
  /// Sends what the lanes accept now.
  void pump();

  /// The two ends disagree: reconnects as after an interruption.
  void restart();

  // Called for the transport.
  void onConnected(FrameTransport::ConnectionId connection);
  void onClosed(FrameTransport::ConnectionId connection, CloseReason reason);
  bool owns(FrameTransport::ConnectionId connection) const;
  /// @return false if the greeting is not acceptable in this state.
  bool onHello(const Hello& hello);
  void onPing() { heard(); }
  bool onAck(const FrameHeader& header);
  /// A counted frame was received and processed.
  /// @param now  the peer waits for the acknowledgement.
  void acknowledge(Traffic traffic, uint32_t bytes, bool now);

  uint64_t receivedBytes() const { return received_bytes_; }

private:
  void connect();
  void reconnect(std::chrono::milliseconds delay);
  void closeConnections();
  void sayHello(Lane* lane);
  void heard() { last_heard_ = SteadyClock::now(); }
  void beUp();
  void interrupt(State next);
  void lose(State next);
  bool mayWait() const;
  void end(bool hung);
  void tick();
  bool pumpControl();
  void pumpLane(Traffic traffic);

  EventLoop* const loop_;
  FrameTransport* const transport_;
  Listener* const listener_;
  const Endpoint endpoint_;
  const SteadyTime created_at_ = SteadyClock::now();
  State state_ = State::CONNECTING;
  std::array<Lane, TRAFFIC_CLASSES> lanes_;
  std::array<std::shared_ptr<AckSender>, TRAFFIC_CLASSES> acks_;
  std::array<bool, TRAFFIC_CLASSES> hello_due_{};  ///< a greeting that the connection did not accept
  uint64_t secret_;
  uint64_t their_secret_ = 0;
  uint64_t instance_ = 0;
  std::string name_;
  uint32_t max_message_bytes_ = 0;
  bool verified_ = false;  ///< the peer has proved that it receives frames at its address
  bool ever_up_ = false;
  bool carries_ = false;                    ///< links may have survived an interruption
  SteadyTime ticked_ = SteadyClock::now();  ///< last
  SteadyTime interrupted_at_;               ///< the session that may be continued
  SteadyTime connected_since_;
  SteadyTime last_heard_;
  SteadyTime last_sent_;
  Timer tick_timer_;
  Timer connect_timer_;
  uint64_t received_bytes_ = 0;

  struct Control
  {
    FrameHeader header;
    std::shared_ptr<std::vector<uint8_t>> payload;
  };
  std::deque<Control> controls_;
  std::deque<Control> unacked_controls_;  ///< sent again after an interruption
  std::array<std::deque<std::weak_ptr<FrameSource>>, TRAFFIC_CLASSES> sources_;
};

}  // namespace pi_os_transport
