#pragma once

#include <pi_slam/spline_trajectory.h>
#include <pi_slam/stereo_calibration.h>
#include "front_end/frame_features.h"

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <random>
#include <unordered_map>
#include <vector>

struct SimulatedFeaturesOptions
{
  int landmarks = 600;         ///< spread around the path
  double pixel_noise = 0.5;    ///< standard deviation of each coordinate in each camera [px]
  double outlier_ratio = 0.0;  ///< part of the landmarks that move by 0.5 to 1.5 m/s, or whose match in the right
                               ///< camera is 5 to 40 px off (half of them each)
  double min_range = 2.0;      ///< of landmarks from the place of the path about which they lie [m]
  double max_range = 12.0;     ///< likewise [m]
  int max_features = 120;      ///< per pair
  double readout_s = 0.0;  ///< of rolling shutters: rows are seen one after the other, the middle one at the stamp [s]
  uint64_t seed = 1;
};

/// What a perfect front end would see of random points around a trajectory: nothing is hidden behind anything.
/// Ids behave as a tracker's: the same while a landmark is in view, never used again.
class SimulatedFeatures
{
public:
  SimulatedFeatures(const pi_slam::SplineTrajectory& trajectory, const pi_slam::StereoCalibration& calibration,
                    const SimulatedFeaturesOptions& options);

  /// @param stamp_ns  within the trajectory; later than that of the call before.
  pi_slam::FrameFeatures at(int64_t stamp_ns);

  /// Where a landmark that was seen is (outliers that move: at the start of the trajectory).
  std::optional<Eigen::Vector3d> p_world(int64_t id) const;
  bool isOutlier(int64_t id) const;

private:
  struct Landmark
  {
    Eigen::Vector3d p_world;
    Eigen::Vector3d v_world = Eigen::Vector3d::Zero();
    Eigen::Vector2d mismatch = Eigen::Vector2d::Zero();  ///< in the right camera [px]
    int64_t id = -1;                                     ///< current one; -1: not seen in the last pair
    uint32_t age = 0;
    bool outlier = false;
  };

  pi_slam::SplineTrajectory trajectory_;
  pi_slam::StereoCalibration calibration_;
  SimulatedFeaturesOptions options_;
  std::mt19937_64 random_;
  std::vector<Landmark> landmarks_;
  std::unordered_map<int64_t, size_t> landmark_of_id_;
  int64_t next_id_ = 0;
};
