// Time of the stereo front end on a recording, beside OpenCV doing the same job on the same pictures:
//   bench_front_end EUROC_DIR [PAIRS]
// All run on one thread, one after the other for each pair; time is that of the processor, so that other programs
// disturb less. OpenCV's rows: corners where there are none, tracked from left to left and back, then from left to
// right and back; no epipolar checks, no undistortion.

#include "front_end/stereo_tracker.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <exception>
#include <fstream>
#include <functional>
#include <numeric>
#include <opencv2/core/utility.hpp>
#include <opencv2/features2d.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/video/tracking.hpp>
#include <stdexcept>
#include <string>
#include <vector>

namespace
{

using namespace pi_slam;

constexpr int FEATURES = 150;
constexpr size_t USUAL_PAIRS = 200;

double processorMs()
{
  timespec time{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
  return static_cast<double>(time.tv_sec) * 1e3 + static_cast<double>(time.tv_nsec) * 1e-6;
}

std::string machineName()
{
  std::ifstream info("/proc/cpuinfo");
  std::string line;
  while (std::getline(info, line))
  {
    if (line.rfind("model name", 0) == 0)
    {
      return line.substr(line.find(':') + 2);
    }
  }
  return "unknown processor";
}

struct Counts
{
  size_t features = 0;
  size_t tracked = 0;
  size_t stereo = 0;
};

enum class Corners
{
  GOOD,  ///< goodFeaturesToTrack with a mask around features, as VINS-Fusion does
  FAST,  ///< the strongest of each free cell of a grid, as OpenVINS does
};

class OpenCvFrontEnd
{
public:
  OpenCvFrontEnd(Corners corners, int window, int levels)
    : corners_(corners)
    , window_(window, window)
    , levels_(levels)
    , criteria_(cv::TermCriteria::COUNT + cv::TermCriteria::EPS, corners == Corners::GOOD ? 30 : 12,
                corners == Corners::GOOD ? 0.01 : 0.02)
  {
  }

  Counts process(const cv::Mat& left, const cv::Mat& right)
  {
    std::vector<cv::Mat> left_pyramid;
    std::vector<cv::Mat> right_pyramid;
    cv::buildOpticalFlowPyramid(left, left_pyramid, window_, levels_ - 1);
    cv::buildOpticalFlowPyramid(right, right_pyramid, window_, levels_ - 1);
    Counts counts;
    if (!last_pyramid_.empty() && !points_.empty())
    {
      std::vector<cv::Point2f> to = points_;
      const std::vector<uint8_t> good = thereAndBack(last_pyramid_, left_pyramid, points_, &to);
      std::vector<cv::Point2f> kept;
      for (size_t i = 0; i < to.size(); ++i)
      {
        if (good[i] != 0 && cv::Rect2f(2.0F, 2.0F, left.cols - 4.0F, left.rows - 4.0F).contains(to[i]))
        {
          kept.push_back(to[i]);
        }
      }
      points_ = kept;
      counts.tracked = kept.size();
    }
    addCorners(left);
    if (!points_.empty())
    {
      std::vector<cv::Point2f> to = points_;
      const std::vector<uint8_t> good = thereAndBack(left_pyramid, right_pyramid, points_, &to);
      counts.stereo = static_cast<size_t>(std::count(good.begin(), good.end(), 1));
    }
    counts.features = points_.size();
    last_pyramid_ = left_pyramid;
    return counts;
  }

private:
  std::vector<uint8_t> thereAndBack(const std::vector<cv::Mat>& from, const std::vector<cv::Mat>& to,
                                    const std::vector<cv::Point2f>& points, std::vector<cv::Point2f>* found) const
  {
    std::vector<uint8_t> status;
    std::vector<uint8_t> back_status;
    std::vector<float> error;
    std::vector<cv::Point2f> back = points;
    cv::calcOpticalFlowPyrLK(from, to, points, *found, status, error, window_, levels_ - 1, criteria_,
                             cv::OPTFLOW_USE_INITIAL_FLOW);
    cv::calcOpticalFlowPyrLK(to, from, *found, back, back_status, error, window_, 1, criteria_,
                             cv::OPTFLOW_USE_INITIAL_FLOW);
    for (size_t i = 0; i < status.size(); ++i)
    {
      status[i] = status[i] != 0 && back_status[i] != 0 && cv::norm(back[i] - points[i]) < 0.5 ? 1 : 0;
    }
    return status;
  }

  void addCorners(const cv::Mat& picture)
  {
    const StereoTrackerOptions ours;
    const int missing = FEATURES - static_cast<int>(points_.size());
    if (missing <= 0)
    {
      return;
    }
    if (corners_ == Corners::GOOD)
    {
      cv::Mat mask(picture.size(), CV_8UC1, cv::Scalar(255));
      for (const cv::Point2f& point : points_)
      {
        cv::circle(mask, point, static_cast<int>(ours.min_distance_px), 0, cv::FILLED);
      }
      std::vector<cv::Point2f> corners;
      cv::goodFeaturesToTrack(picture, corners, missing, 0.01, ours.min_distance_px, mask);
      points_.insert(points_.end(), corners.begin(), corners.end());
      return;
    }
    std::vector<cv::KeyPoint> corners;
    cv::FAST(picture, corners, ours.fast_threshold, true);
    std::sort(corners.begin(), corners.end(),
              [](const cv::KeyPoint& a, const cv::KeyPoint& b) { return a.response > b.response; });
    const int columns = picture.cols / ours.cell_px + 1;
    std::vector<int> cells(static_cast<size_t>(columns * (picture.rows / ours.cell_px + 1)), 0);
    const auto cellOf = [&ours, columns](const cv::Point2f& p) {
      return static_cast<size_t>(static_cast<int>(p.y) / ours.cell_px * columns + static_cast<int>(p.x) / ours.cell_px);
    };
    for (const cv::Point2f& point : points_)
    {
      ++cells[cellOf(point)];
    }
    for (const cv::KeyPoint& corner : corners)
    {
      if (static_cast<int>(points_.size()) < FEATURES && cells[cellOf(corner.pt)] < 2)
      {
        ++cells[cellOf(corner.pt)];
        points_.push_back(corner.pt);
      }
    }
  }

  const Corners corners_;
  const cv::Size window_;
  const int levels_;
  const cv::TermCriteria criteria_;
  std::vector<cv::Mat> last_pyramid_;
  std::vector<cv::Point2f> points_;
};

struct Row
{
  std::string name;
  std::function<Counts(int64_t, const cv::Mat&, const cv::Mat&)> process;
  std::vector<double> ms;
  Counts sum;
};

double quantile(std::vector<double> values, double part)
{
  std::sort(values.begin(), values.end());
  return values[std::min(values.size() - 1, static_cast<size_t>(part * static_cast<double>(values.size())))];
}

std::vector<std::string> readNames(const std::string& folder)
{
  std::ifstream list(folder + "/cam0/data.csv");
  std::vector<std::string> names;
  std::string line;
  while (std::getline(list, line))
  {
    if (!line.empty() && line[0] != '#')
    {
      names.push_back(line.substr(0, line.find(',')));
    }
  }
  if (names.empty())
  {
    throw std::runtime_error(folder + "/cam0/data.csv: no pictures; give the folder of an EuRoC recording");
  }
  return names;
}

void run(const std::string& recording, size_t pairs)
{
  const std::string folder = recording + "/mav0";
  const std::vector<std::string> names = readNames(folder);
  cv::setNumThreads(1);
  StereoTrackerOptions options;
  options.max_features = FEATURES;
  StereoTracker tracker(StereoCalibration::loadEuroc(folder + "/cam0/sensor.yaml", folder + "/cam1/sensor.yaml"),
                        options);
  OpenCvFrontEnd good(Corners::GOOD, 21, 4);
  OpenCvFrontEnd fast(Corners::FAST, options.window_px, options.levels);
  std::vector<double> stages[4];
  std::vector<Row> rows(3);
  rows[0].name = "pi_slam";
  rows[0].process = [&](int64_t stamp_ns, const cv::Mat& left, const cv::Mat& right)
  {
    TrackerReport report;
    const size_t features = tracker.process(stamp_ns, left, right, {}, FEATURES, &report).features.size();
    const double ms[4] = {report.pyramid_ms, report.track_ms, report.detect_ms, report.stereo_ms};
    for (size_t i = 0; i < 4; ++i)
    {
      stages[i].push_back(ms[i]);
    }
    return Counts{features, static_cast<size_t>(report.tracked), static_cast<size_t>(report.stereo)};
  };
  rows[1].name = "OpenCV, FAST, LK " + std::to_string(options.window_px) + "x" + std::to_string(options.window_px);
  rows[1].process = [&](int64_t, const cv::Mat& left, const cv::Mat& right) { return fast.process(left, right); };
  rows[2].name = "OpenCV, Shi-Tomasi, LK 21x21";
  rows[2].process = [&](int64_t, const cv::Mat& left, const cv::Mat& right) { return good.process(left, right); };

  const size_t count = std::min(pairs, names.size());
  for (size_t k = 0; k < count; ++k)
  {
    const cv::Mat left = cv::imread(folder + "/cam0/data/" + names[k] + ".png", cv::IMREAD_GRAYSCALE);
    const cv::Mat right = cv::imread(folder + "/cam1/data/" + names[k] + ".png", cv::IMREAD_GRAYSCALE);
    for (size_t turn = 0; turn < rows.size(); ++turn)
    {
      Row& row = rows[(k + turn) % rows.size()];  // each is first as often as the others
      const double start = processorMs();
      const Counts counts = row.process(std::stoll(names[k]), left, right);
      row.ms.push_back(processorMs() - start);
      row.sum.features += counts.features;
      row.sum.tracked += counts.tracked;
      row.sum.stereo += counts.stereo;
    }
  }
  const double n = static_cast<double>(count);
  std::printf("%s, one thread, %zu pairs of %s, %d features asked for\n", machineName().c_str(), count,
              recording.c_str(), FEATURES);
  std::printf("%-30s %8s %8s %8s %7s %9s %9s %9s\n", "", "mean ms", "p50 ms", "p99 ms", "ratio", "features", "tracked",
              "stereo");
  std::vector<double> ratios;
  for (const Row& row : rows)
  {
    ratios.clear();
    for (size_t k = 0; k < count; ++k)
    {
      ratios.push_back(row.ms[k] / rows[0].ms[k]);
    }
    std::printf("%-30s %8.2f %8.2f %8.2f %7.2f %9.1f %9.1f %9.1f\n", row.name.c_str(),
                std::accumulate(row.ms.begin(), row.ms.end(), 0.0) / n, quantile(row.ms, 0.5), quantile(row.ms, 0.99),
                quantile(ratios, 0.5), static_cast<double>(row.sum.features) / n,
                static_cast<double>(row.sum.tracked) / n, static_cast<double>(row.sum.stereo) / n);
  }
  std::printf(
      "pi_slam's stages, median of the wall clock: pyramids %.2f, tracking %.2f, corners %.2f, stereo %.2f ms\n",
      quantile(stages[0], 0.5), quantile(stages[1], 0.5), quantile(stages[2], 0.5), quantile(stages[3], 0.5));
}

}  // namespace

int main(int argc, char** argv)
{
  if (argc < 2 || argc > 3)
  {
    std::fprintf(stderr, "Usage: %s EUROC_DIR [PAIRS]\n", argv[0]);
    return 2;
  }
  try
  {
    run(argv[1], argc == 3 ? std::max(1UL, std::stoul(argv[2])) : USUAL_PAIRS);
  }
  catch (const std::exception& error)
  {
    std::fprintf(stderr, "bench_front_end: %s\n", error.what());
    return 1;
  }
  return 0;
}
