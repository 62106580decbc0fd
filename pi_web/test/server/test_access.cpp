#include "server/access.h"

#include <gtest/gtest.h>
#include <pi_node/test_support/temporary_folder.h>
#include <sys/stat.h>

#include <fstream>
#include <stdexcept>

namespace pi_web
{
namespace
{

AccessOptions options()
{
  AccessOptions options;
  options.token = "0123456789abcdef";
  options.allow_control = true;
  options.host_names = {"robot.lan"};
  options.web_origins = {"https://app.foxglove.dev"};
  return options;
}

TEST(Access, TokenDecidesAboutControl)
{
  EXPECT_EQ("", accessOf(options(), "/", "localhost:8890", "").refusal);
  EXPECT_FALSE(accessOf(options(), "/", "localhost:8890", "").control);
  EXPECT_TRUE(accessOf(options(), "/?a=1&token=0123456789abcde%66", "127.0.0.1:8890", "").control);
  EXPECT_EQ("wrong token", accessOf(options(), "/?token=0123456789abcdeF", "localhost", "").refusal);
  AccessOptions closed = options();
  closed.token_to_watch = true;
  EXPECT_NE("", accessOf(closed, "/", "localhost", "").refusal);
  closed.token.clear();
  EXPECT_NE("", accessOf(closed, "/?token=", "localhost", "").refusal);
  closed = options();
  closed.allow_control = false;
  EXPECT_FALSE(accessOf(closed, "/?token=0123456789abcdef", "localhost", "").control);
}

TEST(Access, HostMustBeOurs)
{
  for (const char* host : {"localhost", "LOCALHOST:80", "10.0.0.7:8890", "[::1]:8890", "robot.lan:8890"})
  {
    EXPECT_EQ("", accessOf(options(), "/", host, "").refusal) << host;
  }
  for (const char* host : {"", "evil.example", "localhost.evil.example:8890", "10.0.0.7.evil.example", ":8890"})
  {
    EXPECT_NE("", accessOf(options(), "/", host, "").refusal) << host;
  }
}

TEST(Access, PagesFromElsewhereAreRefused)
{
  for (const char* origin : {"", "http://localhost:8890", "https://app.foxglove.dev", "file://", "lichtblick://app"})
  {
    EXPECT_EQ("", accessOf(options(), "/", "localhost:8890", origin).refusal) << origin;
  }
  for (const char* origin : {"null", "http://localhost:9000", "https://evil.example", "http"})
  {
    EXPECT_NE("", accessOf(options(), "/", "localhost:8890", origin).refusal) << origin;
  }
}

TEST(Access, TokenIsMadeOnceAndForItsUserAlone)
{
  const pi_node::test_support::TemporaryFolder folder;
  const std::string path = folder.path() + "/below/token";
  const std::string token = tokenOfFile(path);
  EXPECT_EQ(32u, token.size());
  EXPECT_EQ(token, tokenOfFile(path));
  struct stat status = {};
  ASSERT_EQ(0, stat(path.c_str(), &status));
  EXPECT_EQ(0600u, status.st_mode & 0777u);
  EXPECT_THROW(tokenOfFile("/proc/none/token"), std::runtime_error);
  std::ofstream(folder.path() + "/short") << "abc";
  EXPECT_THROW(tokenOfFile(folder.path() + "/short"), std::runtime_error);
}

}  // namespace
}  // namespace pi_web
