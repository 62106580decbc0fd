#pragma once

#include <pi_slam/trajectory_file.h>
#include "evaluation/sequence_reader.h"
#include "map/mapper.h"
#include "odometry/vio.h"

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

namespace pi_slam
{

struct SequenceRunOptions
{
  VioOptions vio;
  MapperOptions mapper;
  bool map = false;                 ///< build one beside odometry
  std::vector<WheelSample> wheels;  ///< in order of time; empty: none
  std::string save_map;             ///< file for it; empty: not kept
};

/// One pair as it went through.
struct PairRecord
{
  FrameReport report;
  double wall_ms = 0.0;  ///< of Vio::addPair()
  double cpu_ms = 0.0;   ///< likewise, of all threads but the reader's
  double map_ms = 0.0;   ///< wall time of mapping afterwards
};

/// The pose at a sample of the IMU, as it went out at that time.
struct ImuRateRecord
{
  StampedPose pose;
  double since_pair_s = 0.0;  ///< since the corrected state that it goes on from
};

struct SequenceRunResult
{
  std::vector<PairRecord> pairs;
  std::vector<StampedPose> poses;       ///< after each pair, of the body in odom
  std::vector<ImuRateRecord> imu_rate;  ///< T_odom_body
  std::vector<StampedPose> map_path;    ///< keyframes in the map as it was at the end
  std::vector<std::string> warnings;    ///< of odometry, with their times; the first 100
  size_t all_warnings = 0;
  MapStatistics map;
  double imu_mean_us = 0.0;  ///< wall time of Vio::addImu()
  double imu_p99_us = 0.0;
  double wall_s = 0.0;       ///< of all of it
  double peak_rss_mb = 0.0;  ///< of the process
  bool stopped = false;      ///< by the callback
};

/// Runs odometry over a recording: every pair as soon as the IMU's samples reach over it, or 0.2 s later without them.
/// Depends on the recording and the options only, as long as these set neither a budget nor threads.
/// @param progress  called after each pair; false stops.
/// @throws RecordingError for pictures of another size than the calibration's, std::invalid_argument for options out of
///         range, MapError for a map that cannot be written.
SequenceRunResult runSequence(SequenceReader* reader, const StereoCalibration& calibration,
                              const SequenceRunOptions& options, const std::function<bool(size_t done)>& progress);

/// Without their ages.
std::vector<StampedPose> posesOf(const std::vector<ImuRateRecord>& records);

/// A stretch of time of one status.
struct StatusInterval
{
  VioStatus status = VioStatus::INITIALIZING;
  int64_t from_ns = 0;
  int64_t to_ns = 0;
  size_t pairs = 0;
};
/// In order of time; neighbours differ.
std::vector<StatusInterval> statusIntervals(const std::vector<PairRecord>& pairs);

}  // namespace pi_slam
