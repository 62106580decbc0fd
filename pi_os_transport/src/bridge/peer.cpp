#include "bridge/peer.h"

#include <algorithm>
#include <utility>

#include "event_loop/if_alive.h"
#include "shm/side_channel.h"

namespace pi_os_transport
{
namespace
{

using std::chrono::milliseconds;

constexpr milliseconds TICK{100};
/// A peer that sends nothing for this time is connected again.
constexpr milliseconds SILENCE{600};
/// Timeout for the first frame after the machine of the peer has accepted the connections.
constexpr milliseconds HANDSHAKE{500};
/// The same if the transport does not tell whether the machine accepted: most interruptions are shorter.
constexpr milliseconds HANDSHAKE_UNSURE{1500};
/// Since an interruption, while messages wait that would be lost with the session.
constexpr milliseconds PATIENCE{5000};
/// A tick that comes so long after the last one: this process did not run.
constexpr milliseconds STOPPED{300};
constexpr milliseconds RECONNECT{100};
constexpr milliseconds RECONNECT_DOWN{300};
/// Most control frames that wait for one peer.
constexpr size_t MAX_CONTROLS = 65536;

}  // namespace

Peer::Peer(EventLoop* loop, FrameTransport* transport, Listener* listener, Endpoint endpoint)
  : loop_(loop)
  , transport_(transport)
  , listener_(listener)
  , endpoint_(std::move(endpoint))
  , lanes_{Lane(Traffic::EXPRESS, transport), Lane(Traffic::BULK, transport)}
  , secret_(Token::random().high | 1)
{
  for (size_t traffic = 0; traffic < TRAFFIC_CLASSES; ++traffic)
  {
    acks_[traffic] = std::make_shared<AckSender>(
        loop_, static_cast<Traffic>(traffic),
        [this, traffic](uint64_t frames)
        { control(FrameHeader::of(FrameType::ACK, static_cast<uint32_t>(traffic), 0, frames)); });
  }
}

Peer::~Peer()
{
  closeConnections();
}

void Peer::start()
{
  connect();
  tick_timer_.start(loop_, TICK, [this]() { tick(); });
}

void Peer::connect()
{
  for (Lane& lane : lanes_)
  {
    lane.open(transport_->connect(endpoint_));
  }
}

void Peer::reconnect(milliseconds delay)
{
  if (!connect_timer_.running())
  {
    connect_timer_.start(loop_, delay, [this]() { connect(); });
  }
}

void Peer::closeConnections()
{
  for (Lane& lane : lanes_)
  {
    if (lane.connection() != 0)
    {
      transport_->close(lane.connection());
    }
    lane.reset();
  }
  for (const auto& acks : acks_)
  {
    acks->reset();
  }
  // Frames that are not counted belong to this session alone.
  controls_.erase(std::remove_if(controls_.begin(), controls_.end(),
                                 [](const Control& control) { return !Lane::isCounted(control.header.type); }),
                  controls_.end());
  controls_.insert(controls_.begin(), unacked_controls_.begin(), unacked_controls_.end());
  unacked_controls_.clear();
  verified_ = false;
  their_secret_ = 0;
}

bool Peer::owns(FrameTransport::ConnectionId connection) const
{
  return std::any_of(lanes_.begin(), lanes_.end(),
                     [connection](const Lane& lane) { return lane.connection() == connection; });
}

void Peer::sayHello(Lane* lane)
{
  Hello hello = listener_->describe(endpoint_);
  hello.secret = secret_;
  hello.echo = their_secret_;
  auto payload = std::make_shared<std::vector<uint8_t>>(hello.encode());
  FrameHeader header = FrameHeader::of(FrameType::HELLO, lane == &lanes_[0] ? 0 : 1);
  header.session = their_secret_;
  const iovec piece{payload->data(), payload->size()};
  hello_due_[header.id] = !lane->send(header, &piece, 1, payload, nullptr);
}

void Peer::onConnected(FrameTransport::ConnectionId connection)
{
  for (Lane& lane : lanes_)
  {
    if (lane.connection() == connection)
    {
      lane.setConnected(true);
      sayHello(&lane);
    }
  }
  connected_since_ = SteadyClock::now();
  beUp();
}

void Peer::onClosed(FrameTransport::ConnectionId connection, CloseReason reason)
{
  for (Lane& lane : lanes_)
  {
    if (lane.connection() == connection)
    {
      lane.reset();
    }
  }
  switch (reason)
  {
    case CloseReason::REFUSED:
    case CloseReason::MALFORMED:
    case CloseReason::UNTRUSTED:
      lose(State::DOWN);
      break;
    case CloseReason::PEER_CLOSED:
      // The process has ended, or only closed this connection: the next attempt tells which.
      reconnect(state_ == State::UP ? milliseconds(1) : RECONNECT);
      interrupt(state_ == State::UP ? State::SILENT : state_);
      break;
    case CloseReason::SILENT:
      if (!mayWait())
      {
        lose(State::HUNG);
        break;
      }
      [[fallthrough]];
    case CloseReason::UNREACHABLE:
      interrupt(State::SILENT);
      reconnect(RECONNECT);
      break;
  }
}

void Peer::interrupt(State next)
{
  const bool was_up = state_ == State::UP;
  closeConnections();
  if (!carries_)
  {
    controls_.clear();
  }
  if (was_up)
  {
    interrupted_at_ = SteadyClock::now();
  }
  state_ = ever_up_ ? next : (next == State::SILENT ? State::CONNECTING : next);
  // Frames in buffers on the way belong to the old session and must be refused.
  secret_ = Token::random().high | 1;
  if (was_up)
  {
    listener_->onInterrupted(this);
  }
}

void Peer::restart()
{
  loop_->defer(ifAlive(weak_from_this(),
                       [](const std::shared_ptr<Peer>& self)
                       {
                         if (self->state_ == State::UP)
                         {
                           self->interrupt(State::SILENT);
                           self->reconnect(RECONNECT);
                         }
                       }));
}

void Peer::lose(State next)
{
  interrupt(next);
  state_ = next;
  end(next == State::HUNG);
  reconnect(RECONNECT_DOWN);
}

/// Whether the session is kept although the peer seems to hang.
bool Peer::mayWait() const
{
  return carries_ && SteadyClock::now() - interrupted_at_ < PATIENCE && listener_->holdsLast(this);
}

void Peer::end(bool hung)
{
  instance_ = 0;
  controls_.clear();
  unacked_controls_.clear();
  if (std::exchange(carries_, false))
  {
    listener_->onLost(this, hung);
  }
}

bool Peer::onHello(const Hello& hello)
{
  if (state_ == State::UP && hello.echo != secret_)
  {
    // The two connections are not ordered: this greeting may be older than the one that made the session.
    return hello.instance == instance_ && hello.secret == their_secret_;
  }
  heard();
  name_ = hello.name;
  max_message_bytes_ = hello.max_message_bytes;
  if (hello.echo == secret_)
  {
    verified_ = true;
    if (instance_ != 0 && instance_ != hello.instance)
    {
      end(false);  // another process: the links of the last one are over
    }
    instance_ = hello.instance;
  }
  if (their_secret_ != hello.secret)
  {
    their_secret_ = hello.secret;
    for (const auto& acks : acks_)
    {
      acks->reset();  // the peer starts counting again as well
    }
    for (Lane& lane : lanes_)
    {
      if (lane.connected())
      {
        sayHello(&lane);
      }
    }
  }
  if (state_ == State::DOWN && connect_timer_.running())
  {
    connect_timer_.stop();
    connect();
  }
  beUp();
  return true;
}

void Peer::beUp()
{
  if (state_ == State::UP || !verified_ || their_secret_ == 0 || !lanes_[0].connected() || !lanes_[1].connected())
  {
    return;
  }
  state_ = State::UP;
  heard();
  const bool resumed = carries_;
  ever_up_ = true;
  carries_ = true;
  listener_->onUp(this, resumed);
  pump();
}

void Peer::tick()
{
  tick_timer_.start(loop_, TICK, [this]() { tick(); });
  const SteadyTime now = SteadyClock::now();
  if (now - std::exchange(ticked_, now) > STOPPED)
  {
    heard();
    connected_since_ = now;
  }
  if (state_ == State::UP)
  {
    if (now - last_heard_ > SILENCE)
    {
      interrupt(State::SILENT);
      reconnect(milliseconds(1));
      return;
    }
    if (now - last_sent_ >= TICK)
    {
      control(FrameHeader::of(FrameType::PING));
    }
    return;
  }
  const bool connected = lanes_[0].connected() && lanes_[1].connected();
  const milliseconds handshake = transport_->tellsConnected() ? HANDSHAKE : HANDSHAKE_UNSURE;
  if (connected && now - connected_since_ > handshake && !mayWait())
  {
    // The machine accepts, but the process is silent. Keep the connection: the process reads the greeting when it
    // wakes.
    state_ = State::HUNG;
    end(true);
    if (now - connected_since_ > 20 * HANDSHAKE)
    {
      interrupt(State::HUNG);
      reconnect(milliseconds(1));
    }
  }
}

void Peer::control(FrameHeader header, std::vector<uint8_t> payload)
{
  if (controls_.size() + unacked_controls_.size() >= MAX_CONTROLS)
  {
    // The peer sends requests without reading the answers.
    loop_->defer(ifAlive(weak_from_this(),
                         [](const std::shared_ptr<Peer>& self)
                         {
                           if (self->controls_.size() + self->unacked_controls_.size() >= MAX_CONTROLS)
                           {
                             self->lose(State::DOWN);
                           }
                         }));
    return;
  }
  if (state_ == State::UP || ((carries_ || verified_) && Lane::isCounted(header.type)))
  {
    controls_.push_back(Control{header, std::make_shared<std::vector<uint8_t>>(std::move(payload))});
    pumpControl();
  }
}

bool Peer::pumpControl()
{
  Lane& lane = lanes_[static_cast<size_t>(Traffic::EXPRESS)];
  while (!controls_.empty() && state_ == State::UP)
  {
    Control& next = controls_.front();
    next.header.session = their_secret_;
    const iovec piece{next.payload->data(), next.payload->size()};
    Lane::Acknowledged acknowledged;
    const bool counted = Lane::isCounted(next.header.type);
    if (counted)
    {
      acknowledged = [this]()
      {
        if (!unacked_controls_.empty())
        {
          unacked_controls_.pop_front();
        }
      };
    }
    if (!lane.send(next.header, &piece, next.payload->empty() ? 0 : 1, next.payload, std::move(acknowledged)))
    {
      return false;
    }
    last_sent_ = SteadyClock::now();
    if (counted)
    {
      unacked_controls_.push_back(std::move(next));
    }
    controls_.pop_front();
  }
  return controls_.empty();
}

void Peer::offer(const std::shared_ptr<FrameSource>& source)
{
  std::deque<std::weak_ptr<FrameSource>>& queue = sources_[static_cast<size_t>(source->traffic())];
  const bool known = std::any_of(queue.begin(), queue.end(),
                                 [&source](const std::weak_ptr<FrameSource>& other)
                                 { return !other.owner_before(source) && !source.owner_before(other); });
  if (!known)
  {
    queue.push_back(source);
  }
}

void Peer::pump()
{
  for (size_t index = 0; index < TRAFFIC_CLASSES; ++index)
  {
    if (hello_due_[index] && lanes_[index].connected())
    {
      sayHello(&lanes_[index]);
    }
  }
  if (state_ != State::UP || !pumpControl())
  {
    return;
  }
  // Repeat if a source has changed from BULK to EXPRESS meanwhile.
  const auto expressWaits = [this]() { return !sources_[0].empty() && lanes_[0].ready(); };
  do
  {
    pumpLane(Traffic::EXPRESS);
    pumpLane(Traffic::BULK);
  } while (state_ == State::UP && expressWaits());
}

void Peer::pumpLane(Traffic traffic)
{
  Lane& lane = lanes_[static_cast<size_t>(traffic)];
  std::deque<std::weak_ptr<FrameSource>>& queue = sources_[static_cast<size_t>(traffic)];
  while (!queue.empty() && lane.ready() && state_ == State::UP)
  {
    const std::shared_ptr<FrameSource> source = queue.front().lock();
    queue.pop_front();
    if (!source)
    {
      continue;
    }
    if (source->traffic() != traffic)
    {
      offer(source);
      continue;
    }
    if (source->sendNext(this, &lane))
    {
      offer(source);
      last_sent_ = traffic == Traffic::EXPRESS ? SteadyClock::now() : last_sent_;
    }
  }
}

bool Peer::onAck(const FrameHeader& header)
{
  heard();
  return header.id < TRAFFIC_CLASSES && lanes_[header.id].onAck(header.offset);
}

void Peer::acknowledge(Traffic traffic, uint32_t bytes, bool now)
{
  heard();
  received_bytes_ += bytes;
  acks_[static_cast<size_t>(traffic)]->onFrame(bytes, now);
}

}  // namespace pi_os_transport
