#include "front_end/rolling_shutter.h"

#include <pi_slam/so3.h>

#include <algorithm>

namespace pi_slam
{

RollingShutter::RollingShutter(const StereoCalibration& calibration, double readout_s)
  : geometry_(calibration), readout_s_(readout_s)
{
}

void RollingShutter::correct(const Eigen::Vector3d& w, const Eigen::Vector3d& v, FrameFeatures* features) const
{
  for (FeatureObservation& feature : features->features)
  {
    const FeatureObservation seen = feature;
    for (const int camera : {LEFT, RIGHT})
    {
      if (!seen.seen[camera])
      {
        continue;
      }
      const double row = seen.pixel[camera].y() / static_cast<double>(geometry_.camera(camera).height - 1);
      const double late_s = readout_s_ * (row - 0.5);
      const int other = LEFT + RIGHT - camera;
      const double inverse_m =
          seen.seen[other] ? std::max(0.0, geometry_.inverseDistance(camera, seen.bearing[camera], seen.bearing[other]))
                           : 0.0;
      const Eigen::Isometry3d& T_body_camera = geometry_.T_body_camera(camera);
      // The point in the body when its row was read, times the inverse of its distance; then in the body at the stamp.
      const Eigen::Vector3d point =
          T_body_camera.linear() * seen.bearing[camera] + inverse_m * T_body_camera.translation();
      const Eigen::Vector3d at_stamp = expSo3(late_s * w) * point + inverse_m * late_s * v;
      feature.bearing[camera] =
          (T_body_camera.linear().transpose() * (at_stamp - inverse_m * T_body_camera.translation())).normalized();
    }
  }
}

}  // namespace pi_slam
