#include <pi_detect/picture_motion.h>

#include <algorithm>
#include <cmath>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/video/tracking.hpp>

namespace pi_detect
{
namespace
{

// Sizes are in pixels of the reduced picture. Reducing costs accuracy that boxes of a detector do not have: 0.1 px of
// 768 at the median (vtest.avi, a pan of 200 px/s).
constexpr int REDUCED_WIDTH = 320;
constexpr int CORNERS = 150;             // many, as they also lie on things that move
constexpr double CORNER_DISTANCE = 8.0;  // half of the window of the flow: neighbours would see the same
constexpr double CORNER_QUALITY = 0.01;  // OpenCV's example
constexpr int FLOW_WINDOW = 15;
constexpr int PYRAMID_LEVELS = 3;   // reaches half a window of the smallest level: 60 px
constexpr double AGREEMENT = 1.5;   // with the motion of the others; the rest of parallax and noise
constexpr int LEAST_AGREEING = 12;  // three times as many as the motion has parameters
constexpr double LEAST_PART = 0.5;  // of the corners: most of what is seen

cv::Mat toGrey(const PictureView& picture, double scale)
{
  const int type = picture.format == PictureView::Format::MONO8 ? CV_8UC1 : CV_8UC3;
  const cv::Mat whole(picture.height, picture.width, type, const_cast<uint8_t*>(picture.data), picture.stride);
  cv::Mat reduced;
  cv::resize(whole, reduced, cv::Size(), scale, scale, cv::INTER_AREA);
  if (type == CV_8UC1)
  {
    return reduced;
  }
  cv::Mat grey;
  cv::cvtColor(reduced, grey, picture.format == PictureView::Format::RGB8 ? cv::COLOR_RGB2GRAY : cv::COLOR_BGR2GRAY);
  return grey;
}

}  // namespace

PictureMotion PictureMotionEstimator::update(const PictureView& picture, const std::vector<Box>& moving, bool wanted)
{
  const cv::Mat before = last_;
  const double scale = std::min(1.0, static_cast<double>(REDUCED_WIDTH) / picture.width);
  last_ = toGrey(picture, scale);
  const bool same_camera = before.size() == last_.size() && scale == scale_;
  scale_ = scale;
  if (!wanted || before.empty() || !same_camera)
  {
    return nullptr;
  }
  cv::Mat still(before.size(), CV_8UC1, cv::Scalar::all(255.0));
  for (const Box& box : moving)
  {
    cv::rectangle(still, cv::Point(static_cast<int>(box.x1 * scale), static_cast<int>(box.y1 * scale)),
                  cv::Point(static_cast<int>(box.x2 * scale), static_cast<int>(box.y2 * scale)), cv::Scalar::all(0.0),
                  cv::FILLED);
  }
  std::vector<cv::Point2f> corners;
  cv::goodFeaturesToTrack(before, corners, CORNERS, CORNER_QUALITY, CORNER_DISTANCE, still);
  if (static_cast<int>(corners.size()) < LEAST_AGREEING)
  {
    return nullptr;
  }
  std::vector<cv::Point2f> moved;
  std::vector<uint8_t> found;
  cv::calcOpticalFlowPyrLK(before, last_, corners, moved, found, cv::noArray(), cv::Size(FLOW_WINDOW, FLOW_WINDOW),
                           PYRAMID_LEVELS);
  std::vector<cv::Point2f> from;
  std::vector<cv::Point2f> to;
  for (size_t i = 0; i < corners.size(); ++i)
  {
    if (found[i] != 0)
    {
      from.push_back(corners[i]);
      to.push_back(moved[i]);
    }
  }
  std::vector<uint8_t> agrees;
  const cv::Mat motion = static_cast<int>(from.size()) < LEAST_AGREEING
                             ? cv::Mat()
                             : cv::estimateAffinePartial2D(from, to, agrees, cv::RANSAC, AGREEMENT);
  const auto agreeing = std::count(agrees.begin(), agrees.end(), 1);
  if (motion.empty() || agreeing < LEAST_AGREEING ||
      static_cast<double>(agreeing) < LEAST_PART * static_cast<double>(from.size()))
  {
    return nullptr;
  }
  Eigen::Matrix2d A;
  A << motion.at<double>(0, 0), motion.at<double>(0, 1), motion.at<double>(1, 0), motion.at<double>(1, 1);
  const Eigen::Vector2d b = Eigen::Vector2d(motion.at<double>(0, 2), motion.at<double>(1, 2)) / scale;
  return [A, b](const Eigen::Vector2d& point) -> Eigen::Vector2d { return A * point + b; };
}

}  // namespace pi_detect
