#pragma once

#include <pi_detect/stereo_obstacles.h>

#include <Eigen/Geometry>
#include <cstdint>
#include <opencv2/core/mat.hpp>
#include <string>
#include <vector>

namespace pi_detect::bench
{

/// An object that a rendered recording knows.
struct TrueObject
{
  int id = 0;
  std::string class_name;
  Box box;                   ///< around its visible pixels
  Eigen::Vector3d position;  ///< centre, in the body frame [m]
  Eigen::Vector3d velocity;  ///< over the ground, in body axes [m/s]
  Eigen::Vector3d size;      ///< along its own axes [m]
  double heading = 0.0;      ///< of its x axis, in the body frame [rad]
};

struct Pair
{
  int64_t stamp_ns = 0;
  cv::Mat left;   ///< rectified
  cv::Mat right;  ///< rectified
  cv::Mat depth;  ///< CV_32FC1 [m], 0: none; empty if the recording has no truth
  Eigen::Isometry3d T_world_body = Eigen::Isometry3d::Identity();
  std::vector<TrueObject> objects;
};

/// An EuRoC folder, by render_sequence (with --depth --obstacle-truth) or real.
class Recording
{
public:
  /// @throws std::runtime_error naming what cannot be read.
  explicit Recording(const std::string& folder);

  const StereoGeometry& geometry() const { return geometry_; }
  /// Rectified left optical frame in the body.
  const Eigen::Isometry3d& T_body_left() const { return T_body_left_; }
  bool hasTruth() const { return has_truth_; }
  size_t size() const { return stamps_.size(); }
  double seconds() const;
  Pair read(size_t index) const;

private:
  void readCalibration();
  void readTruth();

  std::string folder_;
  StereoGeometry geometry_;
  Eigen::Isometry3d T_body_left_ = Eigen::Isometry3d::Identity();
  bool rectify_ = false;
  cv::Mat maps_[4];
  bool has_truth_ = false;
  std::vector<int64_t> stamps_;
  std::vector<std::string> files_;
  std::vector<std::vector<TrueObject>> objects_;
  std::vector<std::pair<int64_t, Eigen::Isometry3d>> poses_;
};

}  // namespace pi_detect::bench
