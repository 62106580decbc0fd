#pragma once

#include <gtest/gtest.h>
#include <pi_detect/detection.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <opencv2/dnn.hpp>
#include <opencv2/imgproc.hpp>
#include <string>
#include <utility>
#include <vector>

namespace pi_detect
{

/// What Detector is compared with: a network as OpenCV's and its authors' examples run it.
class Reference
{
public:
  virtual ~Reference() = default;
  /// Boxes are cut at the picture's edge.
  virtual Detections detect(const cv::Mat& picture, float score_threshold) = 0;
};

/// The recipe of OpenCV's tutorials for SSD MobileNet.
class SsdReference : public Reference
{
public:
  explicit SsdReference(const std::string& weights) : net_(cv::dnn::readNet(weights)) {}

  Detections detect(const cv::Mat& picture, float score_threshold) override
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

/// A box of a cell with the scores of all classes, on its way to detections.
struct ScoredBox
{
  cv::Rect2d box;  ///< [px of the input]
  cv::Mat scores;  ///< a row
};

/// Best class of each box, suppression per class by OpenCV, and back to the picture by its one scale.
inline Detections detectionsOf(const std::vector<ScoredBox>& boxes, double ratio, float score_threshold,
                               float overlap_threshold, cv::Size picture)
{
  std::map<int, std::pair<std::vector<cv::Rect2d>, std::vector<float>>> by_class;
  for (const ScoredBox& one : boxes)
  {
    double score = 0.0;
    cv::Point place;
    cv::minMaxLoc(one.scores, nullptr, &score, nullptr, &place);
    if (score >= score_threshold)
    {
      by_class[place.x].first.push_back(one.box);
      by_class[place.x].second.push_back(static_cast<float>(score));
    }
  }
  Detections detections;
  for (const auto& [id, list] : by_class)
  {
    std::vector<int> kept;
    cv::dnn::NMSBoxes(list.first, list.second, score_threshold, overlap_threshold, kept);
    for (const int index : kept)
    {
      const cv::Rect2d& box = list.first[static_cast<size_t>(index)];
      const auto x = [&](double value)
      { return static_cast<float>(std::clamp(value / ratio, 0.0, 1.0 * picture.width)); };
      const auto y = [&](double value)
      { return static_cast<float>(std::clamp(value / ratio, 0.0, 1.0 * picture.height)); };
      detections.push_back({id, list.second[static_cast<size_t>(index)],
                            Box{x(box.x), y(box.y), x(box.x + box.width), y(box.y + box.height)}});
    }
  }
  return detections;
}

/// The picture at the top left of a square.
inline cv::Mat letterbox(const cv::Mat& picture, int side, int level, double* ratio)
{
  *ratio = std::min(static_cast<double>(side) / picture.cols, static_cast<double>(side) / picture.rows);
  cv::Mat resized;
  cv::resize(picture, resized,
             cv::Size(static_cast<int>(picture.cols * *ratio), static_cast<int>(picture.rows * *ratio)));
  cv::Mat square(side, side, CV_8UC3, cv::Scalar::all(level));
  resized.copyTo(square(cv::Rect(0, 0, resized.cols, resized.rows)));
  return square;
}

/// YOLOX-nano after the demo of its project, with suppression at 0.5.
class YoloxReference : public Reference
{
public:
  explicit YoloxReference(const std::string& weights) : net_(cv::dnn::readNet(weights)) {}

  Detections detect(const cv::Mat& picture, float score_threshold) override
  {
    constexpr int SIDE = 416;
    double ratio = 0.0;
    net_.setInput(cv::dnn::blobFromImage(letterbox(picture, SIDE, 114, &ratio)));
    const cv::Mat output = net_.forward();
    const cv::Mat rows = output.reshape(1, output.size[1]);
    std::vector<ScoredBox> boxes;
    int cell = 0;
    for (const int stride : {8, 16, 32})
    {
      for (int i = 0; i < SIDE / stride * (SIDE / stride); ++i, ++cell)
      {
        const float* row = rows.ptr<float>(cell);
        const double width = std::exp(row[2]) * stride;
        const double height = std::exp(row[3]) * stride;
        const double x = (row[0] + static_cast<float>(i % (SIDE / stride))) * stride;
        const double y = (row[1] + static_cast<float>(i / (SIDE / stride))) * stride;
        boxes.push_back({cv::Rect2d(x - width / 2, y - height / 2, width, height),
                         cv::Mat(rows(cv::Rect(5, cell, rows.cols - 5, 1)) * row[4])});
      }
    }
    return detectionsOf(boxes, ratio, score_threshold, 0.5F, picture.size());
  }

private:
  cv::dnn::Net net_;
};

/// NanoDet-m after the demo of its project, with the picture at the top left.
class NanoDetReference : public Reference
{
public:
  explicit NanoDetReference(const std::string& weights) : net_(cv::dnn::readNet(weights)) {}

  Detections detect(const cv::Mat& picture, float score_threshold) override
  {
    constexpr int SIDE = 320;
    constexpr int BINS = 8;
    double ratio = 0.0;
    cv::Mat input;
    letterbox(picture, SIDE, 0, &ratio).convertTo(input, CV_32FC3);
    cv::subtract(input, cv::Scalar(103.53, 116.28, 123.675), input);
    cv::divide(input, cv::Scalar(57.375, 57.12, 58.395), input);
    net_.setInput(cv::dnn::blobFromImage(input));
    std::vector<cv::Mat> outputs;
    net_.forward(outputs, net_.getUnconnectedOutLayersNames());
    const auto find = [&](int rows, int columns)
    {
      return *std::find_if(outputs.begin(), outputs.end(),
                           [&](const cv::Mat& output) { return output.rows == rows && output.cols == columns; });
    };
    std::vector<ScoredBox> boxes;
    for (const int stride : {8, 16, 32})
    {
      const int side = SIDE / stride;
      const cv::Mat scores = find(side * side, 80);
      const cv::Mat distances = find(side * side, 4 * BINS);
      for (int cell = 0; cell < side * side; ++cell)
      {
        double distance[4];
        for (int k = 0; k < 4; ++k)
        {
          cv::Mat weights;
          cv::exp(distances(cv::Rect(k * BINS, cell, BINS, 1)), weights);
          const cv::Mat steps = (cv::Mat_<float>(1, BINS) << 0, 1, 2, 3, 4, 5, 6, 7);
          distance[k] = weights.dot(steps) / cv::sum(weights)[0] * stride;
        }
        const double x = (cell % side + 0.5) * stride;
        const double y = (cell / side + 0.5) * stride;
        boxes.push_back(
            {cv::Rect2d(x - distance[0], y - distance[1], distance[0] + distance[2], distance[1] + distance[3]),
             scores.row(cell)});
      }
    }
    return detectionsOf(boxes, ratio, score_threshold, 0.6F, picture.size());
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
