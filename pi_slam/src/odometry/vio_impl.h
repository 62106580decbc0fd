#pragma once

#include <array>
#include <atomic>
#include <chrono>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <unordered_map>
#include <utility>
#include <vector>

#include <pi_runtime/stage.h>

#include "estimator/factors.h"
#include "estimator/frame_budget.h"
#include "estimator/window_estimator.h"
#include "front_end/frame_filter.h"
#include "front_end/rolling_shutter.h"
#include "inertial/imu_preintegration.h"
#include "inertial/vibration_meter.h"
#include "inertial/wheels.h"
#include "odometry/rig_calibrator.h"
#include "odometry/vio.h"

namespace pi_slam
{

/// vio.cpp has the threads, inputs and results; vio_estimate.cpp has the estimate; vio_calibration.cpp what it tells of
/// the calibration.
struct Vio::Impl
{
  Impl(const StereoCalibration& calibration_in, const VioOptions& options_in,
       std::shared_ptr<pi_runtime::Runtime> runtime, const RigReport& found)
    : calibration(calibration_in)
    , options(options_in)
    , cameras(estimator::cameraGeometry(calibration))
    // Tasks within a run would wait for the unit that the run is on.
    , front_end_stage(options.tracker.kernel_tasks ? nullptr : runtime, {"slam_front_end"})
    , window_stage(runtime, {"slam_window", std::chrono::nanoseconds(0), WINDOW_DEADLINE})
    , tracker(calibration, options.tracker, std::move(runtime))
    , shutter(calibration, options.readout_s)
    , initializer(calibration, options.imu, options.initializer)
    , standstill(calibration, options.imu, options.standstill)
    , window(calibration, options.imu, options.window)
    , filter(calibration, options.window.pixel_noise)
    , rig(calibration, options.imu, found)
    , propagator(options.imu)
    , imu_correction(found.used.after(ImuCorrection::of(options_in.imu)))
    , rig_report(found)
    , imu(options.imu)
    , inbox_check(options.imu)
    , vibration(options.imu)
    , wheel_monitor(options.wheels)
    , since_keyframe(options.imu, ImuBias())
    , budget(options.frame_budget_s)
  {
  }

  // The thread of the IMU.
  std::optional<PropagatedState> addImu(ImuSample sample);

  // The thread of the pictures.
  FrameReport addPair(int64_t stamp_ns, const cv::Mat& left, const cv::Mat& right);
  void addWheels(const WheelSample& sample);
  void clearEstimate();
  void takeInbox();
  std::string whyUnusable(int64_t stamp_ns, bool running) const;
  void bridgeImu(int64_t stamp_ns);
  TrackerPrediction predictViews(const ImuPreintegration& since_pair, bool running);
  void runFrontEnd(const cv::Mat& left, const cv::Mat& right, const TrackerPrediction& prediction, int64_t stamp_ns,
                   FrameReport* report);
  void straighten(bool running);
  void start(FrameReport* report);
  void turnLastKnown(int64_t stamp_ns);
  void displaceOdom(const NavState& now);
  Matrix15d displacedCovariance(const NavState& state) const;
  void track(const ImuPreintegration& since_pair, FrameReport* report);
  void predict(const ImuPreintegration& since_pair, FrameReport* report);
  void predictByWheels(const ImuPreintegration& part, FrameReport* report);
  void noteSlip(const ImuPreintegration& part, const WheelSample& mean, double residual, FrameReport* report);
  std::optional<bool> wheelsAtRest(int64_t stamp_ns) const;
  std::optional<estimator::WheelTie> wheelTie() const;
  void noteMissingCorrection(const FilterReport& filtered, size_t views, FrameReport* report);
  void enterStandstill();
  void keepStill();
  bool leaveStandstill(FrameReport* report);
  std::vector<LandmarkView> viewsOfKnown() const;
  void noteOutliers(const FilterReport& filtered);
  bool keyframeDue(const FrameReport& report, size_t views) const;
  double parallaxSinceKeyframe(double* tracked_ratio) const;
  void addKeyframe(FrameReport* report);
  void optimize(int iterations, FrameReport* report);
  void rememberKeyframe();
  void offerToMap(int64_t stamp_ns, const cv::Mat& left, const cv::Mat& right);
  std::string failure(const FrameReport& report) const;
  void refineCalibration(FrameReport* report);
  void correctImu(const ImuCorrection& due);
  void correctEstimate(const ImuCorrection& due, FrameReport* report);
  void giveUp(const std::string& why, FrameReport* report);
  void publish();

  const StereoCalibration calibration;
  const VioOptions options;
  const std::array<estimator::CameraGeometry, 2> cameras;
  static constexpr std::chrono::milliseconds WINDOW_DEADLINE{100};  ///< about the time between two keyframes
  static constexpr int MIN_VIEWS = 10;                              ///< that a correction by pictures needs
  pi_runtime::Stage front_end_stage;
  pi_runtime::Stage window_stage;
  StereoTracker tracker;
  RollingShutter shutter;
  Initializer initializer;
  StandstillDetector standstill;
  WindowEstimator window;
  FrameFilter filter;
  RigCalibrator rig;
  ImuPropagator propagator;

  // Between the threads.
  std::mutex inbox_mutex;
  std::vector<ImuSample> inbox;
  std::vector<WheelSample> wheel_inbox;
  std::string imu_message;
  ImuCorrection imu_correction;
  std::optional<ImuSample> inbox_newest;  ///< corrected
  std::atomic<int64_t> newest_imu_ns{INT64_MIN};

  mutable std::mutex output_mutex;
  std::optional<PropagatedState> corrected;
  FrameFeatures shown_features;
  RigReport rig_report;

  std::function<void(const MapFrame&)> keyframe_callback;

  // Of the pictures' thread alone.
  ImuBuffer imu;
  ImuBuffer inbox_check;                ///< of the IMU's thread: finds gaps and disorder, holds two samples
  std::optional<ImuSample> newest_raw;  ///< likewise
  VibrationMeter vibration;             ///< likewise
  std::vector<ImuSample> taken;
  std::vector<WheelSample> taken_wheels;
  WheelBuffer wheels;
  WheelMonitor wheel_monitor;
  WheelWay wheels_since_pair;
  double wheel_turn = 0.0;  ///< likewise [rad]
  Eigen::Quaterniond pair_q = Eigen::Quaterniond::Identity();
  WheelWay wheels_since_keyframe;  ///< with since_keyframe
  int64_t by_wheels_ns = 0;        ///< they last corrected the state
  int64_t slipping_since_ns = 0;   ///< 0: they do not
  uint64_t slips = 0;
  VioStatus status = VioStatus::INITIALIZING;
  int64_t last_pair_ns = INT64_MIN;
  Eigen::Vector3d last_rate = Eigen::Vector3d::Zero();  ///< of the body between the last two pairs, estimated [rad/s]
  int64_t last_corrected_ns = 0;
  int64_t odds_since_ns = 0;  ///< 0: pictures and IMU agree
  FrameFeatures features;
  ImuPreintegration since_keyframe;
  int64_t keyframe_ns = 0;
  std::unordered_map<int64_t, FeatureObservation> keyframe_features;
  Eigen::Quaterniond keyframe_q = Eigen::Quaterniond::Identity();
  std::unordered_map<int64_t, int> strikes;
  Matrix15d common_covariance = Matrix15d::Zero();  ///< of position and heading of the window as a whole
  int64_t picture_moves_since_ns = 0;               ///< at rest; 0: it does not
  NavState still_state;
  Matrix15d still_covariance = Matrix15d::Zero();
  std::array<FrameFeatures, 4> at_rest;  ///< of pairs at rest, a window of the detector apart; the newest is first
  std::optional<NavState> last_known;    ///< where to go on from after the estimate was given up
  Matrix15d last_known_covariance = Matrix15d::Zero();
  int64_t given_up_ns = 0;
  /// How much less is known of where odom is since an estimate was given up and began again: it was moved by an unknown
  /// distance, and turned about where it began again.
  struct Displaced
  {
    Eigen::Vector3d about = Eigen::Vector3d::Zero();
    Eigen::Matrix3d position = Eigen::Matrix3d::Zero();  ///< covariance [m^2]
    double heading = 0.0;                                ///< variance [rad^2]
  } displaced;
  estimator::FrameBudget budget;
};

}  // namespace pi_slam
