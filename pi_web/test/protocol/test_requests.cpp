#include "protocol/messages.h"
#include "protocol/requests.h"

#include <gtest/gtest.h>

#include <random>
#include <stdexcept>

namespace pi_web
{
namespace
{

std::string refusal(std::string_view message, bool text = true)
{
  try
  {
    text ? decodeText(message) : decodeBinary(message);
  }
  catch (const std::invalid_argument& error)
  {
    return error.what();
  }
  return "";
}

TEST(Requests, AreDecoded)
{
  const auto subscribe = std::get<request::Subscribe>(
      decodeText(R"({"op":"subscribe","subscriptions":[{"id":0,"channelId":4294967295},{"id":1,"channelId":5}]})"));
  ASSERT_EQ(2u, subscribe.subscriptions.size());
  EXPECT_EQ(std::make_pair(0u, 4294967295u), subscribe.subscriptions[0]);
  EXPECT_EQ(
      std::vector<uint32_t>({1, 2}),
      std::get<request::Unsubscribe>(decodeText(R"({"op":"unsubscribe","subscriptionIds":[1,2]})")).subscriptions);
  const auto parameters = std::get<request::SetParameters>(
      decodeText(R"({"op":"setParameters","parameters":[{"name":"/a","value":1.5},{"name":"/b"}],"id":"x"})"));
  EXPECT_EQ(1.5, parameters.values[0].second);
  EXPECT_TRUE(parameters.values[1].second.is_null());
  EXPECT_FALSE(std::get<request::WatchGraph>(decodeText(R"({"op":"unsubscribeConnectionGraph"})")).on);

  std::string call = "\x02";
  appendUint32(7, &call);
  appendUint32(8, &call);
  appendUint32(4, &call);
  call += "ros1xyz";
  const auto service = std::get<request::CallService>(decodeBinary(call));
  EXPECT_EQ(7u, service.service);
  EXPECT_EQ(8u, service.call);
  EXPECT_EQ("ros1", service.encoding);
  EXPECT_EQ("xyz", service.payload);
  EXPECT_EQ("ab", std::get<request::Publish>(decodeBinary(std::string("\x01\x05\0\0\0ab", 7))).payload);
}

TEST(Requests, RefusalsNameFieldAndBound)
{
  EXPECT_EQ("a text message must be a JSON object", refusal("[1]"));
  EXPECT_EQ("a text message must be a JSON object", refusal("{\"op\":"));
  EXPECT_EQ("no field op", refusal("{}"));
  EXPECT_EQ("op \"f?y\" is unknown here", refusal("{\"op\":\"f\\ny\"}"));
  EXPECT_EQ("id must be an integer in [0, 4294967295]",
            refusal(R"({"op":"subscribe","subscriptions":[{"id":4294967296,"channelId":1}]})"));
  EXPECT_EQ("subscriptions must hold objects", refusal(R"({"op":"subscribe","subscriptions":[1]})"));
  EXPECT_EQ("channelIds must be a list of at most 500",
            refusal("{\"op\":\"unadvertise\",\"channelIds\":" + nlohmann::json(std::vector<int>(501, 1)).dump() + "}"));
  EXPECT_EQ("topic must be a text of at most 300 characters",
            refusal("{\"op\":\"advertise\",\"channels\":[{\"id\":1,\"topic\":\"" + std::string(301, 'a') + "\"}]}"));
  EXPECT_EQ("a binary message of 0 bytes ends too early", refusal("", false));
  EXPECT_EQ("a binary message of 3 bytes ends too early", refusal("\x01xy", false));
  EXPECT_EQ("binary opcode 9 is unknown here", refusal("\x09", false));
  EXPECT_EQ("encoding has 4294967295 characters, must be at most 300",
            refusal(std::string("\x02") + std::string(8, '\0') + "\xff\xff\xff\xff", false));
}

/// Correct messages of which bytes are changed, cut, doubled and inserted: the decoder returns or refuses, and nothing
/// else.
TEST(Requests, GarbageIsRefusedAndNothingElse)
{
  std::vector<std::string> seeds = {
      R"({"op":"subscribe","subscriptions":[{"id":0,"channelId":3}]})",
      R"({"op":"advertise","channels":[{"id":1,"topic":"/goal","encoding":"ros1","schemaName":"std_msgs/String"}]})",
      R"({"op":"setParameters","parameters":[{"name":"/a","value":{"b":[1,2.5,"x",null,true]}}],"id":"7"})",
      R"({"op":"fetchAsset","uri":"package://a/b.urdf","requestId":1})",
      std::string(5000, '['),
      std::string("\x02\1\0\0\0\2\0\0\0\4\0\0\0ros1abc", 20),
      std::string("\x01\1\0\0\0abc", 8)};
  std::mt19937 random(7);
  int refused = 0;
  for (int round = 0; round < 100000; ++round)
  {
    std::string message = seeds[random() % seeds.size()];
    for (uint32_t change = random() % 6; change > 0 && !message.empty(); --change)
    {
      const size_t at = random() % message.size();
      switch (random() % 4)
      {
        case 0:
          message[at] = static_cast<char>(random());
          break;
        case 1:
          message.resize(at);
          break;
        case 2:
          message.insert(at, message.substr(at, random() % 9));
          break;
        default:
          message.insert(at, 1, "{}[],:\"\\0-9e.\xff"[random() % 15]);
      }
    }
    refused += refusal(message, true).empty() ? 0 : 1;
    refused += refusal(message, false).empty() ? 0 : 1;
  }
  EXPECT_GT(refused, 50000);   // the decoder that it is not for refuses nearly all
  EXPECT_LT(refused, 200000);  // what was not changed is taken
}

}  // namespace
}  // namespace pi_web
