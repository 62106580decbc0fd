#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

namespace pi_slam
{

constexpr int LEFT = 0;
constexpr int RIGHT = 1;

/// One landmark as a pair of pictures shows it.
struct FeatureObservation
{
  int64_t id = 0;                 ///< of the landmark, the same in every pair; never used again
  bool seen[2] = {false, false};  ///< by the left and the right camera; one at least
  Eigen::Vector2f pixel[2] = {Eigen::Vector2f::Zero(), Eigen::Vector2f::Zero()};  ///< as the lens shows it [px]
  /// Unit vectors in the cameras' frames, without distortion.
  Eigen::Vector3d bearing[2] = {Eigen::Vector3d::Zero(), Eigen::Vector3d::Zero()};
  uint32_t age = 0;  ///< pairs before this one in which it was seen in a row
};

/// What the front end saw in one pair of pictures.
struct FrameFeatures
{
  int64_t stamp_ns = 0;
  std::vector<FeatureObservation> features;  ///< by increasing id
};

}  // namespace pi_slam
