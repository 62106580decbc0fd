#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <vector>

#include "front_end/stereo_geometry.h"

namespace pi_slam::front_end
{

/// A feature that one camera has seen in two pairs.
struct MovedFeature
{
  int camera = LEFT;
  Eigen::Vector3d bearing_last;
  Eigen::Vector3d bearing_now;
  bool has_depth = false;
  double inverse_distance = 0.0;  ///< from the camera at the time of the last pair [1/m], if has_depth
};

/// Motion of the body between two pairs: p_now = R p_last + t.
struct BodyMotion
{
  Eigen::Matrix3d R_now_last = Eigen::Matrix3d::Identity();
  Eigen::Vector3d p_now_last = Eigen::Vector3d::Zero();  ///< [m]
};

/// Finds features that do not move as the rest of the world does. Where stereo knows the depth of enough of them, the
/// motion is found by robust least squares (weights of Geman and McClure, made stricter step by step: Yang, Antonante,
/// Tzoumas and Carlone, RA-L 2020), starting from the rotation of the gyro; else by the translation alone, from pairs
/// of features (Kneip, Chli and Siegwart, BMVC 2011) in a fixed order. Deterministic. Not thread safe.
class MotionCheck
{
public:
  /// @param tolerance_px  how far a feature may be from where the motion takes it.
  MotionCheck(const StereoGeometry& geometry, double tolerance_px);

  /// @param rotation_sigma_rad  of R_now_last.
  /// @param[in,out] motion  R_now_last as known before; replaced by what was found.
  /// @return true if the motion of the body was found, the depths being known. If not, p_now_last is 0.
  /// @param[out] consistent  for each feature; all of them if there are too few to tell, or if most would fall out.
  /// @param expected  the motion by other sensors; may be null. Where enough features agree with it and not with what
  ///                  was found, that is the motion of other things: then this one holds.
  bool check(const std::vector<MovedFeature>& features, double rotation_sigma_rad, BodyMotion* motion,
             std::vector<uint8_t>* consistent, const BodyMotion* expected = nullptr);

  /// Whether the last check() took the expected motion in place of what it found.
  bool othersMove() const { return others_move_; }

private:
  bool findMotion(const std::vector<MovedFeature>& features, double rotation_sigma_rad, BodyMotion* motion,
                  std::vector<uint8_t>* consistent);

  /// Of a feature with depth: what stays the same over the iterations.
  struct Point
  {
    size_t feature;
    Eigen::Matrix<double, 2, 3> axes;  ///< across bearing_now, times the focal length [px]
    Eigen::Vector3d x_last;            ///< bearing_last + inverse_distance * camera's position, in the body frame
  };
  bool estimate(const std::vector<MovedFeature>& features, double rotation_sigma_rad, BodyMotion* motion);
  void judgeByMotion(const std::vector<MovedFeature>& features, const BodyMotion& motion,
                     std::vector<uint8_t>* consistent) const;
  void judgeByTranslation(const std::vector<MovedFeature>& features, const BodyMotion& motion,
                          std::vector<uint8_t>* consistent) const;
  /// Residual [px] of a point with depth; its covariance is the unit matrix if noise is as assumed, times tolerance.
  Eigen::Vector2d residual(const MovedFeature& feature, const Point& point, const BodyMotion& motion,
                           Eigen::Matrix<double, 2, 6>* jacobian) const;

  const StereoGeometry& geometry_;
  const double tolerance_px_;
  std::vector<Point> points_;
  bool others_move_ = false;
};

}  // namespace pi_slam::front_end
