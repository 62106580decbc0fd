// SpTransport inside TLS: frames arrive as without it, and whoever cannot prove an identity gets nothing but the
// reason.

#include <gtest/gtest.h>
#include <openssl/err.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <functional>
#include <memory>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include "event_loop/event_loop.h"
#include "wire/ipv4.h"
#include "wire/sp_transport.h"
#include "wire/tls_keys_folder.h"

namespace pi_os_transport
{
namespace
{

using std::chrono::milliseconds;
using Bytes = std::vector<uint8_t>;

constexpr std::chrono::seconds DEADLINE{60};
constexpr char LOCALHOST[] = "127.0.0.1";
constexpr char OTHER[] = "127.0.0.2";

/// One bridge's end: a transport and what it said.
class End : public FrameTransport::Listener
{
public:
  /// @param keys  null: not protected
  End(EventLoop* loop, const TestKeysFolder* keys)
    : transport(keys != nullptr ? makeProtectedTransport(loop, this, std::make_shared<const TlsKeys>(keys->path()))
                                : makeSpTransport(loop, this))
  {
    std::string error;
    EXPECT_TRUE(transport->listen({"0.0.0.0", 0}, &error)) << error;
  }

  void onConnected(FrameTransport::ConnectionId) override { ++connected; }
  void onWritable(FrameTransport::ConnectionId) override { ++writable; }
  void onClosed(FrameTransport::ConnectionId, CloseReason reason) override { closed.push_back(reason); }
  bool onAccept(const std::string&) override { return true; }
  uint8_t* onHeader(FrameTransport::SourceId source, const FrameHeader&, uint32_t length) override
  {
    Bytes& place = places[source];
    place.resize(std::max<size_t>(length, 1));
    return place.data();
  }
  void onFrame(FrameTransport::SourceId source, const FrameHeader& header, uint8_t* payload, uint32_t length) override
  {
    sender = transport->identityOf(source);
    ids.push_back(header.id);
    received.emplace_back(payload, payload + length);
  }
  void onSourceClosed(FrameTransport::SourceId, CloseReason reason, const std::string&) override
  {
    sources_closed.push_back(reason);
  }
  Verdict onIdentity(const Endpoint& at, const std::string& identity) override
  {
    (at.port != 0 ? met : visitors).push_back(identity);
    return identity == refused ? Verdict{"\"" + identity + "\" is not in trust", is_revoked} : Verdict{};
  }
  void onUntrusted(const Endpoint& at, const std::string& reason) override
  {
    (at.port != 0 ? refusals_out : refusals_in).push_back(reason);
  }

  std::string refused;
  bool is_revoked = false;
  size_t connected = 0;
  size_t writable = 0;
  std::vector<CloseReason> closed;
  std::vector<CloseReason> sources_closed;
  std::map<FrameTransport::SourceId, Bytes> places;
  std::vector<uint32_t> ids;
  std::vector<Bytes> received;
  std::string sender;
  std::vector<std::string> met;
  std::vector<std::string> visitors;
  std::vector<std::string> refusals_out;
  std::vector<std::string> refusals_in;
  std::unique_ptr<FrameTransport> transport;
};

class ProtectedTransport : public testing::Test
{
protected:
  ProtectedTransport() : fleet_(makeTestAuthority()) {}

  bool runUntil(const std::function<bool()>& done)
  {
    const SteadyTime deadline = SteadyClock::now() + DEADLINE;
    while (!done() && SteadyClock::now() < deadline)
    {
      loop_.runOnce(milliseconds(20));
    }
    return done();
  }

  /// Lets `client` connect to `server`. Neither must get a connection, and both the reason.
  void expectRefused(End* client, End* server, const std::string& at_client, const std::string& at_server)
  {
    client->transport->connect({LOCALHOST, server->transport->port()});
    EXPECT_TRUE(runUntil([&] { return !client->closed.empty() && !server->sources_closed.empty(); }));
    EXPECT_EQ(0U, client->connected);
    EXPECT_EQ(0U, server->received.size());
    ASSERT_EQ(1U, client->refusals_out.size());
    ASSERT_EQ(1U, server->refusals_in.size());
    EXPECT_NE(std::string::npos, client->refusals_out[0].find(at_client)) << client->refusals_out[0];
    EXPECT_NE(std::string::npos, server->refusals_in[0].find(at_server)) << server->refusals_in[0];
    EXPECT_EQ(CloseReason::UNTRUSTED, client->closed[0]);
  }
  /// The same with the roles of the two exchanged; `at_good` and `at_bad` are the reasons at either end.
  void expectRefusedBothWays(const TestKeysFolder& good, const TestKeysFolder& bad, const std::string& at_good,
                             const std::string& at_bad)
  {
    {
      SCOPED_TRACE("the bad one connects");
      End client(&loop_, &bad);
      End server(&loop_, &good);
      expectRefused(&client, &server, at_bad, at_good);
    }
    SCOPED_TRACE("the bad one is connected to");
    End client(&loop_, &good);
    End server(&loop_, &bad);
    expectRefused(&client, &server, at_good, at_bad);
  }

  EventLoop loop_;
  TestAuthority fleet_;
};

size_t openDescriptors()
{
  return static_cast<size_t>(std::distance(std::filesystem::directory_iterator("/proc/self/fd"), {}));
}

TEST_F(ProtectedTransport, FramesOfAllSizesArriveInOrder)
{
  TestKeysFolder keys;
  TestKeysFolder other_keys;
  End server(&loop_, &keys.device("vehicle", &fleet_, fleet_));
  End client(&loop_, &other_keys.device("edge", &fleet_, fleet_));
  const auto connection = client.transport->connect({LOCALHOST, server.transport->port()});
  ASSERT_TRUE(runUntil([&] { return client.connected == 1; }));
  EXPECT_EQ(std::vector<std::string>{"vehicle"}, client.met);
  EXPECT_EQ(std::vector<std::string>{"edge"}, server.visitors);
  std::mt19937 random(7);
  std::vector<Bytes> sent;
  const std::vector<size_t> sizes{0, 1, 100, 16343, 16344, 16345, 16384, 40000, 131072, MAX_PAYLOAD, 5, 0, MAX_PAYLOAD};
  for (int round = 0; round < 20; ++round)
  {
    for (const size_t size : sizes)
    {
      Bytes payload(size);
      std::generate(payload.begin(), payload.end(), [&random] { return static_cast<uint8_t>(random()); });
      sent.push_back(std::move(payload));
    }
  }
  for (size_t i = 0; i < sent.size(); ++i)
  {
    const size_t first = sent[i].size() / 3;
    const std::array<iovec, 2> pieces{{{sent[i].data(), first}, {sent[i].data() + first, sent[i].size() - first}}};
    ASSERT_TRUE(runUntil([&] { return client.transport->writable(connection); }));
    ASSERT_TRUE(client.transport->send(connection, FrameHeader::of(FrameType::MESSAGE, static_cast<uint32_t>(i)),
                                       pieces.data(), sent[i].empty() ? 0 : 2, i % 3 == 0));
  }
  ASSERT_TRUE(runUntil([&] { return server.received.size() == sent.size(); }));
  EXPECT_EQ(sent, server.received);
  EXPECT_TRUE(std::is_sorted(server.ids.begin(), server.ids.end()));
  EXPECT_EQ("edge", server.sender);
}

TEST_F(ProtectedTransport, SharedKeysProveTheirId)
{
  const std::string first = "fleet " + std::string(64, 'a') + "\n";
  const std::string second = "old " + std::string(64, 'b') + "\n";
  TestKeysFolder keys;
  TestKeysFolder other_keys;
  End server(&loop_, &keys.shared(first + second));
  End client(&loop_, &other_keys.shared("# comment\n" + second));
  client.transport->connect({LOCALHOST, server.transport->port()});
  ASSERT_TRUE(runUntil([&] { return client.connected == 1; }));
  EXPECT_EQ(std::vector<std::string>{"old"}, server.visitors);
}

TEST_F(ProtectedTransport, ExpiredCertificate)
{
  TestKeysFolder good;
  TestKeysFolder bad;
  expectRefusedBothWays(good.device("good", &fleet_, fleet_), bad.device("bad", &fleet_, fleet_, {-7200, -3600}),
                        "certificate has expired", "the certificate of this device has expired");
}

TEST_F(ProtectedTransport, CertificateThatIsNotYetValid)
{
  TestKeysFolder good;
  TestKeysFolder bad;
  expectRefusedBothWays(good.device("good", &fleet_, fleet_), bad.device("bad", &fleet_, fleet_, {3600, 7200}),
                        "certificate is not yet valid", "refused by the other bridge: it does not accept this device");
}

TEST_F(ProtectedTransport, CertificateOfAnotherAuthority)
{
  const TestAuthority other = makeTestAuthority();
  TestKeysFolder good;
  TestKeysFolder bad;
  good.device("good", &fleet_, fleet_);
  bad.device("bad", &other, fleet_);  // accepts the fleet's
  expectRefusedBothWays(good, bad, "its certificate is not accepted", "refused by the other bridge");
}

TEST_F(ProtectedTransport, SelfSignedCertificate)
{
  TestKeysFolder good;
  TestKeysFolder bad;
  expectRefusedBothWays(good.device("good", &fleet_, fleet_), bad.device("bad", nullptr, fleet_),
                        "its certificate is not accepted: self-signed certificate",
                        "the certificate of this device is not of its fleet's authority");
}

TEST_F(ProtectedTransport, NameThatIsNotAllowedOrRevoked)
{
  TestKeysFolder good;
  TestKeysFolder bad;
  good.device("good", &fleet_, fleet_);
  bad.device("bad", &fleet_, fleet_);
  for (const bool revoked : {false, true})
  {
    const std::string told = revoked ? "this device is revoked there" : "its trust and peers must allow the name";
    End judge(&loop_, &good);
    judge.refused = "bad";
    judge.is_revoked = revoked;
    End refused(&loop_, &bad);
    expectRefused(&refused, &judge, told, "\"bad\" is not in trust");
    End again(&loop_, &good);
    again.refused = "bad";
    again.is_revoked = revoked;
    End met(&loop_, &bad);
    expectRefused(&again, &met, "\"bad\" is not in trust", told);
  }
}

TEST_F(ProtectedTransport, CertificateThatNamesNoDevice)
{
  TestKeysFolder good;
  TestKeysFolder bad;
  good.device("good", &fleet_, fleet_);
  EXPECT_THROW(TlsKeys(bad.device("no name", &fleet_, fleet_).path()), std::runtime_error);
}

TEST_F(ProtectedTransport, SharedKeyThatDiffers)
{
  TestKeysFolder good;
  TestKeysFolder bad;
  expectRefusedBothWays(good.shared("fleet " + std::string(64, 'a')), bad.shared("fleet " + std::string(64, 'b')),
                        "shared key", "shared key");
}

TEST_F(ProtectedTransport, SharedKeyThatIsUnknown)
{
  TestKeysFolder keys;
  TestKeysFolder other_keys;
  End server(&loop_, &keys.shared("fleet " + std::string(64, 'a')));
  End client(&loop_, &other_keys.shared("other " + std::string(64, 'a')));
  expectRefused(&client, &server, "it does not know the kind of key, or the key id",
                "the id of its shared key is not known here");
}

TEST_F(ProtectedTransport, SharedKeyAgainstCertificate)
{
  TestKeysFolder keys;
  TestKeysFolder other_keys;
  keys.device("good", &fleet_, fleet_);
  other_keys.shared("fleet " + std::string(64, 'a'));
  {
    End server(&loop_, &keys);
    End client(&loop_, &other_keys);
    expectRefused(&client, &server, "its certificate is not accepted", "certificate of this device");
  }
  End server(&loop_, &other_keys);
  End client(&loop_, &keys);
  expectRefused(&client, &server, "it does not know the kind of key", "");
}

TEST_F(ProtectedTransport, PlainBridgeAtAProtectedPort)
{
  TestKeysFolder keys;
  End server(&loop_, &keys.device("good", &fleet_, fleet_));
  End client(&loop_, nullptr);
  expectRefused(&client, &server, "it speaks TLS: set secure: tls on both", "it does not speak TLS");
}

TEST_F(ProtectedTransport, ProtectedBridgeAtAPlainPort)
{
  TestKeysFolder keys;
  End server(&loop_, nullptr);
  End client(&loop_, &keys.device("good", &fleet_, fleet_));
  expectRefused(&client, &server, "it does not speak TLS", "it speaks TLS: set secure: tls on both");
}

/// A client of OpenSSL alone. @return what it was told
std::string foreignClient(EventLoop* loop, End* server, const std::function<void(SSL_CTX*)>& prepare)
{
  std::string told;
  std::thread client(
      [&]
      {
        const FileDescriptor socket(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0));
        const sockaddr_in address = socketAddress(LOCALHOST, server->transport->port());
        const std::unique_ptr<SSL_CTX, decltype(&SSL_CTX_free)> context(SSL_CTX_new(TLS_client_method()), SSL_CTX_free);
        prepare(context.get());
        const std::unique_ptr<SSL, decltype(&SSL_free)> ssl(SSL_new(context.get()), SSL_free);
        SSL_set_fd(ssl.get(), socket.get());
        char byte;
        if (::connect(socket.get(), reinterpret_cast<const sockaddr*>(&address), sizeof(address)) != 0 ||
            SSL_connect(ssl.get()) != 1 || SSL_read(ssl.get(), &byte, 1) != 1)
        {
          const char* const reason = ERR_reason_error_string(ERR_peek_error());
          told = reason != nullptr ? reason : "the connection ended";
        }
      });
  const SteadyTime deadline = SteadyClock::now() + DEADLINE;
  while (server->sources_closed.empty() && SteadyClock::now() < deadline)
  {
    loop->runOnce(milliseconds(20));
  }
  client.join();
  return told;
}

TEST_F(ProtectedTransport, ClientWithoutCertificate)
{
  TestKeysFolder keys;
  End server(&loop_, &keys.device("good", &fleet_, fleet_));
  EXPECT_EQ("tlsv13 alert certificate required", foreignClient(&loop_, &server, [](SSL_CTX*) {}));
  EXPECT_EQ(std::vector<std::string>{"it shows no certificate"}, server.refusals_in);
}

TEST_F(ProtectedTransport, ClientOfAnOlderTls)
{
  TestKeysFolder keys;
  End server(&loop_, &keys.device("good", &fleet_, fleet_));
  const auto older = [](SSL_CTX* context) { SSL_CTX_set_max_proto_version(context, TLS1_2_VERSION); };
  EXPECT_EQ("tlsv1 alert protocol version", foreignClient(&loop_, &server, older));
  EXPECT_EQ(std::vector<std::string>{"it does not speak TLS 1.3"}, server.refusals_in);
}

TEST(TlsKeys, NamesTheFileThatIsWrong)
{
  const auto problemOf = [](const std::string& folder) -> std::string
  {
    try
    {
      TlsKeys keys(folder);
    }
    catch (const std::runtime_error& error)
    {
      return error.what();
    }
    return "";
  };
  const TestAuthority fleet = makeTestAuthority();
  EXPECT_EQ(
      "/nowhere/device.key cannot be read: No such file or directory. Make keys with: rosrun pi_os_transport pi_os "
      "keys init",
      problemOf("/nowhere"));
  TestKeysFolder keys;
  keys.device("good", &fleet, fleet);
  EXPECT_EQ("", problemOf(keys.path()));
  chmod((keys.path() + "/device.key").c_str(), 0640);
  EXPECT_EQ(keys.path() + "/device.key can be read or written by others: chmod 600 " + keys.path() + "/device.key",
            problemOf(keys.path()));
  TestKeysFolder another;
  another.device("another", &fleet, fleet);
  std::filesystem::copy_file(another.path() + "/device.key", keys.path() + "/device.key",
                             std::filesystem::copy_options::overwrite_existing);
  chmod((keys.path() + "/device.key").c_str(), 0600);
  EXPECT_EQ(0U, problemOf(keys.path()).find(keys.path() + "/device.key is not the private key of device.pem"));
  for (const char* const line : {"fleet 00", "fleet", "bad/id aaaa", ""})
  {
    TestKeysFolder shared;
    EXPECT_EQ(0U, problemOf(shared.shared(line).path()).find(shared.path() + "/shared.key")) << line;
  }
}

TEST_F(ProtectedTransport, HostileHandshakesLeakNothingAndStallNobody)
{
  TestKeysFolder keys;
  TestKeysFolder other_keys;
  End server(&loop_, &keys.device("vehicle", &fleet_, fleet_));
  End client(&loop_, &other_keys.device("edge", &fleet_, fleet_));
  const auto good = client.transport->connect({LOCALHOST, server.transport->port()});
  ASSERT_TRUE(runUntil([&] { return client.connected == 1; }));
  const size_t descriptors = openDescriptors();
  std::mt19937 random(11);
  Bytes hello;  // of a real client, to be damaged
  {
    SSL_CTX* const context = SSL_CTX_new(TLS_client_method());
    SSL* const ssl = SSL_new(context);
    BIO* const out = BIO_new(BIO_s_mem());
    SSL_set_bio(ssl, BIO_new(BIO_s_mem()), out);
    SSL_connect(ssl);
    char* bytes = nullptr;
    const long count = BIO_get_mem_data(out, &bytes);
    hello.assign(bytes, bytes + count);
    SSL_free(ssl);
    SSL_CTX_free(context);
  }
  const size_t attempts = std::getenv("PI_EDGE_SOAK") != nullptr ? 10000 : 300;
  const sockaddr_in address = socketAddress(LOCALHOST, server.transport->port());
  for (size_t attempt = 0; attempt < attempts; ++attempt)
  {
    FileDescriptor hostile(socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0));
    const sockaddr_in from = socketAddress(OTHER, 0);
    ASSERT_EQ(0, bind(hostile.get(), reinterpret_cast<const sockaddr*>(&from), sizeof(from)));
    ASSERT_EQ(0, connect(hostile.get(), reinterpret_cast<const sockaddr*>(&address), sizeof(address)));
    Bytes bytes = hello;
    switch (attempt % 4)
    {
      case 0:  // damaged
        for (int i = 0; i < 4; ++i)
        {
          bytes[random() % bytes.size()] = static_cast<uint8_t>(random());
        }
        break;
      case 1:  // ends in the middle
        bytes.resize(random() % bytes.size());
        break;
      case 2:  // noise
        std::generate(bytes.begin(), bytes.end(), [&random] { return static_cast<uint8_t>(random()); });
        break;
      default:  // right so far, and then nothing
        break;
    }
    send(hostile.get(), bytes.data(), bytes.size(), MSG_NOSIGNAL);
    shutdown(hostile.get(), SHUT_WR);
    if (attempt % 16 == 0)
    {
      const size_t before = server.received.size();
      ASSERT_TRUE(client.transport->send(good, FrameHeader::of(FrameType::PING)));
      ASSERT_TRUE(runUntil([&] { return server.received.size() == before + 1; }));
    }
  }
  ASSERT_TRUE(runUntil([&] { return server.sources_closed.size() + server.refusals_in.size() >= attempts; }));
  ASSERT_TRUE(runUntil([&] { return openDescriptors() == descriptors; }));
  EXPECT_EQ(1U, server.visitors.size());
  EXPECT_TRUE(client.closed.empty());
}

TEST_F(ProtectedTransport, AMachineThatKeepsHandshakesOpenLeavesRoomForOthers)
{
  TestKeysFolder keys;
  TestKeysFolder other_keys;
  End server(&loop_, &keys.device("vehicle", &fleet_, fleet_));
  End client(&loop_, &other_keys.device("edge", &fleet_, fleet_));
  const sockaddr_in address = socketAddress(LOCALHOST, server.transport->port());
  const sockaddr_in from = socketAddress(OTHER, 0);
  std::vector<FileDescriptor> silent;
  for (size_t i = 0; i < 3 * SP_MAX_UNPROVED; ++i)
  {
    silent.emplace_back(socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0));
    ASSERT_EQ(0, bind(silent.back().get(), reinterpret_cast<const sockaddr*>(&from), sizeof(from)));
    ASSERT_EQ(0, connect(silent.back().get(), reinterpret_cast<const sockaddr*>(&address), sizeof(address)));
  }
  ASSERT_TRUE(runUntil([&] { return server.refusals_in.size() == 2 * SP_MAX_UNPROVED; }));
  EXPECT_EQ("too many connections without a proof", server.refusals_in[0]);
  client.transport->connect({LOCALHOST, server.transport->port()});
  ASSERT_TRUE(runUntil([&] { return client.connected == 1; }));
}

}  // namespace
}  // namespace pi_os_transport
