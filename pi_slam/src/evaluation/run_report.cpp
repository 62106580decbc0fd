#include "evaluation/run_report.h"

#include <pi_node/durations.h>

#include <algorithm>
#include <cmath>
#include <iomanip>
#include <numeric>
#include <ostream>
#include <sstream>

namespace pi_slam
{

namespace
{

constexpr double DEG = 180.0 / M_PI;
constexpr size_t SHOWN_WARNINGS = 10;

std::string fixed(double value, int decimals)
{
  std::ostringstream text;
  text << std::fixed << std::setprecision(decimals) << value;
  return text.str();
}

/// Time of a recording [s].
std::string since(int64_t start_ns, int64_t stamp_ns)
{
  return fixed(pi_node::seconds(stamp_ns - start_ns), 2) + " s";
}

/// A row of mean, median, 99th percentile and largest value.
void printTimes(const char* name, std::vector<double> values, std::ostream* stream)
{
  if (values.empty())
  {
    return;
  }
  std::sort(values.begin(), values.end());
  double mean = 0.0;
  for (const double value : values)
  {
    mean += value / static_cast<double>(values.size());
  }
  const auto quantile = [&](double part)
  { return values[static_cast<size_t>(std::lround(part * static_cast<double>(values.size() - 1)))]; };
  *stream << "  " << std::left << std::setw(18) << name << std::right;
  for (const double value : {mean, quantile(0.5), quantile(0.99), values.back()})
  {
    *stream << std::setw(9) << fixed(value, 2);
  }
  *stream << std::setw(8) << values.size() << "\n";
}

template <typename Get>
std::vector<double> collect(const std::vector<PairRecord>& pairs, const Get& get)
{
  std::vector<double> values;
  for (const PairRecord& pair : pairs)
  {
    if (pair.report.processed)
    {
      values.push_back(get(pair));
    }
  }
  return values;
}

void printStatus(const SequenceRunResult& result, std::ostream* stream)
{
  if (result.pairs.empty())
  {
    return;
  }
  const int64_t start_ns = result.pairs.front().report.stamp_ns;
  const auto first = std::find_if(result.pairs.begin(), result.pairs.end(),
                                  [](const PairRecord& pair)
                                  { return pair.report.processed && pair.report.status != VioStatus::INITIALIZING; });
  *stream << "start        "
          << (first == result.pairs.end()
                  ? "never initialised"
                  : "initialised " + since(start_ns, first->report.stamp_ns) + " after the first pair")
          << "\n";
  for (const StatusInterval& interval : statusIntervals(result.pairs))
  {
    if (interval.status != VioStatus::TRACKING)
    {
      *stream << std::left << std::setw(13) << toString(interval.status) << std::right
              << since(start_ns, interval.from_ns) << " to " << since(start_ns, interval.to_ns) << ", "
              << interval.pairs << " pairs\n";
    }
  }
}

void printDefects(const SequenceDefects& defects, std::ostream* stream)
{
  if (!defects.any())
  {
    return;
  }
  *stream << "recording    " << defects.single << " pairs with one picture only, " << defects.dropped
          << " without any, " << defects.unreadable << " pictures not readable, " << defects.unsorted
          << " stamps out of order, " << defects.repeated << " repeated"
          << (defects.first.empty() ? "" : "; first: " + defects.first) << "\n";
}

void printWarnings(const SequenceRunResult& result, std::ostream* stream)
{
  const size_t shown = std::min(result.warnings.size(), SHOWN_WARNINGS);
  for (size_t i = 0; i < shown; ++i)
  {
    *stream << "warning      " << result.warnings[i] << "\n";
  }
  if (result.all_warnings > shown)
  {
    *stream << "             and " << result.all_warnings - shown << " more\n";
  }
}

void printTiming(const SequenceRunResult& result, std::ostream* stream)
{
  const std::vector<PairRecord>& pairs = result.pairs;
  *stream << "time per processed pair [ms]  mean      p50      p99      max   pairs\n";
  printTimes("front end", collect(pairs, [](const PairRecord& pair) { return pair.report.front_end_ms; }), stream);
  printTimes("filter", collect(pairs, [](const PairRecord& pair) { return pair.report.filter_ms; }), stream);
  printTimes("window", collect(pairs, [](const PairRecord& pair) { return pair.report.window_ms; }), stream);
  const std::vector<double> wall = collect(pairs, [](const PairRecord& pair) { return pair.wall_ms; });
  printTimes("total", wall, stream);
  printTimes("total, CPU", collect(pairs, [](const PairRecord& pair) { return pair.cpu_ms; }), stream);
  std::vector<double> map;
  for (const PairRecord& pair : pairs)
  {
    if (pair.map_ms > 0.05)
    {
      map.push_back(pair.map_ms);
    }
  }
  printTimes("map, if it works", map, stream);
  if (const double sum_ms = std::accumulate(wall.begin(), wall.end(), 0.0); sum_ms > 0.0)
  {
    *stream << "speed        " << fixed(1e3 * static_cast<double>(wall.size()) / sum_ms, 1)
            << " pairs per second without loading and map; all took " << fixed(result.wall_s, 1) << " s, peak "
            << fixed(result.peak_rss_mb, 0) << " MB resident\n";
  }
}

void printImuRate(const SequenceRunResult& result, std::ostream* stream)
{
  if (result.imu_rate.empty())
  {
    return;
  }
  double mean_s = 0.0;
  double max_s = 0.0;
  for (const ImuRateRecord& record : result.imu_rate)
  {
    mean_s += record.since_pair_s / static_cast<double>(result.imu_rate.size());
    max_s = std::max(max_s, record.since_pair_s);
  }
  *stream << "IMU rate     " << result.imu_rate.size() << " poses, each " << fixed(1e3 * mean_s, 1) << " ms (at most "
          << fixed(1e3 * max_s, 1) << ") after the corrected state it goes on from; " << fixed(result.imu_mean_us, 1)
          << " us per sample, p99 " << fixed(result.imu_p99_us, 1) << "\n";
}

void printStatistics(const std::string& name, const ErrorStatistics& error, double scale, int decimals,
                     std::ostream* stream)
{
  *stream << name;
  for (const double value : {error.rmse, error.mean, error.median, error.max})
  {
    *stream << std::setw(9) << fixed(scale * value, decimals);
  }
}

}  // namespace

Accuracy assess(const std::string& name, const std::vector<StampedPose>& poses, const std::vector<StampedPose>& truth)
{
  Accuracy accuracy;
  accuracy.name = name;
  accuracy.pairs = associate(poses, truth);
  accuracy.se3 = absoluteError(accuracy.pairs, Alignment::SE3);
  accuracy.yaw = absoluteError(accuracy.pairs, Alignment::YAW);
  for (const double distance_m : {1.0, 5.0, 8.0, 10.0, 50.0, 100.0, 200.0, 500.0})
  {
    if (const auto error = relativeErrorOverDistance(accuracy.pairs, distance_m))
    {
      accuracy.relative.emplace_back(fixed(distance_m, 0) + " m", *error);
    }
  }
  if (const auto error = relativeErrorOverTime(accuracy.pairs, 1.0))
  {
    accuracy.relative.emplace_back("1 s", *error);
  }
  return accuracy;
}

void printRun(const SequenceRunResult& result, const SequenceDescription& description, const SequenceDefects& defects,
              std::ostream* stream)
{
  size_t processed = 0;
  size_t keyframes = 0;
  size_t reduced = 0;
  size_t resets = 0;
  for (const PairRecord& pair : result.pairs)
  {
    processed += pair.report.processed ? 1 : 0;
    keyframes += pair.report.keyframe ? 1 : 0;
    reduced += pair.report.reduced ? 1 : 0;
    resets += pair.report.reset ? 1 : 0;
  }
  const double length_s =
      result.pairs.empty()
          ? 0.0
          : pi_node::seconds(result.pairs.back().report.stamp_ns - result.pairs.front().report.stamp_ns);
  *stream << description.name << ": " << result.pairs.size() << " pairs in " << fixed(length_s, 2) << " s"
          << (result.stopped ? ", stopped before the end" : "") << "\n"
          << "pairs        " << processed << " processed, " << result.pairs.size() - processed << " skipped, "
          << keyframes << " keyframes, " << reduced << " with less work than asked for, " << resets << " resets\n";
  printDefects(defects, stream);
  printStatus(result, stream);
  printWarnings(result, stream);
  printTiming(result, stream);
  printImuRate(result, stream);
  if (!result.map_path.empty())
  {
    *stream << "map          " << result.map.keyframes << " keyframes, " << result.map.landmarks << " landmarks, "
            << fixed(static_cast<double>(result.map.bytes) / 1048576.0, 1) << " MB, " << result.map.loops
            << " loops closed\n";
  }
}

void printAccuracy(const Accuracy& accuracy, std::ostream* stream)
{
  *stream << accuracy.name << ": " << accuracy.pairs.size() << " poses with ground truth, path "
          << fixed(accuracy.se3.length_m, 2) << " m\n"
          << "             position [mm] rmse   mean   median      max  rotation [deg] rmse  mean   median      max\n";
  for (const auto& [name, error] : {std::pair("ATE SE3", &accuracy.se3), std::pair("ATE yaw only", &accuracy.yaw)})
  {
    *stream << "  " << std::left << std::setw(14) << name << std::right;
    printStatistics(" ", error->position, 1e3, 2, stream);
    printStatistics("     ", error->rotation, DEG, 3, stream);
    *stream << "  " << fixed(error->driftPercent(), 3) << " % of the path\n";
  }
  for (const auto& [name, error] : accuracy.relative)
  {
    *stream << "  " << std::left << std::setw(14) << "RPE " + name << std::right;
    printStatistics(" ", error.position, 1e3, 2, stream);
    printStatistics("     ", error.rotation, DEG, 3, stream);
    if (error.drift_percent > 0.0)
    {
      *stream << "  " << fixed(error.drift_percent, 3) << " % drift";
    }
    *stream << "\n";
  }
}

std::vector<Judged> judge(const SequenceRunResult& result, const std::vector<StampedPose>& truth, std::ostream* stream)
{
  std::vector<Judged> all;
  for (auto& [name, poses] :
       {std::pair("odometry after each pair", result.poses),
        std::pair("odometry at IMU rate", posesOf(result.imu_rate)), std::pair(MAP_PATH_NAME, result.map_path)})
  {
    if (poses.empty())
    {
      continue;
    }
    Judged judged{name, poses, std::nullopt};
    if (!truth.empty())
    {
      try
      {
        judged.accuracy = assess(name, poses, truth);
        printAccuracy(*judged.accuracy, stream);
      }
      catch (const TrajectoryError& error)
      {
        *stream << name << ": not compared: " << error.what() << "\n";
      }
    }
    all.push_back(std::move(judged));
  }
  return all;
}

}  // namespace pi_slam
