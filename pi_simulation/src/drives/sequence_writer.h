#pragma once

#include "renderer/stereo_renderer.h"
#include "world/synthetic_world.h"

#include <pi_slam/imu_simulator.h>
#include <pi_slam/spline_trajectory.h>
#include <pi_slam/stereo_calibration.h>

#include <functional>
#include <memory>
#include <string>
#include <vector>

namespace pi_simulation
{

/// Part of a recording, [s] since its start, both ends included.
struct TimeSpan
{
  double from_s = 0.0;
  double to_s = 0.0;

  /// Compares with a tolerance of 1 us, so that rounding does not decide about a picture at an end.
  bool contains(double time_s) const { return time_s >= from_s - 1e-6 && time_s <= to_s + 1e-6; }
};

/// Faults for tests of a localisation.
struct SequenceFaults
{
  enum class Cameras
  {
    BOTH,
    LEFT,
    RIGHT,
  };
  struct Black
  {
    TimeSpan span;
    Cameras cameras = Cameras::BOTH;
  };

  std::vector<Black> black;       ///< pictures are all zero
  std::vector<TimeSpan> dropped;  ///< pairs are missing
  double drop_probability = 0.0;  ///< of each pair, in [0, 1)
  std::vector<TimeSpan> late;  ///< pairs are stamped late_s after they were taken, as by a host that stamps on arrival
  double late_s = 0.2;         ///< pairs that would be out of order afterwards are left out
  std::vector<TimeSpan> imu_gaps;  ///< IMU samples are missing
  bool swapped_cameras = false;    ///< the left camera's pictures are in cam1, calibration as it was
};

struct SequenceOptions
{
  std::string folder;                ///< is created; gets mav0, truth and groundtruth_tum.txt
  bool overwrite = false;            ///< replaces these three if they are there
  double frame_rate_hz = 20.0;       ///< in [0.1, 1000]
  double start_s = 0.0;              ///< of the trajectory to leave out
  double duration_s = 0.0;           ///< 0: to the end of the trajectory
  pi_slam::ImuSimulatorOptions imu;  ///< with imu_log, its noise densities only: they go into sensor.yaml
  std::string imu_log;               ///< EuRoC csv that is copied line by line; empty: the IMU is simulated
  StereoRendererOptions renderer;    ///< its threads render one picture each
  bool depth = false;      ///< truth/depth/STAMP.png: left depth along the optical axis, 16 bit, [mm], 0: none
  bool obstacles = false;  ///< truth/obstacles.json
  SequenceFaults faults;

  /// @throws std::invalid_argument that names field, value and bound.
  void validate() const;
};

struct SequenceReport
{
  bool complete = false;  ///< false: stopped by the callback; the partial recording was removed
  size_t pairs = 0;
  size_t imu_samples = 0;
  size_t obstacles = 0;  ///< seen, summed over pairs
};

/// Writes a drive through a world in the folder layout of the EuRoC MAV data set (Burri et al., IJRR 2016): mav0/cam0,
/// mav0/cam1, mav0/imu0 and mav0/state_groundtruth_estimate0, each with sensor.yaml and data.csv, and
/// groundtruth_tum.txt. The body is the IMU. With an IMU log, pictures are taken at stamps of its samples. The content
/// does not depend on the number of threads.
/// @param progress  called from any thread, one at a time, with the number of pairs done and in all; false stops.
/// @throws std::invalid_argument for options out of range, RecordingError for a log that cannot be used or does not
///         overlap the trajectory, std::runtime_error for a folder that exists or cannot be written.
SequenceReport writeSequence(const std::shared_ptr<const SyntheticWorld>& world,
                             const pi_slam::SplineTrajectory& trajectory, const pi_slam::StereoCalibration& calibration,
                             const SequenceOptions& options,
                             const std::function<bool(size_t done, size_t total)>& progress);

}  // namespace pi_simulation
