#include <gtest/gtest.h>
#include <nanomsg/nn.h>
#include <nanomsg/reqrep.h>
#include <nanomsg/tcp.h>
#include <pi_node/test_support/message_of.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <memory>
#include <random>
#include <thread>

#include "wire/raw_socket.h"
#include "wire/sp_socket.h"

using namespace pi_offload;
using pi_node::test_support::messageOf;

namespace
{

using Bytes = std::vector<uint8_t>;

Bytes bytesOf(const std::string& text)
{
  return Bytes(text.begin(), text.end());
}

std::string textOf(const Bytes& bytes)
{
  return std::string(bytes.begin(), bytes.end());
}

Bytes message(const Bytes& body)
{
  Bytes all(8 + body.size());
  for (size_t byte = 0; byte < 8; ++byte)
  {
    all[7 - byte] = static_cast<uint8_t>(body.size() >> (8 * byte));
  }
  std::copy(body.begin(), body.end(), all.begin() + 8);
  return all;
}

const Bytes REQ_GREETING{0, 'S', 'P', 0, 0, 48, 0, 0};
const Bytes REP_GREETING{0, 'S', 'P', 0, 0, 49, 0, 0};

SpReplier::Options loopbackReplier()
{
  SpReplier::Options options;
  options.host = "127.0.0.1";
  return options;
}

SpRequester::Options requesterTo(uint16_t port)
{
  SpRequester::Options options;
  options.address = "127.0.0.1:" + std::to_string(port);
  options.reconnect_s = 0.01;
  options.max_reconnect_s = 0.05;
  return options;
}

/// A replier whose requests the test takes.
struct Node
{
  explicit Node(const SpReplier::Options& options = loopbackReplier())
  {
    SpReplier::Callbacks callbacks;
    callbacks.request = [this](const SpReplier::Peer& peer, Bytes body, int64_t) {
      requests.put({peer, std::move(body)});
    };
    callbacks.closed = [this](uint64_t connection, const std::string& reason) { closed.put({connection, reason}); };
    replier = std::make_unique<SpReplier>(options, callbacks);
  }
  Inbox<std::pair<SpReplier::Peer, Bytes>> requests;
  Inbox<std::pair<uint64_t, std::string>> closed;
  std::unique_ptr<SpReplier> replier;
};

/// A requester whose replies and link states the test takes.
struct Vehicle
{
  explicit Vehicle(const SpRequester::Options& options)
  {
    SpRequester::Callbacks callbacks;
    callbacks.reply = [this](uint32_t id, Bytes body, int64_t) { replies.put({id, std::move(body)}); };
    callbacks.link = [this](bool up, const std::string& reason) { links.put({up, reason}); };
    requester = std::make_unique<SpRequester>(options, callbacks);
  }
  void waitUntilUp()
  {
    while (!links.take().first)
    {
    }
  }
  Inbox<std::pair<uint32_t, Bytes>> replies;
  Inbox<std::pair<bool, std::string>> links;
  std::unique_ptr<SpRequester> requester;
};

}  // namespace

TEST(SpSocket, NamesTheOptionThatIsWrong)
{
  SpRequester::Options requester;
  const auto addressError = [&](const std::string& address)
  {
    requester.address = address;
    return messageOf<std::exception>([&] { requester.validate(); });
  };
  EXPECT_EQ(addressError("node:7000"), "");
  EXPECT_EQ(addressError("[::1]:7000"), "");
  EXPECT_EQ(addressError("node"), "requester/address = 'node': no port; must be host:port");
  EXPECT_EQ(addressError("node:0"), "requester/address = 'node:0': the port must be in [1, 65535]; must be host:port");
  EXPECT_NE(addressError("node:70000"), "");
  EXPECT_NE(addressError("node:7a"), "");
  EXPECT_NE(addressError(":7000").find("no host"), std::string::npos);
  EXPECT_NE(addressError("::1:7000").find("brackets"), std::string::npos);
  requester.address = "node:7000";
  requester.max_reconnect_s = 0.1;
  EXPECT_EQ(messageOf<std::exception>([&] { requester.validate(); }),
            "requester/max_reconnect_s = 0.1, must be in [0.2, 3600]");
  SpReplier::Options replier;
  EXPECT_EQ(messageOf<std::exception>([&] { replier.validate(); }), "");
  replier.idle_timeout_s = NAN;
  EXPECT_NE(messageOf<std::exception>([&] { replier.validate(); }).find("replier/idle_timeout_s"), std::string::npos);
}

TEST(SpSocket, SaysWhyItCannotListen)
{
  Node node;
  SpReplier::Options options = loopbackReplier();
  options.port = node.replier->port();
  EXPECT_EQ(messageOf<std::exception>([&] { Node other(options); }),
            "cannot listen on 127.0.0.1:" + std::to_string(options.port) + ": Address already in use");
  options.host = "no such name";
  EXPECT_NE(messageOf<std::exception>([&] { Node other(options); }).find("cannot resolve 'no such name'"),
            std::string::npos);
}

TEST(SpSocket, RequestsAreAnsweredInAnyOrder)
{
  Node node;
  Vehicle vehicle(requesterTo(node.replier->port()));
  vehicle.waitUntilUp();
  EXPECT_TRUE(vehicle.requester->connected());
  ASSERT_TRUE(vehicle.requester->send(1, bytesOf("one")));
  ASSERT_TRUE(vehicle.requester->send(0x7fffffff, bytesOf("two")));
  ASSERT_TRUE(vehicle.requester->send(0, {}));
  const auto one = node.requests.take();
  const auto two = node.requests.take();
  const auto three = node.requests.take();
  EXPECT_EQ(textOf(one.second), "one");
  EXPECT_EQ(textOf(two.second), "two");
  EXPECT_TRUE(three.second.empty());
  EXPECT_EQ(one.first.address.find("127.0.0.1:"), 0U);
  ASSERT_TRUE(node.replier->reply(two.first, bytesOf("second")));
  ASSERT_TRUE(node.replier->reply(three.first, {}));
  ASSERT_TRUE(node.replier->reply(one.first, bytesOf("first")));
  EXPECT_TRUE(node.replier->flush(PATIENCE_S));
  const auto a = vehicle.replies.take();
  const auto b = vehicle.replies.take();
  const auto c = vehicle.replies.take();
  EXPECT_EQ(a.first, 0x7fffffffU);
  EXPECT_EQ(textOf(a.second), "second");
  EXPECT_EQ(b.first, 0U);
  EXPECT_EQ(c.first, 1U);
  EXPECT_EQ(textOf(c.second), "first");
  EXPECT_THROW(vehicle.requester->send(0x80000000U, {}), std::invalid_argument);
}

TEST(SpSocket, LargeMessagesArriveWhole)
{
  SpReplier::Options node_options = loopbackReplier();
  node_options.max_queued_bytes = 8U << 20U;
  Node node(node_options);
  SpRequester::Options options = requesterTo(node.replier->port());
  options.max_queued_bytes = 64U << 20U;
  options.max_message_bytes = 8U << 20U;
  Vehicle vehicle(options);
  vehicle.waitUntilUp();
  std::mt19937 random(2);
  for (const size_t size : {size_t{1}, size_t{65535}, size_t{65536}, size_t{6220800}, size_t{5000001}})
  {
    Bytes body(size);
    for (uint8_t& byte : body)
    {
      byte = static_cast<uint8_t>(random());
    }
    ASSERT_TRUE(vehicle.requester->send(5, body));
    const auto request = node.requests.take();
    ASSERT_EQ(request.second, body);
    ASSERT_TRUE(node.replier->reply(request.first, body));
    ASSERT_EQ(vehicle.replies.take().second, body);
  }
}

TEST(SpSocket, AMessageTooLargeForTheQueueIsNotSent)
{
  Node node;
  SpRequester::Options options = requesterTo(node.replier->port());
  options.max_queued_bytes = 10000;
  Vehicle vehicle(options);
  EXPECT_FALSE(vehicle.requester->connected() && vehicle.requester->send(1, Bytes(20000)));
  vehicle.waitUntilUp();
  EXPECT_FALSE(vehicle.requester->send(1, Bytes(20000)));
  EXPECT_TRUE(vehicle.requester->send(2, Bytes(9000)));
  EXPECT_EQ(node.requests.take().second.size(), 9000U);
}

TEST(SpSocket, WithoutAConnectionNothingIsSentAndTheReasonIsTold)
{
  uint16_t port = 0;
  {
    RawSocket listener = RawSocket::listenOn(&port);  // a port that nobody has
  }
  Vehicle vehicle(requesterTo(port));
  const auto link = vehicle.links.take();
  EXPECT_FALSE(link.first);
  EXPECT_EQ(link.second, "127.0.0.1:" + std::to_string(port) + ": Connection refused");
  EXPECT_FALSE(vehicle.requester->connected());
  EXPECT_FALSE(vehicle.requester->send(1, {}));
  // Somebody comes: it connects by itself.
  SpReplier::Options options = loopbackReplier();
  options.port = port;
  Node node(options);
  vehicle.waitUntilUp();
  EXPECT_TRUE(vehicle.requester->send(1, bytesOf("x")));
  EXPECT_EQ(textOf(node.requests.take().second), "x");
}

TEST(SpSocket, AnUnknownNameIsAReason)
{
  SpRequester::Options options = requesterTo(1);
  options.address = "no-such-host.invalid:7000";
  Vehicle vehicle(options);
  const auto link = vehicle.links.take();
  EXPECT_FALSE(link.first);
  EXPECT_NE(link.second.find("cannot resolve 'no-such-host.invalid'"), std::string::npos) << link.second;
}

TEST(SpSocket, ItConnectsAgainWhenTheNodeComesBack)
{
  auto node = std::make_unique<Node>();
  const uint16_t port = node->replier->port();
  Vehicle vehicle(requesterTo(port));
  for (int round = 0; round < 10; ++round)
  {
    vehicle.waitUntilUp();
    ASSERT_TRUE(vehicle.requester->send(1, bytesOf("x")));
    node->requests.take();
    node.reset();
    EXPECT_FALSE(vehicle.links.take().first);
    SpReplier::Options options = loopbackReplier();
    options.port = port;
    node = std::make_unique<Node>(options);
  }
}

TEST(SpSocket, ReconnectThrowsAwayWhatIsUnderWay)
{
  Node node;
  Vehicle vehicle(requesterTo(node.replier->port()));
  vehicle.waitUntilUp();
  ASSERT_TRUE(vehicle.requester->send(1, bytesOf("old")));
  const auto old = node.requests.take();
  vehicle.requester->reconnect("nobody answers");
  EXPECT_FALSE(vehicle.requester->send(2, bytesOf("no")));
  const auto link = vehicle.links.take();
  EXPECT_FALSE(link.first);
  EXPECT_EQ(link.second, "nobody answers");
  EXPECT_EQ(node.closed.take().first, old.first.connection);
  EXPECT_FALSE(node.replier->reply(old.first, bytesOf("too late")));
  vehicle.waitUntilUp();
  ASSERT_TRUE(vehicle.requester->send(3, bytesOf("new")));
  const auto fresh = node.requests.take();
  EXPECT_EQ(textOf(fresh.second), "new");
  EXPECT_NE(fresh.first.connection, old.first.connection);
  ASSERT_TRUE(node.replier->reply(fresh.first, bytesOf("answer")));
  EXPECT_EQ(vehicle.replies.take().first, 3U);
  EXPECT_EQ(vehicle.replies.size(), 0U);
}

TEST(SpSocket, TheVehicleSurvivesWhatIsNoNode)
{
  uint16_t port = 0;
  RawSocket listener = RawSocket::listenOn(&port);
  SpRequester::Options options = requesterTo(port);
  options.max_message_bytes = 1000;
  options.connect_timeout_s = 0.1;
  Vehicle vehicle(options);
  const auto expectLost = [&](const std::string& part)
  {
    for (std::pair<bool, std::string> link = vehicle.links.take();; link = vehicle.links.take())
    {
      if (!link.first && link.second.find(part) != std::string::npos)
      {
        return;
      }
    }
  };
  {
    RawSocket peer = listener.accept();
    EXPECT_EQ(peer.read(8), REQ_GREETING);
    peer.write("HTTP/1.1 400 Bad Request\r\n\r\n");
    expectLost("not an SP REP socket");
    EXPECT_TRUE(peer.closes());
  }
  {
    RawSocket peer = listener.accept();  // says nothing
    expectLost("does not speak SP");
  }
  const std::vector<std::pair<Bytes, std::string>> faults = {
      {{0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff}, "a message of 18446744073709551615 bytes, at most 1000"},
      {message({1, 2}), "without the number"},
      {message({0, 0, 0, 1, 0x80, 0, 0, 1}), "without the number"},
  };
  for (const auto& fault : faults)
  {
    RawSocket peer = listener.accept();
    peer.write(REP_GREETING);
    peer.write(fault.first);
    expectLost(fault.second);
    EXPECT_TRUE(peer.closes());
  }
  // After all that it takes an honest one.
  RawSocket peer = listener.accept();
  peer.write(REP_GREETING);
  vehicle.waitUntilUp();
  ASSERT_TRUE(vehicle.requester->send(7, bytesOf("hello")));
  EXPECT_EQ(peer.read(8), REQ_GREETING);
  EXPECT_EQ(peer.read(8 + 4 + 5), message({0x80, 0, 0, 7, 'h', 'e', 'l', 'l', 'o'}));
  peer.write(message({0x80, 0, 0, 7, 'y'}));
  EXPECT_EQ(textOf(vehicle.replies.take().second), "y");
}

TEST(SpSocket, TheNodeClosesWhatIsNoVehicle)
{
  SpReplier::Options options = loopbackReplier();
  options.handshake_timeout_s = 0.1;
  options.max_message_bytes = 1000;
  Node node(options);
  {
    RawSocket peer = RawSocket::connectTo(node.replier->port());
    EXPECT_EQ(peer.read(8), REP_GREETING);
    peer.write("GET / HTTP/1.0\r\n\r\n");
    EXPECT_TRUE(peer.closes());
  }
  {
    RawSocket silent = RawSocket::connectTo(node.replier->port());
    EXPECT_TRUE(silent.closes());
  }
  {
    RawSocket publisher = RawSocket::connectTo(node.replier->port());
    publisher.write(Bytes{0, 'S', 'P', 0, 0, 32, 0, 0});
    EXPECT_TRUE(publisher.closes());
  }
  const Bytes no_end(4 * 20, 0);
  for (const Bytes& fault :
       {Bytes{0x7f, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff}, message({1, 2, 3}), message({}), message(no_end)})
  {
    RawSocket peer = RawSocket::connectTo(node.replier->port());
    peer.write(REQ_GREETING);
    peer.write(fault);
    EXPECT_TRUE(peer.closes());
    EXPECT_NE(node.closed.take().second, "");
  }
  EXPECT_EQ(node.requests.size(), 0U);
  Vehicle vehicle(requesterTo(node.replier->port()));
  vehicle.waitUntilUp();
  ASSERT_TRUE(vehicle.requester->send(1, bytesOf("x")));
  node.requests.take();
}

TEST(SpSocket, ConnectionsWithoutRequestsAreClosed)
{
  SpReplier::Options options = loopbackReplier();
  options.idle_timeout_s = 0.05;
  Node node(options);
  Vehicle vehicle(requesterTo(node.replier->port()));
  vehicle.waitUntilUp();
  EXPECT_EQ(node.closed.take().second, "no request for too long");
  EXPECT_FALSE(vehicle.links.take().first);
}

TEST(SpSocket, ConnectionsBeyondTheLimitAreClosed)
{
  SpReplier::Options options = loopbackReplier();
  options.max_connections = 2;
  Node node(options);
  Vehicle a(requesterTo(node.replier->port()));
  a.waitUntilUp();
  Vehicle b(requesterTo(node.replier->port()));
  b.waitUntilUp();
  EXPECT_EQ(node.replier->connections(), 2U);
  RawSocket third = RawSocket::connectTo(node.replier->port());
  EXPECT_TRUE(third.closes());
  ASSERT_TRUE(a.requester->send(1, {}));
  node.requests.take();
}

TEST(SpSocket, WhoDoesNotReadItsRepliesIsClosed)
{
  SpReplier::Options options = loopbackReplier();
  options.max_queued_bytes = 100000;
  Node node(options);
  RawSocket peer = RawSocket::connectTo(node.replier->port());
  peer.write(REQ_GREETING);
  peer.write(message({0x80, 0, 0, 1}));
  const SpReplier::Peer to = node.requests.take().first;
  int taken = 0;
  while (taken < 100000 && node.replier->reply(to, Bytes(50000)))
  {
    ++taken;
  }
  EXPECT_LT(taken, 100000);
  EXPECT_EQ(node.closed.take().second, "it does not read its replies");
  EXPECT_FALSE(node.replier->reply(to, {}));
}

TEST(SpSocket, WhatIsBeingReceivedIsBoundedOverAllConnections)
{
  SpReplier::Options options = loopbackReplier();
  options.max_message_bytes = 1U << 20U;
  options.max_receiving_bytes = 2U << 20U;
  Node node(options);
  std::vector<RawSocket> peers;
  Bytes part = message(Bytes(1U << 20U));
  part.resize(part.size() - 1);  // never whole
  for (int count = 0; count < 5; ++count)
  {
    peers.push_back(RawSocket::connectTo(node.replier->port()));
    peers.back().write(REQ_GREETING);
    peers.back().write(part);
  }
  EXPECT_EQ(node.closed.take().second, "too much is being received on all connections");
  EXPECT_EQ(node.closed.take().second, "too much is being received on all connections");
  EXPECT_EQ(node.closed.take().second, "too much is being received on all connections");
}

TEST(SpSocket, ClosingAConnectionTellsBothEnds)
{
  Node node;
  Vehicle vehicle(requesterTo(node.replier->port()));
  vehicle.waitUntilUp();
  ASSERT_TRUE(vehicle.requester->send(1, {}));
  const auto request = node.requests.take();
  node.replier->close(request.first.connection, "a bad one");
  EXPECT_EQ(node.closed.take(), std::make_pair(request.first.connection, std::string("a bad one")));
  EXPECT_FALSE(vehicle.links.take().first);
  vehicle.waitUntilUp();
}

TEST(SpSocket, AFailingHandlerClosesTheConnectionNotTheProcess)
{
  SpReplier::Callbacks callbacks;
  Inbox<std::string> closed;
  callbacks.request = [](const SpReplier::Peer&, Bytes, int64_t) { throw std::runtime_error("out of coffee"); };
  callbacks.closed = [&](uint64_t, const std::string& reason) { closed.put(reason); };
  SpReplier replier(loopbackReplier(), callbacks);
  Vehicle vehicle(requesterTo(replier.port()));
  vehicle.waitUntilUp();
  vehicle.requester->send(1, {});
  EXPECT_EQ(closed.take(), "the handler of a request failed: out of coffee");
}

TEST(SpSocket, RandomBytesNeverEndTheNode)
{
  SpReplier::Options options = loopbackReplier();
  options.max_message_bytes = 4096;
  options.handshake_timeout_s = 5.0;
  std::atomic<size_t> received{0};
  SpReplier::Callbacks callbacks;
  SpReplier* to = nullptr;
  callbacks.request = [&](const SpReplier::Peer& peer, Bytes body, int64_t)
  {
    ++received;
    to->reply(peer, body);
  };
  SpReplier replier(options, callbacks);
  to = &replier;
  std::mt19937 random(11);
  size_t whole = 0;
  for (int round = 0; round < 400; ++round)
  {
    RawSocket peer = RawSocket::connectTo(replier.port());
    bool alive = round % 5 != 0 ? peer.write(REQ_GREETING) : true;
    for (unsigned count = random() % 20; count > 0 && alive; --count)
    {
      Bytes bytes(random() % 200);
      for (uint8_t& byte : bytes)
      {
        byte = static_cast<uint8_t>(random());
      }
      if (random() % 3 != 0)
      {
        if (bytes.size() >= 4)
        {
          bytes[0] |= 0x80U;
          ++whole;
        }
        bytes = message(bytes);
        if (random() % 8 == 0)
        {
          bytes[random() % 8] = static_cast<uint8_t>(random());
        }
      }
      alive = peer.write(bytes);
    }
  }
  EXPECT_GT(whole, 500U);
  Vehicle vehicle(requesterTo(replier.port()));
  vehicle.waitUntilUp();
  ASSERT_TRUE(vehicle.requester->send(9, bytesOf("still there")));
  EXPECT_EQ(textOf(vehicle.replies.take().second), "still there");
  EXPECT_GT(received.load(), 100U);
}

TEST(SpSocket, ManyVehiclesAtOnceEachGetTheirAnswers)
{
  SpReplier::Callbacks callbacks;
  SpReplier* to = nullptr;
  callbacks.request = [&](const SpReplier::Peer& peer, Bytes body, int64_t) { to->reply(peer, body); };
  SpReplier replier(loopbackReplier(), callbacks);
  to = &replier;
  std::vector<std::unique_ptr<Vehicle>> vehicles;
  for (int count = 0; count < 20; ++count)
  {
    vehicles.push_back(std::make_unique<Vehicle>(requesterTo(replier.port())));
  }
  for (auto& vehicle : vehicles)
  {
    vehicle->waitUntilUp();
  }
  for (uint32_t id = 0; id < 50; ++id)
  {
    for (size_t index = 0; index < vehicles.size(); ++index)
    {
      ASSERT_TRUE(vehicles[index]->requester->send(id, bytesOf(std::to_string(index) + " " + std::to_string(id))));
    }
  }
  for (size_t index = 0; index < vehicles.size(); ++index)
  {
    for (uint32_t id = 0; id < 50; ++id)
    {
      const auto reply = vehicles[index]->replies.take();
      EXPECT_EQ(reply.first, id);
      EXPECT_EQ(textOf(reply.second), std::to_string(index) + " " + std::to_string(id));
    }
  }
}

TEST(SpSocket, ANanomsgReqIsAnswered)
{
  Node node;
  const int socket = nn_socket(AF_SP, NN_REQ);
  ASSERT_GE(socket, 0);
  int patience_ms = static_cast<int>(PATIENCE_S * 1e3);
  nn_setsockopt(socket, NN_SOL_SOCKET, NN_RCVTIMEO, &patience_ms, sizeof(patience_ms));
  ASSERT_GE(nn_connect(socket, ("tcp://127.0.0.1:" + std::to_string(node.replier->port())).c_str()), 0);
  for (int round = 0; round < 20; ++round)
  {
    const std::string text = "request " + std::to_string(round);
    ASSERT_EQ(nn_send(socket, text.data(), text.size(), 0), static_cast<int>(text.size()));
    const auto request = node.requests.take();
    EXPECT_EQ(textOf(request.second), text);
    EXPECT_EQ(request.first.route.size(), 1U);
    ASSERT_TRUE(node.replier->reply(request.first, bytesOf("reply " + std::to_string(round))));
    char answer[100];
    const int count = nn_recv(socket, answer, sizeof(answer), 0);
    ASSERT_GT(count, 0) << nn_strerror(nn_errno());
    EXPECT_EQ(std::string(answer, static_cast<size_t>(count)), "reply " + std::to_string(round));
  }
  nn_close(socket);
  EXPECT_NE(node.closed.take().second, "");
}

TEST(SpSocket, ANanomsgRepAnswers)
{
  uint16_t port = 0;
  {
    RawSocket free = RawSocket::listenOn(&port);
  }
  const int socket = nn_socket(AF_SP, NN_REP);
  ASSERT_GE(socket, 0);
  int patience_ms = static_cast<int>(PATIENCE_S * 1e3);
  nn_setsockopt(socket, NN_SOL_SOCKET, NN_RCVTIMEO, &patience_ms, sizeof(patience_ms));
  ASSERT_GE(nn_bind(socket, ("tcp://127.0.0.1:" + std::to_string(port)).c_str()), 0);
  Vehicle vehicle(requesterTo(port));
  vehicle.waitUntilUp();
  for (uint32_t round = 0; round < 20; ++round)
  {
    const std::string text = "request " + std::to_string(round);
    ASSERT_TRUE(vehicle.requester->send(1000 + round, bytesOf(text)));
    char request[100];
    const int count = nn_recv(socket, request, sizeof(request), 0);
    ASSERT_EQ(std::string(request, static_cast<size_t>(std::max(count, 0))), text);
    ASSERT_GE(nn_send(socket, "done", 4, 0), 0);
    const auto reply = vehicle.replies.take();
    EXPECT_EQ(reply.first, 1000 + round);
    EXPECT_EQ(textOf(reply.second), "done");
  }
  nn_close(socket);
  EXPECT_FALSE(vehicle.links.take().first);
}

TEST(SpSocket, ThroughANanomsgDeviceRepliesFindTheirWay)
{
  // A device puts another number before the request: the stack is two deep.
  Node node;
  RawSocket peer = RawSocket::connectTo(node.replier->port());
  peer.write(REQ_GREETING);
  peer.write(message({0, 0, 0, 5, 0x80, 0, 0, 9, 'q'}));
  const auto request = node.requests.take();
  EXPECT_EQ(textOf(request.second), "q");
  ASSERT_TRUE(node.replier->reply(request.first, bytesOf("a")));
  EXPECT_EQ(peer.read(8), REP_GREETING);
  EXPECT_EQ(peer.read(8 + 9), message({0, 0, 0, 5, 0x80, 0, 0, 9, 'a'}));
}
