#pragma once

#include <diagnostic_updater/diagnostic_updater.h>
#include <pi_node/ros/recent_values.h>
#include <pi_node/ros/warning_board.h>
#include <ros/node_handle.h>
#include "map/mapper.h"
#include "odometry/vio.h"

#include <chrono>
#include <cstdint>
#include <mutex>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace pi_slam
{

/// Figures of the adapter for the diagnostics.
struct VioFigures
{
  struct Input
  {
    std::string topic;
    uint64_t messages = 0;
    double silent_s = 0.0;  ///< since the last one
  };
  std::vector<Input> inputs;
  std::string problem;               ///< why there can be no odometry; empty: there can
  bool failed = false;               ///< the problem is an error, not something to wait for
  uint64_t dropped_pairs = 0;        ///< as the worker fell behind
  uint64_t late_pictures = 0;        ///< that came after newer pairs
  uint64_t single_pictures = 0;      ///< that went on without a partner
  uint64_t odometries = 0;           ///< poses so far
  double delay_s = 0.0;              ///< of the newest pair behind the IMU's samples of the same time
  RigReport rig;                     ///< what driving told of the calibration
  std::optional<MapStatistics> map;  ///< nullopt: no mapping
  std::vector<std::pair<std::string, std::string>> stages;  ///< of the runtime: name, how it does
};

/// The diagnostics: status and frame times of odometry, rates and faults of the inputs, the map.
class VioDiagnostics
{
public:
  /// @param private_node  with the parameter diagnostic_period.
  /// @param warnings  outlives it.
  VioDiagnostics(const ros::NodeHandle& node, const ros::NodeHandle& private_node,
                 const pi_node::WarningBoard* warnings, double input_timeout_s);

  /// After each pair. Any thread.
  void addFrame(const FrameReport& report);
  /// After each IMU sample: from its callback to the odometry handed over [ms]. One thread at a time.
  void addImu(double work_ms);
  /// Odometry was restarted.
  void reset();

  /// Looks at everything and publishes. One thread at a time.
  void update(const VioFigures& figures);

private:
  using Status = diagnostic_updater::DiagnosticStatusWrapper;
  void reportOdometry(Status& status);
  void reportInputs(Status& status) const;
  void reportMap(Status& status) const;

  const pi_node::WarningBoard* const warnings_;
  const double input_timeout_s_;
  diagnostic_updater::Updater updater_;
  VioFigures now_;
  VioFigures before_;  ///< at the previous update
  int64_t updated_at_ns_;
  double interval_s_ = 0.0;  ///< between the last two updates

  std::mutex mutex_;  ///< of all below
  std::optional<FrameReport> frame_;
  pi_node::RecentValues frame_ms_;
  pi_node::RecentValues imu_ms_;
  uint64_t frames_ = 0;
  uint64_t late_frames_ = 0;  ///< that took longer than the time to the pair before
  int64_t frame_stamp_ns_ = 0;
  std::optional<std::chrono::steady_clock::time_point> odometry_at_;
  double longest_gap_s_ = 0.0;  ///< between two odometries, since the previous update
  uint64_t gaps_ = 0;           ///< longer than 20 ms
  uint64_t resets_ = 0;
};

}  // namespace pi_slam
