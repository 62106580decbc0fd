#include <gtest/gtest.h>
#include <pi_bringup/ros/euroc_bag_writer.h>
#include <rosbag/bag.h>
#include <rosbag/view.h>
#include <sys/resource.h>

#include <csignal>
#include <filesystem>
#include <map>
#include <stdexcept>
#include <string>

#include "tiny_recording.h"

using pi_bringup::BagWriterOptions;
using pi_bringup::BagWriterResult;
using pi_bringup::EurocDataset;
using pi_bringup::writeBag;

namespace fs = std::filesystem;

namespace
{

class EurocToBag : public testing::Test
{
protected:
  EurocToBag() : bag_((folder_.path() / "out" / "tiny.bag").string())
  {
    TinyRecording::write(folder_.path() / "recording");
    fs::create_directory(folder_.path() / "out");
  }

  BagWriterResult write(const BagWriterOptions& options)
  {
    const EurocDataset dataset = EurocDataset::load((folder_.path() / "recording").string());
    return writeBag(dataset, bag_, options, [](size_t, size_t) { return true; });
  }

  bool outputIsEmpty() const { return fs::is_empty(folder_.path() / "out"); }

  TemporaryFolder folder_;
  const std::string bag_;
};

}  // namespace

TEST_F(EurocToBag, KeepsEveryMessageWithItsStampAndContent)
{
  for (const std::string compression : {"none", "lz4", "bz2"})
  {
    BagWriterOptions options;
    options.compression = compression;
    options.overwrite = true;
    const BagWriterResult result = write(options);
    ASSERT_TRUE(result.complete);
    EXPECT_EQ(0U, result.skipped_pictures);

    rosbag::Bag bag(bag_, rosbag::bagmode::Read);
    std::map<std::string, int> counts;
    for (const rosbag::MessageInstance& instance : rosbag::View(bag))
    {
      const std::string& topic = instance.getTopic();
      const int index = counts[topic]++;
      if (const auto image = instance.instantiate<sensor_msgs::Image>())
      {
        const bool left = topic == "/left/image_raw";
        EXPECT_EQ(pi_bringup::toTime(TinyRecording::pictureStamp(index)), image->header.stamp);
        EXPECT_EQ(image->header.stamp, instance.getTime());
        EXPECT_EQ(static_cast<uint32_t>(index), image->header.seq);
        EXPECT_EQ("mono8", image->encoding);
        EXPECT_EQ(left ? "left_optical" : "right_optical", image->header.frame_id);
        EXPECT_EQ(std::vector<uint8_t>(64 * 48, TinyRecording::grey(left, index)), image->data);
      }
      else if (const auto imu = instance.instantiate<sensor_msgs::Imu>())
      {
        EXPECT_EQ(pi_bringup::toTime(TinyRecording::sampleStamp(index)), imu->header.stamp);
        EXPECT_DOUBLE_EQ(0.001 * index, imu->angular_velocity.x);
      }
      else if (const auto odometry = instance.instantiate<nav_msgs::Odometry>())
      {
        EXPECT_NEAR(0.01 * index, odometry->pose.pose.position.x, 1e-12);
      }
      else if (const auto info = instance.instantiate<sensor_msgs::CameraInfo>())
      {
        EXPECT_NEAR(topic == "/left/camera_info" ? 0.0 : -TinyRecording::BASELINE_M * info->P[0], info->P[3], 1e-6);
      }
      else if (const auto transforms = instance.instantiate<tf2_msgs::TFMessage>())
      {
        EXPECT_EQ(3U, transforms->transforms.size());
        EXPECT_EQ("1", (*instance.getConnectionHeader())["latching"]);
      }
    }
    const std::map<std::string, int> expected = {{"/ground_truth/odometry", TinyRecording::SAMPLES},
                                                 {"/imu/data", TinyRecording::SAMPLES},
                                                 {"/left/camera_info", TinyRecording::PICTURES},
                                                 {"/left/image_raw", TinyRecording::PICTURES},
                                                 {"/right/camera_info", TinyRecording::PICTURES},
                                                 {"/right/image_raw", TinyRecording::PICTURES},
                                                 {"/tf_static", 1}};
    EXPECT_EQ(expected, counts) << compression;
  }
}

TEST_F(EurocToBag, PutsTopicsIntoTheNamespaceAndKeepsThePart)
{
  BagWriterOptions options;
  options.topic_prefix = "/euroc/";
  options.timeline.start_at_first_image = true;
  options.timeline.duration_s = 0.1;
  const BagWriterResult result = write(options);
  EXPECT_EQ(2U, result.written.at("/euroc/left/image_raw"));
  EXPECT_EQ(20U, result.written.at("/euroc/imu/data"));
}

TEST_F(EurocToBag, SkipsAndCountsDamagedPictures)
{
  const fs::path picture = folder_.path() / "recording/mav0/cam0/data" / TinyRecording::pictureName(3);
  fs::resize_file(picture, fs::file_size(picture) / 2);
  const BagWriterResult result = write({});
  EXPECT_TRUE(result.complete);
  EXPECT_EQ(1U, result.skipped_pictures);
  EXPECT_NE(std::string::npos, result.first_skip_reason.find(TinyRecording::pictureName(3)));
  EXPECT_EQ(static_cast<size_t>(TinyRecording::PICTURES - 1), result.written.at("/left/image_raw"));
  EXPECT_EQ(static_cast<size_t>(TinyRecording::PICTURES - 1), result.written.at("/left/camera_info"));
}

TEST_F(EurocToBag, DoesNotReplaceAFileUnlessTold)
{
  writeText(bag_, "precious");
  EXPECT_THROW(write({}), std::invalid_argument);
  EXPECT_EQ(8U, fs::file_size(bag_));
  BagWriterOptions options;
  options.overwrite = true;
  EXPECT_TRUE(write(options).complete);
  EXPECT_NO_THROW(rosbag::Bag(bag_, rosbag::bagmode::Read));
}

TEST_F(EurocToBag, LeavesNothingBehindWhenStopped)
{
  const EurocDataset dataset = EurocDataset::load((folder_.path() / "recording").string());
  for (const size_t stop_at : {size_t{0}, size_t{100}})
  {
    const BagWriterResult result =
        writeBag(dataset, bag_, {}, [stop_at](size_t done, size_t) { return done < stop_at; });
    EXPECT_FALSE(result.complete);
    EXPECT_TRUE(outputIsEmpty());
  }
  const BagWriterResult at_the_end =
      writeBag(dataset, bag_, {}, [](size_t done, size_t total) { return done < total; });
  EXPECT_FALSE(at_the_end.complete);
  EXPECT_TRUE(outputIsEmpty());
}

TEST_F(EurocToBag, LeavesNothingBehindWhenItFails)
{
  const EurocDataset dataset = EurocDataset::load((folder_.path() / "recording").string());
  EXPECT_THROW(writeBag(dataset, bag_, {}, [](size_t, size_t) -> bool { throw std::runtime_error("disk full"); }),
               std::runtime_error);
  EXPECT_TRUE(outputIsEmpty());
  EXPECT_THROW(writeBag(dataset, (folder_.path() / "none" / "x.bag").string(), {}, [](size_t, size_t) { return true; }),
               std::runtime_error);
}

TEST_F(EurocToBag, LeavesNothingBehindWhenTheDiskIsFull)
{
  rlimit unlimited = {};
  ASSERT_EQ(0, getrlimit(RLIMIT_FSIZE, &unlimited));
  const auto old_handler = std::signal(SIGXFSZ, SIG_IGN);   // what does not fit then fails as on a full disk
  for (const rlim_t bytes : {rlim_t{4096}, rlim_t{60000}})  // at the first write of the bag, and later
  {
    rlimit full = unlimited;
    full.rlim_cur = bytes;
    ASSERT_EQ(0, setrlimit(RLIMIT_FSIZE, &full));
    std::string error;
    try
    {
      write(BagWriterOptions());
    }
    catch (const std::runtime_error& exception)
    {
      error = exception.what();
    }
    ASSERT_EQ(0, setrlimit(RLIMIT_FSIZE, &unlimited));
    EXPECT_NE(std::string::npos, error.find("tiny.bag.part: cannot be written: ")) << error;
    EXPECT_TRUE(outputIsEmpty());
  }
  std::signal(SIGXFSZ, old_handler);
}

TEST_F(EurocToBag, DoesNotTouchThePartialFileOfAnotherRun)
{
  writeText(bag_ + ".part", "of another run");
  EXPECT_THROW(write({}), std::runtime_error);
  EXPECT_EQ(14U, fs::file_size(bag_ + ".part"));
}

TEST_F(EurocToBag, NamesOptionsOutOfRange)
{
  BagWriterOptions options;
  options.compression = "zip";
  EXPECT_THROW(write(options), std::invalid_argument);
  options = BagWriterOptions();
  options.topic_prefix = "euroc";
  EXPECT_THROW(write(options), std::invalid_argument);
  EXPECT_TRUE(outputIsEmpty());
}
