#include "shm/topic_mark.h"

#include <gtest/gtest.h>

#include <string>

namespace pi_os_transport
{
namespace
{

/// The key of SipHash's test vectors: bytes 0 to 15, low word first.
constexpr Token KEY{0x0f0e0d0c0b0a0908, 0x0706050403020100};

/// Bytes 0, 1, 2, ...
std::string counting(size_t length)
{
  std::string text;
  for (size_t i = 0; i < length; ++i)
  {
    text += static_cast<char>(i);
  }
  return text;
}

TEST(TopicMark, IsSipHash)
{
  // Aumasson and Bernstein 2012, appendix A, and the vectors published with it.
  EXPECT_EQ(0xa129ca6149be45e5U, topicMark(KEY, counting(15)));
  EXPECT_EQ(0x726fdb47dd0e0e31U, topicMark(KEY, ""));
  EXPECT_EQ(0x74f839c593dc67fdU, topicMark(KEY, counting(1)));
}

TEST(TopicMark, DependsOnNameAndLink)
{
  EXPECT_NE(topicMark(KEY, "/camera"), topicMark(KEY, "/camerb"));
  EXPECT_NE(topicMark(KEY, "/camera"), topicMark(Token{1, 2}, "/camera"));
}

}  // namespace
}  // namespace pi_os_transport
