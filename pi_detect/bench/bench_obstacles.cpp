// Obstacles from stereo on recordings by pi_slam's render_sequence (with --depth --obstacle-truth), against what was
// rendered, beside the usual recipe on the same pictures:
//   bench_obstacles RECORDING...
// The vehicle's poses are true. Time is that of the processor, on one thread. A recording without truth, as EuRoC's,
// gives times and pictures only.

#include <pi_detect/obstacle_tracker.h>
#include <pi_node/command_line.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <exception>
#include <filesystem>
#include <fstream>
#include <opencv2/core/utility.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "obstacles/grid_score.h"
#include "obstacles/recording.h"
#include "obstacles/truth.h"
#include "obstacles/usual_recipe.h"

namespace
{

using namespace pi_detect;
using namespace pi_detect::bench;

struct Arguments
{
  std::vector<std::string> recordings;
  std::string overlay;  ///< pictures with something wrong, and every 20th, go there
  double height_m = 1.0;
  bool baseline = true;
  StereoObstacleOptions options;
};

double processorMs()
{
  timespec time{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
  return static_cast<double>(time.tv_sec) * 1e3 + static_cast<double>(time.tv_nsec) * 1e-6;
}

std::string machineName()
{
  std::ifstream info("/proc/cpuinfo");
  for (std::string line; std::getline(info, line);)
  {
    if (line.rfind("model name", 0) == 0)
    {
      return line.substr(line.find(':') + 2);
    }
  }
  return "unknown processor";
}

bool parse(int argc, char** argv, Arguments* line)
{
  namespace po = boost::program_options;
  bool no_baseline = false;
  pi_node::CommandLine options("bench_obstacles RECORDING... [options]");
  options.add("overlay", po::value(&line->overlay), "folder for pictures with something wrong, and every 20th");
  options.addValue("height", &line->height_m, "of the cameras' body above the ground [m]");
  options.addFlag("no-baseline", &no_baseline, "without the usual recipe");
  options.addPositional("recordings", &line->recordings, "no recording is named; see --help");
  if (!options.parse(argc, argv))
  {
    return false;
  }
  line->baseline = !no_baseline;
  return true;
}

double median(std::vector<double> values)
{
  std::nth_element(values.begin(), values.begin() + static_cast<ptrdiff_t>(values.size() / 2), values.end());
  return values[values.size() / 2];
}

std::vector<FoundBox> toBoxes(const std::vector<ObstacleMeasurement>& measurements)
{
  std::vector<FoundBox> boxes;
  for (const ObstacleMeasurement& measurement : measurements)
  {
    boxes.push_back({measurement.min, measurement.max, measurement.nearest.head<2>().norm()});
  }
  return boxes;
}

/// Left: what is measured (red: false), what is in view but missed (yellow). Right: disparity.
void draw(const std::string& file, const Pair& pair, const StereoObstacles& detector,
          const StereoObstacles::Result& result, const TruthCloud* truth, const Score& score)
{
  cv::Mat picture;
  cv::cvtColor(pair.left, picture, cv::COLOR_GRAY2BGR);
  for (size_t i = 0; i < result.obstacles.size(); ++i)
  {
    const ObstacleMeasurement& o = result.obstacles[i];
    const bool wrong = score.falseBoxes().count(i) > 0;
    const cv::Scalar color = wrong ? cv::Scalar(0, 0, 255) : cv::Scalar(0, 200, 0);
    cv::rectangle(picture, cv::Point2f(o.box.x1, o.box.y1), cv::Point2f(o.box.x2, o.box.y2), color, 1);
    char text[32];
    std::snprintf(text, sizeof(text), "%.1f", o.nearest.head<2>().norm());
    cv::putText(picture, text, cv::Point2f(o.box.x1 + 1, o.box.y1 + 10), cv::FONT_HERSHEY_PLAIN, 0.8, color);
  }
  if (truth != nullptr)
  {
    for (const int missed : score.missed())
    {
      const Box& box = truth->objects()[static_cast<size_t>(missed)].object->box;
      cv::rectangle(picture, cv::Point2f(box.x1, box.y1), cv::Point2f(box.x2, box.y2), cv::Scalar(0, 255, 255), 2);
    }
  }
  cv::Mat levels, colors, both;
  detector.disparity().convertTo(levels, CV_8U, 4.0);
  cv::applyColorMap(levels, colors, cv::COLORMAP_JET);
  colors.setTo(cv::Scalar(), detector.disparity() <= 0.0F);
  cv::hconcat(picture, colors, both);
  if (!cv::imwrite(file, both))
  {
    throw std::runtime_error(file + ": cannot be written");
  }
}

void run(const std::string& folder, const Arguments& line)
{
  const Recording recording(folder);
  Eigen::Isometry3d T_base_body = Eigen::Isometry3d::Identity();
  T_base_body.translation().z() = line.height_m;
  Eigen::Isometry3d T_base_left = T_base_body * recording.T_body_left();
  if (!recording.hasTruth())
  {
    // The mounting is unknown: looks ahead, level.
    T_base_left.linear() << 0, 0, 1, -1, 0, 0, 0, -1, 0;
    T_base_left.translation() << 0.0, 0.0, line.height_m;
  }
  StereoObstacles detector(recording.geometry(), T_base_left, line.options);
  UsualRecipe recipe(recording.geometry(), T_base_left, line.options);
  ObstacleTracker tracker;
  ObstacleTracker recipe_tracker;
  Score score;
  Score recipe_score;
  GridScore grid;
  std::vector<double> pair_ms, disparity_ms, ground_ms, clusters_ms, tracker_ms, recipe_ms, coverage;
  std::vector<double> ground_tilt_errors, ground_step_errors;
  size_t ground_measured = 0;
  std::optional<std::pair<int64_t, Eigen::Vector3d>> last;
  for (size_t i = 0; i < recording.size(); ++i)
  {
    const Pair pair = recording.read(i);
    const Eigen::Isometry3d T_world_base = pair.T_world_body * T_base_body.inverse();
    const auto pose = [&] { return recording.hasTruth() ? std::make_optional(T_world_base) : std::nullopt; };
    double start = processorMs();
    const StereoObstacles::Result result = detector.detect(pair.left, pair.right, pose);
    pair_ms.push_back(processorMs() - start);
    disparity_ms.push_back(1e3 * result.disparity_s);
    ground_ms.push_back(1e3 * result.ground_s);
    clusters_ms.push_back(1e3 * result.clusters_s);
    coverage.push_back(result.coverage);
    ground_measured += result.ground.measured ? 1 : 0;
    std::optional<TruthCloud> truth;
    if (recording.hasTruth())
    {
      truth.emplace(pair, recording.geometry(), T_base_body, T_base_left, line.options, detector.minDepth());
      const Eigen::Vector3d true_normal = T_world_base.linear().transpose() * Eigen::Vector3d::UnitZ();
      ground_tilt_errors.push_back(std::acos(std::min(1.0, true_normal.dot(result.ground.normal))) * 180.0 / M_PI);
      ground_step_errors.push_back(std::abs(result.ground.offset_m + T_world_base.translation().z()));
      VehicleState vehicle;
      vehicle.T_odom_base = T_world_base;
      if (last)
      {
        vehicle.velocity = T_world_base.linear().transpose() * (T_world_base.translation() - last->second) /
                           (1e-9 * static_cast<double>(pair.stamp_ns - last->first));
      }
      last = {pair.stamp_ns, T_world_base.translation()};
      start = processorMs();
      const auto obstacles = tracker.update(pair.stamp_ns, vehicle, result.obstacles, {}, recording.geometry(),
                                            T_base_left, detector.minDepth());
      tracker_ms.push_back(processorMs() - start);
      score.addMeasured(*truth, toBoxes(result.obstacles));
      score.addPublished(*truth, obstacles, pair.stamp_ns);
      score.addShapes(*truth, obstacles);
      grid.add(pair.stamp_ns, T_world_base, result, obstacles, *truth);
      if (line.baseline)
      {
        start = processorMs();
        const std::vector<ObstacleMeasurement> found = recipe.detect(pair.left, pair.right);
        recipe_ms.push_back(processorMs() - start);
        recipe_score.addMeasured(*truth, toBoxes(found));
        recipe_score.addPublished(*truth,
                                  recipe_tracker.update(pair.stamp_ns, vehicle, found, {}, recording.geometry(),
                                                        T_base_left, detector.minDepth()),
                                  pair.stamp_ns);
      }
    }
    const bool faulty = !score.missed().empty() || !score.falseBoxes().empty();
    if (!line.overlay.empty() && (faulty || i % 20 == 0))
    {
      const std::string name = std::filesystem::path(folder).filename().string();
      draw(line.overlay + "/" + name + "_" + std::to_string(1000 + i) + ".png", pair, detector, result,
           truth ? &*truth : nullptr, score);
    }
  }
  const StereoGeometry& geometry = recording.geometry();
  std::printf("\n%s: %zu pairs %dx%d, %.0f s, fx %.0f px, baseline %.3f m, depth from %.2f m\n", folder.c_str(),
              recording.size(), geometry.width, geometry.height, recording.seconds(), geometry.fx, geometry.baseline_m,
              detector.minDepth());
  std::printf(
      "time of the processor, median: %.1f ms per pair, least %.1f ms (wall: disparity %.1f, ground %.1f, "
      "clusters %.1f)\n",
      median(pair_ms), *std::min_element(pair_ms.begin(), pair_ms.end()), median(disparity_ms), median(ground_ms),
      median(clusters_ms));
  std::printf("disparity for %.0f %% of the pixels; ground measured in %zu of %zu pairs\n", 100.0 * median(coverage),
              ground_measured, recording.size());
  if (!recording.hasTruth())
  {
    return;
  }
  std::sort(ground_tilt_errors.begin(), ground_tilt_errors.end());
  std::sort(ground_step_errors.begin(), ground_step_errors.end());
  const size_t p95 = ground_tilt_errors.size() * 95 / 100;
  std::printf(
      "tracker %.2f ms; ground: tilt error median %.2f, p95 %.2f degrees, height error median %.3f, p95 %.3f m\n",
      median(tracker_ms), ground_tilt_errors[ground_tilt_errors.size() / 2], ground_tilt_errors[p95],
      ground_step_errors[ground_step_errors.size() / 2], ground_step_errors[p95]);
  const double minutes = recording.seconds() / 60.0;
  score.print("here", minutes);
  grid.print();
  const std::string name = std::filesystem::path(folder).filename().string();
  grid.draw(line.overlay.empty() ? "" : line.overlay + "/" + name + "_grid.png");
  if (line.baseline)
  {
    recipe_score.print(
        "usual recipe, " + std::to_string(static_cast<int>(std::lround(median(recipe_ms)))) + " ms per pair", minutes);
  }
}

}  // namespace

int main(int argc, char** argv)
{
  Arguments line;
  return pi_node::runTool(
      "bench_obstacles", [&] { return parse(argc, argv, &line); },
      [&]
      {
        cv::setNumThreads(1);
        std::printf("%s, one thread\n", machineName().c_str());
        for (const std::string& folder : line.recordings)
        {
          run(folder, line);
        }
        return EXIT_SUCCESS;
      });
}
