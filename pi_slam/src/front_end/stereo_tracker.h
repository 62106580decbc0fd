#pragma once

#include <pi_slam/stereo_calibration.h>
#include "front_end/frame_features.h"

#include <Eigen/Geometry>
#include <cstdint>
#include <functional>
#include <memory>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <string>

namespace pi_runtime
{
class Runtime;
}

namespace pi_slam
{

struct StereoTrackerOptions
{
  int max_features = 160;         ///< in [20, 2000]
  int cell_px = 50;               ///< side of the grid that spreads corners [px]; in [8, 200]
  double min_distance_px = 16.0;  ///< between features; in [2, 100]
  int fast_threshold = 15;        ///< of corners; falls to 5 in dark or blurred pictures; in [1, 100]
  int levels = 4;                 ///< of the pyramid; in [1, 8]
  int window_px = 11;             ///< side of the patch that is compared; odd, in [5, 31]
  int max_iterations = 12;        ///< per level; in [1, 100]
  double epsilon_px = 0.02;       ///< a smaller step ends the search; in [0.001, 1]
  double slow_px = 0.1;        ///< median way per pair, below which features are compared with an older picture, until
                               ///< they have gone four times that; 0: never; in [0, 5]
  double max_residual = 25.0;  ///< mean absolute difference of patches [grey levels]; in [1, 255]
  double epipolar_px = 1.5;    ///< farthest from the epipolar line; two thirds: from the motion's; in [0.1, 20]
  double min_depth_m = 0.2;    ///< nearest point that stereo may see; in [0.01, 10]
  bool kernel_tasks = false;   ///< kernels as tasks of pi_runtime (OpenCL or native); false: called directly

  /// @throws std::invalid_argument that names field, value and bound.
  void validate() const;
};

/// The predicted motion since the last pair.
struct TrackerPrediction
{
  /// R_last_now of the body (from the gyro).
  Eigen::Quaterniond R_last_now = Eigen::Quaterniond::Identity();
  /// p_last_now of the body, where an estimate knows it well: what moves otherwise is not taken for the body's motion.
  std::optional<Eigen::Vector3d> p_last_now;
  /// Of a landmark known in space: its position in the body frame at the time of this pair; nullopt: by rotation only.
  std::function<std::optional<Eigen::Vector3d>(int64_t id)> p_body;
};

/// The figures of one call.
struct TrackerReport
{
  int tracked = 0;                   ///< features that go on from the last pair
  int lost = 0;                      ///< features of the last pair that do not
  int created = 0;                   ///< new ones
  int stereo = 0;                    ///< seen by both cameras
  double mean_grey[2] = {0.0, 0.0};  ///< of each picture
  double contrast[2] = {0.0, 0.0};   ///< standard deviation of grey levels
  bool blank[2] = {false, false};    ///< dark, white or without texture: nothing to be seen
  bool others_move = false;          ///< many features move otherwise than the body: people pass
  /// Median of the distances that features went in the picture, beyond what the rotation explains [px]; 0 for fewer
  /// than 5 features.
  double parallax_px = 0.0;
  /// Median of the distances that features went in the picture since the last pair [px]; 0 for fewer than 5.
  double flow_px = 0.0;
  double pyramid_ms = 0.0;
  double track_ms = 0.0;
  double detect_ms = 0.0;
  double stereo_ms = 0.0;
};

/// The stereo front end: FAST corners spread over a grid, tracked from pair to pair and from left to right by pyramidal
/// Lucas-Kanade (kernels of pi_runtime), with starting points from the predicted motion, checks against the epipolar
/// geometry of the pair and of the motion, and a check of tracking back for new stereo matches. If one camera is blank
/// the other one goes on alone; features keep their ids when the roles change as far as both cameras saw them.
///
/// Size of the pictures and lens come from the calibration alone. Deterministic. Not thread safe.
class StereoTracker
{
public:
  /// @param runtime  needed if options.kernel_tasks is set.
  /// @throws std::invalid_argument for options or a calibration out of range.
  StereoTracker(const StereoCalibration& calibration, const StereoTrackerOptions& options,
                std::shared_ptr<pi_runtime::Runtime> runtime = nullptr);
  ~StereoTracker();

  /// @param left,right   CV_8UC1, of the calibration's size. Not kept. An empty one counts as blank.
  /// @param prediction   motion since the last pair.
  /// @param max_features for this pair: at most options.max_features.
  /// @throws std::invalid_argument for pictures of another size or type.
  FrameFeatures process(int64_t stamp_ns, const cv::Mat& left, const cv::Mat& right,
                        const TrackerPrediction& prediction, int max_features, TrackerReport* report);

  /// Takes features out that the estimator has found wrong (moving things, false matches); they get no successor.
  void drop(const std::vector<int64_t>& ids);

  /// Forgets all features.
  void reset();

private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// A picture of the tracked features: the pair side by side (BGR), points coloured by age (red: new, blue: old), hollow
/// where only one camera sees them, with their paths over the last frames.
/// @param earlier  features of earlier pairs, newest last; may be empty.
cv::Mat drawTracks(const cv::Mat& left, const cv::Mat& right, const FrameFeatures& features,
                   const std::vector<FrameFeatures>& earlier);

}  // namespace pi_slam
