#include <gtest/gtest.h>

#include <string>
#include <utility>
#include <vector>

#include "master/loopback_client.h"
#include "pi_os_transport/little_endian.h"
#include "rosout/log_publisher.h"
#include "rosout/log_subscriber.h"
#include "rosout/tcpros_header.h"

namespace pi_os_transport
{
namespace
{

const std::string TOPIC = "/log";
const std::string PUBLISHER_API = "http://publisher:1/";

TEST(TcprosHeader, ReadsBackWhatItWrites)
{
  const TcprosHeader header{{"topic", "/a"}, {"empty", ""}, {"odd", "a=b\n"}};
  const std::string bytes = encodeTcprosHeader(header);
  EXPECT_EQ(bytes.size() - 4, loadLittleEndian<uint32_t>(reinterpret_cast<const uint8_t*>(bytes.data())));
  EXPECT_EQ(header, decodeTcprosHeader(std::string_view(bytes).substr(4)));
}

TEST(TcprosHeader, RefusesWhatIsNone)
{
  EXPECT_EQ(std::nullopt, decodeTcprosHeader("abc"));
  EXPECT_EQ(std::nullopt, decodeTcprosHeader(std::string("\x05\0\0\0a=b", 7)));
  EXPECT_EQ(std::nullopt, decodeTcprosHeader(std::string("\x03\0\0\0abc", 7)));
  EXPECT_EQ(TcprosHeader(), decodeTcprosHeader(""));
}

TEST(TcprosReader, CutsPartsHoweverTheyCome)
{
  const std::string bytes("\x02\0\0\0ab\0\0\0\0\x01\0\0\0c", 15);
  for (size_t step = 1; step <= bytes.size(); ++step)
  {
    TcprosReader reader(2);
    std::vector<std::string> parts;
    for (size_t at = 0; at < bytes.size(); at += step)
    {
      reader.feed(bytes.substr(at, step));
      while (const auto part = reader.next())
      {
        parts.emplace_back(*part);
      }
    }
    EXPECT_EQ((std::vector<std::string>{"ab", "", "c"}), parts) << step;
    EXPECT_FALSE(reader.isBroken());
  }
  TcprosReader reader(2);
  reader.feed(bytes + std::string("\x03\0\0\0", 4));
  while (reader.next())
  {
    EXPECT_FALSE(reader.isBroken());
  }
  EXPECT_TRUE(reader.isBroken());
}

/// A publisher and a subscriber on one loop; the node call that asks for the port is answered here.
class LogLinkTest : public testing::Test, protected NodeCalls
{
protected:
  void call(const std::string& api, NodeCall call) override
  {
    asked.push_back(api);
    const RpcResponse response{
        false, RpcValue::Array{1, "", RpcValue::Array{"TCPROS", "localhost", static_cast<int32_t>(port)}}};
    loop.defer([done = std::move(call.done), response, is_gone = is_gone] { done(is_gone ? nullptr : &response); });
  }
  static bool isConnected(const RpcValue::Array& info)
  {
    return info.size() == 1 && info[0].as<RpcValue::Array>()[5] == RpcValue(1);
  }

  EventLoop loop;
  LogPublisher publisher{&loop, "127.0.0.1", "/pub", TOPIC};
  uint16_t port = publisher.port();
  bool is_gone = false;
  std::vector<std::string> asked;
  std::vector<std::string> received;
  LogSubscriber subscriber{&loop, this, "/sub", TOPIC,
                           [this](std::string_view message) { received.emplace_back(message); }};
};

TEST_F(LogLinkTest, CarriesMessagesWithThePublishersSequence)
{
  subscriber.setPublishers({PUBLISHER_API});
  ASSERT_TRUE(runUntil(&loop, [&] { return isConnected(subscriber.busInfo()) && isConnected(publisher.busInfo()); }));
  publisher.publish(std::string("\x09\0\0\0first", 9));
  publisher.publish(std::string("\x09\0\0\0", 4) + std::string(300000, 'x'));
  ASSERT_TRUE(runUntil(&loop, [&] { return received.size() == 2; }));
  EXPECT_EQ(std::string("\0\0\0\0first", 9), received[0]);
  EXPECT_EQ(std::string("\x01\0\0\0", 4) + std::string(300000, 'x'), received[1]);
  EXPECT_EQ(RpcValue("/sub"), publisher.busInfo()[0].as<RpcValue::Array>()[1]);
  EXPECT_EQ(RpcValue(PUBLISHER_API), subscriber.busInfo()[0].as<RpcValue::Array>()[1]);
}

TEST_F(LogLinkTest, ConnectsAnewWhileThePublisherIsListed)
{
  subscriber.setPublishers({PUBLISHER_API});
  ASSERT_TRUE(runUntil(&loop, [&] { return isConnected(publisher.busInfo()); }));
  is_gone = true;
  publisher.disconnectAll();
  ASSERT_TRUE(runUntil(&loop, [&] { return asked.size() >= 3; }));
  is_gone = false;
  ASSERT_TRUE(runUntil(&loop, [&] { return isConnected(subscriber.busInfo()); }));
  subscriber.setPublishers({});
  EXPECT_TRUE(runUntil(&loop, [&] { return publisher.busInfo().empty(); }));
}

TEST_F(LogLinkTest, TellsSubscribersOfOtherTypesWhy)
{
  LoopbackClient other(&loop, publisher.port());
  other.send(encodeTcprosHeader({{"topic", TOPIC}, {"md5sum", "1234"}, {"type", "a/B"}, {"callerid", "/x"}}));
  EXPECT_NE(std::string::npos, other.receiveAll().find("error=Client [/x] wants topic /log"));
  LoopbackClient wrong(&loop, publisher.port());
  wrong.send(encodeTcprosHeader({{"topic", "/else"}, {"md5sum", "*"}}));
  EXPECT_NE(std::string::npos, wrong.receiveAll().find("[/else]"));
  LoopbackClient nonsense(&loop, publisher.port());
  nonsense.send("GET / HTTP/1.1\r\n\r\n");
  EXPECT_EQ("", nonsense.receiveAll());
}

TEST_F(LogLinkTest, LetsASlowSubscriberLoseTheOldest)
{
  LoopbackClient slow(&loop, publisher.port());
  slow.send(encodeTcprosHeader({{"topic", TOPIC}, {"md5sum", "*"}, {"callerid", "/slow"}}));
  ASSERT_TRUE(runUntil(&loop, [&] { return publisher.busInfo().size() == 1; }));
  const std::string body(1024 * 1024, 'x');
  for (int count = 0; count < 40; ++count)
  {
    publisher.publish(body);
  }
  publisher.publish("lastlast");
  const std::string all = slow.receive([](const std::string& text) { return text.find("last") != std::string::npos; });
  EXPECT_LT(all.size(), 40 * body.size());
  EXPECT_GT(all.size(), 2 * body.size());
}

}  // namespace
}  // namespace pi_os_transport
