#pragma once

#include <pi_slam/stereo_calibration.h>
#include "estimator/window_estimator.h"
#include "front_end/frame_features.h"
#include "front_end/stereo_tracker.h"
#include "inertial/imu_propagator.h"
#include "inertial/nav_state.h"
#include "inertial/wheels.h"
#include "initialization/initializer.h"
#include "initialization/standstill_detector.h"
#include "map/map_frame.h"
#include "odometry/rig_calibrator.h"

#include <cstdint>
#include <functional>
#include <memory>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace pi_runtime
{
class Runtime;
}

namespace pi_slam
{

struct VioOptions
{
  ImuModel imu;
  StereoTrackerOptions tracker;
  InitializerOptions initializer;
  StandstillOptions standstill;
  WindowOptions window;
  WheelOptions wheels;

  double frame_budget_s = 0.020;       ///< longest time for one pair; above it features and iterations are reduced.
                                       ///< 0: no bound, and so the same result on every machine; in [0, 1]
  double keyframe_parallax_px = 12.0;  ///< median parallax since the last keyframe that asks for a new one; in [1, 200]
  double keyframe_tracked_ratio = 0.6;  ///< part of its landmarks still seen below which a new one is due; in [0.05, 1]
  double keyframe_max_interval_s = 0.5;  ///< in motion; in [0.1, 5]
  double keyframe_min_interval_s = 0.1;  ///< in [0, 1]
  double max_speed = 30.0;               ///< faster is a failure of the estimate [m/s]; > 0
  double max_blind_s = 10.0;             ///< without pictures that help, before the state is given up [s]; in [0.5, 60]
  double readout_s = 0.0;  ///< of rolling shutters: from the first row to the last [s]; 0: global shutters.
                           ///< Stamps are those of the middle row; in [0, 0.1]
  /// Time offset and rotation between cameras and IMU are found and corrected while driving.
  bool refine_calibration = true;

  /// @throws std::invalid_argument that names field, value and bound.
  void validate() const;
};

enum class VioStatus
{
  INITIALIZING,  ///< no pose yet
  TRACKING,
  STANDSTILL,  ///< known not to move: the pose is held
  BLIND,       ///< pictures give nothing (dark, covered, missing, at odds with the IMU): IMU, and wheels, only
  LOST,        ///< given up; begins anew from the last pose as soon as pictures and IMU allow
};
const char* toString(VioStatus status);

/// What the wheels are worth.
struct WheelReport
{
  bool known = false;     ///< there are samples
  bool used = false;      ///< for this pair
  bool slipping = false;  ///< at odds with IMU and pictures, not used
  uint64_t slips = 0;     ///< stretches of that so far
  WheelScale scale;
};

/// The result of one pair.
struct FrameReport
{
  int64_t stamp_ns = 0;
  VioStatus status = VioStatus::INITIALIZING;
  bool processed = false;  ///< false: not used, message says why
  bool keyframe = false;
  bool reset = false;   ///< the estimate was given up or began anew with this pair
  std::string message;  ///< a warning: object, value, way out; empty if there is none
  TrackerReport tracker;
  WheelReport wheels;
  int features = 0;      ///< seen
  int inliers = 0;       ///< that agreed with the state
  int landmarks = 0;     ///< in the window
  int iterations = 0;    ///< of the window's optimisation, 0 without one
  bool reduced = false;  ///< fewer features or iterations than asked for, to stay within the budget
  double front_end_ms = 0.0;
  double front_end_cpu_ms = 0.0;  ///< of that, processor time of its thread; the rest it waited
  double filter_ms = 0.0;
  double window_ms = 0.0;
  double total_ms = 0.0;
};

/// Stereo visual-inertial odometry: tracker, filter per pair, window of keyframes, propagation per IMU sample.
///
/// Per pair an iterated Kalman filter corrects the state against the landmarks of the window (FrameFilter); at
/// keyframes the window of states and landmarks is optimised (WindowEstimator) and the filter begins again from its
/// result. Between them addImu() gives a pose per sample. odom begins where the body was at first, z up, and stays
/// continuous but for corrections; after a reset it continues from the last pose.
///
/// addImu() may be called from one thread, addPair() from another; what they return belongs to the caller. With no
/// frame budget the result depends on the input only.
class Vio
{
public:
  /// @param runtime  runs the stages slam_front_end and slam_window, or the kernels with options.tracker.kernel_tasks;
  /// null: all is called directly.
  /// @param found  rig() of odometry before, with the same calibration.
  /// @throws std::invalid_argument for options or a calibration out of range.
  Vio(const StereoCalibration& calibration, const VioOptions& options,
      std::shared_ptr<pi_runtime::Runtime> runtime = nullptr, const RigReport& found = RigReport());
  ~Vio();

  /// Never waits for pictures. Samples must come in order of time; imuMessage() tells their faults.
  /// @return the pose at the sample's stamp; nullopt before the start.
  std::optional<PropagatedState> addImu(const ImuSample& sample);

  /// Samples of the wheels, in order of time; from any one thread. Without any, odometry is that of pictures and IMU.
  void addWheels(const WheelSample& sample);

  /// True if the IMU's samples reach over the stamp of a pair, so that addPair() can use it.
  bool imuCovers(int64_t stamp_ns) const;

  /// Works on one pair; pairs must come in order of time. With samples of the IMU missing at its end it is not
  /// processed.
  /// @param left,right  CV_8UC1 of the calibration's size; an empty one is a picture that is missing.
  FrameReport addPair(int64_t stamp_ns, const cv::Mat& left, const cv::Mat& right);

  /// A warning about the IMU since the last call: gap, saturation, disorder; empty if there is none.
  std::string imuMessage();

  /// The state at the last pair; nullopt before the start.
  std::optional<PropagatedState> newestCorrected() const;
  FrameFeatures newestFeatures() const;
  /// What driving has told of time and rotation between cameras and IMU. Any thread.
  RigReport rig() const;

  /// How the runtime's stages do: name and text. Any thread.
  std::vector<std::pair<std::string, std::string>> stages() const;

  /// Called on the thread of addPair() for keyframes that a map could use, with pictures.
  void setKeyframeCallback(std::function<void(const MapFrame&)> callback);

private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace pi_slam
