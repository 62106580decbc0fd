#include "roscpp/topics/numbered_message.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <optional>
#include <vector>

#include "pi_os_transport/little_endian.h"
#include "shm/ring_sender.h"

namespace pi_os_transport
{
namespace
{

using Bytes = std::vector<uint8_t>;

const Token LINK{0x0102030405060708, 0x1112131415161718};

Bytes contentOf(const ros::SerializedMessage& message)
{
  return Bytes(message.message_start, message.buf.get() + message.num_bytes);
}

/// The message as the subscriber gets it: without its length.
ros::SerializedMessage received(const Bytes& bytes)
{
  const boost::shared_array<uint8_t> buffer(new uint8_t[bytes.size()]);
  std::copy(bytes.begin(), bytes.end(), buffer.get());
  return ros::SerializedMessage(buffer, bytes.size());
}

TEST(NumberedMessage, ReachesTheSubscriberAsItWas)
{
  for (const Bytes& bytes : {Bytes{}, Bytes{7}, Bytes(1000, 3)})
  {
    const ros::SerializedMessage sent = numberedMessage(LINK, 4000000000U, bytes.data(), bytes.size());
    EXPECT_EQ(sent.num_bytes - LENGTH_PREFIX, loadLittleEndian<uint32_t>(sent.buf.get()));
    ros::SerializedMessage message = received(contentOf(sent));
    EXPECT_EQ(4000000000U, takeNumber(LINK, 0, &message));
    EXPECT_EQ(bytes, contentOf(message));
    EXPECT_EQ(std::nullopt, takeNumber(LINK, 0, &message));
  }
}

TEST(NumberedMessage, CanBeTakenOutOfThePublishersQueue)
{
  const Bytes bytes{1, 2, 3};
  ros::SerializedMessage message = numberedMessage(LINK, 5, bytes.data(), bytes.size());
  EXPECT_EQ(5U, takeNumber(LINK, LENGTH_PREFIX, &message));
  EXPECT_EQ(bytes, contentOf(message));
  EXPECT_EQ(bytes.size() + LENGTH_PREFIX, message.num_bytes);
  EXPECT_EQ(bytes.size(), loadLittleEndian<uint32_t>(message.buf.get()));
}

TEST(NumberedMessage, LeavesOtherMessagesAlone)
{
  const Bytes numbered = contentOf(numberedMessage(LINK, 5, nullptr, 0));
  const Bytes short_by_one(numbered.begin(), numbered.end() - 1);
  for (const Bytes& bytes : {Bytes{}, Bytes{1}, short_by_one, Bytes(100, 0)})
  {
    ros::SerializedMessage message = received(bytes);
    EXPECT_EQ(std::nullopt, takeNumber(LINK, 0, &message));
    EXPECT_EQ(std::nullopt, takeNumber(Token(), 0, &message)) << "a link without a token has no numbers";
    EXPECT_EQ(bytes, contentOf(message));
  }
  ros::SerializedMessage of_another_link = received(numbered);
  EXPECT_EQ(std::nullopt, takeNumber(Token{LINK.high, 1}, 0, &of_another_link));
  EXPECT_EQ(numbered, contentOf(of_another_link));
}

}  // namespace
}  // namespace pi_os_transport
