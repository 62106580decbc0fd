#pragma once

#include <pi_slam/stereo_calibration.h>

#include <Eigen/Geometry>
#include <memory>
#include <optional>
#include <vector>

#include "map/descriptor_matcher.h"
#include "map/feature_set.h"

namespace pi_slam::map
{

/// Features and where they were seen from. map: any frame with z up.
struct PlaceView
{
  FeatureSetPtr features;
  Eigen::Isometry3d T_map_body = Eigen::Isometry3d::Identity();
};

struct PlaceMatch
{
  Eigen::Isometry3d T_map_odom = Eigen::Isometry3d::Identity();  ///< a turn about z and a shift
  Eigen::Isometry3d T_map_body = Eigen::Isometry3d::Identity();  ///< T_map_odom * T_odom_body
  Eigen::Matrix4d covariance = Eigen::Matrix4d::Identity();      ///< of the body in map: x, y, z [m], heading [rad]
  int inliers = 0;
  double support = 0.0;  ///< inliers, as part of the first view's features that the picture should show
};

struct PlaceVerifierOptions
{
  int min_inliers = 25;
  double min_support = 0.33;            ///< of PlaceMatch::support; chance alone was seen to reach 0.28
  double min_support_confirmed = 0.22;  ///< where the place was expected, or as many matches are each other's nearest
  int max_iterations = 250;             ///< of the search for a first pose
  double pixel_noise = 1.2;             ///< standard deviation of a corner's place, on the finest level [px]
  double gravity_noise_deg = 0.3;       ///< of roll and pitch, on each side
};

/// Finds the pose of a picture from other pictures near its place with known poses, and verifies it. Both sides know
/// gravity: position and heading from two matches between a point and a ray (Kukelova, Bujnak and Pajdla, ACCV 2010) in
/// RANSAC, then all six degrees of freedom, with a prior of gravity, by Gauss-Newton over the matches of all views,
/// whose distances (known to both sides, with their uncertainty) are eliminated one by one. Not thread safe.
/// Deterministic.
class PlaceVerifier
{
public:
  PlaceVerifier(const StereoCalibration& calibration, const PlaceVerifierOptions& options,
                std::shared_ptr<pi_runtime::Runtime> runtime = nullptr);
  ~PlaceVerifier();

  /// @param query        the picture of now, with its pose by odometry, whose roll and pitch are taken.
  /// @param views        of one place, the best first; their poses must fit together.
  /// @param expected     the body should be near, by odometry.
  /// @return nullopt if the picture does not show this place, or not enough of it.
  std::optional<PlaceMatch> verify(const FeatureSet& query, const Eigen::Isometry3d& T_odom_body,
                                   const std::vector<PlaceView>& views, bool expected = false);

private:
  struct Match;
  struct Pose;
  void gather(const FeatureSet& query, const PlaceView& view, const std::vector<DescriptorMatch>& pairs,
              std::vector<Match>* matches) const;
  std::optional<Pose> search(const std::vector<Match>& matches) const;
  void refine(std::vector<Match>* matches, Pose* pose, Eigen::Matrix<double, 6, 6>* information) const;
  int expectedIn(const PlaceView& view, const Pose& pose) const;
  void guided(const FeatureSet& query, const std::vector<PlaceView>& views, const Pose& pose,
              std::vector<Match>* matches) const;
  bool isSpread(const std::vector<Match>& matches) const;

  const StereoCalibration calibration_;
  const PlaceVerifierOptions options_;
  const double pixel_rad_;  ///< one pixel in the middle of the picture [rad]
  DescriptorMatcher matcher_;
  Eigen::Isometry3d T_odom_body_ = Eigen::Isometry3d::Identity();  ///< of the query in work
};

}  // namespace pi_slam::map
