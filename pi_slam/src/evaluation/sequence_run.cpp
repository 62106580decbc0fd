#include "evaluation/sequence_run.h"

#include <pi_node/durations.h>
#include <pi_node/formatting.h>

#include <pi_runtime/runtime.h>
#include <sys/resource.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <ctime>
#include <deque>
#include <utility>

namespace pi_slam
{

namespace
{

using pi_node::secondsSince;
using Clock = std::chrono::steady_clock;

/// A pair waits this long for the IMU's samples, as a live system would [s].
constexpr double MAX_WAIT_S = 0.2;
constexpr size_t MAX_WARNINGS = 100;

double peakRssMb()
{
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return static_cast<double>(usage.ru_maxrss) / 1024.0;
}

void requireSize(const cv::Mat& picture, const CameraModel& model, const char* side, int64_t stamp_ns)
{
  if (!picture.empty() && (picture.cols != model.width || picture.rows != model.height))
  {
    throw RecordingError(std::string(side) + " picture at " + formatSeconds(stamp_ns) + " s is " +
                         pi_node::sizeText(picture.cols, picture.rows) + ", the calibration is for " +
                         pi_node::sizeText(model.width, model.height) +
                         "; give the calibration of these cameras by --calibration");
  }
}

/// Runs odometry and the map, and records both.
class Run
{
public:
  Run(SequenceReader* reader, const StereoCalibration& calibration, const SequenceRunOptions& options)
    : reader_(*reader)
    , calibration_(calibration)
    , wheels_(options.wheels)
    , max_wait_ns_(static_cast<int64_t>(1e9 * (MAX_WAIT_S + std::abs(options.vio.imu.time_offset_s))))
    , runtime_(options.vio.tracker.kernel_tasks || (options.map && options.mapper.kernel_tasks)
                   ? pi_runtime::Runtime::shared()
                   : nullptr)
    , vio_(calibration, options.vio, runtime_)
  {
    if (options.map)
    {
      mapper_ = std::make_unique<Mapper>(calibration, options.mapper, runtime_);
      vio_.setKeyframeCallback([this](const MapFrame& frame) { new_keyframes_.push_back(frame); });
    }
    result_.pairs.reserve(reader_.description().pairs);
  }

  SequenceRunResult work(const std::function<bool(size_t)>& progress)
  {
    const Clock::time_point start = Clock::now();
    while (!result_.stopped)
    {
      std::optional<SequenceItem> item = reader_.next();
      const bool ended = !item;
      if (!ended)
      {
        take(std::move(*item));
      }
      while (
          !waiting_.empty() && !result_.stopped &&
          (ended || vio_.imuCovers(waiting_.front().stamp_ns) || newest_ns_ > waiting_.front().stamp_ns + max_wait_ns_))
      {
        addPair(waiting_.front());
        waiting_.pop_front();
        result_.stopped = !progress(result_.pairs.size());
      }
      if (ended)
      {
        break;
      }
    }
    finish();
    result_.wall_s = secondsSince(start);
    return std::move(result_);
  }

  const Mapper* mapper() const { return mapper_.get(); }

private:
  void take(SequenceItem item)
  {
    if (StereoPair* pair = std::get_if<StereoPair>(&item))
    {
      requireSize(pair->left, calibration_.left.model, "left", pair->stamp_ns);
      requireSize(pair->right, calibration_.right.model, "right", pair->stamp_ns);
      newest_ns_ = std::max(newest_ns_, pair->stamp_ns);
      waiting_.push_back(std::move(*pair));
      return;
    }
    addImu(std::get<ImuSample>(item));
  }

  void addImu(const ImuSample& sample)
  {
    newest_ns_ = std::max(newest_ns_, sample.stamp_ns);
    for (; next_wheels_ < wheels_.size() && wheels_[next_wheels_].stamp_ns <= sample.stamp_ns; ++next_wheels_)
    {
      vio_.addWheels(wheels_[next_wheels_]);
    }
    const Clock::time_point start = Clock::now();
    const std::optional<PropagatedState> state = vio_.addImu(sample);
    imu_us_.push_back(static_cast<float>(1e6 * secondsSince(start)));
    if (state)
    {
      result_.imu_rate.push_back({{state->state.stamp_ns, state->state.T_odom_body()},
                                  pi_node::seconds(state->state.stamp_ns - corrected_ns_)});
    }
    warn(sample.stamp_ns, vio_.imuMessage());
  }

  void addPair(const StereoPair& pair)
  {
    PairRecord record;
    const double cpu_s = pi_node::cpuSeconds(CLOCK_PROCESS_CPUTIME_ID) - reader_.cpuSeconds();
    Clock::time_point start = Clock::now();
    record.report = vio_.addPair(pair.stamp_ns, pair.left, pair.right);
    record.wall_ms = 1e3 * secondsSince(start);
    record.cpu_ms = 1e3 * std::max(0.0, pi_node::cpuSeconds(CLOCK_PROCESS_CPUTIME_ID) - reader_.cpuSeconds() - cpu_s);
    warn(pair.stamp_ns, record.report.message);
    if (mapper_)
    {
      start = Clock::now();
      if (record.report.reset && !result_.poses.empty())
      {
        mapper_->odometryReset();
      }
      for (const MapFrame& frame : new_keyframes_)
      {
        mapper_->add(frame);
      }
      new_keyframes_.clear();
      record.map_ms = 1e3 * secondsSince(start);
    }
    keepPose(record.report.status);
    result_.pairs.push_back(std::move(record));
  }

  void keepPose(VioStatus status)
  {
    const std::optional<PropagatedState> corrected = vio_.newestCorrected();
    if (!corrected || status == VioStatus::INITIALIZING || status == VioStatus::LOST)
    {
      return;
    }
    corrected_ns_ = corrected->state.stamp_ns;
    if (result_.poses.empty() || corrected_ns_ > result_.poses.back().stamp_ns)
    {
      result_.poses.push_back({corrected_ns_, corrected->state.T_odom_body()});
    }
  }

  void warn(int64_t stamp_ns, const std::string& message)
  {
    if (message.empty())
    {
      return;
    }
    ++result_.all_warnings;
    if (result_.warnings.size() < MAX_WARNINGS)
    {
      result_.warnings.push_back(formatSeconds(stamp_ns) + " s: " + message);
    }
  }

  void finish()
  {
    if (!imu_us_.empty())
    {
      for (const float microseconds : imu_us_)
      {
        result_.imu_mean_us += microseconds / static_cast<double>(imu_us_.size());
      }
      const auto p99 = imu_us_.begin() + static_cast<std::ptrdiff_t>(0.99 * static_cast<double>(imu_us_.size() - 1));
      std::nth_element(imu_us_.begin(), p99, imu_us_.end());
      result_.imu_p99_us = *p99;
    }
    // After the last pair there is only integration.
    const int64_t last_ns = result_.pairs.empty() ? 0 : result_.pairs.back().report.stamp_ns;
    while (!result_.imu_rate.empty() && result_.imu_rate.back().pose.stamp_ns > last_ns)
    {
      result_.imu_rate.pop_back();
    }
    if (mapper_)
    {
      mapper_->flush();
      for (const auto& [stamp_ns, T_map_body] : mapper_->path())
      {
        result_.map_path.push_back({stamp_ns, T_map_body});
      }
      result_.map = mapper_->statistics();
    }
    result_.peak_rss_mb = peakRssMb();
  }

  SequenceReader& reader_;
  const StereoCalibration& calibration_;
  const std::vector<WheelSample>& wheels_;
  size_t next_wheels_ = 0;
  const int64_t max_wait_ns_;
  std::shared_ptr<pi_runtime::Runtime> runtime_;
  Vio vio_;
  std::unique_ptr<Mapper> mapper_;
  std::vector<MapFrame> new_keyframes_;
  std::deque<StereoPair> waiting_;  // for the IMU
  int64_t newest_ns_ = 0;
  int64_t corrected_ns_ = 0;
  std::vector<float> imu_us_;
  SequenceRunResult result_;
};

}  // namespace

SequenceRunResult runSequence(SequenceReader* reader, const StereoCalibration& calibration,
                              const SequenceRunOptions& options, const std::function<bool(size_t done)>& progress)
{
  Run run(reader, calibration, options);
  SequenceRunResult result = run.work(progress);
  if (run.mapper() != nullptr && !options.save_map.empty())
  {
    run.mapper()->save(options.save_map);
  }
  return result;
}

std::vector<StampedPose> posesOf(const std::vector<ImuRateRecord>& records)
{
  std::vector<StampedPose> poses;
  poses.reserve(records.size());
  for (const ImuRateRecord& record : records)
  {
    poses.push_back(record.pose);
  }
  return poses;
}

std::vector<StatusInterval> statusIntervals(const std::vector<PairRecord>& pairs)
{
  std::vector<StatusInterval> intervals;
  for (const PairRecord& pair : pairs)
  {
    const FrameReport& report = pair.report;
    if (intervals.empty() || intervals.back().status != report.status)
    {
      intervals.push_back({report.status, report.stamp_ns, report.stamp_ns, 0});
    }
    intervals.back().to_ns = report.stamp_ns;
    ++intervals.back().pairs;
  }
  return intervals;
}

}  // namespace pi_slam
