#pragma once

#include <diagnostic_updater/diagnostic_updater.h>
#include <pi_detect/detector.h>
#include <pi_node/ros/recent_values.h>
#include <pi_node/ros/warning_board.h>
#include <ros/node_handle.h>

#include <chrono>
#include <cstdint>
#include <mutex>
#include <string>

namespace pi_detect
{

/// State of the ssd node, for the diagnostics.
struct SsdFigures
{
  std::string topic;
  bool subscribed = false;
  uint64_t pictures = 0;  ///< that came
  double silent_s = 0.0;  ///< since the last one, or since the subscription [s]
  uint64_t dropped = 0;   ///< as a newer one came before the worker was free
  uint64_t left_out = 0;  ///< to keep max_rate_hz
  uint64_t calls = 0;     ///< of detect

  std::string model;    ///< in use; empty: none
  std::string runtime;  ///< how it has the work
  TargetInUse target;   ///< if there is a model
  std::string loading;  ///< description that is being loaded; empty: none
  std::string notice;   ///< why the model in use stands in for another one; empty: it does not
  std::string problem;  ///< why the model asked for last is not in use; empty: it is
  int threads = 0;      ///< of OpenCV
};

/// Publishes the diagnostics of the ssd node: network and speed, inputs and their faults.
class SsdDiagnostics
{
public:
  /// @param private_node  with the parameter diagnostic_period.
  /// @param warnings  outlives it.
  SsdDiagnostics(const ros::NodeHandle& node, const ros::NodeHandle& private_node,
                 const pi_node::WarningBoard* warnings, double input_timeout_s);

  /// After each picture, when its detections are published. Any thread.
  /// @param latency_s  from its stamp on [s].
  /// @param work_s     from when the worker took it on [s].
  void addPicture(const DetectionResult& result, double latency_s, double work_s);
  /// Another model. Any thread.
  void reset();
  /// Pictures worked on per second, of late. Any thread.
  double rate() const;

  /// Publishes. Not thread safe.
  void update(const SsdFigures& figures);

private:
  using Status = diagnostic_updater::DiagnosticStatusWrapper;
  void reportDetection(Status& status);
  void reportInput(Status& status) const;

  const pi_node::WarningBoard* const warnings_;
  const double input_timeout_s_;
  diagnostic_updater::Updater updater_;
  SsdFigures now_;
  SsdFigures before_;  ///< at the previous update
  uint64_t worked_before_ = 0;
  int64_t updated_at_ns_;
  double interval_s_ = 0.0;  ///< between the last two updates

  mutable std::mutex mutex_;  ///< of all below
  uint64_t worked_ = 0;
  size_t objects_ = 0;  ///< in the last picture
  int64_t worked_at_ns_ = 0;
  double period_s_ = 0.0;  ///< between pictures, smoothed; 0: not known
  pi_node::RecentValues latency_ms_;
  pi_node::RecentValues work_ms_;
  pi_node::RecentValues blob_ms_;
  pi_node::RecentValues forward_ms_;
  pi_node::RecentValues decode_ms_;
};

}  // namespace pi_detect
