#include "pictures/jpeg_encoder.h"

#include <gtest/gtest.h>

#include <random>
#include <stdexcept>

namespace pi_web
{
namespace
{

Bytes image(uint32_t width, uint32_t height, const std::string& encoding, uint32_t step, size_t data)
{
  std::string bytes;
  for (const uint32_t number : {1u, 2u, 3u, 3u})
  {
    appendUint32(number, &bytes);
  }
  bytes += "cam";
  appendUint32(height, &bytes);
  appendUint32(width, &bytes);
  appendUint32(static_cast<uint32_t>(encoding.size()), &bytes);
  bytes += encoding + '\0';
  appendUint32(step, &bytes);
  appendUint32(static_cast<uint32_t>(data), &bytes);
  bytes.append(data, '\x7f');
  return {bytes.begin(), bytes.end()};
}

TEST(JpegEncoder, TakesAllEncodingsAndSizes)
{
  JpegEncoder encoder(320, 70);
  for (const auto& [encoding, pixel] : {std::pair<std::string, uint32_t>("mono8", 1),
                                        {"mono16", 2},
                                        {"bgr8", 3},
                                        {"rgb8", 3},
                                        {"bgra8", 4},
                                        {"rgba8", 4}})
  {
    for (const uint32_t width : {1u, 320u, 641u, 1920u})
    {
      const uint32_t step = width * pixel + 5;
      const Payload jpeg = encoder.encode(image(width, 41, encoding, step, step * 41));
      const std::string text(jpeg->begin(), jpeg->end());
      EXPECT_NE(std::string::npos, text.find("jpeg " + std::to_string(width) + "x41")) << encoding;
      EXPECT_NE(std::string::npos, text.find("\xff\xd8\xff"));
      EXPECT_LT(text.size(), 12000u);
    }
  }
}

TEST(JpegEncoder, RefusesWhatIsNoPicture)
{
  JpegEncoder encoder(320, 70);
  EXPECT_THROW(encoder.encode(image(10, 10, "bayer_rggb8", 10, 100)), std::invalid_argument);
  EXPECT_THROW(encoder.encode(image(10, 10, "bgr8", 29, 1000)), std::invalid_argument);
  EXPECT_THROW(encoder.encode(image(10, 10, "bgr8", 30, 299)), std::invalid_argument);
  EXPECT_THROW(encoder.encode(image(0, 10, "mono8", 0, 0)), std::invalid_argument);
  EXPECT_THROW(encoder.encode(image(4294967295u, 2, "mono8", 4294967295u, 8)), std::invalid_argument);
  const Bytes whole = image(8, 8, "mono8", 8, 64);
  for (size_t length = 0; length < whole.size(); ++length)
  {
    EXPECT_THROW(encoder.encode(Bytes(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(length))),
                 std::invalid_argument);
  }
}

TEST(JpegEncoder, GarbageIsRefusedAndNothingElse)
{
  JpegEncoder encoder(16, 70);
  const Bytes whole = image(33, 20, "bgr8", 99, 1980);
  std::mt19937 random(3);
  for (int round = 0; round < 20000; ++round)
  {
    Bytes bytes = whole;
    for (uint32_t change = random() % 4 + 1; change > 0; --change)
    {
      bytes[random() % 46] = static_cast<uint8_t>(random());
    }
    try
    {
      EXPECT_TRUE(encoder.encode(bytes));
    }
    catch (const std::invalid_argument&)
    {
      // the usual outcome
    }
  }
}

}  // namespace
}  // namespace pi_web
