// cv::Mat, cv_bridge and PCL over zero-copy messages: nothing is copied, and what is shared lives long enough.

#include "pi_os_transport/zero_copy/shared_image.h"

#include <cv_bridge/cv_bridge.h>
#include <gtest/gtest.h>
#include <pcl/point_types.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/PointCloud2.h>
#include <sensor_msgs/image_encodings.h>

#include <boost/make_shared.hpp>

#include <opencv2/imgproc.hpp>

#include <cstdint>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "pi_os_transport/zero_copy/cv_bridge.h"
#include "pi_os_transport/zero_copy/image_subscriber.h"
#include "pi_os_transport/zero_copy/loan.h"
#include "pi_os_transport/zero_copy/point_cloud.h"
#include "pi_os_transport/zero_copy/statistics.h"
#include "pi_os_transport/zero_copy/subscriber.h"

namespace pi_os_transport::zero_copy
{
namespace
{

/// What a subscriber in this process gets.
template <typename M>
ConstPtr<M> deliver(const Loan<M>& loan)
{
  expectMessagesToHold();
  TopicCounters counters("test", true);
  const ros::SerializedMessage message = loan.serialise(&counters);
  return receive<Message<M>>(message.message_start, static_cast<uint32_t>(message.num_bytes - 4), &counters);
}

ConstPtr<sensor_msgs::Image> deliverImage(int rows, int cols, const std::string& encoding, const cv::Scalar& colour)
{
  auto loan = Loan<sensor_msgs::Image>::borrow();
  resizeImage(loan.get(), rows, cols, encoding).setTo(colour);
  loan->header.frame_id = "camera";
  loan->header.stamp = ros::Time(7, 8);
  return deliver(loan);
}

TEST(SharedImage, EncodingsHaveTheTypesOfCvBridge)
{
  for (const char* encoding : {"mono8",  "mono16", "bgr8",        "rgb8",         "bgra8",  "rgba8", "bgr16", "rgb16",
                               "bgra16", "rgba16", "bayer_rggb8", "bayer_gbrg16", "yuv422", "8UC1",  "8UC3",  "8SC2",
                               "16UC1",  "16SC1",  "32SC1",       "32FC1",        "32FC3",  "64FC1", "64FC4"})
  {
    EXPECT_EQ(cv_bridge::getCvType(encoding), matType(encoding)) << encoding;
  }
  EXPECT_THROW(matType("feather"), std::runtime_error);
  EXPECT_THROW(matType(""), std::runtime_error);
}

TEST(SharedImage, IsDrawnInTheLoanAndReadFromIt)
{
  auto loan = Loan<sensor_msgs::Image>::borrow();
  cv::Mat drawn = resizeImage(loan.get(), 480, 640, "bgr8");
  drawn.setTo(cv::Scalar(1, 2, 3));
  EXPECT_EQ(loan->data.data(), drawn.data);
  const ConstPtr<sensor_msgs::Image> image = deliver(loan);
  const cv::Mat shared = shareMat(image);
  EXPECT_EQ(drawn.data, shared.data);
  EXPECT_EQ(cv::Vec3b(1, 2, 3), shared.at<cv::Vec3b>(479, 639));
}

TEST(SharedImage, LivesAsLongAsAnyPartOfTheMatrix)
{
  ConstPtr<sensor_msgs::Image> image = deliverImage(480, 640, "mono8", 9);
  const boost::weak_ptr<const void> watch = image;
  cv::Mat whole = shareMat(image);
  image.reset();
  cv::Mat part = whole(cv::Rect(10, 10, 20, 20));
  whole.release();
  EXPECT_FALSE(watch.expired());
  EXPECT_EQ(400, cv::countNonZero(part == 9));
  const cv::Mat copy = part.clone();
  part.release();
  EXPECT_TRUE(watch.expired());
  EXPECT_EQ(400, cv::countNonZero(copy == 9));
}

TEST(SharedImage, RefusesWhatIsNoImage)
{
  const auto image = boost::make_shared<sensor_msgs::Image>();
  image->encoding = "mono8";
  image->width = 100;
  image->height = 10;
  image->step = 100;
  image->data.resize(999);
  EXPECT_THROW(matOver(*image), std::runtime_error);
  image->data.resize(1000);
  EXPECT_NO_THROW(matOver(*image));
  image->step = 99;
  EXPECT_THROW(matOver(*image), std::runtime_error);
  EXPECT_THROW(resizeImage(image.get(), -1, 5, "mono8"), std::runtime_error);
}

TEST(SharedImage, RefusesWhatNoMatrixCanBe)
{
  const auto image = boost::make_shared<sensor_msgs::Image>();
  image->encoding = "mono16";
  image->width = 4;
  image->height = 2;
  image->step = 9;  // a pixel would lie at an odd address
  image->data.resize(100);
  EXPECT_THROW(matOver(*image), std::runtime_error);
  image->step = 10;
  EXPECT_NO_THROW(matOver(*image));
  for (const char* encoding : {"8UC-3", "8UC513"})
  {
    image->encoding = encoding;
    EXPECT_THROW(matOver(*image), std::runtime_error) << encoding;
  }
  image->encoding = "mono8";
  image->width = 0;
  image->height = 0x80000001;
  image->step = 0;
  EXPECT_THROW(matOver(*image), std::runtime_error);
  image->height = 0x40000000;
  EXPECT_EQ(0, matOver(*image).rows);
}

TEST(SharedImage, AStandardImageIsSharedAndKept)
{
  auto standard = boost::make_shared<sensor_msgs::Image>();
  resizeImage(standard.get(), 48, 64, "mono8").setTo(5);
  standard->header.frame_id = "camera";
  const uint8_t* const data = standard->data.data();
  const boost::weak_ptr<const void> watch = standard;
  ImageHandle handle = toHandle(standard);
  standard.reset();
  EXPECT_EQ(data, handle->data.data());
  EXPECT_EQ("camera", handle->header.frame_id);
  EXPECT_EQ(48U * 64U, handle->data.size());
  EXPECT_FALSE(watch.expired());
  handle.reset();
  EXPECT_TRUE(watch.expired());
}

TEST(SharedImage, AStandardImageIsFoundAgain)
{
  const auto standard = boost::make_shared<sensor_msgs::Image>();
  EXPECT_EQ(standard, standardOf(toHandle(standard)));
  EXPECT_EQ(nullptr, standardOf(deliverImage(48, 64, "mono8", 5)));
  EXPECT_EQ(nullptr, standardOf(nullptr));
}

TEST(SharedImage, AnEmptyStandardImageIsNoError)
{
  EXPECT_TRUE(toHandle(boost::make_shared<sensor_msgs::Image>())->data.empty());
}

TEST(CvBridge, SharesWithoutConversion)
{
  const ConstPtr<sensor_msgs::Image> image = deliverImage(480, 640, "bgr8", cv::Scalar(1, 2, 3));
  const cv_bridge::CvImageConstPtr shared = toCvShare(image);
  EXPECT_EQ(image->data.data(), shared->image.data);
  EXPECT_EQ("bgr8", shared->encoding);
  EXPECT_EQ("camera", shared->header.frame_id);
  EXPECT_EQ(ros::Time(7, 8), shared->header.stamp);
  EXPECT_EQ(image->data.data(), toCvShare(image, "bgr8")->image.data);
}

TEST(CvBridge, OutlivesTheMessage)
{
  ConstPtr<sensor_msgs::Image> image = deliverImage(480, 640, "mono8", 9);
  const boost::weak_ptr<const void> watch = image;
  cv_bridge::CvImageConstPtr shared = toCvShare(image);
  image.reset();
  EXPECT_EQ(480 * 640, cv::countNonZero(shared->image == 9));
  shared.reset();
  EXPECT_TRUE(watch.expired());
}

TEST(CvBridge, ConvertsOnDemand)
{
  const ConstPtr<sensor_msgs::Image> image = deliverImage(48, 64, "bgr8", cv::Scalar(1, 2, 3));
  const cv_bridge::CvImageConstPtr converted = toCvShare(image, "rgb8");
  EXPECT_NE(image->data.data(), converted->image.data);
  EXPECT_EQ(cv::Vec3b(3, 2, 1), converted->image.at<cv::Vec3b>(0, 0));
}

TEST(CvBridge, TurnsTheByteOrderOfOtherMachines)
{
  const auto image = boost::make_shared<sensor_msgs::Image>();
  resizeImage(image.get(), 2, 2, "mono16").setTo(0x1234);
  image->is_bigendian = 1;
  const cv_bridge::CvImageConstPtr shared = toCvShare(sensor_msgs::ImageConstPtr(image));
  EXPECT_EQ(0x3412, shared->image.at<uint16_t>(0, 0));
}

TEST(PointCloud, PointsAreWrittenInTheLoanAndReadFromIt)
{
  auto loan = Loan<sensor_msgs::PointCloud2>::borrow();
  auto* const points = resizePoints<pcl::PointXYZI>(loan.get(), 640, 480);
  for (uint32_t i = 0; i < 640 * 480; ++i)
  {
    points[i].x = static_cast<float>(i);
    points[i].intensity = 1.0F;
  }
  ConstPtr<sensor_msgs::PointCloud2> cloud = deliver(loan);
  std::optional<SharedPoints<pcl::PointXYZI>> shared = sharePoints<pcl::PointXYZI>(cloud);
  ASSERT_TRUE(shared);
  EXPECT_EQ(points, shared->begin());
  const boost::weak_ptr<const void> watch = cloud;
  cloud.reset();
  loan.reset();
  EXPECT_EQ(640U, shared->width());
  EXPECT_EQ(640U * 480U, shared->size());
  EXPECT_EQ(1000.0F, (*shared)[1000].x);
  shared.reset();
  EXPECT_TRUE(watch.expired());
}

TEST(PointCloud, PointsOfAnotherLayoutAreCopied)
{
  auto loan = Loan<sensor_msgs::PointCloud2>::borrow();
  auto* const points = resizePoints<pcl::PointXYZI>(loan.get(), 100, 1);
  for (int i = 0; i < 100; ++i)
  {
    points[i].getVector3fMap() << static_cast<float>(i), 2.0F, 3.0F;
  }
  const ConstPtr<sensor_msgs::PointCloud2> cloud = deliver(loan);
  EXPECT_FALSE(sharePoints<pcl::PointXYZ>(cloud));
  const pcl::PointCloud<pcl::PointXYZ> copied = copyPoints<pcl::PointXYZ>(*cloud);
  ASSERT_EQ(100U, copied.size());
  EXPECT_EQ(42.0F, copied[42].x);
  EXPECT_EQ(3.0F, copied[42].z);
}

TEST(PointCloud, RefusesACloudWithoutItsData)
{
  auto loan = Loan<sensor_msgs::PointCloud2>::borrow();
  resizePoints<pcl::PointXYZ>(loan.get(), 100, 10);
  loan->data.resize(15999);
  const ConstPtr<sensor_msgs::PointCloud2> cloud = deliver(loan);
  EXPECT_THROW(sharePoints<pcl::PointXYZ>(cloud), std::runtime_error);
  EXPECT_THROW(copyPoints<pcl::PointXYZ>(*cloud), std::runtime_error);
}

TEST(PointCloud, DataBehindTheLastPointIsNotCopied)
{
  auto loan = Loan<sensor_msgs::PointCloud2>::borrow();
  auto* const points = resizePoints<pcl::PointXYZ>(loan.get(), 100, 1);
  points[99].x = 7.0F;
  loan->data.resize(100000);
  const pcl::PointCloud<pcl::PointXYZ> copied = copyPoints<pcl::PointXYZ>(*deliver(loan));
  ASSERT_EQ(100U, copied.size());
  EXPECT_EQ(7.0F, copied[99].x);
}

TEST(PointCloud, RefusesFieldsOutsideOfTheirPoint)
{
  for (const uint32_t offset : {13U, 16U, 0xfffffff8U})
  {
    auto loan = Loan<sensor_msgs::PointCloud2>::borrow();
    resizePoints<pcl::PointXYZ>(loan.get(), 100, 1);
    loan->fields[2].offset = offset;
    const ConstPtr<sensor_msgs::PointCloud2> cloud = deliver(loan);
    EXPECT_FALSE(sharePoints<pcl::PointXYZ>(cloud));
    EXPECT_THROW(copyPoints<pcl::PointXYZ>(*cloud), std::runtime_error) << offset;
  }
}

TEST(PointCloud, AnEmptyCloudIsNoError)
{
  EXPECT_TRUE(copyPoints<pcl::PointXYZ>(Message<sensor_msgs::PointCloud2>()).empty());
}

}  // namespace
}  // namespace pi_os_transport::zero_copy
