#pragma once

#include <pi_slam/trajectory_file.h>

#include <Eigen/Geometry>
#include <cstdint>
#include <optional>
#include <stdexcept>
#include <vector>

namespace pi_slam
{

/// Trajectories that cannot be compared. what() names the trajectory, the value and the way out.
class TrajectoryError : public std::runtime_error
{
public:
  using std::runtime_error::runtime_error;
};

/// An estimated pose and the true one at the same time. The two worlds differ until they are aligned.
struct PosePair
{
  int64_t stamp_ns = 0;
  Eigen::Isometry3d T_truth_body = Eigen::Isometry3d::Identity();
  Eigen::Isometry3d T_estimate_body = Eigen::Isometry3d::Identity();
};

/// Pairs every estimated pose with the truth at its stamp, interpolated between the neighbours (position linearly,
/// rotation on the sphere). Estimates outside of the truth, or in a hole of it, get no pair.
/// @param max_gap_s  longest distance of two true poses between which is interpolated [s]; > 0. Over an interval of
///                   0.1 s and at 2 m/s^2 the interpolated position is 2.5 mm off at most, at 200 Hz 6 um.
/// @throws TrajectoryError for poses that are not finite, stamps that do not increase, or an empty trajectory.
std::vector<PosePair> associate(const std::vector<StampedPose>& estimate, const std::vector<StampedPose>& truth,
                                double max_gap_s = 0.1);

enum class Alignment
{
  SE3,  ///< six degrees of freedom: what most published tables show
  YAW,  ///< heading and position only: gravity must be right as well (Zhang and Scaramuzza, IROS 2018)
};

/// The transform that takes estimated positions onto the true ones with the least sum of squares, without scale
/// (Horn 1987; Umeyama 1991). What positions leave open (the turn about a straight drive, all of it at standstill) is
/// settled by the orientations, which count like points 1 cm off the body.
/// @throws TrajectoryError for fewer than three pairs or values that are not finite.
Eigen::Isometry3d align(const std::vector<PosePair>& pairs, Alignment alignment);

struct ErrorStatistics
{
  size_t count = 0;
  double rmse = 0.0;
  double mean = 0.0;
  double median = 0.0;
  double max = 0.0;
};
/// @throws TrajectoryError for no values or one that is not finite.
ErrorStatistics statisticsOf(std::vector<double> values);

/// Absolute trajectory error (Sturm et al., IROS 2012) after alignment.
struct AbsoluteError
{
  Eigen::Isometry3d T_truth_estimate = Eigen::Isometry3d::Identity();  ///< the alignment
  ErrorStatistics position;                                            ///< [m]
  ErrorStatistics rotation;                                            ///< angle [rad]
  double length_m = 0.0;                                               ///< of the true path over the pairs
  std::vector<double> position_errors;                                 ///< per pair [m]
  std::vector<double> rotation_errors;                                 ///< per pair [rad]

  /// RMSE of position in percent of the path; 0 at standstill (less than 1 cm).
  double driftPercent() const;
};
/// @throws TrajectoryError as align().
AbsoluteError absoluteError(const std::vector<PosePair>& pairs, Alignment alignment);

/// Relative pose error: how far the motion over a stretch is off, over all stretches of one length (Geiger, Lenz and
/// Urtasun, CVPR 2012). Needs no alignment.
struct RelativeError
{
  ErrorStatistics position;  ///< [m]
  ErrorStatistics rotation;  ///< angle [rad]
  double drift_percent =
      0.0;  ///< mean of position errors divided by the distance of their stretch; 0 for those by time
};

/// Over stretches of `distance_m` of the true path [m], > 0, from every pair on. Stretches that end more than a tenth
/// (and 5 cm) beyond, because poses are missing, do not count.
/// @return nullopt if the path is shorter than the stretch.
/// @throws TrajectoryError for a distance that is not above 0 or values that are not finite.
std::optional<RelativeError> relativeErrorOverDistance(const std::vector<PosePair>& pairs, double distance_m);

/// Likewise over stretches of `interval_s` [s], > 0.
std::optional<RelativeError> relativeErrorOverTime(const std::vector<PosePair>& pairs, double interval_s);

/// Length of the true path [m]; 0 for fewer than two pairs.
double pathLength(const std::vector<PosePair>& pairs);

/// Poses moved by the alignment: into the world of the truth.
std::vector<StampedPose> transformed(const std::vector<StampedPose>& poses, const Eigen::Isometry3d& T_truth_estimate);

}  // namespace pi_slam
