#pragma once

#include <diagnostic_updater/diagnostic_updater.h>
#include <pi_node/ros/recent_values.h>
#include <pi_node/ros/warning_board.h>
#include <ros/node_handle.h>

#include <chrono>
#include <cstdint>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

namespace pi_detect
{

/// State of the obstacles node, for the diagnostics.
struct ObstaclesFigures
{
  struct Input
  {
    std::string topic;
    uint64_t messages = 0;
    double silent_s = 0.0;  ///< since the last one, or since the subscription [s]
    bool required = true;   ///< nothing works without
  };
  std::vector<Input> inputs;
  bool subscribed = false;
  uint64_t dropped = 0;                                     ///< pairs, as a newer one came before the worker was free
  uint64_t left_out = 0;                                    ///< pairs, to keep max_rate_hz
  uint64_t single = 0;                                      ///< pictures without partner
  std::string problem;                                      ///< why there can be no obstacles; empty: there can
  bool failed = false;                                      ///< the problem is an error, not something to wait for
  std::string motion_problem;                               ///< of odom -> base_link; empty: none
  bool motion_known = false;                                ///< false: velocities are relative to the vehicle
  std::vector<std::pair<std::string, std::string>> stages;  ///< of the runtime: name, how it does
};

/// Figures of a pair.
struct PairFigures
{
  double latency_s = 0.0;  ///< from stamp to published [s]
  double rectify_s = 0.0;
  double stereo_s = 0.0;
  double track_s = 0.0;
  double coverage = 0.0;
  bool ground_measured = false;
  double nearest_visible_m = 0.0;  ///< distance before the vehicle's front from which on obstacles are measured [m]
  size_t obstacles = 0;
  double nearest_m = 0.0;             ///< infinite: none
  double time_to_collision_s = 0.0;   ///< smallest; infinite: none
  std::optional<double> track_age_s;  ///< of the labels' tracks; nullopt: none
};

/// What limits the view near the vehicle; empty if obstacles are measured from 2 m before its front on, or nearer.
std::string nearLimitText(double nearest_visible_m);

/// Publishes the diagnostics of the obstacles node: results and speed, inputs and their faults, motion of the vehicle.
class ObstaclesDiagnostics
{
public:
  /// @param private_node  with the parameter diagnostic_period.
  /// @param warnings  outlives it.
  ObstaclesDiagnostics(const ros::NodeHandle& node, const ros::NodeHandle& private_node,
                       const pi_node::WarningBoard* warnings, double input_timeout_s, double min_coverage);

  /// After each pair. Any thread.
  void addPair(const PairFigures& pair);
  /// Publishes. Not thread safe.
  void update(const ObstaclesFigures& figures);

private:
  using Status = diagnostic_updater::DiagnosticStatusWrapper;
  void reportObstacles(Status& status);
  void reportInput(Status& status) const;
  void reportMotion(Status& status) const;

  const pi_node::WarningBoard* const warnings_;
  const double input_timeout_s_;
  const double min_coverage_;
  diagnostic_updater::Updater updater_;
  ObstaclesFigures now_;
  ObstaclesFigures before_;  ///< at the previous update
  uint64_t pairs_before_ = 0;
  int64_t updated_at_ns_;
  double interval_s_ = 0.0;  ///< between the last two updates

  std::mutex mutex_;  ///< of all below
  std::optional<PairFigures> pair_;
  uint64_t pairs_ = 0;
  pi_node::RecentValues latency_ms_;
  pi_node::RecentValues rectify_ms_;
  pi_node::RecentValues stereo_ms_;
  pi_node::RecentValues track_ms_;
};

}  // namespace pi_detect
