#include "bridge/tunnel.h"

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <functional>
#include <limits>
#include <memory>
#include <random>
#include <utility>
#include <vector>

#include "shm/ring_pair.h"
#include "wire/fake_frame_transport.h"

namespace pi_os_transport
{
namespace
{

using std::chrono::milliseconds;
using Frame = FakeFrameTransport::Frame;

constexpr uint32_t TUNNEL = 5;

/// A process that uses the tunnel: writes what it has, reads what comes.
struct Process
{
  void makePair(FileDescriptor* tunnel_end)
  {
    int ends[2];
    ASSERT_EQ(0, socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends));
    socket = FileDescriptor(ends[0]);
    *tunnel_end = FileDescriptor(ends[1]);
  }
  void work()
  {
    if (!socket)
    {
      return;
    }
    while (written < to_write.size())
    {
      const ssize_t count =
          send(socket.get(), to_write.data() + written, to_write.size() - written, MSG_DONTWAIT | MSG_NOSIGNAL);
      if (count <= 0)
      {
        break;
      }
      written += static_cast<size_t>(count);
    }
    uint8_t buffer[65536];
    while (reads && !ended)
    {
      const ssize_t count = recv(socket.get(), buffer, sizeof(buffer), MSG_DONTWAIT);
      if (count < 0 && errno == EAGAIN)
      {
        break;
      }
      ended = count <= 0;
      received.insert(received.end(), buffer, buffer + std::max<ssize_t>(count, 0));
    }
  }

  FileDescriptor socket;
  Bytes to_write;
  size_t written = 0;
  Bytes received;
  bool reads = true;
  bool ended = false;
};

class TunnelTest : public ::testing::Test
{
protected:
  void SetUp() override
  {
    ASSERT_NO_FATAL_FAILURE(wires_.meet());
    for (size_t side = 0; side < 2; ++side)
    {
      wires_.handlers[side] = [this, side](const FrameHeader& header, const Bytes& payload)
      { return onFrame(side, header, payload); };
      wires_.sides[side].on_interrupted = [this, side]()
      {
        if (tunnels_[side])
        {
          tunnels_[side]->rewind();
        }
      };
      wires_.sides[side].on_up = [this, side]()
      {
        if (tunnels_[side])
        {
          wires_.sides[side].peer->offer(tunnels_[side]);
        }
      };
    }
  }
  void TearDown() override
  {
    for (size_t side = 0; side < 2; ++side)
    {
      tunnels_[side].reset();
      wires_.sides[side].on_interrupted = nullptr;
    }
    loop_.runOnce(milliseconds(0));
  }

  void make(size_t side, FileDescriptor socket)
  {
    tunnels_[side] =
        std::make_shared<Tunnel>(&loop_, wires_.sides[side].peer.get(), TUNNEL,
                                 side == 0 ? Tunnel::Side::CLIENT : Tunnel::Side::SERVER, std::move(socket), "target",
                                 [this, side]()
                                 {
                                   ++closed_[side];
                                   tunnels_[side].reset();
                                 });
    tunnels_[side]->start();
  }
  void makeBoth()
  {
    for (size_t side = 0; side < 2; ++side)
    {
      FileDescriptor end;
      ASSERT_NO_FATAL_FAILURE(processes_[side].makePair(&end));
      make(side, std::move(end));
    }
    ASSERT_TRUE(turnUntil([this]() { return countOf(0, FrameType::TUNNEL_READY) == 1; }));
  }
  bool onFrame(size_t side, const FrameHeader& header, const Bytes& payload)
  {
    EXPECT_EQ(side == 0 ? TUNNEL | Tunnel::SERVER_BIT : TUNNEL, header.id);
    seen_[side].push_back(header);
    const std::shared_ptr<Tunnel> tunnel = tunnels_[side];
    if (!tunnel)
    {
      return true;
    }
    switch (header.type)
    {
      case FrameType::TUNNEL_DATA:
      {
        const auto bytes = std::make_unique<uint8_t[]>(payload.size());
        std::copy(payload.begin(), payload.end(), bytes.get());
        return tunnel->onData(header, bytes.get(), static_cast<uint32_t>(payload.size()));
      }
      case FrameType::TUNNEL_CREDIT:
        return tunnel->onCredit(header);
      case FrameType::TUNNEL_CLOSE:
        tunnel->onClose(header);
        return true;
      default:
        return header.type == FrameType::TUNNEL_READY;
    }
  }
  void turn(size_t frames = std::numeric_limits<size_t>::max())
  {
    for (Process& process : processes_)
    {
      process.work();
    }
    wires_.carry(frames);
    loop_.runOnce(milliseconds(0));
  }
  bool turnUntil(const std::function<bool()>& done)
  {
    return runUntil(&loop_,
                    [&]()
                    {
                      turn();
                      return done();
                    });
  }
  size_t countOf(size_t side, FrameType type) const
  {
    return static_cast<size_t>(std::count_if(seen_[side].begin(), seen_[side].end(),
                                             [type](const FrameHeader& header) { return header.type == type; }));
  }
  static FrameHeader dataHeader(uint64_t offset)
  {
    FrameHeader header;
    header.type = FrameType::TUNNEL_DATA;
    header.id = TUNNEL;
    header.offset = offset;
    return header;
  }

  EventLoop loop_;
  FakeLink wires_{&loop_};
  Process processes_[2];
  std::shared_ptr<Tunnel> tunnels_[2];
  size_t closed_[2] = {};
  std::vector<FrameHeader> seen_[2];  ///< what came to each side
};

TEST_F(TunnelTest, CarriesBothDirections)
{
  ASSERT_NO_FATAL_FAILURE(makeBoth());
  processes_[0].to_write = {1, 2, 3};
  ASSERT_TRUE(turnUntil([this]() { return processes_[1].received.size() == 3; }));
  processes_[1].to_write = {4, 5};
  ASSERT_TRUE(turnUntil([this]() { return processes_[0].received.size() == 2; }));
  EXPECT_EQ(processes_[0].to_write, processes_[1].received);
  EXPECT_EQ(processes_[1].to_write, processes_[0].received);
  EXPECT_EQ(3U, tunnels_[0]->sentBytes());
  EXPECT_EQ(3U, tunnels_[1]->receivedBytes());
  EXPECT_EQ(Traffic::EXPRESS, tunnels_[0]->traffic());
  EXPECT_STREQ("open", tunnels_[0]->state());
}

TEST_F(TunnelTest, CarriesMuchBothWaysOnceWhateverIsInterrupted)
{
  std::mt19937 random(99);
  for (FakeSession& side : wires_.sides)
  {
    side.transport.capacity = 3;
  }
  ASSERT_NO_FATAL_FAILURE(makeBoth());
  processes_[0].to_write = patternOf(1, 5 << 20);
  processes_[1].to_write = patternOf(2, 5 << 20);
  size_t interruptions = 0;
  const auto received = [this]() { return processes_[0].received.size() + processes_[1].received.size(); };
  for (size_t next = 1 << 20; next < 10 << 20; next += 1 << 20)
  {
    ASSERT_TRUE(runUntil(&loop_,
                         [&]()
                         {
                           turn(random() % 5 + 1);
                           return received() >= next;
                         }));
    ++interruptions;
    wires_.interrupt();
    ASSERT_NO_FATAL_FAILURE(wires_.meet());
  }
  ASSERT_TRUE(turnUntil([&]() { return received() >= 10 << 20; }));
  EXPECT_GE(interruptions, 9U);
  EXPECT_TRUE(processes_[0].to_write == processes_[1].received);
  EXPECT_TRUE(processes_[1].to_write == processes_[0].received);
  processes_[0].socket.reset();
  ASSERT_TRUE(turnUntil([this]() { return closed_[0] + closed_[1] == 2; }));
  EXPECT_EQ(5U << 20, processes_[1].received.size()) << "and no byte more";
}

TEST_F(TunnelTest, SwitchesBetweenExpressAndBulkWithoutMixingTheOrder)
{
  ASSERT_NO_FATAL_FAILURE(makeBoth());
  std::mt19937 random(3);
  for (int round = 0; round < 200; ++round)
  {
    const Bytes more = patternOf(static_cast<uint32_t>(round), random() % 4 == 0 ? 100000 : random() % 1000);
    processes_[0].to_write.insert(processes_[0].to_write.end(), more.begin(), more.end());
    turn(random() % 4);
  }
  ASSERT_TRUE(turnUntil([this]() { return processes_[1].received.size() >= processes_[0].to_write.size(); }));
  EXPECT_TRUE(processes_[0].to_write == processes_[1].received);
  size_t bulk = 0;
  for (const FrameHeader& header : seen_[1])
  {
    bulk += header.type == FrameType::TUNNEL_DATA && (header.lane & ~ACK_NOW) == 1 ? 1 : 0;
  }
  EXPECT_GT(bulk, 0U);
  EXPECT_LT(bulk, countOf(1, FrameType::TUNNEL_DATA));
}

TEST_F(TunnelTest, AReaderThatStopsHoldsUpTheWriter)
{
  ASSERT_NO_FATAL_FAILURE(makeBoth());
  processes_[0].to_write = patternOf(1, 10 << 20);
  processes_[1].reads = false;
  size_t before;
  do
  {
    before = processes_[0].written;
    for (int round = 0; round < 50; ++round)
    {
      turn();
      loop_.runOnce(milliseconds(1));
    }
  } while (processes_[0].written != before);
  EXPECT_LE(tunnels_[0]->sentBytes(), (4U << 20) + (1U << 20)) << "a window, and what the socket takes";
  EXPECT_LT(processes_[0].written, 6U << 20);
  processes_[1].reads = true;
  ASSERT_TRUE(turnUntil([this]() { return processes_[1].received.size() >= 10U << 20; }));
  EXPECT_TRUE(processes_[0].to_write == processes_[1].received);
}

TEST_F(TunnelTest, EndsWhenTheServerDoesAfterItsLastByte)
{
  ASSERT_NO_FATAL_FAILURE(makeBoth());
  wires_.sides[1].transport.capacity = 2;
  processes_[1].to_write = patternOf(1, 1 << 20);
  ASSERT_TRUE(turnUntil([this]() { return processes_[1].written == processes_[1].to_write.size(); }));
  processes_[1].socket.reset();
  ASSERT_TRUE(turnUntil([this]() { return closed_[0] + closed_[1] == 2; }));
  processes_[0].work();
  EXPECT_TRUE(processes_[0].received == processes_[1].to_write);
  EXPECT_TRUE(processes_[0].ended);
}

TEST_F(TunnelTest, EndsWhenTheClientDoes)
{
  ASSERT_NO_FATAL_FAILURE(makeBoth());
  processes_[0].to_write = {1, 2, 3};
  processes_[0].work();
  processes_[0].socket.reset();
  ASSERT_TRUE(turnUntil([this]() { return closed_[0] + closed_[1] == 2; }));
  processes_[1].work();
  EXPECT_EQ((Bytes{1, 2, 3}), processes_[1].received);
  EXPECT_TRUE(processes_[1].ended);
  EXPECT_EQ(1U, closed_[0]);
  EXPECT_EQ(1U, closed_[1]);
}

TEST_F(TunnelTest, EndsWhenBothEndAtOnce)
{
  ASSERT_NO_FATAL_FAILURE(makeBoth());
  processes_[0].socket.reset();
  processes_[1].socket.reset();
  ASSERT_TRUE(turnUntil([this]() { return closed_[0] + closed_[1] == 2; }));
}

TEST_F(TunnelTest, TheEndSurvivesAnInterruption)
{
  ASSERT_NO_FATAL_FAILURE(makeBoth());
  processes_[1].to_write = patternOf(1, 300000);
  wires_.sides[1].transport.capacity = 2;
  ASSERT_TRUE(runUntil(&loop_,
                       [this]()
                       {
                         turn(1);
                         return processes_[1].written == processes_[1].to_write.size();
                       }));
  processes_[1].socket.reset();
  turn(1);
  wires_.interrupt();
  ASSERT_NO_FATAL_FAILURE(wires_.meet());
  ASSERT_TRUE(turnUntil([this]() { return closed_[0] + closed_[1] == 2; }));
  processes_[0].work();
  EXPECT_TRUE(processes_[0].received == processes_[1].to_write);
}

TEST_F(TunnelTest, AServerThatRefusesClosesTheClient)
{
  FileDescriptor end;
  ASSERT_NO_FATAL_FAILURE(processes_[0].makePair(&end));
  make(0, std::move(end));
  // A port on which nobody listens: it is bound.
  const FileDescriptor deaf(socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0));
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  socklen_t length = sizeof(address);
  ASSERT_EQ(0, bind(deaf.get(), reinterpret_cast<const sockaddr*>(&address), length));
  ASSERT_EQ(0, getsockname(deaf.get(), reinterpret_cast<sockaddr*>(&address), &length));
  FileDescriptor client(socket(AF_INET, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0));
  ASSERT_EQ(-1, connect(client.get(), reinterpret_cast<const sockaddr*>(&address), length));
  ASSERT_EQ(EINPROGRESS, errno);
  make(1, std::move(client));
  EXPECT_STREQ("connecting", tunnels_[1]->state());
  processes_[0].to_write = {1, 2, 3};  // the client need not wait for the server
  ASSERT_TRUE(turnUntil([this]() { return closed_[0] + closed_[1] == 2; }));
  processes_[0].work();
  EXPECT_TRUE(processes_[0].ended);
  EXPECT_EQ(0U, countOf(0, FrameType::TUNNEL_READY));
}

TEST_F(TunnelTest, BytesMayComeBeforeTheServerIsConnected)
{
  FileDescriptor end;
  ASSERT_NO_FATAL_FAILURE(processes_[0].makePair(&end));
  make(0, std::move(end));
  const FileDescriptor listener(socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0));
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  socklen_t length = sizeof(address);
  ASSERT_EQ(0, bind(listener.get(), reinterpret_cast<const sockaddr*>(&address), length));
  ASSERT_EQ(0, listen(listener.get(), 1));
  ASSERT_EQ(0, getsockname(listener.get(), reinterpret_cast<sockaddr*>(&address), &length));
  FileDescriptor client(socket(AF_INET, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0));
  connect(client.get(), reinterpret_cast<const sockaddr*>(&address), length);
  make(1, std::move(client));
  const Bytes early{1, 2, 3};
  ASSERT_TRUE(tunnels_[1]->onData(dataHeader(0), early.data(), 3));
  processes_[1].socket = FileDescriptor(accept(listener.get(), nullptr, nullptr));
  ASSERT_TRUE(turnUntil([this]() { return processes_[1].received.size() == 3; }));
  EXPECT_EQ(early, processes_[1].received);
  EXPECT_EQ(1U, countOf(0, FrameType::TUNNEL_READY));
  EXPECT_STREQ("open", tunnels_[1]->state());
}

TEST_F(TunnelTest, RefusesBytesThatCannotBe)
{
  ASSERT_NO_FATAL_FAILURE(makeBoth());
  processes_[1].reads = false;
  const Bytes bytes(MAX_PAYLOAD, 7);
  EXPECT_FALSE(tunnels_[1]->onData(dataHeader(1), bytes.data(), 10)) << "the first byte is missing";
  EXPECT_FALSE(tunnels_[1]->onData(dataHeader(~uint64_t{0}), bytes.data(), 10));
  uint64_t sent = 0;
  while (tunnels_[1]->onData(dataHeader(sent), bytes.data(), MAX_PAYLOAD))
  {
    sent += MAX_PAYLOAD;
    ASSERT_LT(sent, 20U << 20) << "takes without end what nobody reads";
  }
  EXPECT_GE(sent, 1U << 20);
  EXPECT_EQ(sent, tunnels_[1]->receivedBytes());
}

TEST_F(TunnelTest, IgnoresWhatCameBefore)
{
  ASSERT_NO_FATAL_FAILURE(makeBoth());
  const Bytes bytes{0, 1, 2, 3, 4, 5, 6, 7};
  ASSERT_TRUE(tunnels_[1]->onData(dataHeader(0), bytes.data(), 4));
  ASSERT_TRUE(tunnels_[1]->onData(dataHeader(0), bytes.data(), 4));
  ASSERT_TRUE(tunnels_[1]->onData(dataHeader(2), bytes.data() + 2, 4));
  ASSERT_TRUE(tunnels_[1]->onData(dataHeader(0), bytes.data(), 8));
  processes_[1].work();
  EXPECT_EQ(bytes, processes_[1].received);
}

TEST_F(TunnelTest, RefusesCreditForWhatWasNotSentAndBytesAfterTheEnd)
{
  ASSERT_NO_FATAL_FAILURE(makeBoth());
  FrameHeader credit;
  credit.type = FrameType::TUNNEL_CREDIT;
  credit.offset = 1;
  EXPECT_FALSE(tunnels_[0]->onCredit(credit));
  credit.offset = ~uint64_t{0};
  EXPECT_FALSE(tunnels_[0]->onCredit(credit));
  FrameHeader close;
  close.type = FrameType::TUNNEL_CLOSE;
  close.offset = 3;
  tunnels_[1]->onClose(close);
  const Bytes bytes(4);
  EXPECT_STREQ("closing", tunnels_[1]->state());
  EXPECT_FALSE(tunnels_[1]->onData(dataHeader(0), bytes.data(), 4));
  EXPECT_TRUE(tunnels_[1]->onData(dataHeader(0), bytes.data(), 3));
  ASSERT_TRUE(turnUntil([this]() { return closed_[1] == 1; }));
}

TEST_F(TunnelTest, AbortEndsItHere)
{
  ASSERT_NO_FATAL_FAILURE(makeBoth());
  const std::shared_ptr<Tunnel> kept = tunnels_[0];
  kept->finish();
  kept->finish();
  loop_.runOnce(milliseconds(0));
  EXPECT_EQ(1U, closed_[0]);
  processes_[0].work();
  EXPECT_TRUE(processes_[0].ended);
  const Bytes bytes(4);
  kept->onData(dataHeader(0), bytes.data(), 4);  // came meanwhile
  FrameHeader close;
  kept->onClose(close);
  EXPECT_EQ(1U, closed_[0]);
}

}  // namespace
}  // namespace pi_os_transport
