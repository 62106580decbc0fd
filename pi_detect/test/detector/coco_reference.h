#pragma once

#include <gtest/gtest.h>
#include <pi_detect/detection.h>

#include <algorithm>
#include <cmath>
#include <opencv2/dnn.hpp>
#include <string>

namespace pi_detect
{

/// The recipe of OpenCV's tutorials for SSD MobileNet: what SsdDetector is compared with.
class CocoReference
{
public:
  explicit CocoReference(const std::string& weights) : net_(cv::dnn::readNet(weights)) {}

  /// Boxes are cut at the picture's edge.
  Detections detect(const cv::Mat& picture, float score_threshold)
  {
    net_.setInput(
        cv::dnn::blobFromImage(picture, 1.0 / 127.5, cv::Size(300, 300), cv::Scalar::all(127.5), true, false));
    const cv::Mat output = net_.forward();
    const cv::Mat rows = output.reshape(1, static_cast<int>(output.total() / 7));
    const auto width = static_cast<float>(picture.cols);
    const auto height = static_cast<float>(picture.rows);
    Detections detections;
    for (int i = 0; i < rows.rows; ++i)
    {
      const float* row = rows.ptr<float>(i);
      if (row[2] >= score_threshold)
      {
        const auto x = [&](float part) { return std::clamp(part * width, 0.0F, width); };
        const auto y = [&](float part) { return std::clamp(part * height, 0.0F, height); };
        detections.push_back({static_cast<int>(row[1]), row[2], Box{x(row[3]), y(row[4]), x(row[5]), y(row[6])}});
      }
    }
    return detections;
  }

private:
  cv::dnn::Net net_;
};

/// Every detection has its like in the other list: class, score within 1e-3, corners within 1 px. Those within 1e-3 of
/// the threshold may be missing. @return number of expected ones.
inline size_t compareDetections(const Detections& expected, const Detections& detections, const std::string& picture,
                                float score_threshold = 0.05F)
{
  constexpr float SCORE_TOLERANCE = 1e-3F;
  constexpr float BOX_TOLERANCE = 1.0F;  // [px]
  const auto same = [](const Detection& a, const Detection& b)
  {
    return a.class_id == b.class_id && std::abs(a.score - b.score) <= SCORE_TOLERANCE &&
           std::abs(a.box.x1 - b.box.x1) <= BOX_TOLERANCE && std::abs(a.box.y1 - b.box.y1) <= BOX_TOLERANCE &&
           std::abs(a.box.x2 - b.box.x2) <= BOX_TOLERANCE && std::abs(a.box.y2 - b.box.y2) <= BOX_TOLERANCE;
  };
  const auto allIn = [&](const Detections& wanted, const Detections& all, const char* which)
  {
    for (const Detection& detection : wanted)
    {
      if (detection.score > score_threshold + SCORE_TOLERANCE && detection.box.area() > 0.0F)
      {
        EXPECT_TRUE(std::any_of(all.begin(), all.end(), [&](const Detection& other) { return same(detection, other); }))
            << picture << ": class " << detection.class_id << ", score " << detection.score << " only " << which;
      }
    }
  };
  allIn(expected, detections, "in the reference");
  allIn(detections, expected, "here");
  return expected.size();
}

}  // namespace pi_detect
