#include "shm/side_channel.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <poll.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>

namespace pi_os_transport
{
namespace
{

using Descriptors = std::array<FileDescriptor, SideChannel::MAX_DESCRIPTORS>;

class SideChannelPair : public ::testing::Test
{
protected:
  void SetUp() override
  {
    name_ = "pi_os_test/" + Token::random().toString();
    listener_ = SideChannel::listen(name_);
    ASSERT_TRUE(static_cast<bool>(listener_));
    client_ = SideChannel::connect(name_);
    ASSERT_TRUE(static_cast<bool>(client_));
    server_ = listener_.accept();
    ASSERT_TRUE(static_cast<bool>(server_));
  }

  std::string name_;
  SideChannel listener_;
  SideChannel client_;
  SideChannel server_;
  Packet packet_;
  Descriptors descriptors_;
};

TEST(Token, ReadsWhatItWrites)
{
  const Token token = Token::random();
  const std::optional<Token> read = Token::fromString(token.toString());
  ASSERT_TRUE(read.has_value());
  EXPECT_TRUE(token == *read);
}

TEST(Token, RefusesAnythingElse)
{
  for (const char* text : {"", "12", "zz345678901234567890123456789012", "123456789012345678901234567890123"})
  {
    EXPECT_FALSE(Token::fromString(text).has_value()) << text;
  }
}

TEST(Token, RefusesWhatScanfWouldTake)
{
  for (const char* text : {" 123456789abcde0123456789abcdef0", "-123456789abcde00123456789abcdef",
                           "0x23456789abcde00123456789abcdef", "0123456789abcdef 123456789abcdef"})
  {
    EXPECT_FALSE(Token::fromString(text).has_value()) << text;
  }
}

TEST(SideChannel, ConnectFindsNobodyUnderAnUnknownName)
{
  EXPECT_FALSE(static_cast<bool>(SideChannel::connect("pi_os_test/" + Token::random().toString())));
}

TEST_F(SideChannelPair, CarriesPacketsAndDescriptors)
{
  int pipe_ends[2];
  ASSERT_EQ(0, pipe(pipe_ends));
  FileDescriptor read_end(pipe_ends[0]);
  FileDescriptor write_end(pipe_ends[1]);
  Packet sent;
  sent.type = Packet::OFFER;
  sent.values = {1, 2, 3};
  ASSERT_TRUE(client_.send(sent, {read_end.get(), write_end.get()}));
  ASSERT_EQ(SideChannel::Receive::PACKET, server_.receive(&packet_, &descriptors_));
  EXPECT_EQ(sent.type, packet_.type);
  EXPECT_EQ(sent.values, packet_.values);
  ASSERT_EQ(1, write(descriptors_[1].get(), "x", 1));
  char byte = 0;
  EXPECT_EQ(1, read(descriptors_[0].get(), &byte, 1));
  EXPECT_NE(0, fcntl(descriptors_[0].get(), F_GETFD) & FD_CLOEXEC);
  EXPECT_EQ(SideChannel::Receive::NOTHING, server_.receive(&packet_, &descriptors_));
}

TEST_F(SideChannelPair, ReportsTheEndOfThePeerAfterItsLastPacket)
{
  Packet sent;
  sent.type = Packet::PROOF;
  ASSERT_TRUE(client_.send(sent));
  client_.close();
  EXPECT_EQ(SideChannel::Receive::PACKET, server_.receive(&packet_, &descriptors_));
  EXPECT_EQ(SideChannel::Receive::CLOSED, server_.receive(&packet_, &descriptors_));
  EXPECT_FALSE(server_.send(sent));
}

TEST_F(SideChannelPair, RefusesAnotherProtocolVersion)
{
  Packet sent;
  sent.version = PROTOCOL_VERSION + 1;
  ASSERT_TRUE(client_.send(sent));
  EXPECT_EQ(SideChannel::Receive::MALFORMED, server_.receive(&packet_, &descriptors_));
}

TEST_F(SideChannelPair, RefusesPacketsOfAnotherSize)
{
  const char oversized[200] = {};
  ASSERT_EQ(200, write(client_.fd(), oversized, sizeof(oversized)));
  EXPECT_EQ(SideChannel::Receive::MALFORMED, server_.receive(&packet_, &descriptors_));
  ASSERT_EQ(3, write(client_.fd(), oversized, 3));
  EXPECT_EQ(SideChannel::Receive::MALFORMED, server_.receive(&packet_, &descriptors_));
}

TEST_F(SideChannelPair, ClosesTheDescriptorsOfAnEmptyPacket)
{
  int pipe_ends[2];
  ASSERT_EQ(0, pipe(pipe_ends));
  FileDescriptor read_end(pipe_ends[0]);
  FileDescriptor write_end(pipe_ends[1]);
  ASSERT_TRUE(client_.sendBytes(nullptr, 0, {write_end.get()}));
  EXPECT_EQ(SideChannel::Receive::CLOSED, server_.receive(&packet_, &descriptors_));
  write_end.reset();
  char byte = 0;
  EXPECT_EQ(0, read(read_end.get(), &byte, 1)) << "somebody still holds the other end";
}

TEST_F(SideChannelPair, RefusesOtherUsers)
{
  if (geteuid() != 0)
  {
    GTEST_SKIP() << "needs root to become another user";
  }
  const pid_t child = fork();
  if (child == 0)
  {
    // Either side must refuse: the connecting one sees our user, we see its.
    _exit(setuid(65534) == 0 && !SideChannel::connect(name_) ? 0 : 1);
  }
  int status = -1;
  waitpid(child, &status, 0);
  EXPECT_EQ(0, status);
  EXPECT_FALSE(static_cast<bool>(listener_.accept()));
}

TEST_F(SideChannelPair, ForkedChildDoesNotKeepTheChannelOpen)
{
  int barrier[2];
  ASSERT_EQ(0, pipe(barrier));
  const pid_t child = fork();
  if (child == 0)
  {
    char byte;
    close(barrier[1]);
    _exit(isForkedChild() && read(barrier[0], &byte, 1) == 0 ? 0 : 1);
  }
  client_.close();
  pollfd readable{server_.fd(), POLLIN, 0};
  EXPECT_EQ(1, poll(&readable, 1, 10000));
  EXPECT_EQ(SideChannel::Receive::CLOSED, server_.receive(&packet_, &descriptors_));
  EXPECT_FALSE(isForkedChild());
  close(barrier[1]);
  int status = -1;
  waitpid(child, &status, 0);
  EXPECT_EQ(0, status);
  close(barrier[0]);
}

}  // namespace
}  // namespace pi_os_transport
