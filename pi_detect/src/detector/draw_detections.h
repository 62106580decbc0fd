#pragma once

#include <pi_detect/detection.h>

#include <functional>
#include <map>
#include <opencv2/core/mat.hpp>
#include <opencv2/core/types.hpp>
#include <string>

namespace pi_detect
{

/// A colour that stays with a number (a class, a track) and differs from its neighbours'. BGR, 0 to 255.
cv::Scalar colourOf(int number);

/// Draws boxes with class and score, the best on top. @param labels by class id. @param picture CV_8UC3, BGR.
/// @param prefix  of a detection's caption; null: none.
void drawDetections(const Detections& detections, const std::map<int, std::string>& labels, cv::Mat* picture,
                    const std::function<std::string(const Detection&)>& prefix = nullptr);

}  // namespace pi_detect
