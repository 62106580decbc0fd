#include "drives/sequence_writer.h"

#include "drives/sequence_files.h"
#include "drives/visible_obstacles.h"
#include "renderer/worker_pool.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <exception>
#include <filesystem>
#include <mutex>
#include <opencv2/imgcodecs.hpp>
#include <random>
#include <stdexcept>

namespace pi_simulation
{

namespace
{

namespace fs = std::filesystem;

constexpr int64_t SECOND_NS = 1000000000LL;

bool inAny(const std::vector<TimeSpan>& spans, double time_s)
{
  return std::any_of(spans.begin(), spans.end(), [&](const TimeSpan& span) { return span.contains(time_s); });
}

/// When a pair is taken, and which stamp it gets.
struct Pair
{
  int64_t taken_ns = 0;
  int64_t stamp_ns = 0;
};

/// The part of a trajectory that is recorded.
struct Period
{
  Period(const pi_slam::SplineTrajectory& trajectory, const SequenceOptions& options)
    : start_ns(trajectory.startNs() + std::llround(options.start_s * 1e9)), end_ns(trajectory.endNs())
  {
    if (options.duration_s > 0.0)
    {
      end_ns = std::min<int64_t>(end_ns, start_ns + std::llround(options.duration_s * 1e9));
    }
    if (start_ns >= end_ns)
    {
      throw std::invalid_argument("sequence: start_s = " + std::to_string(options.start_s) +
                                  " leaves nothing of a trajectory of " +
                                  std::to_string((trajectory.endNs() - trajectory.startNs()) / SECOND_NS) + " s");
    }
  }
  double seconds(int64_t stamp_ns) const { return 1e-9 * static_cast<double>(stamp_ns - start_ns); }

  int64_t start_ns;
  int64_t end_ns;
};

/// Part of an IMU log that a recording keeps: from 5 s before its first picture, for initialisation, to its end.
struct LogRange
{
  LogRange(const pi_slam::ImuLog& log, const Period& period)
  {
    const auto& stamps = log.stamps_ns;
    first = std::lower_bound(stamps.begin(), stamps.end(), period.start_ns - 5 * SECOND_NS) - stamps.begin();
    last = std::upper_bound(stamps.begin(), stamps.end(), period.end_ns) - stamps.begin();
  }
  ptrdiff_t first;
  ptrdiff_t last;
};

/// The log's stamp nearest to a time.
int64_t snapped(const std::vector<int64_t>& stamps, int64_t time_ns)
{
  const auto after = std::lower_bound(stamps.begin(), stamps.end(), time_ns);
  if (after == stamps.begin() || (after != stamps.end() && *after - time_ns < time_ns - *(after - 1)))
  {
    return *after;
  }
  return *(after - 1);
}

std::vector<Pair> planPairs(const Period& period, const SequenceOptions& options, const pi_slam::ImuLog& log)
{
  std::mt19937_64 random(options.renderer.seed);
  std::vector<Pair> pairs;
  for (int64_t i = 0;; ++i)
  {
    Pair pair;
    pair.taken_ns = period.start_ns + std::llround(static_cast<double>(i) / options.frame_rate_hz * 1e9);
    if (pair.taken_ns > period.end_ns)
    {
      return pairs;
    }
    if (!log.stamps_ns.empty())
    {
      pair.taken_ns = snapped(log.stamps_ns, pair.taken_ns);
    }
    const double time_s = period.seconds(pair.taken_ns);
    const bool unlucky = static_cast<double>(random() >> 11) * 0x1p-53 < options.faults.drop_probability;
    const bool late = inAny(options.faults.late, time_s);
    pair.stamp_ns = pair.taken_ns + (late ? std::llround(options.faults.late_s * 1e9) : 0);
    const bool ordered = pairs.empty() || pair.stamp_ns > pairs.back().stamp_ns;
    const bool inside = pair.taken_ns >= period.start_ns && pair.taken_ns <= period.end_ns;
    if (inside && ordered && !unlucky && !inAny(options.faults.dropped, time_s))
    {
      pairs.push_back(pair);
    }
  }
}

/// Folders of a recording; removes what it wrote unless it is kept.
class OutputFolder
{
public:
  OutputFolder(const std::string& folder, bool overwrite, bool with_depth) : root_(folder)
  {
    for (const fs::path& entry : entries())
    {
      if (fs::exists(entry) && !overwrite)
      {
        throw std::runtime_error(entry.string() + " exists; choose another folder or ask to overwrite it");
      }
    }
    remove();
    for (const fs::path& path : {camera(0) / "data", camera(1) / "data", imu(), groundTruth()})
    {
      fs::create_directories(path);
    }
    if (with_depth)
    {
      fs::create_directories(truth() / "depth");
    }
  }
  ~OutputFolder()
  {
    if (!kept_)
    {
      remove();
    }
  }
  OutputFolder(const OutputFolder&) = delete;
  OutputFolder& operator=(const OutputFolder&) = delete;

  void keep() { kept_ = true; }
  fs::path camera(int index) const { return root_ / "mav0" / ("cam" + std::to_string(index)); }
  fs::path imu() const { return root_ / "mav0" / "imu0"; }
  fs::path groundTruth() const { return root_ / "mav0" / "state_groundtruth_estimate0"; }
  fs::path tum() const { return root_ / "groundtruth_tum.txt"; }
  fs::path truth() const { return root_ / "truth"; }

private:
  std::vector<fs::path> entries() const { return {root_ / "mav0", truth(), tum()}; }
  void remove() const
  {
    std::error_code ignored;
    for (const fs::path& entry : entries())
    {
      fs::remove_all(entry, ignored);
    }
  }

  const fs::path root_;
  bool kept_ = false;
};

void writePicture(const fs::path& file, const cv::Mat& picture)
{
  // Without options OpenCV takes its fastest way; others need twice the time for hardly smaller files, as noise does
  // not compress.
  if (!cv::imwrite(file.string(), picture))
  {
    throw std::runtime_error(file.string() + ": cannot be written; check the folder's permissions and free space");
  }
}

/// Renders and writes pairs on several threads, each with a renderer of its own.
class PairWriter
{
public:
  PairWriter(std::shared_ptr<const SyntheticWorld> world, const pi_slam::SplineTrajectory& trajectory,
             const pi_slam::StereoCalibration& calibration, const SequenceOptions& options, const Period& period,
             const OutputFolder& folder)
    : world_(std::move(world))
    , trajectory_(trajectory)
    , calibration_(calibration)
    , options_(options)
    , period_(period)
    , folder_(folder)
  {
    options_.renderer.truth = options.depth || options.obstacles;
    options_.renderer.threads = 1;
  }

  /// @return false if the callback stopped it. Rethrows the first exception of any thread.
  bool write(const std::vector<Pair>& pairs, int threads, const std::function<bool(size_t, size_t)>& progress)
  {
    json_.resize(pairs.size());
    size_t done = 0;
    synthetic::WorkerPool pool(threads);
    pool.run(static_cast<int>(pairs.size()),
             [&](int index)
             {
               if (stopped_)
               {
                 return;
               }
               try
               {
                 writePair(static_cast<size_t>(index), pairs[static_cast<size_t>(index)]);
                 const std::lock_guard<std::mutex> lock(mutex_);
                 stopped_ = stopped_ || !progress(++done, pairs.size());
               }
               catch (...)
               {
                 const std::lock_guard<std::mutex> lock(mutex_);
                 error_ = error_ ? error_ : std::current_exception();
                 stopped_ = true;
               }
             });
    if (error_)
    {
      std::rethrow_exception(error_);
    }
    return !stopped_;
  }

  /// One line per pair, in order; empty without obstacles.
  const std::vector<std::string>& json() const { return json_; }
  size_t obstacles() const { return obstacles_; }

private:
  void writePair(size_t index, const Pair& pair)
  {
    std::unique_ptr<StereoRenderer> renderer = takeRenderer();
    StereoFrame frame = renderer->render(trajectory_, pair.taken_ns);
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      idle_.push_back(std::move(renderer));
    }
    blacken(pair, &frame);
    const std::string name = std::to_string(pair.stamp_ns) + ".png";
    const bool swapped = options_.faults.swapped_cameras;
    writePicture(folder_.camera(0) / "data" / name, swapped ? frame.right : frame.left);
    writePicture(folder_.camera(1) / "data" / name, swapped ? frame.left : frame.right);
    if (options_.depth)
    {
      cv::Mat millimetres;
      frame.depth.convertTo(millimetres, CV_16UC1, 1000.0);  // saturates at 65.5 m
      millimetres.setTo(0, frame.depth > 65.5f);
      writePicture(folder_.truth() / "depth" / name, millimetres);
    }
    if (options_.obstacles)
    {
      const auto visible = visibleObstacles(*world_, frame, trajectory_.at(pair.taken_ns).T_world_body);
      json_[index] = toJson(pair.stamp_ns, visible);
      obstacles_ += visible.size();
    }
  }

  void blacken(const Pair& pair, StereoFrame* frame) const
  {
    using Cameras = SequenceFaults::Cameras;
    for (const SequenceFaults::Black& black : options_.faults.black)
    {
      if (!black.span.contains(period_.seconds(pair.taken_ns)))
      {
        continue;
      }
      if (black.cameras != Cameras::RIGHT)
      {
        frame->left.setTo(0);
      }
      if (black.cameras != Cameras::LEFT)
      {
        frame->right.setTo(0);
      }
    }
  }

  std::unique_ptr<StereoRenderer> takeRenderer()
  {
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      if (!idle_.empty())
      {
        std::unique_ptr<StereoRenderer> renderer = std::move(idle_.back());
        idle_.pop_back();
        return renderer;
      }
    }
    return std::make_unique<StereoRenderer>(world_, calibration_, options_.renderer);
  }

  std::shared_ptr<const SyntheticWorld> world_;
  const pi_slam::SplineTrajectory& trajectory_;
  const pi_slam::StereoCalibration& calibration_;
  SequenceOptions options_;
  const Period& period_;
  const OutputFolder& folder_;
  std::mutex mutex_;  ///< of idle_, error_ and the callback
  std::vector<std::unique_ptr<StereoRenderer>> idle_;
  std::exception_ptr error_;
  std::atomic<bool> stopped_{false};
  std::atomic<size_t> obstacles_{0};
  std::vector<std::string> json_;
};

/// @return number of samples.
size_t writeImuAndTruth(const pi_slam::SplineTrajectory& trajectory, const SequenceOptions& options,
                        const Period& period, const pi_slam::ImuLog& log, const OutputFolder& folder)
{
  std::vector<int64_t> stamps;
  std::vector<pi_slam::ImuBias> biases;
  std::vector<pi_slam::ImuSample> samples;
  pi_slam::ImuSimulatorOptions imu = options.imu;
  std::string csv;
  size_t count = 0;
  const auto inGap = [&](int64_t stamp_ns) { return inAny(options.faults.imu_gaps, period.seconds(stamp_ns)); };
  if (log.lines.empty())
  {
    samples = pi_slam::ImuSimulator(imu).simulate(trajectory, period.start_ns, period.end_ns, &biases);
    for (const pi_slam::ImuSample& sample : samples)
    {
      stamps.push_back(sample.stamp_ns);
    }
    samples.erase(std::remove_if(samples.begin(), samples.end(),
                                 [&](const pi_slam::ImuSample& sample) { return inGap(sample.stamp_ns); }),
                  samples.end());
    count = samples.size();
    csv = imuCsv(samples);
  }
  else
  {
    const LogRange range(log, period);
    csv = log.header.empty() ? std::string() : log.header + "\n";
    for (auto i = static_cast<size_t>(range.first); i < static_cast<size_t>(range.last); ++i)
    {
      const int64_t stamp_ns = log.stamps_ns[i];
      if (stamp_ns >= period.start_ns)
      {
        stamps.push_back(stamp_ns);
      }
      if (!inGap(stamp_ns))
      {
        csv += log.lines[i] + "\n";
        ++count;
      }
    }
    const auto span_ns = static_cast<double>(log.stamps_ns.back() - log.stamps_ns.front());
    imu.rate_hz = std::round(1e9 * static_cast<double>(log.stamps_ns.size() - 1) / std::max(span_ns, 1.0));
  }
  writeText(folder.imu() / "data.csv", csv);
  writeText(folder.imu() / "sensor.yaml", imuYaml(imu));
  writeText(folder.groundTruth() / "data.csv", groundTruthCsv(trajectory, stamps, biases));
  writeText(folder.groundTruth() / "sensor.yaml",
            "%YAML:1.0\nsensor_type: visual-inertial\ncomment: exact pose of the rendered body\n");
  writeText(folder.tum(), groundTruthTum(trajectory, stamps));
  return count;
}

}  // namespace

void SequenceOptions::validate() const
{
  const auto check = [](bool good, const std::string& field, double value, const char* bound)
  {
    if (!good)
    {
      throw std::invalid_argument("sequence: " + field + " = " + std::to_string(value) + ", must be " + bound);
    }
  };
  if (folder.empty())
  {
    throw std::invalid_argument("sequence: folder is empty, name the one to create");
  }
  check(frame_rate_hz >= 0.1 && frame_rate_hz <= 1000.0, "frame_rate_hz", frame_rate_hz, "in [0.1, 1000]");
  check(start_s >= 0.0 && std::isfinite(start_s), "start_s", start_s, "0 or more");
  check(duration_s >= 0.0 && std::isfinite(duration_s), "duration_s", duration_s, "0 (all) or more");
  check(faults.drop_probability >= 0.0 && faults.drop_probability < 1.0, "drop_probability", faults.drop_probability,
        "in [0, 1)");
  check(faults.late_s >= 0.0 && faults.late_s <= 60.0, "late_s", faults.late_s, "in [0, 60]");
  const auto checkSpan = [&](const TimeSpan& span, const std::string& field)
  {
    check(span.from_s >= 0.0, field + " from", span.from_s, "0 or more");
    check(span.to_s >= span.from_s, field + " to", span.to_s, "at or after its beginning");
  };
  const auto checkSpans = [&](const std::vector<TimeSpan>& spans, const std::string& field)
  {
    for (const TimeSpan& span : spans)
    {
      checkSpan(span, field);
    }
  };
  for (const SequenceFaults::Black& black : faults.black)
  {
    checkSpan(black.span, "black");
  }
  checkSpans(faults.dropped, "dropped");
  checkSpans(faults.late, "late");
  checkSpans(faults.imu_gaps, "imu_gap");
  imu.validate();
  renderer.validate();
}

SequenceReport writeSequence(const std::shared_ptr<const SyntheticWorld>& world,
                             const pi_slam::SplineTrajectory& trajectory, const pi_slam::StereoCalibration& calibration,
                             const SequenceOptions& options, const std::function<bool(size_t, size_t)>& progress)
{
  options.validate();
  const Period period(trajectory, options);
  const pi_slam::ImuLog log = options.imu_log.empty() ? pi_slam::ImuLog() : pi_slam::readImuLog(options.imu_log);
  if (!log.lines.empty() && (log.stamps_ns.back() < period.start_ns || log.stamps_ns.front() > period.end_ns))
  {
    throw pi_slam::RecordingError(options.imu_log + ": has no sample during the trajectory; do both belong together?");
  }
  const std::vector<Pair> pairs = planPairs(period, options, log);
  OutputFolder folder(options.folder, options.overwrite, options.depth);

  SequenceReport report;
  report.imu_samples = writeImuAndTruth(trajectory, options, period, log, folder);
  std::vector<int64_t> stamps;
  for (const Pair& pair : pairs)
  {
    stamps.push_back(pair.stamp_ns);
  }
  for (const int camera : {0, 1})
  {
    const pi_slam::MountedCamera& mounted = camera == 0 ? calibration.left : calibration.right;
    writeText(folder.camera(camera) / "sensor.yaml", cameraYaml(mounted, options.frame_rate_hz));
    writeText(folder.camera(camera) / "data.csv", picturesCsv(stamps));
  }
  PairWriter writer(world, trajectory, calibration, options, period, folder);
  report.complete = writer.write(pairs, options.renderer.threads, progress);
  if (!report.complete)
  {
    return report;
  }
  if (options.obstacles)
  {
    fs::create_directories(folder.truth());
    std::string json = "{\"frames\": [\n";
    for (size_t i = 0; i < writer.json().size(); ++i)
    {
      json += writer.json()[i] + (i + 1 < writer.json().size() ? ",\n" : "\n");
    }
    writeText(folder.truth() / "obstacles.json", json + "]}\n");
  }
  folder.keep();
  report.pairs = pairs.size();
  report.obstacles = writer.obstacles();
  return report;
}

}  // namespace pi_simulation
