#include "master/http_reader.h"

#include <gtest/gtest.h>

#include <string>
#include <vector>

namespace pi_os_transport
{
namespace
{

using Kind = HttpReader::Kind;
using State = HttpReader::State;

const std::string POST = "POST /RPC2 HTTP/1.1\r\nHost: a\r\ncontent-length: 5\r\n\r\nhello";
const std::string CHUNKED =
    "HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\n3;x=y\r\nhel\r\n2\r\nlo\r\n0\r\nTrailer: x\r\n\r\n";

TEST(HttpReader, ReadsARequestHoweverItIsCut)
{
  for (size_t part = 1; part <= POST.size(); ++part)
  {
    HttpReader reader(Kind::REQUEST);
    for (size_t at = 0; at < POST.size(); at += part)
    {
      const std::string bytes = POST.substr(at, part);
      EXPECT_EQ(bytes.size(), reader.feed(bytes));
    }
    ASSERT_EQ(State::DONE, reader.state()) << part;
    EXPECT_EQ("POST", reader.method());
    EXPECT_EQ("/RPC2", reader.target());
    EXPECT_EQ("hello", reader.body());
    EXPECT_TRUE(reader.keepsAlive());
  }
}

TEST(HttpReader, LeavesTheNextMessage)
{
  HttpReader reader(Kind::REQUEST);
  EXPECT_EQ(POST.size(), reader.feed(POST + POST));
  reader.reset();
  EXPECT_FALSE(reader.hasBegun());
  EXPECT_EQ(POST.size() + 2, reader.feed("\r\n" + POST));
  EXPECT_EQ("hello", reader.body());
}

TEST(HttpReader, ReadsChunks)
{
  for (size_t part = 1; part <= CHUNKED.size(); ++part)
  {
    HttpReader reader(Kind::RESPONSE);
    for (size_t at = 0; at < CHUNKED.size(); at += part)
    {
      reader.feed(CHUNKED.substr(at, part));
    }
    ASSERT_EQ(State::DONE, reader.state()) << part << reader.problem();
    EXPECT_EQ(200, reader.status());
    EXPECT_EQ("hello", reader.body());
  }
}

TEST(HttpReader, EndsAnAnswerWithItsConnection)
{
  HttpReader reader(Kind::RESPONSE);
  reader.feed("HTTP/1.0 200 OK\r\n\r\nhello");
  EXPECT_EQ(State::READING, reader.state());
  reader.feedEnd();
  EXPECT_EQ(State::DONE, reader.state());
  EXPECT_EQ("hello", reader.body());
  EXPECT_FALSE(reader.keepsAlive());
}

TEST(HttpReader, SkipsInterimAnswers)
{
  HttpReader reader(Kind::RESPONSE);
  reader.feed("HTTP/1.1 100 Continue\r\n\r\nHTTP/1.1 200 OK\r\nContent-Length: 1\r\n\r\nx");
  EXPECT_EQ(State::DONE, reader.state());
  EXPECT_EQ(200, reader.status());
  EXPECT_EQ("x", reader.body());
}

TEST(HttpReader, KnowsWhetherTheConnectionStays)
{
  const auto keeps = [](const std::string& version, const std::string& header)
  {
    HttpReader reader(Kind::REQUEST);
    reader.feed("POST / HTTP/" + version + "\r\nContent-Length: 0\r\n" + header + "\r\n");
    EXPECT_EQ(State::DONE, reader.state());
    return reader.keepsAlive();
  };
  EXPECT_TRUE(keeps("1.1", ""));
  EXPECT_FALSE(keeps("1.1", "Connection: close\r\n"));
  EXPECT_FALSE(keeps("1.0", ""));
  EXPECT_TRUE(keeps("1.0", "connection: Keep-Alive\r\n"));
}

TEST(HttpReader, TellsWhatIsWrong)
{
  struct Case
  {
    std::string bytes;
    int status;
  };
  HttpLimits limits;
  limits.head_bytes = 200;
  limits.body_bytes = 10;
  const std::vector<Case> cases{
      {"nonsense\r\n", 400},
      {"POST / HTTP/2\r\n", 400},
      {"POST / HTTP/1.1\r\nno colon\r\n", 400},
      {"POST / HTTP/1.1\r\n\r\n", 411},
      {"POST / HTTP/1.1\r\nContent-Length: -1\r\n", 400},
      {"POST / HTTP/1.1\r\nContent-Length: 5x\r\n", 400},
      {"POST / HTTP/1.1\r\nContent-Length: 99999999999999999999\r\n", 400},
      {"POST / HTTP/1.1\r\nContent-Length: 5\r\nContent-Length: 6\r\n", 400},
      {"POST / HTTP/1.1\r\nContent-Length: 11\r\n\r\n", 413},
      {"POST / HTTP/1.1\r\nContent-Encoding: gzip\r\n", 415},
      {"POST / HTTP/1.1\r\nTransfer-Encoding: gzip\r\n", 400},
      {"POST / HTTP/1.1\r\nTransfer-Encoding: chunked\r\n\r\nz\r\n", 400},
      {"POST / HTTP/1.1\r\nTransfer-Encoding: chunked\r\n\r\n2\r\nabc\r\n", 400},
      {"POST / HTTP/1.1\r\nTransfer-Encoding: chunked\r\n\r\nb\r\n01234567890\r\n", 413},
      {std::string(201, 'x'), 431},
      {"POST / HTTP/1.1\r\nA: " + std::string(200, 'x'), 431},
  };
  for (const Case& one : cases)
  {
    HttpReader reader(Kind::REQUEST, limits);
    reader.feed(one.bytes);
    EXPECT_EQ(State::FAILED, reader.state()) << one.bytes;
    EXPECT_EQ(one.status, reader.status()) << one.bytes;
    EXPECT_FALSE(reader.problem().empty());
  }
  HttpReader cut(Kind::RESPONSE);
  cut.feed("HTTP/1.1 200 OK\r\nContent-Length: 5\r\n\r\nhe");
  cut.feedEnd();
  EXPECT_EQ(State::FAILED, cut.state());
}

}  // namespace
}  // namespace pi_os_transport
