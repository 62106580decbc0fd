#include "detector/draw_detections.h"

#include <pi_node/formatting.h>

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

namespace pi_detect
{
namespace
{

constexpr double GOLDEN_ANGLE_DEG = 137.508;  // consecutive hues far from each other

/// With a caption on a plate of its colour, above the box or, at the upper edge, inside.
void drawBox(const Box& box, const std::string& caption, const cv::Scalar& colour, cv::Mat* picture)
{
  // Readable on a picture of any size.
  const double scale = std::clamp(picture->rows / 1000.0, 0.4, 1.5);
  const int thickness = std::max(1, cvRound(2.0 * scale));
  const cv::Rect rectangle(cv::Point(cvRound(box.x1), cvRound(box.y1)), cv::Point(cvRound(box.x2), cvRound(box.y2)));
  cv::rectangle(*picture, rectangle, colour, thickness);
  if (caption.empty())
  {
    return;
  }
  int below = 0;
  const cv::Size text = cv::getTextSize(caption, cv::FONT_HERSHEY_SIMPLEX, scale, 1, &below);
  const int plate = text.height + below + 2;
  const int top = rectangle.y >= plate ? rectangle.y - plate : rectangle.y;
  const int left = std::clamp(rectangle.x, 0, std::max(0, picture->cols - text.width - 2));
  cv::rectangle(*picture, cv::Rect(left, top, text.width + 2, plate), colour, cv::FILLED);
  cv::putText(*picture, caption, cv::Point(left + 1, top + text.height + 1), cv::FONT_HERSHEY_SIMPLEX, scale,
              cv::Scalar::all(0), 1, cv::LINE_AA);
}

}  // namespace

cv::Scalar colourOf(int number)
{
  const double hue = std::fmod(std::abs(number) * GOLDEN_ANGLE_DEG, 360.0);
  cv::Mat pixel(1, 1, CV_32FC3, cv::Scalar(hue, 0.75, 1.0));
  cv::cvtColor(pixel, pixel, cv::COLOR_HSV2BGR);
  const auto colour = pixel.at<cv::Vec3f>(0, 0);
  return {255.0 * colour[0], 255.0 * colour[1], 255.0 * colour[2]};
}

void drawDetections(const Detections& detections, const std::map<int, std::string>& labels, cv::Mat* picture,
                    const std::function<std::string(const Detection&)>& prefix)
{
  for (auto detection = detections.rbegin(); detection != detections.rend(); ++detection)
  {
    const auto label = labels.find(detection->class_id);
    drawBox(detection->box,
            (prefix ? prefix(*detection) : "") +
                (label == labels.end() ? std::to_string(detection->class_id) : label->second) +
                pi_node::format(" %.2f", detection->score),
            colourOf(detection->class_id), picture);
  }
}

}  // namespace pi_detect
