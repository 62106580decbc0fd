#include "evaluation/bag_reader.h"

#include <gtest/gtest.h>
#include <pi_node/test_support/message_of.h>
#include <pi_node/test_support/temporary_folder.h>
#include <rosbag/bag.h>
#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/Imu.h>
#include <sensor_msgs/image_encodings.h>
#include <std_msgs/String.h>

#include <algorithm>
#include <opencv2/imgcodecs.hpp>
#include <vector>

#include "evaluation/read_all.h"

namespace
{

using namespace pi_slam;
using pi_node::test_support::messageOf;
using pi_node::test_support::TemporaryFolder;

ros::Time timeOf(int64_t stamp_ns)
{
  ros::Time time;
  return time.fromNSec(static_cast<uint64_t>(stamp_ns));
}

sensor_msgs::Image picture(int64_t stamp_ns, uint8_t grey, const std::string& encoding = "mono8")
{
  sensor_msgs::Image image;
  image.header.stamp = timeOf(stamp_ns);
  image.width = 64;
  image.height = 48;
  image.encoding = encoding;
  image.step = encoding == "mono8" ? 64 : 192;
  image.data.assign(image.step * image.height, grey);
  return image;
}

sensor_msgs::Imu sample(int64_t stamp_ns)
{
  sensor_msgs::Imu imu;
  imu.header.stamp = timeOf(stamp_ns);
  imu.angular_velocity.y = 0.5;
  imu.linear_acceleration.z = 9.75;
  return imu;
}

/// A bag that is written message by message, each received a little after its stamp.
class BagFile
{
public:
  BagFile() : path_(folder_.path() + "/drive.bag") { bag_.open(path_, rosbag::bagmode::Write); }

  template <typename Message>
  void write(const std::string& topic, const Message& message, int64_t late_ns = 1000000)
  {
    bag_.write(topic, message.header.stamp + ros::Duration().fromNSec(late_ns), message);
  }

  /// Pairs from one frame to another on the given topics, and the IMU from 20 samples before to as many after.
  void writeDrive(int pairs, const std::string& left = "/left/image_raw", const std::string& right = "/right/image_raw",
                  const std::string& imu = "/imu/data")
  {
    for (int i = 0; i < pairs; ++i)
    {
      write(left, picture(START_NS + i * FRAME_NS, static_cast<uint8_t>(10 + i)), 8000000);
      write(right, picture(START_NS + i * FRAME_NS, static_cast<uint8_t>(110 + i)), 9000000);
    }
    for (int i = -20; i < 10 * pairs + 20; ++i)
    {
      write(imu, sample(START_NS + i * IMU_NS));
    }
  }

  std::string close()
  {
    bag_.close();
    return path_;
  }

private:
  TemporaryFolder folder_;
  std::string path_;
  rosbag::Bag bag_;
};

TEST(BagReader, HandsOutSamplesAndPairsInOrderOfTheirStamps)
{
  BagFile file;
  file.writeDrive(6);
  const auto source = openBag(file.close());
  EXPECT_EQ(source->description().pairs, 6u);
  EXPECT_EQ(source->description().first_ns, START_NS);
  EXPECT_EQ(source->description().name, "drive.bag");
  const Content content = readAll(source.get());
  ASSERT_EQ(content.pairs.size(), 6u);
  EXPECT_EQ(content.samples.size(), 100u);
  EXPECT_TRUE(std::is_sorted(content.order_ns.begin(), content.order_ns.end()));
  EXPECT_EQ(content.pairs[3].left.at<uint8_t>(5, 5), 13);
  EXPECT_EQ(content.pairs[3].right.at<uint8_t>(5, 5), 113);
  EXPECT_DOUBLE_EQ(content.samples[50].f.z(), 9.75);
  EXPECT_DOUBLE_EQ(content.samples[50].w.y(), 0.5);
  EXPECT_FALSE(source->defects().any());
}

TEST(BagReader, FindsTheTopicsOfEurocBagsAndOfNamespaces)
{
  BagFile euroc;
  euroc.writeDrive(2, "/cam0/image_raw", "/cam1/image_raw", "/imu0");
  EXPECT_EQ(readAll(openBag(euroc.close()).get()).pairs.size(), 2u);
  BagFile named;
  named.writeDrive(2, "/robot/camera/left/image_raw", "/robot/camera/right/image_raw", "/robot/imu/data");
  EXPECT_EQ(readAll(openBag(named.close()).get()).pairs.size(), 2u);
}

TEST(BagReader, TakesTheTopicsThatAreNamed)
{
  BagFile file;
  file.writeDrive(3);
  file.writeDrive(2, "/a", "/b", "/c");
  BagTopics topics;
  topics.left = "/a";
  topics.right = "/b";
  topics.imu = "/c";
  EXPECT_EQ(readAll(openBag(file.close(), topics).get()).pairs.size(), 2u);
}

TEST(BagReader, NamesTheTopicsThereAreIfOneIsMissing)
{
  BagFile file;
  file.writeDrive(1, "/first", "/second", "/imu/data");
  const std::string path = file.close();
  const std::string unnamed = messageOf<RecordingError>([&] { openBag(path); });
  EXPECT_NE(unnamed.find("say which of /first, /second by --left-topic"), std::string::npos) << unnamed;
  BagTopics topics;
  topics.left = "/imu/data";
  const std::string wrong_type = messageOf<RecordingError>([&] { openBag(path, topics); });
  EXPECT_NE(wrong_type.find("has no topic /imu/data of pictures; there are: /first, /second"), std::string::npos)
      << wrong_type;
}

TEST(BagReader, RefusesTopicsThatAreAmbiguous)
{
  BagFile file;
  file.writeDrive(1, "/front/left/image_raw", "/front/right/image_raw");
  file.writeDrive(1, "/rear/left/image_raw", "/rear/right/image_raw");
  const std::string path = file.close();
  EXPECT_NE(messageOf<RecordingError>([&] { openBag(path); }).find("several topics may be the left one"),
            std::string::npos);
}

TEST(BagReader, RefusesFilesThatAreNoBag)
{
  const TemporaryFolder folder;
  const std::string file = folder.file("no.bag", "this is no bag");
  EXPECT_NE(messageOf<RecordingError>([&] { openBag(file); }).find("no.bag: is no bag"), std::string::npos);
  EXPECT_THROW(openBag("/nowhere.bag"), RecordingError);
}

TEST(BagReader, DecodesCompressedAndColouredPictures)
{
  BagFile file;
  sensor_msgs::CompressedImage compressed;
  compressed.header.stamp = timeOf(START_NS);
  compressed.format = "png";
  cv::imencode(".png", cv::Mat(48, 64, CV_8UC1, cv::Scalar(42)), compressed.data);
  file.write("/left/image_raw/compressed", compressed);
  file.write("/right/image_raw", picture(START_NS, 77, "bgr8"));
  file.write("/imu/data", sample(START_NS));
  const Content content = readAll(openBag(file.close()).get());
  ASSERT_EQ(content.pairs.size(), 1u);
  EXPECT_EQ(content.pairs[0].left.at<uint8_t>(1, 1), 42);
  EXPECT_EQ(content.pairs[0].right.at<uint8_t>(1, 1), 77);
  EXPECT_EQ(content.pairs[0].right.type(), CV_8UC1);
}

TEST(BagReader, HandsOutAPairWithOnePictureMissingOrDamaged)
{
  BagFile file;
  file.writeDrive(3);
  file.write("/left/image_raw", picture(START_NS + 3 * FRAME_NS, 1));
  file.write("/right/image_raw", picture(START_NS + 4 * FRAME_NS, 2));
  file.write("/left/image_raw", picture(START_NS + 5 * FRAME_NS, 3));
  file.write("/right/image_raw", picture(START_NS + 5 * FRAME_NS, 4, "nonsense8"));
  const auto source = openBag(file.close());
  const Content content = readAll(source.get());
  ASSERT_EQ(content.pairs.size(), 6u);
  EXPECT_TRUE(content.pairs[3].right.empty());
  EXPECT_TRUE(content.pairs[4].left.empty());
  EXPECT_FALSE(content.pairs[5].left.empty());
  EXPECT_TRUE(content.pairs[5].right.empty());
  EXPECT_EQ(source->defects().single, 3u);
  EXPECT_EQ(source->defects().unreadable, 1u);
  EXPECT_NE(source->defects().first.find("/right/image_raw"), std::string::npos);
}

TEST(BagReader, WaitsForAStreamThatLags)
{
  BagFile file;
  for (int i = 0; i < 60; ++i)
  {
    file.write("/left/image_raw", picture(START_NS + i * FRAME_NS, 1), 800000000);
    file.write("/right/image_raw", picture(START_NS + i * FRAME_NS, 2), 300000000);
    file.write("/imu/data", sample(START_NS + i * FRAME_NS + 1));
  }
  const auto source = openBag(file.close());
  const Content content = readAll(source.get());
  EXPECT_EQ(content.pairs.size(), 60u);
  EXPECT_EQ(content.samples.size(), 60u);
  EXPECT_TRUE(std::is_sorted(content.order_ns.begin(), content.order_ns.end()));
  EXPECT_FALSE(source->defects().any());
}

TEST(BagReader, LeavesOutWhatIsOutOfOrderWithinItsStream)
{
  BagFile file;
  file.writeDrive(60);
  file.write("/imu/data", sample(START_NS + 4 * IMU_NS + 1000), 400000000);
  file.write("/imu/data", sample(START_NS + 6 * IMU_NS + 1000), 2400000000);
  file.write("/left/image_raw", picture(START_NS + 10 * FRAME_NS + 20000000, 1), 2400000000);
  const auto source = openBag(file.close());
  const Content content = readAll(source.get());
  EXPECT_TRUE(std::is_sorted(content.order_ns.begin(), content.order_ns.end()));
  EXPECT_EQ(source->defects().unsorted, 3u);
  EXPECT_EQ(content.pairs.size(), 60u);
}

TEST(BagReader, GoesOnWhereOneCameraEnds)
{
  BagFile file;
  file.writeDrive(2);
  for (int i = 2; i < 60; ++i)
  {
    file.write("/left/image_raw", picture(START_NS + i * FRAME_NS, 5));
    file.write("/imu/data", sample(START_NS + i * FRAME_NS + 1));
  }
  const auto source = openBag(file.close());
  const Content content = readAll(source.get());
  EXPECT_EQ(content.pairs.size(), 60u);
  EXPECT_EQ(source->defects().single, 58u);
  EXPECT_TRUE(std::is_sorted(content.order_ns.begin(), content.order_ns.end()));
}

TEST(BagReader, CutsThePartThatIsAskedFor)
{
  BagFile file;
  file.writeDrive(100);
  SequenceReaderOptions options;
  options.start_s = 2.0;
  options.duration_s = 1.0;
  const auto source = openBag(file.close(), {}, options);
  const Content content = readAll(source.get());
  ASSERT_EQ(content.pairs.size(), 21u);
  EXPECT_EQ(content.pairs.front().stamp_ns, START_NS + 2000000000);
  EXPECT_EQ(content.samples.front().stamp_ns, START_NS + 1000000000);
  EXPECT_EQ(content.samples.back().stamp_ns, START_NS + 4000000000);
  EXPECT_NEAR(static_cast<double>(source->description().pairs), 21.0, 1.0);
  EXPECT_EQ(source->description().first_ns, START_NS + 2000000000);
}

TEST(BagReader, RefusesAStartBehindTheEnd)
{
  BagFile file;
  file.writeDrive(10);
  SequenceReaderOptions options;
  options.start_s = 60.0;
  const std::string path = file.close();
  EXPECT_NE(messageOf<RecordingError>([&] { openBag(path, {}, options); }).find("has no picture from 60"),
            std::string::npos);
}

}  // namespace
