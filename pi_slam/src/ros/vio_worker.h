#pragma once

#include <pi_node/ros/warning_board.h>
#include <pi_runtime/runtime.h>

#include <cstdint>
#include <memory>
#include <thread>

#include "ros/vio_outputs.h"
#include "ros/vio_session.h"
#include "ros/vio_topics.h"

namespace pi_slam
{

/// Runs odometry on the pairs of a session, on the thread `vio_worker`, and logs faults of pairs.
class VioWorker
{
public:
  /// All arguments outlive it.
  VioWorker(const VioRosOptions& options, const VioTopics& topics, VioSession* session, VioOutputs* outputs,
            pi_node::WarningBoard* warnings, VioDiagnostics* diagnostics);
  /// Needs VioSession::stop() before.
  ~VioWorker();
  VioWorker(const VioWorker&) = delete;
  VioWorker& operator=(const VioWorker&) = delete;

  /// @param runtime  its streams must not keep this thread waiting; null: none.
  void start(const std::shared_ptr<pi_runtime::Runtime>& runtime);

private:
  void run();
  void workOn(const VioSession::Work& work);
  void beginGeneration(const VioSession::Work& work);
  void warnOfImu(int64_t pair_ns);
  void warnOf(const FrameReport& report, const PicturePair& pair);
  void warnOfMissingStereo(const FrameReport& report, const PicturePair& pair);
  void logStatus(const FrameReport& report);

  const VioRosOptions& options_;
  const VioTopics& topics_;
  VioSession& session_;
  VioOutputs& outputs_;
  pi_node::WarningBoard& warnings_;
  VioDiagnostics& diagnostics_;
  VioStatus status_ = VioStatus::INITIALIZING;
  bool started_ = false;  ///< there was a pose in this generation
  uint64_t generation_ = 0;
  std::weak_ptr<Mapper> mapper_;
  int pairs_without_stereo_ = 0;
  std::thread thread_;
};

}  // namespace pi_slam
