#include "payload_pattern.h"

#include <gtest/gtest.h>

#include <cstring>
#include <stdexcept>
#include <vector>

namespace pi_os_transport_bench
{
namespace
{
std::vector<std::uint8_t> filled(const PayloadPattern& pattern, std::size_t size, std::uint64_t key)
{
  std::vector<std::uint8_t> payload(size);
  pattern.fillBody(payload.data(), size, key);
  return payload;
}

const std::vector<std::size_t> SIZES = {
    MIN_PAYLOAD_SIZE, 64, 1000, 64 * 1024 + sizeof(PayloadHeader), 64 * 1024 + sizeof(PayloadHeader) + 3, 200001};

TEST(PayloadPattern, AcceptsWhatItFilled)
{
  const PayloadPattern pattern;
  for (const std::size_t size : SIZES)
  {
    const auto payload = filled(pattern, size, 7);
    EXPECT_FALSE(pattern.findWrongByte(payload.data(), size, 7)) << size;
    for (std::uint64_t sequence = 0; sequence < 50; ++sequence)
    {
      EXPECT_FALSE(pattern.findWrongSample(payload.data(), size, 7, sequence)) << size;
    }
  }
}

TEST(PayloadPattern, NamesEverySingleWrongByte)
{
  const PayloadPattern pattern;
  const std::size_t size = 64 * 1024 + 500;  // two blocks, the second short
  auto payload = filled(pattern, size, 1);
  for (std::size_t i = sizeof(PayloadHeader); i < size; i += i < 64 * 1024 ? 97 : 1)
  {
    payload[i] ^= 1;
    const auto wrong = pattern.findWrongByte(payload.data(), size, 1);
    ASSERT_TRUE(wrong) << i;
    EXPECT_EQ(i, *wrong);
    payload[i] ^= 1;
  }
}

TEST(PayloadPattern, RejectsAnotherMessagesBody)
{
  const PayloadPattern pattern;
  for (const std::size_t size : SIZES)
  {
    const auto payload = filled(pattern, size, 1);
    EXPECT_TRUE(pattern.findWrongByte(payload.data(), size, 2)) << size;
    EXPECT_TRUE(pattern.findWrongSample(payload.data(), size, 2, 0)) << size;
  }
}

TEST(PayloadPattern, RejectsSwappedBlocks)
{
  const PayloadPattern pattern;
  const std::size_t block = 64 * 1024;
  const std::size_t size = sizeof(PayloadHeader) + 2 * block;
  auto payload = filled(pattern, size, 1);
  std::vector<std::uint8_t> swapped(payload);
  std::memcpy(swapped.data() + sizeof(PayloadHeader), payload.data() + sizeof(PayloadHeader) + block, block);
  std::memcpy(swapped.data() + sizeof(PayloadHeader) + block, payload.data() + sizeof(PayloadHeader), block);
  EXPECT_TRUE(pattern.findWrongByte(swapped.data(), size, 1));
}

TEST(PayloadPattern, SamplesFindAPageOfAnotherMessage)
{
  const PayloadPattern pattern;
  const std::size_t size = 1000000;
  auto payload = filled(pattern, size, 1);
  const auto other = filled(pattern, size, 2);
  std::memcpy(payload.data() + size / 2, other.data() + size / 2, size / 4);
  int found = 0;
  for (std::uint64_t sequence = 0; sequence < 20; ++sequence)
  {
    found += pattern.findWrongSample(payload.data(), size, 1, sequence).has_value();
  }
  EXPECT_EQ(20, found);  // a quarter of the bytes escapes 64 random samples with probability 1e-8
}

TEST(PayloadPattern, RefusesPayloadsWithoutRoomForABody)
{
  const PayloadPattern pattern;
  std::vector<std::uint8_t> payload(MIN_PAYLOAD_SIZE);
  EXPECT_THROW(pattern.fillBody(payload.data(), MIN_PAYLOAD_SIZE - 1, 0), std::invalid_argument);
  EXPECT_THROW(pattern.findWrongByte(payload.data(), 0, 0), std::invalid_argument);
}

TEST(ShapeImage, IsFullHdWhereTheSizeIs)
{
  sensor_msgs::Image image;
  shapeImage(&image, 6220800);
  EXPECT_EQ(1920U, image.width);
  EXPECT_EQ(1080U, image.height);
  EXPECT_FALSE(findWrongField(image, 6220800));
  shapeImage(&image, 64);
  EXPECT_FALSE(findWrongField(image, 64));
}

TEST(ShapeImage, AFieldOfAnotherImageIsFound)
{
  sensor_msgs::Image image;
  shapeImage(&image, 1000);
  EXPECT_TRUE(findWrongField(image, 1001));
  image.encoding = "rgb8";
  EXPECT_TRUE(findWrongField(image, 1000));
}
}  // namespace
}  // namespace pi_os_transport_bench

int main(int argc, char** argv)
{
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
