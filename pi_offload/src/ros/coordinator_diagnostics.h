#pragma once

#include <diagnostic_updater/diagnostic_updater.h>
#include <pi_node/ros/warning_board.h>
#include <ros/node_handle.h>

#include <array>
#include <chrono>
#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "client/offload_client.h"
#include "ros/answer_check.h"

namespace pi_offload
{

/// State of the coordinator for its reports.
struct CoordinatorFigures
{
  std::string topic;
  bool subscribed = false;
  uint64_t pictures = 0;  ///< received pictures
  double silent_s = 0.0;  ///< since the last picture or the subscription [s]
  uint64_t late = 0;      ///< results dropped: their deadline was over and a later one published
  size_t held = 0;        ///< results that wait for those of older pictures
  uint64_t crowded = 0;   ///< pictures dropped because too many came at once
  size_t waiting = 0;     ///< pictures that wait for the vehicle's detector
  std::string model;      ///< network of the vehicle's detector; empty: unknown
  bool detector_listens = false;
  std::string vehicle;   ///< name at the nodes
  std::string position;  ///< "known", or why it is not
  bool position_known = false;
  std::string policy;
  double eta = 0.0;
  bool enabled = true;
  double jpeg_ms_per_mpixel = 0.0;
  double jpeg_bytes_per_pixel = 0.0;
  std::string encoding;  ///< how the stage offload_encode does
  OffloadEngine::Statistics statistics;
  std::array<double, TASK_KINDS> p50_s{};
  std::array<double, TASK_KINDS> p99_s{};
  std::array<std::string, TASK_KINDS> last_node;
  std::vector<OffloadEngine::NodeStatus> nodes;
  std::map<std::string, OffloadClient::LinkStatus> links;
  std::map<std::string, AnswerCheck::Status> checks;  ///< of nodes
};

/// Publishes diagnostics of offloading, nodes and input. One thread at a time.
class CoordinatorDiagnostics
{
public:
  /// @param private_node  with the parameter diagnostic_period.
  /// @param warnings  outlives it.
  CoordinatorDiagnostics(const ros::NodeHandle& node, const ros::NodeHandle& private_node,
                         const pi_node::WarningBoard* warnings, double input_timeout_s);

  /// Publishes the diagnostics.
  void update(const CoordinatorFigures& figures);

private:
  using Clock = std::chrono::steady_clock;
  using Status = diagnostic_updater::DiagnosticStatusWrapper;
  void reportOffloading(Status& status) const;
  void reportNodes(Status& status) const;
  void reportInput(Status& status) const;
  std::string checksOf(const std::string& id) const;

  const pi_node::WarningBoard* const warnings_;
  const double input_timeout_s_;
  diagnostic_updater::Updater updater_;
  CoordinatorFigures now_;
  CoordinatorFigures before_;  ///< at the previous update
  Clock::time_point updated_at_;
  double interval_s_ = 0.0;  ///< between the last two updates
};

}  // namespace pi_offload
