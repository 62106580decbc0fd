#pragma once

#include <pi_slam/stereo_calibration.h>
#include "front_end/frame_features.h"
#include "front_end/stereo_geometry.h"

#include <Eigen/Core>

namespace pi_slam
{

/// Cameras that read their rows one after the other. Takes bearings to the time of the stamp, at which the middle row
/// is read: by the rotation of the body, and by its velocity where both cameras tell how far a feature is. Both cameras
/// read the same row at the same time. Not thread safe.
class RollingShutter
{
public:
  /// @param readout_s  from the first row to the last [s]; in [0, 0.1].
  RollingShutter(const StereoCalibration& calibration, double readout_s);

  /// @param w  rate of the body at the stamp, without bias [rad/s]. @param v  its velocity, in its axes [m/s].
  void correct(const Eigen::Vector3d& w, const Eigen::Vector3d& v, FrameFeatures* features) const;

private:
  const front_end::StereoGeometry geometry_;
  const double readout_s_;
};

}  // namespace pi_slam
