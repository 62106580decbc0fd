#include "ros/vio_worker.h"

#include <pi_node/formatting.h>
#include <pthread.h>
#include <ros/console.h>

#include <exception>
#include <optional>
#include <string>

namespace pi_slam
{
namespace
{

using pi_node::format;
using pi_node::seconds;

/// Pairs in a row with texture but hardly a feature seen by both cameras, after which there is a warning.
constexpr int MAX_PAIRS_WITHOUT_STEREO = 20;
constexpr int MIN_STEREO_FEATURES = 5;

}  // namespace

VioWorker::VioWorker(const VioRosOptions& options, const VioTopics& topics, VioSession* session, VioOutputs* outputs,
                     pi_node::WarningBoard* warnings, VioDiagnostics* diagnostics)
  : options_(options)
  , topics_(topics)
  , session_(*session)
  , outputs_(*outputs)
  , warnings_(*warnings)
  , diagnostics_(*diagnostics)
{
}

VioWorker::~VioWorker()
{
  if (thread_.joinable())
  {
    thread_.join();
  }
}

void VioWorker::start(const std::shared_ptr<pi_runtime::Runtime>& runtime)
{
  thread_ = std::thread(
      [this, runtime]
      {
        if (runtime)
        {
          runtime->raiseThread();
        }
        run();
      });
}

void VioWorker::run()
{
  pthread_setname_np(pthread_self(), "vio_worker");
  const auto waits = [this] { return outputs_.pairWaits(options_.imu_wait_s); };
  while (const std::optional<VioSession::Work> work = session_.take(waits))
  {
    if (!work->covered)
    {
      warnOfImu(work->pair.stamp_ns);
    }
    try
    {
      if (work->pipeline)
      {
        workOn(*work);
      }
    }
    catch (const std::exception& error)
    {
      warnings_.error(std::string("a pair cannot be used: ") + error.what());
    }
    outputs_.pairWorkedOff(work->pair.stamp_ns);
  }
}

void VioWorker::workOn(const VioSession::Work& work)
{
  if (generation_ != work.generation)
  {
    beginGeneration(work);
  }
  const VioPipeline& pipeline = *work.pipeline;
  const FrameReport report = pipeline.vio->addPair(work.pair.stamp_ns, work.pair.left, work.pair.right);
  diagnostics_.addFrame(report);
  warnOf(report, work.pair);
  if (pipeline.mapper)
  {
    if (report.reset && started_)
    {
      pipeline.mapper->odometryReset();
    }
    session_.updateMapPlace(pipeline, work.generation);
  }
  if (report.status != VioStatus::INITIALIZING && report.status != VioStatus::LOST)
  {
    started_ = true;
    if (const std::optional<PropagatedState> corrected = pipeline.vio->newestCorrected())
    {
      session_.keepForPath(work.generation, corrected->state.stamp_ns, corrected->state.T_odom_body());
    }
  }
  outputs_.showTracks(work.pair, pipeline);
}

void VioWorker::beginGeneration(const VioSession::Work& work)
{
  generation_ = work.generation;
  status_ = VioStatus::INITIALIZING;
  started_ = false;
  pairs_without_stereo_ = 0;
  outputs_.forgetTracks();
  // Done on the thread that feeds the map: no older frame can follow.
  const std::shared_ptr<Mapper>& mapper = work.pipeline->mapper;
  if (mapper && mapper == mapper_.lock())
  {
    mapper->odometryReset();
  }
  mapper_ = mapper;
}

void VioWorker::warnOfImu(int64_t pair_ns)
{
  const int64_t last_imu_ns = session_.last_imu_ns;
  warnings_.warn(topics_.imu.topic + ": waited " + format("%.2f", options_.imu_wait_s) +
                 " s for it to reach the stamp of a pair, " +
                 (last_imu_ns == 0 ? std::string("no sample came")
                                   : "its newest is " + format("%.3f", seconds(pair_ns - last_imu_ns)) + " s before") +
                 "; check that the IMU runs, with the cameras' clock");
}

void VioWorker::warnOf(const FrameReport& report, const PicturePair& pair)
{
  if (!report.message.empty())
  {
    warnings_.warn(report.message);
  }
  for (const int camera : {LEFT, RIGHT})
  {
    if ((camera == LEFT ? pair.left : pair.right).empty())
    {
      warnings_.warn(topics_.pictures[camera].topic +
                     ": no picture beside that of the other camera within pair_wait_s; "
                     "odometry goes on with one camera");
    }
  }
  const double delay_s = seconds(session_.delay_ns);
  if (delay_s > options_.max_delay_s)
  {
    warnings_.warn("pictures come " + format("%.3f", delay_s) + " s after IMU samples of the same stamp, above " +
                   "max_delay_s = " + format("%.3f", options_.max_delay_s) +
                   "; check exposure, transport and clocks: odometry rests on the IMU for so long");
  }
  warnOfMissingStereo(report, pair);
  if (report.status != status_)
  {
    logStatus(report);
    status_ = report.status;
  }
}

void VioWorker::warnOfMissingStereo(const FrameReport& report, const PicturePair& pair)
{
  // Swapped cameras see nothing in common, however good the pictures.
  const TrackerReport& tracker = report.tracker;
  if (!report.processed || pair.left.empty() || pair.right.empty() || tracker.blank[LEFT] || tracker.blank[RIGHT])
  {
    return;
  }
  pairs_without_stereo_ = tracker.stereo < MIN_STEREO_FEATURES ? pairs_without_stereo_ + 1 : 0;
  if (pairs_without_stereo_ >= MAX_PAIRS_WITHOUT_STEREO)
  {
    warnings_.warn("left and right have texture, but hardly a feature in common (" + std::to_string(tracker.stereo) +
                   " of " + std::to_string(report.features) +
                   "): the cameras are swapped or not triggered together, or the calibration is another pair's");
  }
}

void VioWorker::logStatus(const FrameReport& report)
{
  const std::string text = std::string("odometry: ") + toString(status_) + " -> " + toString(report.status);
  if (report.status == VioStatus::LOST || report.status == VioStatus::BLIND)
  {
    warnings_.warn(text);
  }
  else if (report.status == VioStatus::STANDSTILL || status_ == VioStatus::STANDSTILL)
  {
    ROS_DEBUG_STREAM_NAMED("vio", text);
  }
  else
  {
    ROS_INFO_STREAM_NAMED("vio", text << " with " << report.features << " features");
  }
}

}  // namespace pi_slam
