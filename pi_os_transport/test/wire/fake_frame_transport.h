#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <iterator>
#include <limits>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "bridge/peer.h"
#include "event_loop/event_loop.h"
#include "wire/frame_transport.h"
#include "wire/wire_frame.h"

namespace pi_os_transport
{

using Bytes = std::vector<uint8_t>;

/// Runs the loop until `done` holds. @return false if it does not within a time that no correct run needs.
inline bool runUntil(EventLoop* loop, const std::function<bool()>& done)
{
  const SteadyTime deadline = SteadyClock::now() + std::chrono::seconds(30);
  bool is_done = done();
  for (; !is_done && SteadyClock::now() < deadline; is_done = done())
  {
    loop->runOnce(std::chrono::milliseconds(20));
  }
  return is_done;
}

/// Keeps what is sent until the test takes it. A connection takes `capacity` frames at a time.
class FakeFrameTransport : public FrameTransport
{
public:
  struct Frame
  {
    ConnectionId connection;
    FrameHeader header;
    Bytes payload;
  };

  bool listen(const Endpoint&, std::string*) override { return true; }
  uint16_t port() const override { return 1; }
  ConnectionId connect(const Endpoint&) override
  {
    open.push_back(++last_connection_);
    return last_connection_;
  }
  void close(ConnectionId connection) override
  {
    open.erase(std::remove(open.begin(), open.end(), connection), open.end());
    sent.erase(std::remove_if(sent.begin(), sent.end(),
                              [connection](const Frame& frame) { return frame.connection == connection; }),
               sent.end());
  }
  void closeSource(SourceId) override {}
  std::string addressOf(SourceId) const override { return {}; }
  bool tellsConnected() const override { return true; }
  std::optional<std::chrono::microseconds> roundTrip(ConnectionId) const override { return round_trip; }
  bool writable(ConnectionId connection) const override
  {
    const auto waiting = std::count_if(sent.begin(), sent.end(),
                                       [connection](const Frame& frame) { return frame.connection == connection; });
    return std::find(open.begin(), open.end(), connection) != open.end() && static_cast<size_t>(waiting) < capacity;
  }
  bool send(ConnectionId connection, const FrameHeader& header, const iovec* payload, size_t pieces, bool) override
  {
    if (!writable(connection))
    {
      return false;
    }
    Frame frame{connection, header, {}};
    for (size_t piece = 0; piece < pieces; ++piece)
    {
      const uint8_t* const bytes = static_cast<const uint8_t*>(payload[piece].iov_base);
      frame.payload.insert(frame.payload.end(), bytes, bytes + payload[piece].iov_len);
    }
    EXPECT_LE(frame.payload.size(), MAX_PAYLOAD);
    sent.push_back(std::move(frame));
    return true;
  }

  std::vector<ConnectionId> open;
  std::deque<Frame> sent;
  std::optional<std::chrono::microseconds> round_trip;
  size_t capacity = std::numeric_limits<size_t>::max();

private:
  ConnectionId last_connection_ = 0;
};

/// A peer on a fake transport. The test plays the bridge at the other end.
class FakeSession : public Peer::Listener
{
public:
  using Frame = FakeFrameTransport::Frame;
  static constexpr uint64_t OTHER_INSTANCE = 9000;

  explicit FakeSession(EventLoop* loop, uint64_t instance = 1)
    : instance(instance), loop(loop), peer(std::make_shared<Peer>(loop, &transport, this, Endpoint{"192.0.2.1", 8814}))
  {
    peer->start();
  }

  Hello describe(const Endpoint&) override
  {
    Hello hello;
    hello.instance = instance;
    hello.port = 8814;
    hello.name = "fake";
    return hello;
  }
  void onUp(Peer*, bool again) override
  {
    ++ups;
    resumed += again ? 1 : 0;
    if (on_up)
    {
      on_up();
    }
  }
  void onInterrupted(Peer*) override
  {
    ++interruptions;
    if (on_interrupted)
    {
      on_interrupted();
    }
  }
  bool holdsLast(const Peer*) const override { return holds_last; }
  void onLost(Peer*, bool is_hung) override
  {
    ++lost;
    hung += is_hung ? 1 : 0;
  }

  /// Waits for the peer's next attempt, and lets it connect.
  void connect()
  {
    ASSERT_TRUE(runUntil(loop, [this]() { return transport.open.size() == TRAFFIC_CLASSES; }));
    for (const FrameTransport::ConnectionId connection : std::vector<FrameTransport::ConnectionId>(transport.open))
    {
      peer->onConnected(connection);
    }
    acknowledged_ = {};
    counted_ = {};
  }
  /// Greets as the other bridge would.
  bool greet(uint64_t other_instance = OTHER_INSTANCE)
  {
    Hello hello;
    hello.instance = other_instance;
    hello.secret = ++other_secret;
    hello.echo = peer->secret();
    hello.name = "other";
    return peer->onHello(hello);
  }
  void meet(uint64_t other_instance = OTHER_INSTANCE)
  {
    connect();
    ASSERT_TRUE(greet(other_instance));
    ASSERT_TRUE(peer->up());
    take();
  }
  /// The link breaks: what is under way is lost.
  void interrupt() { close(CloseReason::UNREACHABLE); }
  void close(CloseReason reason)
  {
    const FrameTransport::ConnectionId connection = peer->lane(Traffic::EXPRESS).connection();
    transport.close(connection);
    peer->onClosed(connection, reason);
  }

  Traffic trafficOf(const Frame& frame) const
  {
    return frame.connection == peer->lane(Traffic::EXPRESS).connection() ? Traffic::EXPRESS : Traffic::BULK;
  }
  /// Everything sent since the last call but greetings, pings and acknowledgements.
  std::vector<Frame> take()
  {
    std::vector<Frame> frames;
    for (Frame& frame : transport.sent)
    {
      if (Lane::isCounted(frame.header.type))
      {
        ++counted_[frame.connection];
        frames.push_back(std::move(frame));
      }
    }
    transport.sent.clear();
    return frames;
  }
  /// Acknowledges `frames` more of those taken, or all.
  void acknowledge(Traffic traffic, uint64_t frames = std::numeric_limits<uint64_t>::max())
  {
    const FrameTransport::ConnectionId connection = peer->lane(traffic).connection();
    uint64_t& acknowledged = acknowledged_[connection];
    acknowledged += std::min(frames, counted_[connection] - acknowledged);
    FrameHeader header;
    header.type = FrameType::ACK;
    header.id = static_cast<uint32_t>(traffic);
    header.offset = acknowledged;
    ASSERT_TRUE(peer->onAck(header));
    peer->pump();
  }
  void acknowledgeAll()
  {
    acknowledge(Traffic::EXPRESS);
    acknowledge(Traffic::BULK);
  }
  /// Takes and acknowledges until nothing more comes. @return all frames.
  std::vector<Frame> takeAll()
  {
    std::vector<Frame> all;
    for (std::vector<Frame> more = take(); !more.empty(); more = take())
    {
      all.insert(all.end(), std::make_move_iterator(more.begin()), std::make_move_iterator(more.end()));
      acknowledgeAll();
    }
    return all;
  }

  const uint64_t instance;
  EventLoop* const loop;
  FakeFrameTransport transport;
  std::shared_ptr<Peer> peer;
  uint64_t other_secret = 100;
  size_t ups = 0;
  size_t resumed = 0;
  size_t interruptions = 0;
  size_t lost = 0;
  bool holds_last = false;
  size_t hung = 0;
  std::function<void()> on_up;
  std::function<void()> on_interrupted;

private:
  std::map<FrameTransport::ConnectionId, uint64_t> counted_;
  std::map<FrameTransport::ConnectionId, uint64_t> acknowledged_;
};

/// Two peers and the wires between them: frames travel when the test says so, and may be lost with the link.
class FakeLink
{
public:
  using Frame = FakeFrameTransport::Frame;
  /// Takes a frame that is not the session's own. @return false if it is not acceptable.
  using Handler = std::function<bool(const FrameHeader& header, const Bytes& payload)>;

  explicit FakeLink(EventLoop* loop) : loop_(loop), sides{FakeSession(loop, 1), FakeSession(loop, 2)} {}

  void meet()
  {
    for (FakeSession& side : sides)
    {
      side.connect();
    }
    ASSERT_TRUE(runUntil(loop_,
                         [this]()
                         {
                           carry();
                           return sides[0].peer->up() && sides[1].peer->up();
                         }));
  }
  /// Carries at most `most` frames in each direction, one of each traffic class after the other.
  /// @return frames carried.
  size_t carry(size_t most = std::numeric_limits<size_t>::max())
  {
    size_t carried = 0;
    for (size_t round = 0; round < most; ++round)
    {
      const size_t before = carried;
      for (size_t from = 0; from < 2; ++from)
      {
        for (const Traffic traffic : {Traffic::EXPRESS, Traffic::BULK})
        {
          carried += carryOne(from, traffic) ? 1 : 0;
        }
      }
      if (carried == before)
      {
        break;
      }
    }
    return carried;
  }
  void interrupt()
  {
    for (FakeSession& side : sides)
    {
      side.interrupt();
    }
  }

private:
  bool carryOne(size_t from, Traffic traffic)
  {
    FakeSession& sender = sides[from];
    FakeSession& receiver = sides[1 - from];
    std::deque<Frame>& sent = sender.transport.sent;
    const auto next =
        std::find_if(sent.begin(), sent.end(),
                     [&sender, traffic](const Frame& frame) { return sender.trafficOf(frame) == traffic; });
    if (next == sent.end())
    {
      return false;
    }
    const Frame frame = std::move(*next);
    sent.erase(next);
    sender.peer->pump();
    if (frame.header.type == FrameType::HELLO)
    {
      Hello hello;
      EXPECT_TRUE(Hello::decode(frame.payload.data(), frame.payload.size(), &hello));
      receiver.peer->onHello(hello);
      return true;
    }
    if (frame.header.session != receiver.peer->secret())
    {
      return true;  // of a session that is over
    }
    switch (frame.header.type)
    {
      case FrameType::PING:
        receiver.peer->onPing();
        break;
      case FrameType::ACK:
        EXPECT_TRUE(receiver.peer->onAck(frame.header));
        receiver.peer->pump();
        break;
      default:
        EXPECT_TRUE(handlers[1 - from](frame.header, frame.payload)) << "frame type " << int(frame.header.type);
        receiver.peer->acknowledge(static_cast<Traffic>(frame.header.lane & ~ACK_NOW),
                                   static_cast<uint32_t>(frame.payload.size() + FrameHeader::BYTES),
                                   (frame.header.lane & ACK_NOW) != 0);
        break;
    }
    return true;
  }

  EventLoop* const loop_;

public:
  FakeSession sides[2];
  Handler handlers[2];  ///< of what comes to sides[0] and sides[1]
};

}  // namespace pi_os_transport
