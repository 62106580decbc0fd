#include "core/core_options.h"

#include <gtest/gtest.h>

#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "core/log_folder.h"
#include "master/network_address.h"

namespace pi_os_transport
{
namespace
{

std::optional<CoreOptions> parse(std::vector<std::string> words)
{
  words.insert(words.begin(), "pi_core");
  std::vector<char*> arguments;
  for (std::string& word : words)
  {
    arguments.push_back(word.data());
  }
  arguments.push_back(nullptr);
  return CoreOptions::parse(static_cast<int>(words.size()), arguments.data());
}

TEST(CoreOptions, HaveTheDefaultsOfRoscore)
{
  const std::optional<CoreOptions> options = parse({});
  ASSERT_TRUE(options.has_value());
  EXPECT_EQ(11311, options->port);
  EXPECT_EQ(-1, options->announce);
  EXPECT_FALSE(options->timeout.has_value());
}

TEST(CoreOptions, TakeWhatRoscoreAndRosmasterTake)
{
  const std::optional<CoreOptions> options =
      parse({"--core", "-p", "0", "-w", "3", "--timeout=2.5", "-v", "--master-logger-level", "debug",
             "--sigint-timeout", "1", "--sigterm-timeout=2", "--announce", "1", "__log:=/tmp/a", "__ip:=127.0.0.2"});
  ASSERT_TRUE(options.has_value());
  EXPECT_EQ(0, options->port);
  EXPECT_EQ(std::chrono::milliseconds(2500), options->timeout);
  EXPECT_TRUE(options->is_verbose);
  EXPECT_EQ(1, options->announce);
  EXPECT_EQ("127.0.0.2", options->host);
  EXPECT_FALSE(parse({"--help"}).has_value());
}

TEST(CoreOptions, NameWhatIsWrong)
{
  const std::vector<std::pair<std::vector<std::string>, std::string>> cases{
      {{"-p", "65536"}, "--port = \"65536\", must be in [0, 65535]"},
      {{"--port", "x"}, "--port = \"x\""},
      {{"-p"}, "needs a value"},
      {{"--timeout", "0"}, "--timeout = \"0\""},
      {{"--timeout", "nan"}, "--timeout = \"nan\""},
      {{"-w", "0"}, "--numworkers = \"0\""},
      {{"--announce", "999"}, "--announce = 999"},
      {{"--nonsense"}, "\"--nonsense\""},
      {{"file.launch"}, "\"file.launch\""},
      {{"a:=b"}, "\"a:=b\""},
  };
  for (const auto& [words, expected] : cases)
  {
    try
    {
      parse(words);
      ADD_FAILURE() << words[0] << " was accepted";
    }
    catch (const std::invalid_argument& error)
    {
      EXPECT_NE(std::string::npos, std::string(error.what()).find(expected)) << error.what();
    }
  }
}

class NetworkAddressTest : public testing::Test
{
protected:
  void SetUp() override
  {
    for (const char* name : {"ROS_HOSTNAME", "ROS_IP", "ROS_IPV6"})
    {
      unsetenv(name);
    }
  }
};

TEST_F(NetworkAddressTest, FollowsTheVariables)
{
  EXPECT_EQ("0.0.0.0", networkAddress().bind);
  EXPECT_FALSE(networkAddress().host.empty());
  setenv("ROS_IP", "10.1.2.3", 1);
  EXPECT_EQ("10.1.2.3", networkAddress().host);
  EXPECT_EQ("0.0.0.0", networkAddress().bind);
  setenv("ROS_HOSTNAME", "localhost", 1);
  EXPECT_EQ("localhost", networkAddress().host);
  EXPECT_EQ("127.0.0.1", networkAddress().bind);
  EXPECT_EQ("127.0.0.9", networkAddress("127.0.0.9").bind);
  setenv("ROS_IPV6", "on", 1);
  EXPECT_EQ("::1", networkAddress().bind);
  EXPECT_EQ("::", networkAddress("robot").bind);
}

TEST_F(NetworkAddressTest, RefusesWhatIsNoHost)
{
  for (const char* wrong : {"", "http://robot", "robot:11311"})
  {
    setenv("ROS_HOSTNAME", wrong, 1);
    try
    {
      networkAddress();
      ADD_FAILURE() << "\"" << wrong << "\" was accepted";
    }
    catch (const std::invalid_argument& error)
    {
      EXPECT_NE(std::string::npos, std::string(error.what()).find("ROS_HOSTNAME")) << error.what();
    }
  }
}

TEST_F(NetworkAddressTest, TakesUrisApart)
{
  EXPECT_EQ("robot", parseHttpUri("http://robot:11311/").host);
  EXPECT_EQ(11311, parseHttpUri("http://robot:11311/").port);
  EXPECT_EQ(80, parseHttpUri("http://robot").port);
  EXPECT_EQ("::1", parseHttpUri("http://[::1]:5/").host);
  EXPECT_EQ(5, parseHttpUri(httpUri("::1", 5)).port);
  for (const char* wrong :
       {"", "robot:1", "https://robot:1/", "http://:1/", "http://robot:x/", "http://robot:0/", "http://robot:70000/"})
  {
    EXPECT_THROW(parseHttpUri(wrong), std::invalid_argument) << wrong;
  }
}

class LogFolderTest : public testing::Test
{
protected:
  void SetUp() override
  {
    std::string name = testing::TempDir() + "log_folder_XXXXXX";
    ASSERT_NE(nullptr, mkdtemp(name.data()));
    root = name;
    unsetenv("ROS_LOG_DIR");
  }
  void TearDown() override { std::filesystem::remove_all(root); }
  std::filesystem::path root;
};

TEST_F(LogFolderTest, LiesWhereRosLooksForIt)
{
  setenv("ROS_HOME", root.c_str(), 1);
  EXPECT_EQ(root / "log" / "run", makeLogFolder("run"));
  setenv("ROS_LOG_DIR", (root / "logs").c_str(), 1);
  EXPECT_EQ(root / "logs" / "run", makeLogFolder("run"));
  EXPECT_EQ(root / "logs" / "run2", makeLogFolder("run2"));
  EXPECT_TRUE(std::filesystem::is_directory(root / "logs" / "run2"));
  EXPECT_EQ(root / "logs" / "run2", std::filesystem::read_symlink(root / "logs" / "latest"));
}

TEST_F(LogFolderTest, NamesWhatIsInTheWay)
{
  setenv("ROS_LOG_DIR", "/proc/nowhere", 1);
  try
  {
    makeLogFolder("run");
    FAIL() << "made a folder in /proc";
  }
  catch (const std::runtime_error& error)
  {
    EXPECT_NE(std::string::npos, std::string(error.what()).find("/proc/nowhere/run")) << error.what();
    EXPECT_NE(std::string::npos, std::string(error.what()).find("ROS_LOG_DIR")) << error.what();
  }
}

TEST(RunId, IsAnotherOneEachTime)
{
  EXPECT_EQ(36U, newRunId().size());
  EXPECT_NE(newRunId(), newRunId());
}

}  // namespace
}  // namespace pi_os_transport
