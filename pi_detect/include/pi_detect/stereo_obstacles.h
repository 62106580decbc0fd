#pragma once

#include <pi_detect/detection.h>
#include <pi_detect/outline.h>
#include <pi_node/vehicle_description.h>
#include <pi_runtime/stage.h>

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <functional>
#include <memory>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <vector>

namespace pi_detect
{

/// A rectified stereo camera: both pictures have these intrinsics, and rows are epipolar lines.
struct StereoGeometry
{
  int width = 0;   ///< [px]
  int height = 0;  ///< [px]
  double fx = 0.0;
  double fy = 0.0;
  double cx = 0.0;  ///< of the left camera
  double cy = 0.0;
  double baseline_m = 0.0;     ///< right camera's distance along x [m], > 0
  double cx_difference = 0.0;  ///< cx of the left camera - cx of the right one [px]; usually 0. It is subtracted from
                               ///< all disparities here, so that depth = fx * baseline / disparity

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
};

/// A plane in base_link: points p with normal . p = offset.
struct GroundPlane
{
  Eigen::Vector3d normal = Eigen::Vector3d::UnitZ();  ///< up
  double offset_m = 0.0;  ///< height of the plane at the frame's origin along the normal [m]
  bool measured = false;  ///< false: too little ground was seen; the last plane, or that of the mounting
};

struct StereoObstacleOptions
{
  /// On the ground, from the origin of base_link [m]. Below 2 px of disparity, noise would look like obstacles.
  double max_range_m = 18.0;
  double ground_z_m =
      0.0;  ///< of the ground in base_link, where the vehicle stands level; below its origin: negative [m]
  double min_height_m = 0.15;       ///< least height of an obstacle above the ground [m]
  double max_height_m = 2.2;        ///< the vehicle can pass below what is higher [m]
  double min_size_m = 0.25;         ///< smallest extent (height or width) of an obstacle [m]
  double max_ground_tilt = 0.12;    ///< between the ground and the plane that the mounting implies [rad]
  double max_ground_step_m = 0.15;  ///< height difference of both planes at base_link [m]
  double nearest_distance_m = 1.0;  ///< before the vehicle's front; obstacles are searched from there on [m]
  pi_node::Footprint footprint;     ///< of the vehicle

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
};

/// Something above the ground, measured in one stereo pair.
struct ObstacleMeasurement
{
  Eigen::Vector3d min = Eigen::Vector3d::Zero();  ///< box around its points in base_link [m]
  Eigen::Vector3d max = Eigen::Vector3d::Zero();
  Eigen::Vector3d nearest = Eigen::Vector3d::Zero();         ///< robust nearest point (by distance on the ground) [m]
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Identity();  ///< of nearest [m^2]
  /// Around the visible part, in base_link [m]; empty: unknown. Only single stray points may lie outside.
  Outline outline;
  Box box;                 ///< in the left rectified picture [px]
  int points = 0;          ///< pixels that see it
  bool cut_left = false;   ///< it may extend beyond max.y: the picture ends there, or something nearer hides the rest
  bool cut_right = false;  ///< likewise beyond min.y
  bool piece = false;      ///< of a surface that was split: its ends move with the view
};

/// What one column of cells of a stereo pair shows of the ground: a narrow beam that begins below the camera.
struct GroundBeam
{
  struct Hit
  {
    float distance = 0.0F;  ///< of the middle of what was measured, from the camera [m]
    float sigma = 0.0F;     ///< standard deviation of the distance [m]
  };
  static constexpr size_t MOST_HITS = 3;

  float bearing = 0.0F;    ///< of its middle in base_link, left positive [rad]
  float free_from = 0.0F;  ///< between these distances the ground is seen, and nothing on it [m]; equal: nowhere
  float free_to = 0.0F;
  std::array<Hit, MOST_HITS> hits;  ///< nearest first
  size_t hit_count = 0;
};

/// Free ground and what stands on it, as seen from one place.
struct GroundView
{
  Eigen::Vector2d camera = Eigen::Vector2d::Zero();  ///< the left camera's place in base_link [m]
  double beam_rad = 0.0;                             ///< width of a beam [rad]
  std::vector<GroundBeam> beams;                     ///< from left to right
};

/// Heavy stages of StereoObstacles: two, as between them it may wait for a pose.
struct StereoStages
{
  explicit StereoStages(const std::shared_ptr<pi_runtime::Runtime>& runtime)
    : match(runtime, {"obstacles_match"}), find(runtime, {"obstacles_find"})
  {
  }
  pi_runtime::Stage match;
  pi_runtime::Stage find;
};

/// Finds obstacles in stereo pairs, without classes: matches disparities, fits the ground plane, and clusters what
/// stands above it. Keeps the ground plane from pair to pair. Not thread safe.
class StereoObstacles
{
public:
  /// @param T_base_left  left rectified optical frame (z forward, x right, y down) in base_link.
  /// @throws std::invalid_argument for options, geometry, or a camera that is not 0.1 to 10 m above the ground.
  /// @param stages  that run its work; null: plain calls.
  StereoObstacles(const StereoGeometry& geometry, const Eigen::Isometry3d& T_base_left,
                  const StereoObstacleOptions& options, std::shared_ptr<StereoStages> stages = nullptr);
  ~StereoObstacles();
  StereoObstacles(const StereoObstacles&) = delete;
  StereoObstacles& operator=(const StereoObstacles&) = delete;

  struct Result
  {
    std::vector<ObstacleMeasurement> obstacles;  ///< nearest first
    GroundPlane ground;
    std::vector<Eigen::Vector3f> points;  ///< of the obstacles, in base_link, thinned out [m]
    GroundView view;
    double coverage = 0.0;     ///< part of the pixels that have a disparity; low in the dark or with a covered lens
    double disparity_s = 0.0;  ///< time that matching took; 0 if the disparity was given [s]
    double ground_s = 0.0;     ///< likewise the ground plane [s]
    double clusters_s = 0.0;   ///< likewise all that follows [s]
  };

  /// Pose of the vehicle when the pictures were taken, T_odom_base; nothing: unknown.
  using PoseSource = std::function<std::optional<Eigen::Isometry3d>()>;

  /// @param left, right  CV_8UC1, rectified, of the geometry's size. @throws std::invalid_argument otherwise.
  /// @param pose  moves the last pair's ground to this one; called after matching, so that the pose may come meanwhile.
  Result detect(const cv::Mat& left, const cv::Mat& right, const PoseSource& pose = {});
  /// @param disparity  CV_32FC1 [px] of the geometry's size, left reference; not above 0 or not finite: unknown.
  Result detect(const cv::Mat& disparity, const PoseSource& pose = {});

  /// Depth along the optical axis from which on pairs of pictures are measured [m]. At most that of
  /// nearest_distance_m, unless it takes more disparities than half of the picture's width.
  double minDepth() const;

  /// The last pair's disparity, CV_32FC1 [px] at the geometry's size, for display. Unknown: -1.
  const cv::Mat& disparity() const;

private:
  class Implementation;
  std::unique_ptr<Implementation> implementation_;
};

}  // namespace pi_detect
