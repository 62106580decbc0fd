// Networks on an OpenCL device through OpenCV. Where there is no GPU, on PoCL's CPU device, which OpenCV must be
// allowed to use by the environment, read when it is loaded: the test starts itself again with that.

#include <gtest/gtest.h>
#include <pi_detect/detector.h>
#include <pi_node/test_support/temporary_folder.h>
#include <pi_runtime/runtime.h>
#include <unistd.h>

#include <cmath>
#include <cstdlib>
#include <memory>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <string>

#include "detector/tiny_network.h"

namespace pi_detect
{

using namespace pi_node::test_support;
namespace
{

PictureView viewOf(const cv::Mat& picture)
{
  return PictureView{picture.data, picture.cols, picture.rows, picture.step, PictureView::Format::BGR8};
}

/// Something with edges and colours; no network finds much in it, but low scores say enough.
cv::Mat streetLikePicture()
{
  cv::Mat picture(480, 640, CV_8UC3);
  cv::RNG random(7);
  random.fill(picture, cv::RNG::NORMAL, 110, 20);
  cv::rectangle(picture, cv::Rect(0, 0, 640, 200), cv::Scalar(220, 180, 140), cv::FILLED);
  cv::rectangle(picture, cv::Rect(80, 240, 220, 110), cv::Scalar(40, 40, 200), cv::FILLED);
  cv::circle(picture, cv::Point(120, 350), 28, cv::Scalar::all(20), cv::FILLED);
  cv::circle(picture, cv::Point(260, 350), 28, cv::Scalar::all(20), cv::FILLED);
  cv::ellipse(picture, cv::Point(460, 300), cv::Size(25, 90), 0, 0, 360, cv::Scalar(90, 60, 40), cv::FILLED);
  cv::circle(picture, cv::Point(460, 195), 18, cv::Scalar(150, 170, 210), cv::FILLED);
  cv::GaussianBlur(picture, picture, cv::Size(5, 5), 0);
  return picture;
}

/// Both lists hold the same objects, in any order of equal scores.
void expectSame(const Detections& expected, const Detections& detections, float score_tolerance, float box_tolerance)
{
  ASSERT_EQ(expected.size(), detections.size());
  for (const Detection& detection : expected)
  {
    bool found = false;
    for (const Detection& other : detections)
    {
      found = found ||
              (other.class_id == detection.class_id && std::abs(other.score - detection.score) <= score_tolerance &&
               std::abs(other.box.x1 - detection.box.x1) <= box_tolerance &&
               std::abs(other.box.y2 - detection.box.y2) <= box_tolerance);
    }
    EXPECT_TRUE(found) << "class " << detection.class_id << ", score " << detection.score;
  }
}

class OpenClTarget : public testing::TestWithParam<Target>
{
protected:
  void SetUp() override
  {
    const TargetInUse target = findTarget(GetParam());
    if (target.used != GetParam())
    {
      GTEST_SKIP() << target.reason;
    }
  }

  /// Runs a model on the CPU and on the target.
  void compare(const ModelDescription& model, float least_score, const cv::Mat& picture)
  {
    const bool half = GetParam() == Target::OPENCL_FP16;
    DetectorOptions options;
    options.filter.score_threshold = least_score;
    Detector cpu(model, options, nullptr);
    options.target = GetParam();
    options.require_target = true;
    const auto runtime = std::make_shared<pi_runtime::Runtime>();
    Detector device(model, options, runtime);
    EXPECT_EQ(GetParam(), device.target().used);
    EXPECT_FALSE(device.target().device.empty());
    const Detections expected = cpu.detect(viewOf(picture)).detections;
    ASSERT_FALSE(expected.empty());
    expectSame(expected, device.detect(viewOf(picture)).detections, half ? 0.02F : 1e-3F, half ? 4.0F : 1.0F);
  }
};

INSTANTIATE_TEST_SUITE_P(OfEachKind, OpenClTarget, testing::Values(Target::OPENCL, Target::OPENCL_FP16),
                         [](const auto& parameter) { return std::string(toString(parameter.param)); });

TEST_P(OpenClTarget, GivesTheDetectionsOfTheCpuWithDetectionOutput)
{
  const TemporaryFolder folder;
  cv::Mat picture(48, 64, CV_8UC3, cv::Scalar::all(0));
  picture(cv::Rect(16, 24, 16, 12)) = cv::Scalar::all(255);
  compare(ModelDescription::load(writeTinyNetwork(folder.path())), 0.5F, picture);
}

TEST_P(OpenClTarget, GivesTheDetectionsOfTheCpuWithTheOwnNetwork)
{
  compare(ModelDescription::load(STREET_YAML), 0.03F, streetLikePicture());
}

}  // namespace
}  // namespace pi_detect

int main(int argc, char** argv)
{
  constexpr char ALLOW[] = "OPENCV_DNN_OPENCL_ALLOW_ALL_DEVICES";
  if (std::getenv(ALLOW) == nullptr)
  {
    setenv(ALLOW, "1", 1);
    setenv("OPENCV_OPENCL_DEVICE", ":CPU:", 0);
    execv("/proc/self/exe", argv);
  }
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
