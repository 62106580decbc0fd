#include "wire/frame_transport.h"

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstring>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <ostream>
#include <random>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "event_loop/event_loop.h"
#include "shm/file_descriptor.h"
#include "wire/sp_transport.h"

namespace pi_os_transport
{
namespace
{

using std::chrono::milliseconds;
using Bytes = std::vector<uint8_t>;
using ConnectionId = FrameTransport::ConnectionId;
using SourceId = FrameTransport::SourceId;
using MakeTransport = std::unique_ptr<FrameTransport> (*)(EventLoop*, FrameTransport::Listener*);

constexpr milliseconds ROUND{20};
constexpr std::chrono::seconds DEADLINE{60};
constexpr char LOCALHOST[] = "127.0.0.1";

const Bytes PUSH_GREETING{0, 'S', 'P', 0, 0, 0x50, 0, 0};
const Bytes PULL_GREETING{0, 'S', 'P', 0, 0, 0x51, 0, 0};

bool runUntil(EventLoop* loop, const std::function<bool()>& done)
{
  const SteadyTime deadline = SteadyClock::now() + DEADLINE;
  while (!done() && SteadyClock::now() < deadline)
  {
    loop->runOnce(ROUND);
  }
  return done();
}

/// Writes down what a transport says. A payload gets a place of exactly its size, so that the address sanitizer sees
/// what is written beyond it. What a test wants to be done in a callback stands in `on...`.
class Recorder : public FrameTransport::Listener
{
public:
  struct Frame
  {
    SourceId source;
    FrameHeader header;
    Bytes payload;
  };
  struct Closed
  {
    ConnectionId connection;
    CloseReason reason;
  };
  struct SourceClosed
  {
    SourceId source;
    CloseReason reason;
    std::string detail;
    std::string address;
  };

  void onConnected(ConnectionId connection) override
  {
    connected.push_back(connection);
    call(on_connected, connection);
  }
  void onWritable(ConnectionId connection) override
  {
    writable.push_back(connection);
    call(on_writable, connection);
  }
  void onClosed(ConnectionId connection, CloseReason reason) override
  {
    closed.push_back({connection, reason});
    call(on_closed, connection);
  }
  bool onAccept(const std::string& address) override
  {
    asked.push_back(address);
    call(on_accept, SourceId{0});
    return accept;
  }
  uint8_t* onHeader(SourceId source, const FrameHeader& header, uint32_t length) override
  {
    EXPECT_EQ(WIRE_VERSION, header.version);
    EXPECT_LE(length, MAX_PAYLOAD);
    ++headers;
    places_[source] = std::make_unique<uint8_t[]>(length);
    call(on_header, source);
    return header.id == refused_id ? nullptr : places_[source].get();
  }
  void onFrame(SourceId source, const FrameHeader& header, uint8_t* payload, uint32_t length) override
  {
    EXPECT_EQ(places_[source].get(), payload);
    payload_bytes += length;
    if (!on_payload)
    {
      frames.push_back({source, header, Bytes(payload, payload + length)});
    }
    else
    {
      on_payload(header, payload, length);
    }
    call(on_frame, source);
  }
  void onSourceClosed(SourceId source, CloseReason reason, const std::string& detail) override
  {
    sources_closed.push_back({source, reason, detail, transport != nullptr ? transport->addressOf(source) : ""});
    call(on_source_closed, source);
  }

  size_t countOf(uint32_t id) const
  {
    return static_cast<size_t>(
        std::count_if(frames.begin(), frames.end(), [id](const Frame& frame) { return frame.header.id == id; }));
  }

  FrameTransport* transport = nullptr;
  bool accept = true;
  uint32_t refused_id = 0xffffffff;
  std::vector<ConnectionId> connected;
  std::vector<ConnectionId> writable;
  std::vector<Closed> closed;
  std::vector<std::string> asked;
  std::vector<Frame> frames;
  std::vector<SourceClosed> sources_closed;
  size_t headers = 0;
  size_t payload_bytes = 0;
  std::function<void(uint32_t)> on_connected, on_writable, on_closed, on_accept, on_header, on_frame, on_source_closed;
  std::function<void(const FrameHeader&, const uint8_t*, uint32_t)> on_payload;  ///< in place of `frames`

private:
  static void call(const std::function<void(uint32_t)>& action, uint32_t id)
  {
    if (action)
    {
      action(id);
    }
  }

  std::map<SourceId, std::unique_ptr<uint8_t[]>> places_;
};

/// One bridge's end.
struct Node
{
  Node(MakeTransport make, EventLoop* loop) : transport(make(loop, &said)) { said.transport = transport.get(); }
  Endpoint listen()
  {
    std::string error;
    EXPECT_TRUE(transport->listen({LOCALHOST, 0}, &error)) << error;
    EXPECT_NE(0, transport->port());
    return {LOCALHOST, transport->port()};
  }

  Recorder said;
  std::unique_ptr<FrameTransport> transport;
};

FrameHeader headerOf(uint32_t id)
{
  FrameHeader header;
  header.type = FrameType::FRAGMENT;
  header.id = id;
  header.session = 0x0123456789abcdef;
  header.count = ~id;
  header.offset = uint64_t{id} << 20;
  return header;
}

Bytes randomBytes(std::mt19937* random, size_t count)
{
  Bytes bytes(count);
  for (uint8_t& byte : bytes)
  {
    byte = static_cast<uint8_t>((*random)());
  }
  return bytes;
}

Bytes operator+(Bytes left, const Bytes& right)
{
  left.insert(left.end(), right.begin(), right.end());
  return left;
}

Bytes messageOf(const Bytes& body, uint64_t length)
{
  Bytes message(8);
  for (size_t byte = 0; byte < 8; ++byte)
  {
    message[byte] = static_cast<uint8_t>(length >> (56 - 8 * byte));
  }
  return message + body;
}

Bytes frameOf(const FrameHeader& header, const Bytes& payload)
{
  const auto encoded = header.encode();
  const Bytes body = Bytes(encoded.begin(), encoded.end()) + payload;
  return messageOf(body, body.size());
}

/// The other end as plain TCP, for what no bridge would send.
class RawPeer
{
public:
  explicit RawPeer(const Endpoint& endpoint) : socket_(socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0))
  {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(endpoint.port);
    inet_pton(AF_INET, endpoint.address.c_str(), &address.sin_addr);
    EXPECT_EQ(0, connect(socket_.get(), reinterpret_cast<const sockaddr*>(&address), sizeof(address)));
  }

  int fd() const { return socket_.get(); }
  /// @return false if the other end has closed.
  bool send(const Bytes& bytes) const
  {
    return ::send(fd(), bytes.data(), bytes.size(), MSG_NOSIGNAL) == static_cast<ssize_t>(bytes.size());
  }
  size_t fill(const Bytes& bytes) const
  {
    const ssize_t sent = ::send(fd(), bytes.data(), bytes.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
    return sent < 0 ? 0 : static_cast<size_t>(sent);
  }
  void close() { socket_.reset(); }

private:
  FileDescriptor socket_;
};

/// A plain listening socket.
struct RawListener
{
  explicit RawListener(int backlog) : socket(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0))
  {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t length = sizeof(address);
    EXPECT_EQ(0, bind(socket.get(), reinterpret_cast<const sockaddr*>(&address), length));
    EXPECT_EQ(0, backlog < 0 ? 0 : ::listen(socket.get(), backlog));
    EXPECT_EQ(0, getsockname(socket.get(), reinterpret_cast<sockaddr*>(&address), &length));
    endpoint = {LOCALHOST, ntohs(address.sin_port)};
  }
  FileDescriptor accept() const { return FileDescriptor(accept4(socket.get(), nullptr, nullptr, SOCK_CLOEXEC)); }

  FileDescriptor socket;
  Endpoint endpoint;
};

struct Pairing
{
  const char* name;
  MakeTransport sender;
  MakeTransport receiver;
};

void PrintTo(const Pairing& pairing, std::ostream* out)
{
  *out << pairing.name;
}

class FrameTransports : public testing::TestWithParam<Pairing>
{
protected:
  void connect()
  {
    connection = sender.transport->connect(receiver.listen());
    ASSERT_NE(0U, connection);
    EXPECT_TRUE(sender.said.connected.empty()) << "called back from within connect()";
    ASSERT_TRUE(runUntil(&loop, [this] { return !sender.said.connected.empty(); }));
    ASSERT_EQ(connection, sender.said.connected.front());
    ASSERT_TRUE(sender.transport->writable(connection));
  }

  /// Sends frames with these lengths of payload, as fast as they go, and checks what comes.
  void transfer(const std::vector<uint32_t>& lengths)
  {
    std::mt19937 random(1);
    const Bytes pattern = randomBytes(&random, MAX_PAYLOAD + 1024);
    const auto payloadOf = [&](uint32_t id) { return &pattern[id % 1024]; };
    uint32_t received = 0;
    receiver.said.on_payload = [&](const FrameHeader& header, const uint8_t* payload, uint32_t length)
    {
      const FrameHeader expected = headerOf(received);
      ASSERT_EQ(expected.encode(), header.encode());
      ASSERT_EQ(lengths[received], length);
      ASSERT_EQ(0, length == 0 ? 0 : std::memcmp(payloadOf(received), payload, length)) << received;
      ++received;
    };
    uint32_t sent = 0;
    Bytes payload;
    ASSERT_TRUE(
        runUntil(&loop,
                 [&]
                 {
                   while (sent < lengths.size() && sender.transport->writable(connection))
                   {
                     // Two pieces, in a place that changes as soon as the frame may have left it.
                     payload.assign(payloadOf(sent), payloadOf(sent) + lengths[sent]);
                     const size_t cut = lengths[sent] == 0 ? 0 : sent % lengths[sent];
                     const iovec pieces[2] = {{payload.data(), cut}, {payload.data() + cut, lengths[sent] - cut}};
                     EXPECT_TRUE(sender.transport->send(connection, headerOf(sent), pieces, 2));
                     ++sent;
                   }
                   if (sent < lengths.size())
                   {
                     ++times_full;
                     EXPECT_FALSE(sender.transport->send(connection, headerOf(0)));
                   }
                   return received == lengths.size() || HasFatalFailure();
                 }))
        << sent << " sent, " << received << " received";
    EXPECT_EQ(lengths.size(), received);
    EXPECT_TRUE(sender.said.closed.empty());
    EXPECT_TRUE(receiver.said.sources_closed.empty());
  }

  EventLoop loop;
  Node sender{GetParam().sender, &loop};
  Node receiver{GetParam().receiver, &loop};
  ConnectionId connection = 0;
  size_t times_full = 0;
};

TEST_P(FrameTransports, CarriesEmptyFrames)
{
  connect();
  transfer(std::vector<uint32_t>(5000, 0));
}

TEST_P(FrameTransports, CarriesFramesOfOneByte)
{
  connect();
  transfer(std::vector<uint32_t>(5000, 1));
}

TEST_P(FrameTransports, CarriesSmallFrames)
{
  connect();
  transfer(std::vector<uint32_t>(5000, 1000));
}

TEST_P(FrameTransports, CarriesLargeFrames)
{
  connect();
  transfer(std::vector<uint32_t>(2000, 64 * 1024));
  EXPECT_GT(times_full, 0U);
}

TEST_P(FrameTransports, CarriesTheLargestFrames)
{
  connect();
  transfer(std::vector<uint32_t>(500, MAX_PAYLOAD));
  EXPECT_GT(times_full, 0U);
  EXPECT_FALSE(sender.said.writable.empty());
}

TEST_P(FrameTransports, CarriesFramesOfAllSizesTogether)
{
  connect();
  std::mt19937 random(2);
  std::vector<uint32_t> lengths;
  for (int frame = 0; frame < 4000; ++frame)
  {
    // As many small ones as large ones, with those around each power of two.
    const uint32_t power = 1U << random() % 19;
    lengths.push_back(std::min<uint32_t>(MAX_PAYLOAD, power + random() % 3 - 1));
  }
  transfer(lengths);
}

TEST_P(FrameTransports, SendsOnWhenTheReceiverHasCaughtUp)
{
  connect();
  const Bytes payload(MAX_PAYLOAD, 7);
  const iovec piece{const_cast<uint8_t*>(payload.data()), payload.size()};
  // Nobody takes frames meanwhile: the receiver is called by the same loop.
  uint32_t sent = 0;
  const SteadyTime deadline = SteadyClock::now() + DEADLINE;
  while (sender.transport->writable(connection) && SteadyClock::now() < deadline)
  {
    ASSERT_TRUE(sender.transport->send(connection, headerOf(sent++), &piece, 1));
  }
  ASSERT_FALSE(sender.transport->writable(connection));
  ASSERT_FALSE(sender.transport->send(connection, headerOf(sent), &piece, 1));
  EXPECT_TRUE(sender.said.writable.empty()) << "called back from within send()";
  receiver.said.on_payload = [](const FrameHeader&, const uint8_t*, uint32_t) {};
  ASSERT_TRUE(runUntil(&loop, [&] { return !sender.said.writable.empty(); }));
  EXPECT_EQ(connection, sender.said.writable.front());
  EXPECT_TRUE(sender.transport->writable(connection));
  ASSERT_TRUE(runUntil(&loop, [&] { return receiver.said.payload_bytes == sent * payload.size(); }));
}

TEST_P(FrameTransports, RefusesToSendMoreThanAFrameMayHold)
{
  connect();
  const Bytes payload(MAX_PAYLOAD + 1);
  const iovec piece{const_cast<uint8_t*>(payload.data()), payload.size()};
  EXPECT_THROW(sender.transport->send(connection, headerOf(0), &piece, 1), std::invalid_argument);
  EXPECT_TRUE(sender.transport->writable(connection));
  transfer({10, 20});
}

TEST_P(FrameTransports, KnowsNothingOfAConnectionThatWasClosed)
{
  connect();
  sender.transport->close(connection);
  sender.transport->close(connection);
  EXPECT_FALSE(sender.transport->writable(connection));
  EXPECT_FALSE(sender.transport->send(connection, headerOf(0)));
  EXPECT_FALSE(sender.transport->roundTrip(connection));
  const ConnectionId next = sender.transport->connect({LOCALHOST, receiver.transport->port()});
  EXPECT_NE(connection, next) << "numbers are not used again";
  sender.transport->close(next);  // before it came about
  for (int round = 0; round < 5; ++round)
  {
    loop.runOnce(ROUND);
  }
  EXPECT_EQ(1U, sender.said.connected.size());
  EXPECT_TRUE(sender.said.closed.empty()) << "close() is not reported";
}

TEST_P(FrameTransports, ReceivesFromSeveralSenders)
{
  connect();
  Node second(GetParam().sender, &loop);
  const ConnectionId other = second.transport->connect({LOCALHOST, receiver.transport->port()});
  ASSERT_TRUE(runUntil(&loop, [&] { return !second.said.connected.empty(); }));
  for (uint32_t id = 0; id < 100; ++id)
  {
    ASSERT_TRUE(
        runUntil(&loop, [&] { return sender.transport->writable(connection) && second.transport->writable(other); }));
    ASSERT_TRUE(sender.transport->send(connection, headerOf(id)));
    ASSERT_TRUE(second.transport->send(other, headerOf(1000 + id)));
  }
  ASSERT_TRUE(runUntil(&loop, [&] { return receiver.said.frames.size() == 200; }));
  std::map<uint32_t, uint32_t> next{{0, 0}, {1, 1000}};  // by sender
  for (const Recorder::Frame& frame : receiver.said.frames)
  {
    EXPECT_EQ(next[frame.header.id / 1000]++, frame.header.id);
  }
}

TEST_P(FrameTransports, CannotListenWhereAnotherOneDoes)
{
  const Endpoint endpoint = receiver.listen();
  std::string error;
  EXPECT_FALSE(sender.transport->listen(endpoint, &error));
  EXPECT_NE(std::string::npos, error.find(endpoint.toString())) << error;
  error.clear();
  EXPECT_FALSE(sender.transport->listen({"localhost", 0}, &error)) << "not a number";
  EXPECT_FALSE(error.empty());
  EXPECT_EQ(0, sender.transport->port());
}

TEST_P(FrameTransports, CannotReachWhatIsNoAddress)
{
  const ConnectionId id = sender.transport->connect({"no.such.address", 1});
  EXPECT_TRUE(sender.said.closed.empty());
  ASSERT_TRUE(runUntil(&loop, [&] { return !sender.said.closed.empty(); }));
  EXPECT_EQ(id, sender.said.closed[0].connection);
  EXPECT_EQ(CloseReason::UNREACHABLE, sender.said.closed[0].reason);
  EXPECT_TRUE(sender.said.connected.empty());
}

INSTANTIATE_TEST_SUITE_P(, FrameTransports,
                         testing::Values(Pairing{"SpToSp", makeSpTransport, makeSpTransport},
                                         Pairing{"SpToNanomsg", makeSpTransport, makeNanomsgTransport},
                                         Pairing{"NanomsgToSp", makeNanomsgTransport, makeSpTransport},
                                         Pairing{"NanomsgToNanomsg", makeNanomsgTransport, makeNanomsgTransport}),
                         [](const testing::TestParamInfo<Pairing>& info) { return info.param.name; });

/// A receiver, and a good peer that must be served whatever others send.
class SpTransport : public testing::Test
{
protected:
  void SetUp() override
  {
    endpoint = receiver.listen();
    connection = sender.transport->connect(endpoint);
    ASSERT_TRUE(runUntil(&loop, [this] { return !sender.said.connected.empty(); }));
    expectGoodPeerServed();
    good_source = receiver.said.frames.back().source;
  }

  void expectGoodPeerServed()
  {
    const uint32_t id = GOOD_ID + ++good_frames;
    const Bytes payload(500, static_cast<uint8_t>(good_frames));
    const iovec piece{const_cast<uint8_t*>(payload.data()), payload.size()};
    ASSERT_TRUE(sender.transport->send(connection, headerOf(id), &piece, 1));
    ASSERT_TRUE(runUntil(&loop, [&] { return receiver.said.countOf(id) == 1; })) << good_frames;
    EXPECT_EQ(payload, receiver.said.frames.back().payload);
  }

  /// Runs until one more incoming connection has ended. @return what was said of it.
  Recorder::SourceClosed nextSourceClosed()
  {
    const size_t before = source_ends++;
    EXPECT_TRUE(runUntil(&loop, [&] { return receiver.said.sources_closed.size() > before; }));
    return receiver.said.sources_closed.size() > before ? receiver.said.sources_closed[before]
                                                        : Recorder::SourceClosed{0, CloseReason::REFUSED, "none", ""};
  }

  /// Runs until an outgoing connection has ended.
  CloseReason reasonOfEnd(ConnectionId id)
  {
    EXPECT_TRUE(runUntil(&loop, [&] { return !sender.said.closed.empty(); }));
    EXPECT_EQ(1U, sender.said.closed.size());
    EXPECT_EQ(id, sender.said.closed.at(0).connection);
    EXPECT_FALSE(sender.transport->writable(id));
    return sender.said.closed.at(0).reason;
  }

  /// Connects to a socket which says this.
  CloseReason reasonOfEndAfter(const Bytes& said)
  {
    const RawListener other(1);
    const ConnectionId id = sender.transport->connect(other.endpoint);
    const FileDescriptor accepted = other.accept();
    EXPECT_EQ(static_cast<ssize_t>(said.size()), send(accepted.get(), said.data(), said.size(), MSG_NOSIGNAL));
    return reasonOfEnd(id);
  }

  static constexpr uint32_t GOOD_ID = 0x60000000;

  EventLoop loop;
  Node sender{makeSpTransport, &loop};
  Node receiver{makeSpTransport, &loop};
  Endpoint endpoint;
  ConnectionId connection = 0;
  SourceId good_source = 0;
  uint32_t good_frames = 0;
  size_t source_ends = 0;
};

TEST_F(SpTransport, TellsThatNobodyListens)
{
  const RawListener deaf(-1);
  EXPECT_EQ(CloseReason::REFUSED, reasonOfEnd(sender.transport->connect(deaf.endpoint)));
  EXPECT_EQ(1U, sender.said.connected.size());
}

TEST_F(SpTransport, TellsThatThePeerHasGone)
{
  receiver.transport.reset();
  EXPECT_EQ(CloseReason::PEER_CLOSED, reasonOfEnd(connection));
}

TEST_F(SpTransport, TellsThatThePeerHasGoneInTheMiddleOfAFrame)
{
  const Bytes payload(MAX_PAYLOAD, 1);
  const iovec piece{const_cast<uint8_t*>(payload.data()), payload.size()};
  while (sender.transport->send(connection, headerOf(1), &piece, 1))
  {
  }
  receiver.transport.reset();
  EXPECT_EQ(CloseReason::PEER_CLOSED, reasonOfEnd(connection));
}

TEST_F(SpTransport, TellsThatTheSourceHasGone)
{
  sender.transport->close(connection);
  const Recorder::SourceClosed end = nextSourceClosed();
  EXPECT_EQ(good_source, end.source);
  EXPECT_EQ(CloseReason::PEER_CLOSED, end.reason);
  EXPECT_EQ(LOCALHOST, end.address) << "the listener may still ask for it";
  EXPECT_EQ("", receiver.transport->addressOf(good_source));
}

TEST_F(SpTransport, GivesUpSoonWhereNobodyAnswers)
{
  // A queue that is full stays so: the kernel drops what else wants to connect, as a cut link would.
  const RawListener full(0);
  const RawPeer waiting(full.endpoint);
  const SteadyTime start = SteadyClock::now();
  EXPECT_EQ(CloseReason::UNREACHABLE, reasonOfEnd(sender.transport->connect(full.endpoint)));
  EXPECT_GE(SteadyClock::now() - start, SP_CONNECT_TIME);
  EXPECT_LT(SteadyClock::now() - start, milliseconds(3000)) << "that was the kernel's patience";
  expectGoodPeerServed();
}

TEST_F(SpTransport, GivesUpWhereNobodyGreets)
{
  const RawListener mute(1);
  const SteadyTime start = SteadyClock::now();
  EXPECT_EQ(CloseReason::SILENT, reasonOfEnd(sender.transport->connect(mute.endpoint)));
  EXPECT_GE(SteadyClock::now() - start, SP_ANSWER_TIME);
  EXPECT_EQ(1U, sender.said.connected.size());
}

TEST_F(SpTransport, DoesNotConnectToAnotherProtocol)
{
  EXPECT_EQ(CloseReason::MALFORMED, reasonOfEndAfter({'S', 'S', 'H', '-', '2', '.', '0', '-'}));
  EXPECT_EQ(1U, sender.said.connected.size());
}

TEST_F(SpTransport, DoesNotConnectToAnotherPushSocket)
{
  EXPECT_EQ(CloseReason::MALFORMED, reasonOfEndAfter(PUSH_GREETING));
  EXPECT_EQ(1U, sender.said.connected.size());
}

TEST_F(SpTransport, EndsAConnectionThatTalksBack)
{
  EXPECT_EQ(CloseReason::MALFORMED, reasonOfEndAfter(PULL_GREETING + Bytes{0}));
  EXPECT_EQ(2U, sender.said.connected.size());
}

TEST_F(SpTransport, KnowsWhereItsSourcesAre)
{
  EXPECT_EQ(std::vector<std::string>{LOCALHOST}, receiver.said.asked);
  EXPECT_EQ(LOCALHOST, receiver.transport->addressOf(good_source));
  EXPECT_EQ("", receiver.transport->addressOf(good_source + 1));
}

TEST_F(SpTransport, MeasuresTheNetworkWithoutAProcessThatReadsNothing)
{
  ASSERT_TRUE(sender.transport->roundTrip(connection));
  const Bytes payload(MAX_PAYLOAD);
  const iovec piece{const_cast<uint8_t*>(payload.data()), payload.size()};
  ASSERT_TRUE(sender.transport->send(connection, headerOf(1), &piece, 1));
  const milliseconds away(500);
  std::this_thread::sleep_for(away);  // the time that the receiver, which this thread serves, reads nothing
  const std::optional<std::chrono::microseconds> after = sender.transport->roundTrip(connection);
  ASSERT_TRUE(after);
  EXPECT_LT(*after, away / 2);
}

TEST_F(SpTransport, LetsNobodyInWhomItsListenerRefuses)
{
  receiver.said.accept = false;
  EXPECT_EQ(CloseReason::PEER_CLOSED, reasonOfEnd(sender.transport->connect(endpoint)));
  EXPECT_EQ(2U, receiver.said.asked.size());
  EXPECT_EQ(1U, sender.said.connected.size());
  EXPECT_TRUE(receiver.said.sources_closed.empty());
  expectGoodPeerServed();
}

TEST_F(SpTransport, DeliversWhatWasSentBeforeTheConnectionWasClosed)
{
  for (uint32_t id = 1; id <= 50; ++id)
  {
    ASSERT_TRUE(sender.transport->send(connection, headerOf(id)));
  }
  sender.transport->close(connection);
  EXPECT_EQ(CloseReason::PEER_CLOSED, nextSourceClosed().reason);
  for (uint32_t id = 1; id <= 50; ++id)
  {
    EXPECT_EQ(1U, receiver.said.countOf(id));
  }
}

TEST_F(SpTransport, EndsASourceThatTheListenerCloses)
{
  receiver.transport->closeSource(good_source);
  receiver.transport->closeSource(good_source);
  EXPECT_EQ("", receiver.transport->addressOf(good_source));
  EXPECT_EQ(CloseReason::PEER_CLOSED, reasonOfEnd(connection));
  EXPECT_TRUE(receiver.said.sources_closed.empty());
}

TEST_F(SpTransport, EndsSourcesThatSendNoFrames)
{
  FrameHeader other_version = headerOf(1);
  other_version.version = WIRE_VERSION + 1;
  FrameHeader unknown_type = headerOf(1);
  unknown_type.type = static_cast<FrameType>(LAST_FRAME_TYPE + 1);
  struct Case
  {
    const char* name;
    Bytes bytes;
    std::string detail;
    SourceFault fault;
  };
  const Bytes enough(64, 0x41);
  const std::vector<Case> cases{
      {"another protocol", {'G', 'E', 'T', ' ', '/'}, NO_GREETING_DETAIL, SourceFault::MALFORMED},
      {"one wrong byte", {1}, NO_GREETING_DETAIL, SourceFault::MALFORMED},
      {"a PULL socket", PULL_GREETING, NO_GREETING_DETAIL, SourceFault::MALFORMED},
      {"another SP version", {0, 'S', 'P', 1, 0, 0x50, 0, 0}, NO_GREETING_DETAIL, SourceFault::MALFORMED},
      {"one byte too large", PUSH_GREETING + messageOf({}, FrameHeader::BYTES + MAX_PAYLOAD + 1),
       "oversized frame of 262177 bytes", SourceFault::OVERSIZED},
      {"as large as can be", PUSH_GREETING + messageOf({}, ~uint64_t{0}),
       "oversized frame of 18446744073709551615 bytes", SourceFault::OVERSIZED},
      {"large modulo 2^32", PUSH_GREETING + messageOf(enough, (uint64_t{1} << 32) + 64),
       "oversized frame of 4294967360 bytes", SourceFault::OVERSIZED},
      {"empty message", PUSH_GREETING + messageOf({}, 0), NO_FRAME_DETAIL, SourceFault::MALFORMED},
      {"too short for a header", PUSH_GREETING + messageOf({}, FrameHeader::BYTES - 1), NO_FRAME_DETAIL,
       SourceFault::MALFORMED},
      {"another message", PUSH_GREETING + messageOf(enough, enough.size()), NO_FRAME_DETAIL, SourceFault::MALFORMED},
      {"unknown type", PUSH_GREETING + frameOf(unknown_type, {}), NO_FRAME_DETAIL, SourceFault::MALFORMED},
      {"another version", PUSH_GREETING + frameOf(other_version, {}), "wire version 2, this bridge speaks 1",
       SourceFault::WRONG_VERSION},
      {"unwanted frame", PUSH_GREETING + frameOf(headerOf(receiver.said.refused_id), {1, 2}), FRAME_REFUSED_DETAIL,
       SourceFault::REFUSED},
      {"unwanted empty frame", PUSH_GREETING + frameOf(headerOf(receiver.said.refused_id), {}), FRAME_REFUSED_DETAIL,
       SourceFault::REFUSED},
  };
  static_assert(WIRE_VERSION == 1 && MAX_PAYLOAD == 262144, "adapt the texts above");
  for (const Case& test : cases)
  {
    SCOPED_TRACE(test.name);
    const RawPeer peer(endpoint);
    peer.send(test.bytes + Bytes(100, 0));
    const Recorder::SourceClosed end = nextSourceClosed();
    EXPECT_EQ(CloseReason::MALFORMED, end.reason);
    EXPECT_EQ(test.detail, end.detail);
    EXPECT_EQ(test.fault, faultOf(end.detail));
    EXPECT_EQ(LOCALHOST, end.address);
    EXPECT_NE(good_source, end.source);
    expectGoodPeerServed();
  }
  EXPECT_EQ(good_frames, receiver.said.frames.size());
}

TEST_F(SpTransport, EndsSourcesThatDoNotGreetInTime)
{
  const RawPeer silent(endpoint);
  const RawPeer hesitant(endpoint);
  hesitant.send(Bytes(PUSH_GREETING.begin(), PUSH_GREETING.end() - 1));
  const SteadyTime start = SteadyClock::now();
  for (int source = 0; source < 2; ++source)
  {
    const Recorder::SourceClosed end = nextSourceClosed();
    EXPECT_EQ(CloseReason::MALFORMED, end.reason);
    EXPECT_EQ(std::string(NO_GREETING_DETAIL) + " in time", end.detail);
  }
  EXPECT_GE(SteadyClock::now() - start, SP_GREETING_TIME - milliseconds(100));
  expectGoodPeerServed();
}

TEST_F(SpTransport, UnderstandsBytesThatComeOneByOne)
{
  std::mt19937 random(3);
  const Bytes payload = randomBytes(&random, 100);
  const RawPeer peer(endpoint);
  for (const uint8_t byte : PUSH_GREETING + frameOf(headerOf(1), payload) + frameOf(headerOf(2), {}))
  {
    ASSERT_TRUE(peer.send({byte}));
    loop.runOnce(milliseconds(0));
  }
  ASSERT_TRUE(runUntil(&loop, [&] { return receiver.said.countOf(2) == 1; }));
  ASSERT_EQ(1U, receiver.said.countOf(1));
  EXPECT_EQ(payload, receiver.said.frames[receiver.said.frames.size() - 2].payload);
  EXPECT_TRUE(receiver.said.sources_closed.empty());
}

TEST_F(SpTransport, UnderstandsPiecesOfAnySize)
{
  std::mt19937 random(4);
  Bytes bytes = PUSH_GREETING;
  std::vector<Bytes> payloads;
  for (uint32_t id = 0; id < 300; ++id)
  {
    payloads.push_back(randomBytes(&random, random() % (random() % 8 == 0 ? 40000 : 300)));
    bytes = std::move(bytes) + frameOf(headerOf(id), payloads.back());
  }
  const RawPeer peer(endpoint);
  for (size_t sent = 0; sent < bytes.size();)
  {
    const size_t most = 1 + random() % (random() % 4 == 0 ? 50000 : 100);
    const auto first = bytes.begin() + static_cast<std::ptrdiff_t>(sent);
    sent += peer.fill(Bytes(first, first + static_cast<std::ptrdiff_t>(std::min(most, bytes.size() - sent))));
    loop.runOnce(milliseconds(0));
  }
  ASSERT_TRUE(runUntil(&loop, [&] { return receiver.said.frames.size() == good_frames + payloads.size(); }));
  for (uint32_t id = 0; id < payloads.size(); ++id)
  {
    const Recorder::Frame& frame = receiver.said.frames[good_frames + id];
    ASSERT_EQ(id, frame.header.id);
    ASSERT_EQ(payloads[id], frame.payload) << id;
  }
}

TEST_F(SpTransport, DeliversNoFrameThatWasCutShort)
{
  const Bytes whole = PUSH_GREETING + frameOf(headerOf(1), Bytes(20, 1));
  for (size_t length = 0; length < whole.size(); ++length)
  {
    RawPeer peer(endpoint);
    ASSERT_TRUE(peer.send(Bytes(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(length))));
    peer.close();
    ASSERT_EQ(CloseReason::PEER_CLOSED, nextSourceClosed().reason) << length;
  }
  EXPECT_EQ(0U, receiver.said.countOf(1));
  expectGoodPeerServed();
}

TEST_F(SpTransport, SurvivesRandomBytes)
{
  std::mt19937 random(5);
  for (int round = 0; round < 300; ++round)
  {
    const Bytes garbage = randomBytes(&random, random() % 3000);
    RawPeer peer(endpoint);
    peer.send(round % 2 == 0 ? garbage : PUSH_GREETING + garbage);
    peer.close();
    nextSourceClosed();
    expectGoodPeerServed();
    ASSERT_FALSE(HasFatalFailure()) << round;
  }
  EXPECT_EQ(good_frames, receiver.said.frames.size());
}

TEST_F(SpTransport, SurvivesMutatedFrames)
{
  std::mt19937 random(6);
  for (int round = 0; round < 500; ++round)
  {
    Bytes bytes = PUSH_GREETING;
    for (uint32_t id = 0; id < 4; ++id)
    {
      bytes = bytes + frameOf(headerOf(id), randomBytes(&random, random() % 400));
    }
    for (uint32_t mutation = random() % 4; mutation != 0; --mutation)
    {
      const auto place = bytes.begin() + static_cast<std::ptrdiff_t>(random() % bytes.size());
      const auto end =
          place + std::min<std::ptrdiff_t>(bytes.end() - place, static_cast<std::ptrdiff_t>(random() % 50));
      switch (random() % 4)
      {
        case 0:
          *place = static_cast<uint8_t>(*place ^ 1U << random() % 8);
          break;
        case 1:
          *place = static_cast<uint8_t>(random());
          break;
        case 2:
          bytes.erase(place, end);
          break;
        default:
        {
          const Bytes again(place, end);
          bytes.insert(place, again.begin(), again.end());
        }
      }
    }
    RawPeer peer(endpoint);
    size_t sent = 0;
    while (sent < bytes.size())
    {
      const auto first = bytes.begin() + static_cast<std::ptrdiff_t>(sent);
      const size_t piece = std::min<size_t>(bytes.size() - sent, 1 + random() % 600);
      if (!peer.send(Bytes(first, first + static_cast<std::ptrdiff_t>(piece))))
      {
        break;  // it was noticed
      }
      sent += piece;
      loop.runOnce(milliseconds(0));
    }
    peer.close();
    nextSourceClosed();
    expectGoodPeerServed();
    ASSERT_FALSE(HasFatalFailure()) << round;
  }
}

TEST_F(SpTransport, HoldsOnlySoManySources)
{
  std::vector<RawPeer> peers;
  for (size_t peer = 1; peer < SP_MAX_SOURCES; ++peer)  // the good one is there already
  {
    peers.emplace_back(endpoint);
    peers.back().send(PUSH_GREETING);
    loop.runOnce(milliseconds(0));
  }
  ASSERT_TRUE(runUntil(&loop, [&] { return receiver.said.asked.size() == SP_MAX_SOURCES; }));
  const ConnectionId refused = sender.transport->connect(endpoint);
  const Recorder::SourceClosed end = nextSourceClosed();
  EXPECT_EQ(CloseReason::REFUSED, end.reason);
  EXPECT_EQ(TOO_MANY_DETAIL, end.detail);
  EXPECT_EQ(SourceFault::REFUSED, faultOf(end.detail));
  EXPECT_EQ(CloseReason::PEER_CLOSED, reasonOfEnd(refused));
  expectGoodPeerServed();

  peers.pop_back();
  nextSourceClosed();
  sender.transport->connect(endpoint);
  EXPECT_TRUE(runUntil(&loop, [&] { return sender.said.connected.size() == 2; }));
}

TEST_F(SpTransport, WaitsWhileDescriptorsAreLacking)
{
  rlimit limit;
  ASSERT_EQ(0, getrlimit(RLIMIT_NOFILE, &limit));
  const RawPeer peer(endpoint);
  peer.send(PUSH_GREETING + frameOf(headerOf(1), {}));
  const FileDescriptor next_free(dup(0));
  const rlimit none_left{static_cast<rlim_t>(next_free.get()), limit.rlim_max};
  ASSERT_EQ(0, setrlimit(RLIMIT_NOFILE, &none_left));
  const SteadyTime start = SteadyClock::now();
  int rounds = 0;
  for (; SteadyClock::now() < start + milliseconds(300); ++rounds)
  {
    loop.runOnce(ROUND);
  }
  EXPECT_EQ(1U, receiver.said.asked.size());
  ASSERT_EQ(0, setrlimit(RLIMIT_NOFILE, &limit));
  EXPECT_LT(rounds, 40) << "busy loop";
  EXPECT_TRUE(runUntil(&loop, [&] { return receiver.said.countOf(1) == 1; }));
}

TEST_F(SpTransport, LetsOthersHaveTheirTurn)
{
  const RawPeer greedy(endpoint);
  const int buffer_bytes = 8 << 20;
  setsockopt(greedy.fd(), SOL_SOCKET, SO_SNDBUF, &buffer_bytes, sizeof(buffer_bytes));
  receiver.said.on_payload = [](const FrameHeader&, const uint8_t*, uint32_t) {};
  ASSERT_TRUE(greedy.send(PUSH_GREETING));
  const Bytes frame = frameOf(headerOf(0), Bytes(MAX_PAYLOAD, 1));
  size_t sent = 0;
  const size_t before = receiver.said.payload_bytes;
  constexpr size_t MOST = (1U << 20) + 2 * MAX_PAYLOAD;
  for (int round = 0; round < 300; ++round)  // the kernel lets more wait as time goes on
  {
    for (size_t more = 1; more != 0; sent += more)
    {
      const auto rest = frame.begin() + static_cast<std::ptrdiff_t>(sent % frame.size());
      more = greedy.fill(Bytes(rest, frame.end()));
    }
    const size_t received = receiver.said.payload_bytes;
    loop.runOnce(ROUND);
    ASSERT_LT(receiver.said.payload_bytes - received, MOST);
  }
  EXPECT_GT(receiver.said.payload_bytes, before + 300 * MAX_PAYLOAD);
}

TEST_F(SpTransport, MayBeCalledFromItsOwnCallbacks)
{
  // Connections.
  sender.said.on_connected = [this](uint32_t id) { sender.transport->close(id); };
  ConnectionId second = sender.transport->connect(endpoint);
  ASSERT_TRUE(runUntil(&loop, [&] { return sender.said.connected.size() == 2; }));
  EXPECT_FALSE(sender.transport->writable(second));
  EXPECT_EQ(CloseReason::PEER_CLOSED, nextSourceClosed().reason);
  sender.said.on_connected = nullptr;

  const RawListener deaf(-1);
  second = sender.transport->connect(endpoint);
  sender.said.on_closed = [this, second](uint32_t id)
  {
    sender.transport->close(id);
    sender.transport->close(second);
    sender.transport->connect(endpoint);
  };
  sender.transport->connect(deaf.endpoint);
  ASSERT_TRUE(runUntil(&loop, [&] { return !sender.said.closed.empty() && sender.said.connected.back() > second; }));
  sender.said.on_closed = nullptr;
  second = sender.said.connected.back();

  sender.said.on_writable = [this](uint32_t id) { sender.transport->close(id); };
  const Bytes payload(MAX_PAYLOAD, 1);
  const iovec piece{const_cast<uint8_t*>(payload.data()), payload.size()};
  while (sender.transport->send(second, headerOf(0), &piece, 1))
  {
  }
  ASSERT_TRUE(runUntil(&loop, [&] { return !sender.said.writable.empty(); }));
  EXPECT_FALSE(sender.transport->writable(second));
  EXPECT_EQ(1U, sender.said.closed.size());
  sender.said.on_writable = nullptr;
  expectGoodPeerServed();
}

TEST_F(SpTransport, ASourceMayBeClosedFromItsOwnCallbacks)
{
  const Bytes bytes = PUSH_GREETING + frameOf(headerOf(1), Bytes(30, 1)) + frameOf(headerOf(2), Bytes(30, 2));
  const auto close_it = [this](uint32_t source)
  {
    if (source != good_source)
    {
      receiver.transport->closeSource(source);
    }
  };
  const auto isClosed = [](const RawPeer& peer)
  {
    uint8_t byte;
    ssize_t count;
    while ((count = recv(peer.fd(), &byte, 1, MSG_DONTWAIT)) > 0)
    {
    }
    return count == 0 || errno == ECONNRESET;
  };
  for (const Bytes& first :
       {frameOf(headerOf(3), Bytes(30, 3)), frameOf(headerOf(3), {}), frameOf(headerOf(receiver.said.refused_id), {3})})
  {
    const size_t headers = receiver.said.headers;
    receiver.said.on_header = close_it;
    const RawPeer peer(endpoint);
    ASSERT_TRUE(peer.send(PUSH_GREETING + first + frameOf(headerOf(3), {})));
    ASSERT_TRUE(runUntil(&loop, [&] { return isClosed(peer); }));
    EXPECT_EQ(headers + 1, receiver.said.headers);
    EXPECT_EQ(0U, receiver.said.countOf(3));
    receiver.said.on_header = nullptr;
  }
  const size_t headers = receiver.said.headers;
  {
    receiver.said.on_frame = close_it;
    const RawPeer peer(endpoint);
    ASSERT_TRUE(peer.send(bytes));
    ASSERT_TRUE(runUntil(&loop, [&] { return isClosed(peer); }));
    EXPECT_EQ(headers + 1, receiver.said.headers);
    EXPECT_EQ(1U, receiver.said.countOf(1));
    EXPECT_EQ(0U, receiver.said.countOf(2));
    receiver.said.on_frame = nullptr;
  }
  EXPECT_TRUE(receiver.said.sources_closed.empty());
  {
    receiver.said.on_source_closed = close_it;
    const RawPeer peer(endpoint);
    ASSERT_TRUE(peer.send(Bytes(8, 1)));
    nextSourceClosed();
    receiver.said.on_source_closed = nullptr;
  }
  {
    receiver.said.on_accept = [this](uint32_t) { receiver.transport->closeSource(good_source); };
    sender.said.on_closed = [this](uint32_t) { connection = sender.transport->connect(endpoint); };
    const RawPeer peer(endpoint);
    ASSERT_TRUE(runUntil(&loop, [&] { return !sender.said.closed.empty(); }));
    receiver.said.on_accept = nullptr;
    ASSERT_TRUE(runUntil(&loop, [&] { return sender.transport->writable(connection); }));
  }
  expectGoodPeerServed();
}

TEST_F(SpTransport, OneSourceMayEndAnotherOne)
{
  // Both have frames waiting when the round begins; whichever comes first ends the other.
  const RawPeer first(endpoint);
  const RawPeer second(endpoint);
  first.send(PUSH_GREETING + frameOf(headerOf(1), {}));
  second.send(PUSH_GREETING + frameOf(headerOf(1), {}));
  ASSERT_TRUE(runUntil(&loop, [&] { return receiver.said.countOf(1) == 2; }));
  std::vector<SourceId> sources;
  for (const Recorder::Frame& frame : receiver.said.frames)
  {
    if (frame.header.id == 1)
    {
      sources.push_back(frame.source);
    }
  }
  receiver.said.on_frame = [&](uint32_t source)
  { receiver.transport->closeSource(source == sources[0] ? sources[1] : sources[0]); };
  first.send(frameOf(headerOf(2), {}));
  second.send(frameOf(headerOf(2), {}));
  ASSERT_TRUE(runUntil(&loop, [&] { return receiver.said.countOf(2) == 1; }));
  loop.runOnce(ROUND);
  EXPECT_EQ(1U, receiver.said.countOf(2));
  receiver.said.on_frame = nullptr;
  expectGoodPeerServed();
}

TEST_F(SpTransport, MayEndWhileSomethingIsUnderWay)
{
  const RawListener full(0);
  const RawPeer waiting(full.endpoint);
  const RawPeer silent(endpoint);
  ASSERT_TRUE(runUntil(&loop, [&] { return receiver.said.asked.size() == 2; }));
  sender.transport->connect(full.endpoint);         // has a timer
  sender.transport->connect({"no.such.place", 1});  // is told later
  sender.transport.reset();
  receiver.transport.reset();
  const SteadyTime deadline = SteadyClock::now() + SP_CONNECT_TIME + milliseconds(100);
  while (SteadyClock::now() < deadline)
  {
    loop.runOnce(ROUND);
  }
  EXPECT_TRUE(sender.said.closed.empty());
  EXPECT_TRUE(receiver.said.sources_closed.empty());
}

TEST(NanomsgTransport, CountsWhatIsNoFrameAndGoesOn)
{
  EventLoop loop;
  Node receiver(makeNanomsgTransport, &loop);
  receiver.said.accept = false;
  const RawPeer peer(receiver.listen());
  FrameHeader other_version = headerOf(1);
  other_version.version = WIRE_VERSION + 1;
  peer.send(PUSH_GREETING + messageOf({}, 0) + messageOf(Bytes(40, 1), 40) + frameOf(other_version, {}) +
            frameOf(headerOf(receiver.said.refused_id), {1}) + frameOf(headerOf(1), {1, 2, 3}));
  ASSERT_TRUE(runUntil(&loop, [&] { return receiver.said.frames.size() == 1; }));
  EXPECT_EQ((Bytes{1, 2, 3}), receiver.said.frames[0].payload);
  EXPECT_EQ(0U, receiver.said.frames[0].source);
  EXPECT_EQ("", receiver.transport->addressOf(0));
  EXPECT_TRUE(receiver.said.asked.empty());
  std::vector<SourceFault> faults;
  for (const Recorder::SourceClosed& end : receiver.said.sources_closed)
  {
    EXPECT_EQ(0U, end.source);
    EXPECT_EQ(CloseReason::MALFORMED, end.reason);
    faults.push_back(faultOf(end.detail));
  }
  EXPECT_EQ((std::vector<SourceFault>{SourceFault::MALFORMED, SourceFault::MALFORMED, SourceFault::WRONG_VERSION,
                                      SourceFault::REFUSED}),
            faults);
}

TEST(NanomsgTransport, OutlivesOversizedFrames)
{
  EventLoop loop;
  Node receiver(makeNanomsgTransport, &loop);
  const Endpoint endpoint = receiver.listen();
  const RawPeer hostile(endpoint);
  hostile.send(PUSH_GREETING + messageOf({}, FrameHeader::BYTES + MAX_PAYLOAD + 1));
  const RawPeer good(endpoint);
  good.send(PUSH_GREETING + frameOf(headerOf(1), {}));
  ASSERT_TRUE(runUntil(&loop, [&] { return receiver.said.frames.size() == 1; }));
  uint8_t greeting[8];
  EXPECT_EQ(8, recv(hostile.fd(), greeting, sizeof(greeting), MSG_WAITALL));
  EXPECT_LE(recv(hostile.fd(), greeting, 1, 0), 0) << "libnanomsg still listens to it";
}

TEST(NanomsgTransport, SendsWhatWaitedForTheReceiver)
{
  EventLoop loop;
  Node sender(makeNanomsgTransport, &loop);
  const RawListener deaf(-1);
  const ConnectionId connection = sender.transport->connect(deaf.endpoint);
  ASSERT_TRUE(runUntil(&loop, [&] { return !sender.said.connected.empty(); }));
  ASSERT_TRUE(sender.transport->send(connection, headerOf(1)));
  EXPECT_FALSE(sender.transport->writable(connection));
  EXPECT_FALSE(sender.transport->send(connection, headerOf(2)));
  loop.runOnce(ROUND);
  EXPECT_TRUE(sender.said.writable.empty());
  ASSERT_EQ(0, listen(deaf.socket.get(), 1));
  const FileDescriptor accepted = deaf.accept();
  Bytes received(PUSH_GREETING.size());
  ASSERT_EQ(8, send(accepted.get(), PULL_GREETING.data(), PULL_GREETING.size(), MSG_NOSIGNAL));
  ASSERT_EQ(8, recv(accepted.get(), received.data(), received.size(), MSG_WAITALL));
  EXPECT_EQ(PUSH_GREETING, received);
  ASSERT_TRUE(runUntil(&loop, [&] { return sender.transport->writable(connection); }));
  EXPECT_EQ(std::vector<ConnectionId>{connection}, sender.said.writable);
  received.resize(frameOf(headerOf(1), {}).size());
  ASSERT_EQ(static_cast<ssize_t>(received.size()), recv(accepted.get(), received.data(), received.size(), MSG_WAITALL));
  EXPECT_EQ(frameOf(headerOf(1), {}), received);
}

TEST(NanomsgTransport, MayBeClosedFromItsOwnCallbacks)
{
  EventLoop loop;
  Node sender(makeNanomsgTransport, &loop);
  Node receiver(makeNanomsgTransport, &loop);
  const Endpoint endpoint = receiver.listen();
  sender.said.on_connected = [&](uint32_t id) { sender.transport->close(id); };
  sender.transport->connect(endpoint);
  ASSERT_TRUE(runUntil(&loop, [&] { return sender.said.connected.size() == 1; }));
  sender.said.on_connected = nullptr;

  const ConnectionId second = sender.transport->connect(endpoint);
  ASSERT_TRUE(runUntil(&loop, [&] { return sender.said.connected.size() == 2; }));
  sender.said.on_writable = [&](uint32_t id) { sender.transport->close(id); };
  const Bytes payload(MAX_PAYLOAD, 1);
  const iovec piece{const_cast<uint8_t*>(payload.data()), payload.size()};
  while (sender.transport->send(second, headerOf(0), &piece, 1))
  {
  }
  ASSERT_TRUE(runUntil(&loop, [&] { return !sender.said.writable.empty(); }));
  EXPECT_FALSE(sender.transport->writable(second));

  const ConnectionId third = sender.transport->connect(endpoint);
  sender.said.on_closed = [&](uint32_t) { sender.transport->close(third); };
  sender.transport->connect({"no.such.place", 1});
  ASSERT_TRUE(runUntil(&loop, [&] { return !sender.said.closed.empty(); }));
  EXPECT_FALSE(sender.transport->writable(third));
}

}  // namespace
}  // namespace pi_os_transport
