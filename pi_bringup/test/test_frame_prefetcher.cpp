#include <gtest/gtest.h>
#include <pi_bringup/frame_prefetcher.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <stdexcept>
#include <string>

#include "tiny_recording.h"

using pi_bringup::decodeGreyImage;
using pi_bringup::Frame;
using pi_bringup::FramePrefetcher;

namespace
{

class DecodeGreyImage : public testing::Test
{
protected:
  DecodeGreyImage() : file_((folder_.path() / "picture.png").string())
  {
    cv::Mat picture(48, 64, CV_8UC1);
    cv::randu(picture, 0, 256);  // noise: a cut in the middle then leaves out rows
    cv::imwrite(file_, picture);
    cv::imwrite((folder_.path() / "wide.png").string(), cv::Mat::zeros(48, 65, CV_8UC1));
    picture_ = picture;
  }

  TemporaryFolder folder_;
  const std::string file_;
  cv::Mat picture_;
};

std::string errorOf(const std::string& path)
{
  return decodeGreyImage(path, 64, 48).error;
}

Frame numbered(int number)
{
  Frame frame;
  frame.width = number;
  return frame;
}

}  // namespace

TEST_F(DecodeGreyImage, GivesEveryPixel)
{
  const Frame frame = decodeGreyImage(file_, 64, 48);
  ASSERT_EQ("", frame.error);
  EXPECT_EQ(64, frame.width);
  EXPECT_EQ(48, frame.height);
  EXPECT_EQ(1, frame.channels);
  ASSERT_EQ(picture_.total(), frame.pixels.size());
  EXPECT_TRUE(std::equal(frame.pixels.begin(), frame.pixels.end(), picture_.datastart));
}

TEST_F(DecodeGreyImage, NamesAFileThatIsCutShort)
{
  const auto size = std::filesystem::file_size(file_);
  for (const auto kept : {size - 1, size / 2, size / 4, std::uintmax_t{20}, std::uintmax_t{5}})
  {
    std::filesystem::resize_file(file_, kept);
    const std::string error = errorOf(file_);
    EXPECT_NE(std::string::npos, error.find(file_ + ": truncated")) << error;
    EXPECT_TRUE(decodeGreyImage(file_, 64, 48).pixels.empty());
  }
}

TEST_F(DecodeGreyImage, NamesAFileWithDamagedData)
{
  std::fstream file(file_, std::ios::in | std::ios::out | std::ios::binary);
  file.seekp(static_cast<std::streamoff>(std::filesystem::file_size(file_) / 2));
  file.write("damaged damaged damaged", 23);
  file.close();
  EXPECT_NE(std::string::npos, errorOf(file_).find(file_));
}

TEST_F(DecodeGreyImage, NamesWhatIsNoPictureMissingOrOfAnotherSize)
{
  writeText(folder_.path() / "text.png", "no picture");
  writeText(folder_.path() / "empty.png", "");
  EXPECT_NE(std::string::npos, errorOf((folder_.path() / "text.png").string()).find("not a picture"));
  EXPECT_NE(std::string::npos, errorOf((folder_.path() / "empty.png").string()).find("not a picture"));
  EXPECT_NE(std::string::npos, errorOf((folder_.path() / "none.png").string()).find("cannot be opened"));
  EXPECT_NE(std::string::npos, errorOf((folder_.path() / "wide.png").string()).find("65x48"));
}

TEST(FramePrefetcher, HandsOutInOrderUntilTheEnd)
{
  int produced = 0;
  FramePrefetcher prefetcher([&]() -> std::optional<Frame>
                             { return produced == 100 ? std::nullopt : std::optional<Frame>(numbered(produced++)); },
                             4);
  for (int i = 0; i < 100; ++i)
  {
    const std::optional<Frame> frame = prefetcher.next();
    ASSERT_TRUE(frame);
    EXPECT_EQ(i, frame->width);
  }
  EXPECT_FALSE(prefetcher.next());
  EXPECT_FALSE(prefetcher.next());
}

TEST(FramePrefetcher, StopEndsAnEndlessProducer)
{
  int produced = 0;
  FramePrefetcher prefetcher([&]() -> std::optional<Frame> { return numbered(produced++); }, 2);
  ASSERT_TRUE(prefetcher.next());
  prefetcher.stop();
  // At most one taken out, two in the queue and one in the producer's hands.
  EXPECT_LE(produced, 4);
}

TEST(FramePrefetcher, TurnsAnExceptionIntoAFrameWithAnError)
{
  FramePrefetcher prefetcher([]() -> std::optional<Frame> { throw std::runtime_error("disk gone"); }, 2);
  const std::optional<Frame> frame = prefetcher.next();
  ASSERT_TRUE(frame);
  EXPECT_EQ("disk gone", frame->error);
  EXPECT_FALSE(prefetcher.next());
}
