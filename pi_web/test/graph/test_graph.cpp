#include "graph/graph_messages.h"
#include "graph/peer.h"
#include "ros/parameter_json.h"
#include "ros/web_view_ros_options.h"

#include <arpa/inet.h>
#include <pi_node/test_support/options_reader.h>
#include <sys/socket.h>

#include <chrono>
#include <stdexcept>

namespace pi_web
{
namespace
{

using nlohmann::json;
using pi_node::test_support::OptionsReader;

const OptionsReader<WebViewRosOptions> READER("/web_view/");

TEST(WebViewRosOptions, FileHoldsTheDefaults)
{
  OptionsReader<WebViewRosOptions>::expectDefaultsOf(WEB_VIEW_YAML);
}

TEST(WebViewRosOptions, RefusalsNameParameterValueAndBound)
{
  EXPECT_EQ("parameter /web_view/port = 65536, must be in [0, 65535]", READER.refusal("{port: 65536}"));
  EXPECT_EQ("parameter /web_view/address = \"here\", must be one of this computer, as 127.0.0.1 or 0.0.0.0",
            READER.refusal("{address: here}"));
  EXPECT_EQ("parameter /web_view/services = \"\", must be names: one is empty", READER.refusal("{services: ['']}"));
  EXPECT_EQ("parameter /web_view/jpeg_quality = 0, must be in [1, 100]", READER.refusal("{jpeg_quality: 0}"));
}

TEST(ParameterJson, ValuesComeBack)
{
  const json value = {
      {"a", 1}, {"b", {1.5, "x", true, json::array()}}, {"c", {{"d", -2147483648}}}, {"e", json::object()}};
  EXPECT_EQ(value, toJson(fromJson(value)));
  EXPECT_THROW(fromJson(2147483648), std::invalid_argument);
  EXPECT_THROW(fromJson(nullptr), std::invalid_argument);
  json deep;
  for (int i = 0; i < 30; ++i)
  {
    deep = json::array({deep});
  }
  EXPECT_THROW(fromJson(deep), std::invalid_argument);
}

TEST(GraphUpdate, TellsWhatChanged)
{
  GraphState before;
  before.publishers = {{"/a", {"/x"}}, {"/b", {"/x"}}};
  GraphState now = before;
  EXPECT_TRUE(graphUpdate(before, now).is_null());
  now.publishers = {{"/a", {"/x", "/y"}}};
  const json update = graphUpdate(before, now);
  EXPECT_EQ(json({{{"name", "/a"}, {"publisherIds", {"/x", "/y"}}}}), update["publishedTopics"]);
  EXPECT_EQ(json({"/b"}), update["removedTopics"]);
}

TEST(Links, AreToldByTransport)
{
  EXPECT_EQ("[]", linksJson({}));
  EXPECT_EQ(json({{{"transport", "SHMROS"}, {"links", 3}, {"topics", {"/a", "/b"}}},
                  {{"transport", "NNROS"}, {"links", 1}, {"topics", {"/c"}}}}),
            json::parse(linksJson({{"NNROS", {1, {"/c"}}}, {"SHMROS", {3, {"/a", "/b"}}}})));
}

TEST(Peer, HeadersComeBackAndGarbageIsRefused)
{
  const HeaderFields fields = {{"topic", "/a"}, {"message_definition", "a=b\nc"}};
  EXPECT_EQ(fields, decodeHeader(encodeHeader(fields).substr(4)));
  EXPECT_THROW(decodeHeader(std::string("\xff\xff\xff\xff", 4)), std::runtime_error);
  EXPECT_THROW(decodeHeader(std::string("\2\0\0\0ab", 6)), std::runtime_error);
  EXPECT_EQ(std::make_pair(std::string("host"), uint16_t(11311)), addressOf("http://host:11311/"));
  EXPECT_THROW(addressOf("http://host/"), std::runtime_error);
}

TEST(Peer, WaitsNoLongerThanItsLimit)
{
  const pi_node::UniqueFd silent(socket(AF_INET, SOCK_STREAM, 0));
  sockaddr_in address = {};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  socklen_t size = sizeof address;
  ASSERT_EQ(0, bind(silent.get(), reinterpret_cast<sockaddr*>(&address), size));
  ASSERT_EQ(0, listen(silent.get(), 1));
  getsockname(silent.get(), reinterpret_cast<sockaddr*>(&address), &size);
  const auto began = std::chrono::steady_clock::now();
  Peer peer("127.0.0.1", ntohs(address.sin_port), 0.3);
  EXPECT_THROW(peer.read(1), std::runtime_error);
  EXPECT_LT(std::chrono::steady_clock::now() - began, std::chrono::seconds(10));
}

}  // namespace
}  // namespace pi_web
