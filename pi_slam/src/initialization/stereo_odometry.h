#pragma once

#include "front_end/frame_features.h"
#include <pi_slam/stereo_calibration.h>

#include <Eigen/Geometry>
#include <cstdint>
#include <functional>
#include <map>
#include <vector>

namespace pi_slam
{

/// Poses of the body over a few pairs of pictures from the pictures alone, apart from a guess of the rotations:
/// landmarks are triangulated by the pair, further pairs resected robustly, then all is adjusted together. `ref` is the
/// body at the first pair; scale is known from the cameras' distance.
class StereoOdometry
{
public:
  struct Pose
  {
    Eigen::Quaterniond q = Eigen::Quaterniond::Identity();  ///< R_ref_body
    Eigen::Vector3d p = Eigen::Vector3d::Zero();            ///< of the body in ref [m]
  };
  struct Triangulated
  {
    int matched = 0;  ///< features that both cameras saw
    int valid = 0;    ///< of them, those in front of both cameras and on each other's epipolar line
  };

  explicit StereoOdometry(const StereoCalibration& calibration);

  /// How many features of a pair stereo can place.
  Triangulated countStereo(const FrameFeatures& frame) const;

  /// Begins with the first pair.
  void start(const FrameFeatures& frame);

  /// Appends a pair.
  /// @param R_last_now  guess of its rotation since the last one; a tenth of a radian off does no harm.
  /// @return part of the features of known landmarks that agree with the pose found; below 0 if fewer than 8 do.
  double append(const FrameFeatures& frame, const Eigen::Quaterniond& R_last_now);

  /// Adjusts all poses but the first and all landmarks together (bundle adjustment, Huber loss), once with all
  /// landmarks and once with those that then fit.
  /// @return part of the observations that belong to the latter.
  double adjust();

  const std::vector<Pose>& poses() const { return poses_; }

private:
  struct Observation
  {
    size_t frame;
    int camera;
    Eigen::Vector3d bearing;
    Eigen::Matrix<double, 2, 3> tangent;  ///< base of the plane that touches the unit sphere at the bearing [px]
  };
  struct Landmark
  {
    Eigen::Vector3d p_ref;
    Eigen::Vector3d ray_ref;  ///< unit vector along which it is uncertain: that of the first sight
    double variance;          ///< along it [m^2]
    std::vector<Observation> observations;
  };
  struct Residual
  {
    bool valid = false;  ///< false: beyond 60 degrees of the bearing
    Eigen::Vector2d error;
    Eigen::Matrix<double, 2, 3> by_body;  ///< by the point in the body frame
    Eigen::Vector3d p_body;
  };
  /// A residual weighted with a pixel of noise and what is not known of the landmark's depth.
  struct Weighted
  {
    Residual residual;
    Eigen::Vector2d by_depth;
    Eigen::Matrix2d information = Eigen::Matrix2d::Identity();
    double error = 1e6;  ///< standard deviations
  };

  bool triangulate(const FeatureObservation& feature, Eigen::Vector3d* p_body) const;
  Observation observe(const FeatureObservation& feature, size_t frame, int camera) const;
  Residual residual(const Pose& pose, const Observation& observation, const Eigen::Vector3d& p_ref) const;
  Weighted weigh(const Pose& pose, const Observation& observation, const Landmark& landmark) const;
  void record(const FrameFeatures& frame);
  void minimize();
  double cost(const std::vector<Pose>& poses, const std::vector<Eigen::Vector3d>& points) const;
  bool step(double damping, std::vector<Pose>* poses, std::vector<Eigen::Vector3d>* points) const;

  struct Camera
  {
    Eigen::Matrix3d R_camera_body;
    Eigen::Vector3d p_body;  ///< of the camera [m]
    double focal;            ///< [px]
  };
  Camera cameras_[2];
  double far_m_;  ///< where the disparity is half a pixel: farther points count as being there
  std::vector<Pose> poses_;
  std::map<int64_t, Landmark> landmarks_;
};

}  // namespace pi_slam
