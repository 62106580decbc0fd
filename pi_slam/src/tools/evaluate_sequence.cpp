// evaluate_sequence EUROC_DIR|BAG: runs odometry over a recording and compares it with ground truth. Needs no ROS
// master.

#include <pi_node/child_process.h>
#include <pi_node/command_line.h>
#include <pi_node/progress.h>
#include <pi_node/stop_signal.h>
#include "evaluation/sequence_reader.h"
#include "odometry/vio_options_yaml.h"
#include "ros/vio_ros_options.h"

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <iostream>
#include <iterator>
#include <opencv2/core/utility.hpp>
#include <sstream>

#include "evaluation/bag_reader.h"
#include "evaluation/run_files.h"
#include "evaluation/run_report.h"
#include "evaluation/sequence_run.h"
#include "inertial/wheel_simulator.h"

namespace
{

namespace po = boost::program_options;
namespace fs = std::filesystem;
using namespace pi_slam;

constexpr double PLOT_TIMEOUT_S = 120.0;  ///< matplotlib writes a cache when it runs for the first time

struct Options
{
  std::string recording;
  std::string config;
  std::string calibration;
  std::string imu;
  std::string ground_truth;
  std::string output;
  std::string output_imu_rate;
  std::string timing;
  std::string plot;
  std::string save_map;
  std::string wheel_topic;
  std::string simulated_wheels;
  std::string imu_in_base;
  bool map = false;
  bool quiet = false;
  double frame_budget_ms = 0.0;
  int opencv_threads = 1;
  SequenceReaderOptions reader;
  BagTopics topics;
};

std::unique_ptr<SequenceSource> openRecording(const Options& line)
{
  if (!fs::exists(line.recording))
  {
    throw RecordingError(line.recording + ": missing; expected an EuRoC folder or a bag");
  }
  if (fs::is_directory(line.recording))
  {
    return openEuroc(line.recording, line.reader);
  }
  return openBag(line.recording, line.topics, line.reader);
}

StereoCalibration readCalibration(const Options& line, const SequenceDescription& description)
{
  if (line.calibration.empty())
  {
    if (!description.calibration)
    {
      throw CalibrationError(line.recording +
                             ": has no calibration; give Kalibr's camchain-imucam.yaml or an EuRoC folder by "
                             "--calibration");
    }
    return *description.calibration;
  }
  if (!fs::is_directory(line.calibration))
  {
    return StereoCalibration::loadKalibr(line.calibration);
  }
  const fs::path folder(line.calibration);
  const fs::path mav = fs::exists(folder / "mav0") ? folder / "mav0" : folder;
  return StereoCalibration::loadEuroc((mav / "cam0" / "sensor.yaml").string(), (mav / "cam1" / "sensor.yaml").string());
}

/// Keys that a file of the nodelet's parameters may hold and this tool has no use for.
std::vector<std::string> foreignKeys()
{
  SequenceRunOptions core;
  const std::vector<OptionField> fields = optionFields(&core.vio, &core.mapper);
  std::vector<std::string> keys;
  XmlRpc::XmlRpcValue parameters = VioRosOptions().toParameters();
  for (const auto& [name, value] : parameters)
  {
    const std::string group = name + "/";
    if (std::none_of(fields.begin(), fields.end(),
                     [&group](const OptionField& field) { return field.key.compare(0, group.size(), group) == 0; }))
    {
      keys.push_back(name);
    }
  }
  return keys;
}

SequenceRunOptions readOptions(const Options& line, const SequenceDescription& description)
{
  SequenceRunOptions options;
  if (!line.config.empty())
  {
    loadOptionsYaml(line.config, &options.vio, &options.mapper, foreignKeys());
  }
  // Noise and rate of the IMU go over those of the file of options: they belong to the recording.
  if (!line.imu.empty())
  {
    options.vio.imu = withSensor(options.vio.imu, ImuModel::loadYaml(line.imu));
  }
  else if (description.imu)
  {
    options.vio.imu = withSensor(options.vio.imu, *description.imu);
  }
  options.vio.frame_budget_s = 1e-3 * line.frame_budget_ms;
  options.mapper.threaded = false;
  options.map = line.map || !line.save_map.empty();
  options.save_map = line.save_map;
  return options;
}

/// Recorded in a bag, or simulated along the truth; "SCALE,NOISE" of these.
std::vector<WheelSample> readWheels(const Options& line, const std::vector<StampedPose>& truth)
{
  if (line.simulated_wheels.empty())
  {
    return line.wheel_topic.empty() ? std::vector<WheelSample>() : readBagWheels(line.recording, line.wheel_topic);
  }
  WheelSimulatorOptions wheels;
  if (std::sscanf(line.simulated_wheels.c_str(), "%lf,%lf", &wheels.scale, &wheels.noise) != 2 || truth.size() < 2)
  {
    throw po::error("--simulated-wheels \"" + line.simulated_wheels +
                    "\", expected SCALE,NOISE as in 1.02,0.01, and a recording with ground truth");
  }
  return simulateWheels(SplineTrajectory::fit(truth), wheels);
}

/// "x y z qx qy qz qw".
Eigen::Isometry3d readMounting(const std::string& text)
{
  std::istringstream stream(text);
  const std::vector<double> numbers{std::istream_iterator<double>(stream), {}};
  return text.empty() ? Eigen::Isometry3d::Identity() : parseTransform(numbers, "--imu-in-base");
}

/// Empty if there is none.
std::vector<StampedPose> readTruth(const Options& line, const SequenceDescription& description)
{
  const std::string& file = line.ground_truth.empty() ? description.ground_truth : line.ground_truth;
  return file.empty() || file == "none" ? std::vector<StampedPose>() : readTrajectory(file);
}

/// By default beside the poses; empty: none.
std::string plotFile(const Options& line)
{
  if (line.plot.empty())
  {
    return line.output.empty() ? "" : fs::path(line.output).replace_extension(".png").string();
  }
  return line.plot == "none" ? "" : line.plot;
}

/// What the picture shows, beside it.
std::string runFile(const std::string& plot)
{
  return fs::path(plot).replace_extension(".run.csv").string();
}

/// Calls plot_run, which stands beside this program.
void drawRun(const std::string& plot)
{
  pi_node::ChildOptions options;
  options.timeout_s = PLOT_TIMEOUT_S;
  const std::string program = (fs::read_symlink("/proc/self/exe").parent_path() / "plot_run").string();
  const pi_node::ChildResult result = pi_node::runChild(program, {runFile(plot), plot}, options);
  if (!result.in_time || result.status != 0)
  {
    throw std::runtime_error(plot + ": not drawn by " + program + ": " +
                             (result.in_time ? result.output : std::string("it took too long")));
  }
}

/// Now, rather than after minutes of work.
void requireOutputs(const Options& line)
{
  const std::string plot = plotFile(line);
  for (const std::string& file :
       {line.output, line.output_imu_rate, line.timing, plot, plot.empty() ? plot : runFile(plot)})
  {
    if (!file.empty())
    {
      requireWritable(file);
    }
  }
  const fs::path folder = fs::path(line.save_map).parent_path();
  if (!folder.empty() && !fs::is_directory(folder))
  {
    throw std::runtime_error(line.save_map + ": cannot be written; its folder is missing");
  }
}

void writeOutputs(const Options& line, const SequenceRunResult& result)
{
  if (!line.output.empty())
  {
    writeTum(line.output, "body (IMU) in odom, causal: as it was after each pair", result.poses);
  }
  if (!line.output_imu_rate.empty())
  {
    writeTum(line.output_imu_rate, "body (IMU) in odom, causal: as it was at each IMU sample",
             posesOf(result.imu_rate));
  }
  if (!line.timing.empty())
  {
    writeTiming(line.timing, result.pairs);
  }
}

int evaluate(const Options& line)
{
  cv::setNumThreads(line.opencv_threads);
  std::unique_ptr<SequenceSource> source = openRecording(line);
  const SequenceDescription& description = source->description();
  const StereoCalibration calibration = readCalibration(line, description);
  SequenceRunOptions options = readOptions(line, description);
  options.mapper.validate();
  const std::vector<StampedPose> truth = readTruth(line, description);
  options.wheels = readWheels(line, truth);
  options.vio.wheels.T_body_wheels = readMounting(line.imu_in_base).inverse();
  requireOutputs(line);

  SequenceReader reader(std::move(source), line.reader.read_ahead);
  SequenceRunResult result;
  {
    pi_node::Progress progress("pairs", line.quiet);
    result = runSequence(&reader, calibration, options,
                         [&](size_t done)
                         {
                           progress.show(done, description.pairs);
                           return !pi_node::StopSignal::came();
                         });
  }
  printRun(result, description, reader.defects(), &std::cout);
  writeOutputs(line, result);
  const std::vector<Judged> judged = judge(result, truth, &std::cout);
  if (result.poses.empty())
  {
    throw std::runtime_error(description.name + ": nothing was estimated" +
                             (result.warnings.empty() ? std::string() : "; last warning: " + result.warnings.back()));
  }
  if (truth.empty())
  {
    std::cout << "no ground truth; give it by --groundtruth\n";
  }
  if (const std::string plot = plotFile(line); !plot.empty())
  {
    writeRun(runFile(plot), description.name, result, judged, truth);
    drawRun(plot);
  }
  return pi_node::StopSignal::exitStatus();
}

/// @return false if there is nothing to do.
bool parse(int argc, char** argv, Options* line)
{
  po::options_description input("Recording");
  input.add_options()("config", po::value(&line->config),
                      "YAML of options, as for the nodelet (config/vio.yaml shows them)")(
      "calibration,c", po::value(&line->calibration),
      "Kalibr's camchain-imucam.yaml, or an EuRoC folder; default: that of the recording")(
      "imu", po::value(&line->imu), "Kalibr's imu.yaml; default: mav0/imu0/sensor.yaml")(
      "groundtruth,g", po::value(&line->ground_truth),
      "TUM or EuRoC csv; default: groundtruth_tum.txt or mav0/state_groundtruth_estimate0 of the recording; none: no "
      "comparison")("start", po::value(&line->reader.start_s)->default_value(0.0), "seconds to leave out")(
      "duration,d", po::value(&line->reader.duration_s)->default_value(0.0), "seconds; 0: to the end")(
      "pair-tolerance", po::value(&line->reader.pair_tolerance_s)->default_value(line->reader.pair_tolerance_s),
      "between the stamps of a pair [s]")("left-topic", po::value(&line->topics.left),
                                          "of a bag; default: by its name")(
      "right-topic", po::value(&line->topics.right), "likewise")("imu-topic", po::value(&line->topics.imu), "likewise")(
      "wheel-topic", po::value(&line->wheel_topic),
      "of a bag: nav_msgs/Odometry or geometry_msgs/TwistStamped of the chassis; default: no wheels")(
      "simulated-wheels", po::value(&line->simulated_wheels),
      "SCALE,NOISE: wheels along the ground truth that say SCALE times the speed, with a noise of that part")(
      "imu-in-base", po::value(&line->imu_in_base),
      "x y z qx qy qz qw, where the IMU is in the wheels' frame (base_link); default: at its origin");
  po::options_description run("Run");
  run.add_options()("map", po::bool_switch(&line->map), "build a map beside odometry, with loops closed")(
      "save-map", po::value(&line->save_map), "file for the map; implies --map")(
      "frame-budget", po::value(&line->frame_budget_ms)->default_value(0.0),
      "longest time for one pair [ms]; 0: none, and so the same result every time")(
      "opencv-threads", po::value(&line->opencv_threads)->default_value(1), "1: times are those of one core");
  po::options_description output("Output");
  output.add_options()("output,o", po::value(&line->output), "TUM file: a pose per pair, as it was at that time")(
      "output-imu-rate", po::value(&line->output_imu_rate), "TUM file: a pose per IMU sample, likewise")(
      "timing", po::value(&line->timing), "csv: status, counts and times of every pair")(
      "plot", po::value(&line->plot),
      "PNG, drawn by plot_run from a .run.csv beside it; default: beside --output; none: no plot")(
      "quiet,q", po::bool_switch(&line->quiet), "no progress bar");
  pi_node::CommandLine command(
      "Usage: evaluate_sequence [options] EUROC_DIR|BAG\n"
      "Runs visual-inertial odometry over a recording, prints accuracy and times, writes poses and a plot.\n");
  command.addGroup(input);
  command.addGroup(run);
  command.addGroup(output);
  command.addPositional("recording", &line->recording, "EUROC_DIR or BAG is missing");
  if (!command.parse(argc, argv))
  {
    return false;
  }
  const std::string plot = plotFile(*line);
  if (!plot.empty() && fs::path(plot).extension() != ".png")
  {
    throw po::error("--plot \"" + plot + "\", expected a name that ends in .png, or none");
  }
  return true;
}

}  // namespace

int main(int argc, char** argv)
{
  Options line;
  return pi_node::runTool(
      "evaluate_sequence", [&] { return parse(argc, argv, &line); },
      [&]
      {
        pi_node::StopSignal::install();
        return evaluate(line);
      });
}
