// A network that the runtime cannot interrupt is cut, and gives the same. A program of its own: OpenCV then works in
// pieces for good.

#include <gtest/gtest.h>
#include <pi_detect/detector.h>
#include <pi_runtime/runtime.h>

#include <memory>
#include <opencv2/core.hpp>
#include <opencv2/core/utility.hpp>
#include <opencv2/imgproc.hpp>

namespace pi_detect
{
namespace
{

TEST(CutNetwork, GivesTheSameInShortPieces)
{
  const ModelDescription model = ModelDescription::load(STREET_YAML);
  cv::Mat picture(480, 640, CV_8UC3);
  cv::RNG random(7);
  random.fill(picture, cv::RNG::NORMAL, 110, 20);
  cv::rectangle(picture, cv::Rect(80, 240, 220, 110), cv::Scalar(40, 40, 200), cv::FILLED);
  cv::ellipse(picture, cv::Point(460, 300), cv::Size(25, 90), 0, 0, 360, cv::Scalar(90, 60, 40), cv::FILLED);
  cv::GaussianBlur(picture, picture, cv::Size(5, 5), 0);
  const PictureView view{picture.data, picture.cols, picture.rows, picture.step, PictureView::Format::BGR8};
  DetectorOptions options;
  options.filter.score_threshold = 0.03F;

  Detector plain(model, options, nullptr);
  const Detections expected = plain.detect(view).detections;
  ASSERT_FALSE(expected.empty());

  pi_runtime::RuntimeOptions runtime_options = pi_runtime::RuntimeOptions::forService();
  runtime_options.preemption = false;
  runtime_options.arbitration = false;
  const auto runtime = std::make_shared<pi_runtime::Runtime>(runtime_options);
  Detector cut(model, options, runtime);
  double forward_s = 0.0;
  for (int run = 0; run < 3; ++run)
  {
    const DetectionResult result = cut.detect(view);
    forward_s = result.forward_s;
    ASSERT_EQ(expected.size(), result.detections.size());
    for (size_t i = 0; i < expected.size(); ++i)
    {
      EXPECT_EQ(expected[i].class_id, result.detections[i].class_id);
      EXPECT_EQ(expected[i].score, result.detections[i].score);
      EXPECT_EQ(expected[i].box.x1, result.detections[i].box.x1);
      EXPECT_EQ(expected[i].box.y2, result.detections[i].box.y2);
    }
  }
  const pi_runtime::StageStatus status = cut.stage();
  EXPECT_GT(status.piece_s, 0.0);
  // Processor time of a piece against that of a run: not a matter of who else uses the computer.
  EXPECT_LT(status.piece_s, 0.25 * status.cpu_s / 3.0) << "is not cut: " << 1e3 * forward_s << " ms of network";
}

}  // namespace
}  // namespace pi_detect
