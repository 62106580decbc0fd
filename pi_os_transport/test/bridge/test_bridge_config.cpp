#include "bridge/config/bridge_config.h"

#include <gtest/gtest.h>
#include <stdlib.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <stdexcept>

namespace pi_os_transport
{

static void PrintTo(const Endpoint& endpoint, std::ostream* out)
{
  *out << endpoint.toString();
}

namespace
{

using Priority = TopicOptions::Priority;

std::optional<BridgeConfig> parse(const std::vector<std::string>& arguments)
{
  std::vector<const char*> argv{"pi_os_bridge"};
  for (const std::string& argument : arguments)
  {
    argv.push_back(argument.c_str());
  }
  return loadBridgeConfig(static_cast<int>(argv.size()), argv.data());
}

std::string errorOf(const std::vector<std::string>& arguments)
{
  try
  {
    parse(arguments);
  }
  catch (const std::runtime_error& error)
  {
    return error.what();
  }
  return "no error";
}

const std::filesystem::path& shippedFile()
{
  static const std::filesystem::path path =
      std::filesystem::path(__FILE__).parent_path() / ".." / ".." / "config" / "bridge.yaml";
  return path;
}

class BridgeConfigFile : public ::testing::Test
{
protected:
  void SetUp() override
  {
    char folder[] = "/tmp/pi_os_test_XXXXXX";
    ASSERT_NE(nullptr, mkdtemp(folder));
    folder_ = folder;
    path_ = folder_ + "/bridge.yaml";
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }

  void write(const std::string& text) { std::ofstream(path_) << text; }
  BridgeConfig load(const std::string& text, std::vector<std::string> more = {})
  {
    write(text);
    more.insert(more.begin(), {"--config", path_});
    return *parse(more);
  }
  std::string error(const std::string& text)
  {
    write(text);
    return errorOf({"--config", path_});
  }

  std::string folder_;
  std::string path_;
};

TEST(BridgeConfig, DefaultsListenEverywhereAndLeaveTheGraphToDecide)
{
  const BridgeConfig config = *parse({});
  char host[256] = {};
  ASSERT_EQ(0, gethostname(host, sizeof(host) - 1));
  EXPECT_EQ(host, config.name);
  EXPECT_EQ((std::vector<Endpoint>{{"0.0.0.0", 8814}}), config.listen);
  EXPECT_EQ("", config.advertise.address);
  EXPECT_TRUE(config.peers.empty());
  EXPECT_TRUE(config.allow.empty());
  EXPECT_TRUE(config.allows("203.0.113.9"));
  EXPECT_EQ("", config.master);
  EXPECT_EQ("sp", config.wire);
  EXPECT_EQ("default", config.socket);
  EXPECT_EQ(0, config.nice);
  EXPECT_EQ(512U, config.pool_limit_mb);
  EXPECT_EQ(256U, config.max_message_mb);
  const TopicOptions& topic = config.topic("/any");
  EXPECT_EQ(Priority::NORMAL, topic.priority);
  EXPECT_EQ(0.0, topic.rate_limit_hz);
  EXPECT_FALSE(topic.keep_latest);
  EXPECT_EQ("", topic.compression);
  EXPECT_TRUE(topic.forward);
}

TEST(BridgeConfig, ShippedFileHoldsTheDefaults)
{
  ASSERT_TRUE(std::filesystem::exists(shippedFile())) << shippedFile();
  const BridgeConfig file = *parse({"--config", shippedFile()});
  const BridgeConfig defaults = *parse({});
  EXPECT_EQ(defaults.name, file.name);
  EXPECT_EQ(defaults.listen, file.listen);
  EXPECT_EQ(defaults.advertise, file.advertise);
  EXPECT_EQ(defaults.peers, file.peers);
  EXPECT_EQ(defaults.allow.size(), file.allow.size());
  EXPECT_EQ(defaults.master, file.master);
  EXPECT_EQ(defaults.secure, file.secure);
  EXPECT_EQ(defaults.keys, file.keys);
  EXPECT_EQ(defaults.trust.size(), file.trust.size());
  EXPECT_EQ(defaults.wire, file.wire);
  EXPECT_EQ(defaults.socket, file.socket);
  EXPECT_EQ(defaults.nice, file.nice);
  EXPECT_EQ(defaults.pool_limit_mb, file.pool_limit_mb);
  EXPECT_EQ(defaults.max_message_mb, file.max_message_mb);
  EXPECT_EQ(defaults.topics.size(), file.topics.size());
}

TEST_F(BridgeConfigFile, TrustSaysWhoMayExchangeWhat)
{
  const BridgeConfig config = load(
      "secure: tls\npeers: [\"edge_a@10.0.0.7\", \"10.0.0.8:77\"]\n"
      "trust:\n  - name: lost\n    allow: false\n"
      "  - name: \"edge*\"\n    topics: [\"/camera/*\", \"/cmd_vel\"]\n  - name: base\n");
  EXPECT_TRUE(config.isSecure());
  ASSERT_EQ(2U, config.peers.size());
  EXPECT_EQ("10.0.0.7:8814", config.peers[0].toString());
  ASSERT_EQ(1U, config.peer_names.size());
  EXPECT_EQ("edge_a", config.peer_names.at(config.peers[0]));
  EXPECT_FALSE(config.trustOf("lost")->allow);
  EXPECT_EQ(nullptr, config.trustOf("stranger"));
  EXPECT_TRUE(config.trusts("edge_b", "/camera/image"));
  EXPECT_TRUE(config.trusts("edge_b", "/cmd_vel"));
  EXPECT_FALSE(config.trusts("edge_b", "/cmd_vel2"));
  EXPECT_TRUE(config.trusts("base", "/anything"));
  EXPECT_FALSE(config.trusts("lost", "/cmd_vel"));
  EXPECT_FALSE(config.trusts("stranger", "/cmd_vel"));
  EXPECT_TRUE(load("secure: tls\n").trusts("anyone", "/anything"));
  EXPECT_TRUE(load("").trusts("", "/anything"));
}

TEST_F(BridgeConfigFile, WhatNeedsTlsIsRefusedWithoutIt)
{
  EXPECT_EQ("secure = \"tls\" with wire = \"nanomsg\": libnanomsg cannot encrypt, wire must be sp",
            error("secure: tls\nwire: nanomsg\n"));
  const std::string names =
      "trust, and a NAME@ in peers, with secure = \"off\": names are proved by keys, secure must be tls";
  EXPECT_EQ(names, error("trust: [{name: edge}]\n"));
  EXPECT_EQ(names, errorOf({"--peer", "edge@10.0.0.7"}));
  EXPECT_EQ("--secure = \"on\", must be off or tls", errorOf({"--secure", "on"}));
  EXPECT_EQ(0U,
            errorOf({"--secure", "tls", "--peer", "a b@10.0.0.7"}).find("--peer = \"a b@10.0.0.7\", must be [NAME@]"));
  EXPECT_NE(std::string::npos, error("secure: tls\ntrust: [{allow: false}]\n").find("trust[0].name is missing"));
}

TEST_F(BridgeConfigFile, ShippedExamplesAreValidAndMeanWhatTheySay)
{
  std::ifstream stream(shippedFile());
  std::string text;
  for (std::string line; std::getline(stream, line);)
  {
    const bool example = line.size() > 1 && line[0] == '#' && (line[1] != ' ' || line.compare(1, 2, "  ") == 0);
    const bool replaced = line == "topics: []" || line == "trust: []" || line == "secure: \"off\"";
    text += replaced ? "" : (example ? line.substr(1) : line) + "\n";
  }
  text += "secure: tls\n";
  const BridgeConfig config = load(text);
  EXPECT_EQ("robot", config.name);
  ASSERT_EQ(4U, config.topics.size());
  EXPECT_EQ(Priority::HIGH, config.topic("/cmd_vel").priority);
  const TopicOptions& image = config.topic("/camera/left/image_raw");
  EXPECT_EQ(Priority::LOW, image.priority);
  EXPECT_EQ(10.0, image.rate_limit_hz);
  EXPECT_TRUE(image.keep_latest);
  EXPECT_EQ("jpeg", image.compression);
  EXPECT_EQ(80, image.quality);
  EXPECT_EQ("png", config.topic("/depth/image").compression);
  EXPECT_EQ(3, config.topic("/depth/image").quality);
  EXPECT_FALSE(config.topic("/debug/x").forward);
  ASSERT_EQ(3U, config.trust.size());
  EXPECT_FALSE(config.trusts("stolen_robot", "/cmd_vel"));
  EXPECT_TRUE(config.trusts("edge1", "/camera/image"));
  EXPECT_FALSE(config.trusts("edge1", "/map"));
  EXPECT_TRUE(config.trusts("base", "/map"));
}

TEST(BridgeConfig, CommandLineSetsEverythingItKnows)
{
  const BridgeConfig config =
      *parse({"--name",          "robot",       "--listen",       "127.0.0.1",      "--listen=127.0.0.2:9000",
              "--peer",          "10.0.0.7",    "--peer",         "10.0.0.8:77",    "--allow",
              "10.0.0.0/8",      "--allow",     "192.168.1.5",    "--wire",         "nanomsg",
              "--socket=second", "--advertise", "192.0.2.4:1234", "__name:=bridge", "__log:=/tmp/x.log"});
  EXPECT_EQ("robot", config.name);
  EXPECT_EQ((std::vector<Endpoint>{{"127.0.0.1", 8814}, {"127.0.0.2", 9000}}), config.listen);
  EXPECT_EQ((std::vector<Endpoint>{{"10.0.0.7", 8814}, {"10.0.0.8", 77}}), config.peers);
  EXPECT_EQ((Endpoint{"192.0.2.4", 1234}), config.advertise);
  ASSERT_EQ(2U, config.allow.size());
  EXPECT_EQ("10.0.0.0/8", config.allow[0].toString());
  EXPECT_EQ("192.168.1.5/32", config.allow[1].toString());
  EXPECT_EQ("nanomsg", config.wire);
  EXPECT_EQ("second", config.socket);
}

TEST(BridgeConfig, HelpWinsOverEverythingAfterIt)
{
  EXPECT_FALSE(parse({"--name", "x", "--help", "--nonsense"}).has_value());
  for (const char* option : {"--config", "--name", "--listen", "--advertise", "--peer", "--allow", "--master",
                             "--secure", "--keys", "--wire", "--socket"})
  {
    EXPECT_NE(std::string::npos, bridgeUsage().find(option)) << option;
  }
}

TEST(BridgeConfig, AllowsOnlyWhatItsRangesContain)
{
  const BridgeConfig config = *parse({"--allow", "10.1.2.3/8", "--allow", "192.168.1.5", "--allow", "172.16.0.128/25"});
  EXPECT_TRUE(config.allows("10.255.0.1"));
  EXPECT_FALSE(config.allows("11.0.0.1"));
  EXPECT_TRUE(config.allows("192.168.1.5"));
  EXPECT_FALSE(config.allows("192.168.1.4"));
  EXPECT_TRUE(config.allows("172.16.0.255"));
  EXPECT_FALSE(config.allows("172.16.0.127"));
  EXPECT_FALSE(config.allows("localhost"));
  EXPECT_FALSE(config.allows(""));
  EXPECT_TRUE(parse({"--allow", "0.0.0.0/0"})->allows("8.8.8.8"));
}

TEST(BridgeConfig, ResolvesInterfacesAndHosts)
{
  EXPECT_EQ((std::vector<Endpoint>{{"127.0.0.1", 8814}, {"127.0.0.1", 0}}),
            parse({"--listen", "lo", "--listen", "lo:0"})->listen);
  EXPECT_EQ((std::vector<Endpoint>{{"127.0.0.1", 99}}), parse({"--peer", "localhost:99"})->peers);
  EXPECT_EQ((Endpoint{"127.0.0.1", 0}), parse({"--advertise", "localhost"})->advertise);
}

TEST(BridgeConfig, BadArgumentsAreNamedWithValueAndWhatIsAllowed)
{
  EXPECT_EQ("\"--frob\" is no option, see --help", errorOf({"--frob"}));
  EXPECT_EQ("\"robot\" is no option, see --help", errorOf({"robot"}));
  EXPECT_EQ("--name lacks its value, see --help", errorOf({"--name"}));
  EXPECT_EQ("--name = \"b\" comes after --name = \"a\", must be given once", errorOf({"--name", "a", "--name", "b"}));
  EXPECT_EQ("--wire = \"tls\", must be sp or nanomsg", errorOf({"--wire", "tls"}));
  EXPECT_EQ("--allow = \"10.0.0.0/33\", must be an IPv4 address, or a range like 192.168.1.0/24",
            errorOf({"--allow", "10.0.0.0/33"}));
  EXPECT_EQ(
      "--master = \"vehicle\", must be the URI of a ROS master like http://192.168.1.10:11311, or \"\" for "
      "ROS_MASTER_URI",
      errorOf({"--master", "vehicle"}));
  EXPECT_EQ("http://vehicle:11311/", parse({"--master", "http://vehicle:11311/"})->master);
  EXPECT_EQ("--peer = \"1.2.3.4:0\", must be ADDRESS[:PORT] with a port from 1 to 65535",
            errorOf({"--peer", "1.2.3.4:0"}));
  EXPECT_EQ("--peer = \"0.0.0.0\", must be the address of one device", errorOf({"--peer", "0.0.0.0"}));
  EXPECT_EQ(
      "--listen = \"nosuch0\", must be ADDRESS[:PORT], where ADDRESS is an IPv4 address or an interface of this device "
      "that has one",
      errorOf({"--listen", "nosuch0"}));
  for (const char* value : {"", ":80", "::1", "1.2.3.4:", "1.2.3.4:x", "1.2.3.4:65536", "1.2.3.4:-1"})
  {
    EXPECT_EQ(0U, errorOf({"--listen", value}).find("--listen = \"" + std::string(value) + "\", must be ")) << value;
  }
  for (const char* value : {"", "/", "1.2.3/8", "1.2.3.4/", "1.2.3.4/-1", "1.2.3.4/8x", "host"})
  {
    EXPECT_EQ(0U, errorOf({"--allow", value}).find("--allow = \"" + std::string(value) + "\", must be ")) << value;
  }
  for (const std::string& value : {std::string("0"), std::string(""), std::string("a/b"), std::string(65, 'x')})
  {
    EXPECT_EQ(0U, errorOf({"--socket", value}).find("--socket = \"" + value + "\", must be ")) << value;
  }
}

TEST_F(BridgeConfigFile, CommandLineWinsAndItsListsReplaceThoseOfTheFile)
{
  const BridgeConfig config =
      load("name: file\nlisten: [\"127.0.0.1:1\"]\npeers: [10.0.0.1, 10.0.0.2]\nwire: nanomsg\npool_limit_mb: 64\n",
           {"--name", "line", "--peer", "10.0.0.3"});
  EXPECT_EQ("line", config.name);
  EXPECT_EQ((std::vector<Endpoint>{{"10.0.0.3", 8814}}), config.peers);
  EXPECT_EQ((std::vector<Endpoint>{{"127.0.0.1", 1}}), config.listen);
  EXPECT_EQ("nanomsg", config.wire);
  EXPECT_EQ(64U, config.pool_limit_mb);
}

TEST_F(BridgeConfigFile, FirstMatchingTopicCounts)
{
  const BridgeConfig config = load(
      "topics:\n"
      "  - {match: /camera/left, compression: jpeg}\n"
      "  - {match: '/camera/*', compression: png, priority: low}\n"
      "  - {match: '*', rate_limit_hz: 0.5, forward: false}\n");
  EXPECT_EQ(80, config.topic("/camera/left").quality);
  EXPECT_EQ("png", config.topic("/camera/right").compression);
  EXPECT_EQ(3, config.topic("/camera/a/b").quality);
  EXPECT_FALSE(config.topic("/other").forward);
  EXPECT_EQ(0.5, config.topic("/other").rate_limit_hz);
}

TEST_F(BridgeConfigFile, EmptyFileMeansDefaults)
{
  for (const char* text : {"", "\n", "# nothing\n", "---\n"})
  {
    EXPECT_EQ(512U, load(text).pool_limit_mb) << text;
  }
}

TEST_F(BridgeConfigFile, ErrorsNameFileLineKeyValueAndWhatIsAllowed)
{
  const auto expect = [this](const std::string& text, const std::string& message)
  { EXPECT_EQ(path_ + ":" + message, error(text)) << text; };
  expect("name: a\npool_limit_mb: 0\n", "2: pool_limit_mb = \"0\", must be a whole number from 1 to 65536");
  expect("max_message_mb: 1025", "1: max_message_mb = \"1025\", must be a whole number from 1 to 1024");
  expect("max_message_mb: -1", "1: max_message_mb = \"-1\", must be a whole number from 1 to 1024");
  expect("max_message_mb: 1.5", "1: max_message_mb = \"1.5\", must be a whole number from 1 to 1024");
  expect("nice: -21", "1: nice = \"-21\", must be a whole number from -20 to 19");
  expect("wire: tls", "1: wire = \"tls\", must be sp or nanomsg");
  expect("peers: 10.0.0.1", "1: peers = \"10.0.0.1\", must be a list like [a, b]");
  expect("name: [a]", "1: name = a list, must be a single value");
  expect("name:", "1: name = nothing, must be a single value");
  expect("name: ''", "1: name = \"\", must be 1 to 255 printable characters");
  expect("listen: []", "1: listen = [], must name at least one ADDRESS[:PORT]");
  expect("allow:\n  - 10.0.0.1\n  - nobody\n",
         "3: allow[1] = \"nobody\", must be an IPv4 address, or a range like 192.168.1.0/24");
  expect("\n\npeer: []\n",
         "3: peer is no option, must be one of advertise, allow, keys, listen, master, max_message_mb, name, nice, "
         "peers, pool_limit_mb, secure, socket, topics, trust, wire");
  expect("name: a\nname: b\n", "2: name is given twice, must be given once");
  expect("- a\n", "1: the file = a list, must be a map of keys and values");
  expect("topics: [a]", "1: topics[0] = \"a\", must be a map of keys and values");
}

TEST_F(BridgeConfigFile, ErrorsOfTopicsNameTheirEntry)
{
  const auto expect = [this](const std::string& entry, const std::string& message)
  { EXPECT_EQ(path_ + ":" + message, error("topics:\n  - match: /a\n  - " + entry)) << entry; };
  expect("priority: high", "3: topics[1].match is missing, must be a shell pattern like \"/camera/*\"");
  expect("match: image",
         "3: topics[1].match = \"image\", must be a shell pattern for full topic names, which start with "
         "\"/\"");
  expect("{match: /b, priority: urgent}", "3: topics[1].priority = \"urgent\", must be high, normal or low");
  expect("{match: /b, rate_limit_hz: -1}",
         "3: topics[1].rate_limit_hz = \"-1\", must be a number from 0 (no limit) to 1000000 [1/s]");
  expect("{match: /b, rate_limit_hz: nan}",
         "3: topics[1].rate_limit_hz = \"nan\", must be a number from 0 (no limit) to 1000000 [1/s]");
  expect("{match: /b, keep_latest: 1}", "3: topics[1].keep_latest = \"1\", must be true or false");
  expect("{match: /b, compression: gif}", "3: topics[1].compression = \"gif\", must be jpeg, png or \"\" for none");
  expect("{match: /b, compression: jpeg, quality: 101}",
         "3: topics[1].quality = \"101\", must be a whole number from 1 to 100");
  expect("{match: /b, quality: 10, compression: png}",
         "3: topics[1].quality = \"10\", must be a whole number from 1 to 9");
  expect("{match: /b, quality: 5}", "3: topics[1].quality = \"5\", must be left out without compression: jpeg or png");
  expect(
      "{match: /b, qualtiy: 5}",
      "3: topics[1].qualtiy is no option, must be one of compression, forward, keep_latest, match, priority, quality, "
      "rate_limit_hz");
}

TEST_F(BridgeConfigFile, BrokenAndMissingFilesAreNamed)
{
  EXPECT_EQ(0U, error("name: a\npeers: [b\n").find(path_ + ":")) << error("name: a\npeers: [b\n");
  EXPECT_NE(std::string::npos, error("name: a\npeers: [b\n").find("is no YAML"));
  EXPECT_EQ(path_ + ": must hold one YAML document, holds 2", error("name: a\n---\nname: b\n"));
  EXPECT_EQ("--config = \"" + folder_ + "/none.yaml\", must be a file that can be read: No such file or directory",
            errorOf({"--config", folder_ + "/none.yaml"}));
  EXPECT_EQ("--config = \"" + folder_ + "\", must be a file that can be read: Is a directory",
            errorOf({"--config", folder_}));
}

}  // namespace
}  // namespace pi_os_transport
