#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <stdexcept>
#include <string>
#include <vector>

namespace pi_slam
{

struct StampedPose
{
  int64_t stamp_ns = 0;
  Eigen::Isometry3d T_world_body = Eigen::Isometry3d::Identity();  ///< world: z up
};

/// A file of poses or samples that cannot be used. what() names the file, the line and the defect.
class RecordingError : public std::runtime_error
{
public:
  using std::runtime_error::runtime_error;
  RecordingError(const std::string& file, size_t line, const std::string& defect)
    : std::runtime_error(file + ":" + std::to_string(line) + ": " + defect)
  {
  }
};

/// Decimal seconds ("1403636580.83856") as nanoseconds, without the rounding of a double.
/// @return false if `text` is no such number of at most ten digits before the point.
bool parseSeconds(const std::string& text, int64_t* stamp_ns);
/// The inverse of parseSeconds(); always nine decimals.
std::string formatSeconds(int64_t stamp_ns);

/// Reads poses from a TUM file (`t x y z qx qy qz qw`, seconds; further columns are ignored) or from EuRoC's ground
/// truth (`t,x,y,z,qw,qx,qy,qz,...`, nanoseconds; told by its commas).
/// @throws RecordingError for a missing file, a line that cannot be read, stamps that do not increase, quaternions that
///         are far from unit length, or fewer than two poses.
std::vector<StampedPose> readTrajectory(const std::string& file);

}  // namespace pi_slam
