#include "bridge/peer.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <memory>
#include <random>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "wire/fake_frame_transport.h"

namespace pi_os_transport
{
namespace
{

using std::chrono::milliseconds;
using State = Peer::State;

/// A bridge reduced to its session: one peer over the real transport on the loopback interface.
class Node : private FrameTransport::Listener, public Peer::Listener
{
public:
  Node(EventLoop* loop, uint64_t instance, uint16_t port = 0)
    : instance_(instance), loop_(loop), transport_(makeSpTransport(loop, this))
  {
    std::string error;
    EXPECT_TRUE(transport_->listen({"127.0.0.1", port}, &error)) << error;
  }
  Endpoint endpoint() const { return {"127.0.0.1", transport_->port()}; }
  void seek(const Endpoint& other)
  {
    peer = std::make_shared<Peer>(loop_, transport_.get(), this, other);
    peer->start();
  }
  void say(uint64_t number)
  {
    FrameHeader header;
    header.type = FrameType::LINK_PAUSE;
    header.offset = number;
    peer->control(header);
  }
  /// Ends all connections to this node, as a broken network does.
  void cut()
  {
    const std::vector<FrameTransport::SourceId> all = std::exchange(sources_, {});
    for (const FrameTransport::SourceId source : all)
    {
      transport_->closeSource(source);
    }
  }

  std::shared_ptr<Peer> peer;
  std::vector<uint64_t> heard;  ///< offsets of the control frames that came
  size_t ups = 0;
  size_t resumed = 0;
  size_t interrupted = 0;
  size_t lost = 0;
  size_t hung = 0;

private:
  void onConnected(FrameTransport::ConnectionId connection) override { peer->onConnected(connection); }
  void onWritable(FrameTransport::ConnectionId) override { peer->pump(); }
  void onClosed(FrameTransport::ConnectionId connection, CloseReason reason) override
  {
    peer->onClosed(connection, reason);
  }
  bool onAccept(const std::string&) override { return true; }
  uint8_t* onHeader(FrameTransport::SourceId source, const FrameHeader& header, uint32_t) override
  {
    if (std::find(sources_.begin(), sources_.end(), source) == sources_.end())
    {
      sources_.push_back(source);
    }
    const bool known = header.type == FrameType::HELLO || (peer && header.session == peer->secret());
    return known ? payload_.data() : nullptr;
  }
  void onFrame(FrameTransport::SourceId source, const FrameHeader& header, uint8_t* payload, uint32_t length) override
  {
    bool accepted = peer != nullptr;
    switch (header.type)
    {
      case FrameType::HELLO:
      {
        Hello hello;
        accepted = accepted && Hello::decode(payload, length, &hello) && peer->onHello(hello);
        break;
      }
      case FrameType::PING:
        peer->onPing();
        break;
      case FrameType::ACK:
        accepted = peer->onAck(header);
        peer->pump();
        break;
      default:
        heard.push_back(header.offset);
        peer->acknowledge(static_cast<Traffic>(header.lane & ~ACK_NOW), length + 32, (header.lane & ACK_NOW) != 0);
        break;
    }
    if (!accepted)
    {
      transport_->closeSource(source);
    }
  }
  void onSourceClosed(FrameTransport::SourceId, CloseReason, const std::string&) override {}

  Hello describe(const Endpoint&) override
  {
    Hello hello;
    hello.instance = instance_;
    hello.port = transport_->port();
    hello.name = "node " + std::to_string(instance_);
    return hello;
  }
  void onUp(Peer*, bool again) override
  {
    ++ups;
    resumed += again ? 1 : 0;
  }
  void onInterrupted(Peer*) override { ++interrupted; }
  bool holdsLast(const Peer*) const override { return false; }
  void onLost(Peer*, bool is_hung) override
  {
    ++lost;
    hung += is_hung ? 1 : 0;
  }

  const uint64_t instance_;
  EventLoop* const loop_;
  std::vector<uint8_t> payload_ = std::vector<uint8_t>(MAX_PAYLOAD);
  std::vector<FrameTransport::SourceId> sources_;
  std::unique_ptr<FrameTransport> transport_;
};

class PeersOnLoopback : public ::testing::Test
{
protected:
  void SetUp() override
  {
    one_ = std::make_unique<Node>(&loop_, 1);
    other_ = std::make_unique<Node>(&other_loop_, 2);
    one_->seek(other_->endpoint());
    other_->seek(one_->endpoint());
    ASSERT_TRUE(runBothUntil([this]() { return one_->peer->up() && other_->peer->up(); }));
  }
  void TearDown() override
  {
    if (one_)
    {
      one_->peer.reset();
    }
    if (other_)
    {
      other_->peer.reset();
    }
  }
  bool runBothUntil(const std::function<bool()>& done)
  {
    return runUntil(&loop_,
                    [&]()
                    {
                      other_loop_.runOnce(milliseconds(0));
                      return done();
                    });
  }

  EventLoop loop_;
  EventLoop other_loop_;  ///< when it does not run, the process of `other_` hangs
  std::unique_ptr<Node> one_;
  std::unique_ptr<Node> other_;
};

TEST_F(PeersOnLoopback, Meet)
{
  EXPECT_EQ(2U, one_->peer->instance());
  EXPECT_EQ("node 2", one_->peer->name());
  EXPECT_EQ(1U, other_->peer->instance());
  EXPECT_EQ(other_->peer->secret(), one_->peer->theirSecret());
  EXPECT_EQ(one_->peer->secret(), other_->peer->theirSecret());
  EXPECT_EQ(1U, one_->ups);
  EXPECT_EQ(0U, one_->resumed);
  EXPECT_EQ(0U, one_->lost + one_->interrupted);
}

TEST_F(PeersOnLoopback, StayUpWithoutTraffic)
{
  const SteadyTime until = SteadyClock::now() + milliseconds(1500);
  ASSERT_TRUE(runBothUntil([until]() { return SteadyClock::now() > until; }));
  EXPECT_TRUE(one_->peer->up() && other_->peer->up());
  EXPECT_EQ(0U, one_->interrupted + other_->interrupted);
}

TEST_F(PeersOnLoopback, ControlFramesComeInOrderWhateverIsInterrupted)
{
  std::mt19937 random(5);
  uint64_t said = 0;
  for (int round = 0; round < 300; ++round)
  {
    for (uint64_t more = random() % 20; more > 0; --more)
    {
      one_->say(++said);
      other_->say(said);
    }
    loop_.runOnce(milliseconds(1));
    other_loop_.runOnce(milliseconds(0));
    if (random() % 60 == 0)
    {
      (random() % 2 == 0 ? one_ : other_)->cut();
    }
  }
  one_->cut();
  ASSERT_TRUE(runBothUntil(
      [&]()
      {
        return one_->interrupted > 0 && one_->peer->up() && other_->peer->up() && !one_->heard.empty() &&
               !other_->heard.empty() && one_->heard.back() == said && other_->heard.back() == said;
      }));
  EXPECT_EQ(0U, one_->lost + other_->lost);
  EXPECT_EQ(one_->ups - 1, one_->resumed);
  for (const Node* node : {one_.get(), other_.get()})
  {
    uint64_t newest = 0;
    uint64_t last = 0;
    for (const uint64_t number : node->heard)
    {
      // It goes on where it was, or begins again with something that came already.
      ASSERT_TRUE(number == last + 1 || number <= newest) << number << " after " << last;
      ASSERT_LE(number, newest + 1);
      newest = std::max(newest, number);
      last = number;
    }
    EXPECT_EQ(said, newest);
  }
}

TEST_F(PeersOnLoopback, AProcessThatEndedIsDownAndComesBack)
{
  const Endpoint endpoint = other_->endpoint();
  other_->peer.reset();
  other_.reset();
  ASSERT_TRUE(runBothUntil([this]() { return one_->lost == 1; }));
  EXPECT_EQ(State::DOWN, one_->peer->state());
  EXPECT_EQ(0U, one_->hung);
  one_->say(1);  // nobody will ever hear it

  other_ = std::make_unique<Node>(&other_loop_, 3, endpoint.port);
  other_->seek(one_->endpoint());
  ASSERT_TRUE(runBothUntil([this]() { return one_->peer->up() && other_->peer->up(); }));
  EXPECT_EQ(3U, one_->peer->instance());
  EXPECT_EQ(2U, one_->ups);
  EXPECT_EQ(0U, one_->resumed) << "what the last process carried is over";
  EXPECT_EQ(1U, one_->lost);
  one_->say(2);
  ASSERT_TRUE(runBothUntil([this]() { return !other_->heard.empty(); }));
  EXPECT_EQ(std::vector<uint64_t>{2}, other_->heard);
}

TEST_F(PeersOnLoopback, AProcessThatStopsIsHungAndComesBack)
{
  const SteadyTime before = SteadyClock::now();
  ASSERT_TRUE(runUntil(&loop_, [this]() { return one_->lost == 1; }));  // the other loop stands still
  EXPECT_LT(SteadyClock::now() - before, milliseconds(4000));
  EXPECT_EQ(State::HUNG, one_->peer->state());
  EXPECT_EQ(1U, one_->hung);
  EXPECT_EQ(1U, one_->interrupted);
  ASSERT_TRUE(runBothUntil([this]() { return one_->peer->up() && other_->peer->up() && other_->interrupted > 0; }));
  EXPECT_EQ(0U, one_->resumed) << "its links went back to TCPROS meanwhile";
}

TEST(Peer, IsUpOnlyWithWhoKnowsItsSecret)
{
  EventLoop loop;
  FakeSession session(&loop);
  ASSERT_NO_FATAL_FAILURE(session.connect());
  Hello hello;
  hello.instance = 5;
  hello.secret = 6;
  for (const uint64_t echo : {uint64_t{0}, session.peer->secret() + 2, uint64_t{6}})
  {
    hello.echo = echo;
    EXPECT_TRUE(session.peer->onHello(hello)) << "it may only not know it yet";
    EXPECT_FALSE(session.peer->up());
    EXPECT_EQ(0U, session.peer->instance());
  }
  FrameHeader ack;
  ack.type = FrameType::ACK;
  session.peer->onAck(ack);
  session.peer->onPing();
  EXPECT_FALSE(session.peer->up());
  hello.echo = session.peer->secret();
  EXPECT_TRUE(session.peer->onHello(hello));
  EXPECT_TRUE(session.peer->up());
  EXPECT_EQ(5U, session.peer->instance());
}

TEST(Peer, NeedsBothConnections)
{
  EventLoop loop;
  FakeSession session(&loop);
  EXPECT_TRUE(session.greet());
  EXPECT_FALSE(session.peer->up());
  session.peer->onConnected(session.transport.open[0]);
  EXPECT_FALSE(session.peer->up());
  session.peer->onConnected(session.transport.open[1]);
  EXPECT_TRUE(session.peer->up());
}

TEST(Peer, TellsTheOtherSecretOnBothConnectionsOnceItKnowsIt)
{
  EventLoop loop;
  FakeSession session(&loop);
  ASSERT_NO_FATAL_FAILURE(session.connect());
  const auto echoes = [&session]()
  {
    std::vector<uint64_t> echoes;
    for (const FakeSession::Frame& frame : session.transport.sent)
    {
      Hello hello;
      EXPECT_EQ(FrameType::HELLO, frame.header.type);
      EXPECT_TRUE(Hello::decode(frame.payload.data(), frame.payload.size(), &hello));
      EXPECT_EQ(session.peer->secret(), hello.secret);
      EXPECT_EQ(session.trafficOf(frame), static_cast<Traffic>(frame.header.id));
      echoes.push_back(hello.echo);
    }
    session.transport.sent.clear();
    return echoes;
  };
  EXPECT_EQ((std::vector<uint64_t>{0, 0}), echoes());
  Hello hello;
  hello.instance = 5;
  hello.secret = 66;
  EXPECT_TRUE(session.peer->onHello(hello));
  EXPECT_EQ((std::vector<uint64_t>{66, 66}), echoes());
  EXPECT_TRUE(session.peer->onHello(hello));
  EXPECT_EQ(std::vector<uint64_t>{}, echoes()) << "nothing new to say";
}

/// A greeting for which there is no place at the moment must come later: the other side waits for its echo.
TEST(Peer, AGreetingThatFindsNoPlaceComesLater)
{
  EventLoop loop;
  FakeSession session(&loop);
  session.transport.capacity = 1;
  ASSERT_NO_FATAL_FAILURE(session.connect());
  ASSERT_EQ(2U, session.transport.sent.size());
  Hello hello;
  hello.instance = 5;
  hello.secret = 66;
  EXPECT_TRUE(session.peer->onHello(hello));
  session.transport.sent.clear();
  session.peer->pump();  // as onWritable() does
  ASSERT_TRUE(runUntil(
      &loop, [&session]()
      { return !session.transport.sent.empty() || session.lost > 0 || session.peer->state() == State::HUNG; }));
  ASSERT_FALSE(session.transport.sent.empty());
  EXPECT_EQ(FrameType::HELLO, session.transport.sent.front().header.type);
}

TEST(Peer, LateFirstGreetingOnTheOtherConnectionIsHarmless)
{
  EventLoop loop;
  FakeSession session(&loop);
  ASSERT_NO_FATAL_FAILURE(session.meet());
  Hello late;
  late.instance = FakeSession::OTHER_INSTANCE;
  late.secret = session.other_secret;
  EXPECT_TRUE(session.peer->onHello(late));
  EXPECT_TRUE(session.peer->up());
  Hello strange = late;
  strange.instance = 4711;
  EXPECT_FALSE(session.peer->onHello(strange));
  strange = late;
  ++strange.secret;
  EXPECT_FALSE(session.peer->onHello(strange));
  EXPECT_TRUE(session.peer->up());
  EXPECT_EQ(session.other_secret, session.peer->theirSecret());
  EXPECT_EQ(0U, session.interruptions + session.lost);
}

void say(FakeSession* session, uint64_t number)
{
  FrameHeader header;
  header.type = FrameType::LINK_PAUSE;
  header.offset = number;
  session->peer->control(header, {static_cast<uint8_t>(number)});
}

std::vector<uint64_t> numbersOf(const std::vector<FakeSession::Frame>& frames)
{
  std::vector<uint64_t> numbers;
  for (const FakeSession::Frame& frame : frames)
  {
    EXPECT_EQ(Bytes{static_cast<uint8_t>(frame.header.offset)}, frame.payload);
    numbers.push_back(frame.header.offset);
  }
  return numbers;
}

TEST(Peer, ResumesWithTheControlFramesThatAreNotAcknowledged)
{
  EventLoop loop;
  FakeSession session(&loop);
  ASSERT_NO_FATAL_FAILURE(session.meet());
  for (uint64_t number = 1; number <= 5; ++number)
  {
    say(&session, number);
  }
  EXPECT_EQ((std::vector<uint64_t>{1, 2, 3, 4, 5}), numbersOf(session.take()));
  session.acknowledge(Traffic::EXPRESS, 2);
  const uint64_t secret = session.peer->secret();
  session.interrupt();
  EXPECT_EQ(State::SILENT, session.peer->state());
  EXPECT_EQ(1U, session.interruptions);
  EXPECT_EQ(0U, session.lost);
  EXPECT_NE(secret, session.peer->secret()) << "what is still in buffers on the way must not count";
  say(&session, 6);
  ASSERT_NO_FATAL_FAILURE(session.connect());
  ASSERT_TRUE(session.greet());
  EXPECT_EQ(1U, session.resumed);
  const std::vector<FakeSession::Frame> frames = session.take();
  EXPECT_EQ((std::vector<uint64_t>{3, 4, 5, 6}), numbersOf(frames));
  for (const FakeSession::Frame& frame : frames)
  {
    EXPECT_EQ(session.other_secret, frame.header.session);
  }
}

/// An acknowledgement counts the frames of one session and means nothing, or something wrong, in the next one.
TEST(Peer, AcknowledgementsDoNotOutliveAnInterruption)
{
  EventLoop loop;
  FakeSession session(&loop);
  ASSERT_NO_FATAL_FAILURE(session.meet());
  session.transport.capacity = 0;  // the link takes nothing any more
  for (int frames = 0; frames < 10; ++frames)
  {
    session.peer->acknowledge(Traffic::BULK, 1000, true);
  }
  loop.runOnce(milliseconds(0));
  session.interrupt();
  session.transport.capacity = 100;
  ASSERT_NO_FATAL_FAILURE(session.connect());
  ASSERT_TRUE(session.greet());
  for (const FakeSession::Frame& frame : session.transport.sent)
  {
    EXPECT_NE(FrameType::ACK, frame.header.type) << "of " << frame.header.offset << " frames, in a new session";
  }
}

TEST(Peer, AnotherProcessEndsWhatTheLastOneCarried)
{
  EventLoop loop;
  FakeSession session(&loop);
  ASSERT_NO_FATAL_FAILURE(session.meet(1000));
  say(&session, 1);
  session.take();
  session.close(CloseReason::PEER_CLOSED);
  EXPECT_EQ(0U, session.lost);
  ASSERT_NO_FATAL_FAILURE(session.connect());
  ASSERT_TRUE(session.greet(2000));
  EXPECT_EQ(1U, session.lost);
  EXPECT_EQ(0U, session.hung);
  EXPECT_EQ(2U, session.ups);
  EXPECT_EQ(0U, session.resumed);
  EXPECT_EQ(2000U, session.peer->instance());
  EXPECT_EQ(0U, session.take().size()) << "it is not for this one";
}

TEST(Peer, RefusedIsDown)
{
  EventLoop loop;
  FakeSession session(&loop);
  ASSERT_NO_FATAL_FAILURE(session.meet());
  session.close(CloseReason::REFUSED);
  EXPECT_EQ(State::DOWN, session.peer->state());
  EXPECT_EQ(1U, session.lost);
  EXPECT_EQ(0U, session.hung);
  session.close(CloseReason::REFUSED);
  EXPECT_EQ(1U, session.lost) << "once";
  ASSERT_NO_FATAL_FAILURE(session.meet());
  EXPECT_EQ(0U, session.resumed);
}

TEST(Peer, AGreetingShortensTheWaitForOneThatWasDown)
{
  EventLoop loop;
  FakeSession session(&loop);
  session.close(CloseReason::REFUSED);
  EXPECT_EQ(0U, session.transport.open.size());
  EXPECT_TRUE(session.greet());
  EXPECT_EQ(TRAFFIC_CLASSES, session.transport.open.size());
}

TEST(Peer, AcceptsButSilentIsHung)
{
  EventLoop loop;
  FakeSession session(&loop);
  ASSERT_NO_FATAL_FAILURE(session.meet());
  session.interrupt();
  ASSERT_NO_FATAL_FAILURE(session.connect());
  const SteadyTime before = SteadyClock::now();
  ASSERT_TRUE(runUntil(&loop, [&session]() { return session.lost > 0; }));
  EXPECT_GE(SteadyClock::now() - before, milliseconds(400));
  EXPECT_EQ(State::HUNG, session.peer->state());
  EXPECT_EQ(1U, session.hung);
  EXPECT_EQ(TRAFFIC_CLASSES, session.transport.open.size()) << "it will find the greeting when it wakes";
  ASSERT_TRUE(session.greet());
  EXPECT_TRUE(session.peer->up());
  EXPECT_EQ(0U, session.resumed);
}

TEST(Peer, ASilentOneIsWaitedForWhileMessagesWaitThatNobodyElseHas)
{
  EventLoop loop;
  FakeSession session(&loop);
  session.holds_last = true;
  ASSERT_NO_FATAL_FAILURE(session.meet());
  session.interrupt();
  ASSERT_NO_FATAL_FAILURE(session.connect());
  const SteadyTime before = SteadyClock::now();
  ASSERT_TRUE(runUntil(&loop, [&before]() { return SteadyClock::now() - before > milliseconds(1500); }));
  EXPECT_EQ(0U, session.lost);
  ASSERT_TRUE(session.greet());
  EXPECT_TRUE(session.peer->up());
  EXPECT_EQ(1U, session.resumed);

  session.interrupt();
  ASSERT_NO_FATAL_FAILURE(session.connect());
  session.holds_last = false;
  ASSERT_TRUE(runUntil(&loop, [&session]() { return session.lost > 0; }));
  EXPECT_EQ(1U, session.hung);
}

TEST(Peer, WhoDidNotRunItselfBlamesNobody)
{
  EventLoop loop;
  FakeSession session(&loop);
  ASSERT_NO_FATAL_FAILURE(session.meet());
  std::this_thread::sleep_for(milliseconds(900));  // a process that is stopped
  const SteadyTime awake = SteadyClock::now();
  ASSERT_TRUE(runUntil(&loop, [&awake]() { return SteadyClock::now() - awake > milliseconds(400); }));
  EXPECT_EQ(0U, session.interruptions);
  ASSERT_TRUE(runUntil(&loop, [&session]() { return session.interruptions > 0; })) << "it really is silent";
}

TEST(Peer, SilenceInterruptsAndSignsOfLifePreventIt)
{
  EventLoop loop;
  FakeSession session(&loop);
  ASSERT_NO_FATAL_FAILURE(session.meet());
  const SteadyTime alive_until = SteadyClock::now() + milliseconds(1000);
  size_t pings = 0;
  ASSERT_TRUE(runUntil(&loop,
                       [&]()
                       {
                         for (const FakeSession::Frame& frame : session.transport.sent)
                         {
                           pings += frame.header.type == FrameType::PING ? 1 : 0;
                         }
                         session.transport.sent.clear();
                         session.peer->onPing();
                         return SteadyClock::now() > alive_until;
                       }));
  EXPECT_EQ(0U, session.interruptions);
  EXPECT_GE(pings, 3U) << "it says that it lives as well";
  ASSERT_TRUE(runUntil(&loop, [&session]() { return session.interruptions > 0; }));
  EXPECT_GE(SteadyClock::now() - alive_until, milliseconds(550));
  EXPECT_EQ(State::SILENT, session.peer->state());
  EXPECT_EQ(0U, session.lost) << "its device may come back";
}

TEST(Peer, ControlBeforeTheFirstMeetingIsLost)
{
  EventLoop loop;
  FakeSession session(&loop);
  say(&session, 1);
  ASSERT_NO_FATAL_FAILURE(session.connect());
  ASSERT_TRUE(session.greet());
  EXPECT_EQ(0U, session.take().size());
}

TEST(Peer, AcknowledgesTogetherOrAtOnce)
{
  EventLoop loop;
  FakeSession session(&loop);
  ASSERT_NO_FATAL_FAILURE(session.meet());
  session.transport.sent.clear();
  const auto acks = [&session](Traffic traffic)
  {
    std::vector<uint64_t> acks;
    for (const FakeSession::Frame& frame : session.transport.sent)
    {
      if (frame.header.type == FrameType::ACK && frame.header.id == static_cast<uint32_t>(traffic))
      {
        acks.push_back(frame.header.offset);
      }
    }
    return acks;
  };
  session.peer->acknowledge(Traffic::BULK, 1000, false);
  session.peer->acknowledge(Traffic::BULK, 1000, true);
  session.peer->acknowledge(Traffic::BULK, 1000, true);
  session.peer->acknowledge(Traffic::EXPRESS, 100, false);
  EXPECT_EQ(0U, acks(Traffic::BULK).size()) << "not before all that has come is processed";
  loop.runOnce(milliseconds(0));
  EXPECT_EQ(std::vector<uint64_t>{3}, acks(Traffic::BULK));
  EXPECT_EQ(std::vector<uint64_t>{}, acks(Traffic::EXPRESS));
  session.peer->acknowledge(Traffic::EXPRESS, 100, false);
  ASSERT_TRUE(runUntil(&loop, [&]() { return !acks(Traffic::EXPRESS).empty(); }));
  EXPECT_EQ(std::vector<uint64_t>{2}, acks(Traffic::EXPRESS));
  session.transport.sent.clear();
  session.peer->acknowledge(Traffic::EXPRESS, 70000, false);
  loop.runOnce(milliseconds(0));
  EXPECT_EQ(std::vector<uint64_t>{3}, acks(Traffic::EXPRESS)) << "so much is not kept waiting";
  EXPECT_EQ(73200U, session.peer->receivedBytes());
}

TEST(Peer, RefusesAcknowledgementsThatCannotBe)
{
  EventLoop loop;
  FakeSession session(&loop);
  ASSERT_NO_FATAL_FAILURE(session.meet());
  FrameHeader ack;
  ack.type = FrameType::ACK;
  ack.id = TRAFFIC_CLASSES;
  EXPECT_FALSE(session.peer->onAck(ack));
  ack.id = 0xffffffff;
  EXPECT_FALSE(session.peer->onAck(ack));
  ack.id = 0;
  ack.offset = 1;
  EXPECT_FALSE(session.peer->onAck(ack));
}

/// Sends numbered frames as long as it has some.
class Source : public FrameSource
{
public:
  Source(uint32_t id, Traffic traffic, size_t left) : left(left), id_(id), traffic_(traffic) {}
  bool sendNext(Peer*, Lane* lane) override
  {
    FrameHeader header;
    header.type = FrameType::FRAGMENT;
    header.id = id_;
    EXPECT_TRUE(lane->send(header, nullptr, 0, nullptr, nullptr));
    return --left > 0;
  }
  Traffic traffic() const override { return traffic_; }

  size_t left;

private:
  const uint32_t id_;
  const Traffic traffic_;
};

TEST(Peer, SharesALaneAmongSources)
{
  EventLoop loop;
  FakeSession session(&loop);
  ASSERT_NO_FATAL_FAILURE(session.meet());
  const auto bulk = std::make_shared<Source>(1, Traffic::BULK, 2);
  const auto first = std::make_shared<Source>(2, Traffic::EXPRESS, 3);
  const auto second = std::make_shared<Source>(3, Traffic::EXPRESS, 2);
  auto gone = std::make_shared<Source>(4, Traffic::EXPRESS, 1);
  for (const std::shared_ptr<Source>& source : {bulk, first, second, gone, first})
  {
    session.peer->offer(source);
  }
  gone.reset();
  say(&session, 1);
  session.peer->pump();
  std::vector<uint32_t> order;
  for (const FakeSession::Frame& frame : session.take())
  {
    order.push_back(frame.header.id);
  }
  EXPECT_EQ((std::vector<uint32_t>{0, 2, 3, 2, 3, 2, 1, 1}), order) << "control, EXPRESS in turns, BULK";
}

}  // namespace
}  // namespace pi_os_transport
