#pragma once

#include <pi_slam/stereo_calibration.h>

#include <Eigen/Geometry>
#include <memory>

#include "map/mapper.h"
#include "odometry/vio.h"
#include "ros/calibration_loader.h"
#include "ros/vio_ros_options.h"

namespace pi_slam
{

/// All that belongs to one calibration and one run of odometry. Never changed; replaced as a whole.
struct VioPipeline
{
  using Ptr = std::shared_ptr<const VioPipeline>;
  using RuntimePtr = std::shared_ptr<pi_runtime::Runtime>;

  /// @throws std::exception for a calibration that odometry or mapping cannot use.
  static Ptr make(const VioRosOptions& options, const RuntimePtr& runtime, const FileCalibration& calibration,
                  const Eigen::Isometry3d& T_base_body);
  /// The same with new odometry, which keeps what was found of the calibration. A new object: pairs and samples of the
  /// old time that are in work end with the old one.
  Ptr again(const VioRosOptions& options, const RuntimePtr& runtime, bool forget_map) const;

  StereoCalibration cameras;
  VioOptions vio_options;
  Eigen::Isometry3d T_base_body = Eigen::Isometry3d::Identity();
  double gyro_variance = 0.0;  ///< of a sample [rad^2/s^2]
  std::shared_ptr<Vio> vio;
  std::shared_ptr<Mapper> mapper;  ///< null without mapping; the same after a restart

private:
  void startVio(const RuntimePtr& runtime, const RigReport& found);
};

}  // namespace pi_slam
