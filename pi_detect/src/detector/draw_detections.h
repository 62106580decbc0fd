#pragma once

#include <pi_detect/detection.h>

#include <map>
#include <opencv2/core/mat.hpp>
#include <opencv2/core/types.hpp>
#include <string>

namespace pi_detect
{

/// A colour that stays with a number (a class, a track) and differs from its neighbours'. BGR, 0 to 255.
cv::Scalar colourOf(int number);

/// Draws a box with a caption on a plate of its colour, above the box or, at the upper edge, inside. @param picture
/// CV_8UC3.
void drawBox(const Box& box, const std::string& caption, const cv::Scalar& colour, cv::Mat* picture);

/// Draws boxes with class and score. @param labels by class id. @param picture CV_8UC3, BGR.
void drawDetections(const Detections& detections, const std::map<int, std::string>& labels, cv::Mat* picture);

}  // namespace pi_detect
