#include <gtest/gtest.h>
#include <pi_bringup/video_reader.h>

#include <opencv2/core.hpp>
#include <opencv2/videoio.hpp>
#include <stdexcept>
#include <string>

#include "tiny_recording.h"

using pi_bringup::Frame;
using pi_bringup::VideoReader;

namespace
{

class VideoFile : public testing::Test
{
protected:
  VideoFile() : file_((folder_.path() / "film.avi").string())
  {
    // OpenCV's own Motion JPEG writer, there in every build.
    cv::VideoWriter writer(file_, cv::CAP_OPENCV_MJPEG, cv::VideoWriter::fourcc('M', 'J', 'P', 'G'), 8.0,
                           cv::Size(64, 48));
    for (int i = 0; i < 5; ++i)
    {
      writer.write(cv::Mat(48, 64, CV_8UC3, cv::Scalar::all(40 * i)));
    }
  }

  TemporaryFolder folder_;
  const std::string file_;
};

std::string error(const std::string& file)
{
  try
  {
    VideoReader reader(file, false);
  }
  catch (const std::runtime_error& exception)
  {
    return exception.what();
  }
  return "";
}

}  // namespace

TEST_F(VideoFile, IsReadInOrderToItsEnd)
{
  VideoReader reader(file_, false);
  EXPECT_EQ(64, reader.width());
  EXPECT_EQ(48, reader.height());
  EXPECT_DOUBLE_EQ(8.0, reader.frameRate());
  for (int i = 0; i < 5; ++i)
  {
    const std::optional<Frame> frame = reader.next();
    ASSERT_TRUE(frame);
    EXPECT_EQ(3, frame->channels);
    ASSERT_EQ(64U * 48U * 3U, frame->pixels.size());
    EXPECT_NEAR(40 * i, frame->pixels[1000], 3);  // JPEG is lossy
  }
  EXPECT_FALSE(reader.next());
}

TEST_F(VideoFile, StartsAgainWhenLooping)
{
  VideoReader reader(file_, true);
  for (int i = 0; i < 12; ++i)
  {
    const std::optional<Frame> frame = reader.next();
    ASSERT_TRUE(frame);
    EXPECT_NEAR(40 * (i % 5), frame->pixels[1000], 3);
  }
}

TEST_F(VideoFile, ErrorsNameTheFileAndTheWayOut)
{
  EXPECT_NE(std::string::npos, error("/none/film.avi").find("/none/film.avi: no such file; install"));
  writeText(folder_.path() / "packed.avi.gz", "x");
  EXPECT_NE(std::string::npos, error((folder_.path() / "packed.avi").string()).find("gunzip"));
  writeText(folder_.path() / "text.avi", "no film");
  EXPECT_NE(std::string::npos, error((folder_.path() / "text.avi").string()).find("cannot open"));
}
