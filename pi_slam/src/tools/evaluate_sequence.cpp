// evaluate_sequence EUROC_DIR|BAG: runs odometry over a recording and compares it with ground truth. Needs no ROS
// master.

#include <pi_node/progress.h>
#include <pi_node/stop_signal.h>
#include "ros/vio_ros_options.h"
#include "evaluation/sequence_reader.h"
#include "odometry/vio_options_yaml.h"

#include <algorithm>
#include <boost/program_options.hpp>
#include <cstdlib>
#include <filesystem>
#include <iostream>
#include <opencv2/core/utility.hpp>

#include "evaluation/bag_reader.h"
#include "evaluation/run_files.h"
#include "evaluation/run_plot.h"
#include "evaluation/run_report.h"
#include "evaluation/sequence_run.h"

namespace
{

namespace po = boost::program_options;
namespace fs = std::filesystem;
using namespace pi_slam;

struct CommandLine
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
  bool map = false;
  bool quiet = false;
  double frame_budget_ms = 0.0;
  int opencv_threads = 1;
  SequenceReaderOptions reader;
  BagTopics topics;
};

std::unique_ptr<SequenceSource> openRecording(const CommandLine& line)
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

StereoCalibration readCalibration(const CommandLine& line, const SequenceDescription& description)
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

/// Noise and rate of the IMU go over those of the file of options: they belong to the recording.
void takeImu(const ImuModel& imu, ImuModel* options)
{
  options->rate_hz = imu.rate_hz;
  options->gyro_noise_density = imu.gyro_noise_density;
  options->gyro_random_walk = imu.gyro_random_walk;
  options->accel_noise_density = imu.accel_noise_density;
  options->accel_random_walk = imu.accel_random_walk;
}

SequenceRunOptions readOptions(const CommandLine& line, const SequenceDescription& description)
{
  SequenceRunOptions options;
  if (!line.config.empty())
  {
    loadOptionsYaml(line.config, &options.vio, &options.mapper, foreignKeys());
  }
  if (!line.imu.empty())
  {
    takeImu(ImuModel::loadYaml(line.imu), &options.vio.imu);
  }
  else if (description.imu)
  {
    takeImu(*description.imu, &options.vio.imu);
  }
  options.vio.frame_budget_s = 1e-3 * line.frame_budget_ms;
  options.mapper.threaded = false;
  options.map = line.map || !line.save_map.empty();
  options.save_map = line.save_map;
  return options;
}

/// Empty if there is none.
std::vector<StampedPose> readTruth(const CommandLine& line, const SequenceDescription& description)
{
  const std::string& file = line.ground_truth.empty() ? description.ground_truth : line.ground_truth;
  return file.empty() || file == "none" ? std::vector<StampedPose>() : readTrajectory(file);
}

/// Beside the poses, unless said otherwise; empty: none.
std::string plotFile(const CommandLine& line)
{
  if (line.plot.empty())
  {
    return line.output.empty() ? "" : fs::path(line.output).replace_extension(".png").string();
  }
  return line.plot == "none" ? "" : line.plot;
}

/// Now, rather than after minutes of work.
void requireOutputs(const CommandLine& line)
{
  const std::string plot = plotFile(line);
  if (!plot.empty() && fs::path(plot).extension() != ".png")
  {
    throw po::error("--plot \"" + plot + "\", expected a name that ends in .png, or none");
  }
  for (const std::string& file : {line.output, line.output_imu_rate, line.timing, plot})
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

void writeOutputs(const CommandLine& line, const SequenceRunResult& result)
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

int evaluate(const CommandLine& line)
{
  cv::setNumThreads(line.opencv_threads);
  std::unique_ptr<SequenceSource> source = openRecording(line);
  const SequenceDescription& description = source->description();
  const StereoCalibration calibration = readCalibration(line, description);
  const SequenceRunOptions options = readOptions(line, description);
  options.mapper.validate();
  const std::vector<StampedPose> truth = readTruth(line, description);
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
  if (!plotFile(line).empty())
  {
    writePlot(plotFile(line), description.name, result, judged, truth);
  }
  return pi_node::StopSignal::exitStatus();
}

po::options_description describe(CommandLine* line)
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
      "right-topic", po::value(&line->topics.right), "likewise")("imu-topic", po::value(&line->topics.imu), "likewise");
  po::options_description run("Run");
  run.add_options()("map", po::bool_switch(&line->map), "build a map beside odometry, with loops closed")(
      "save-map", po::value(&line->save_map), "file for the map; implies --map")(
      "frame-budget", po::value(&line->frame_budget_ms)->default_value(0.0),
      "longest time for one pair [ms]; 0: none, and so the same result every time")(
      "opencv-threads", po::value(&line->opencv_threads)->default_value(1), "1: times are those of one core");
  po::options_description output("Output");
  output.add_options()("help,h", "show this text")("output,o", po::value(&line->output),
                                                   "TUM file: a pose per pair, as it was at that time")(
      "output-imu-rate", po::value(&line->output_imu_rate), "TUM file: a pose per IMU sample, likewise")(
      "timing", po::value(&line->timing), "csv: status, counts and times of every pair")(
      "plot", po::value(&line->plot), "PNG; default: beside --output; none: no plot")(
      "quiet,q", po::bool_switch(&line->quiet), "no progress bar");
  po::options_description all(
      "Usage: evaluate_sequence [options] EUROC_DIR|BAG\n"
      "Runs visual-inertial odometry over a recording, prints accuracy and times, writes poses and a plot.\n");
  all.add(input).add(run).add(output);
  return all;
}

}  // namespace

int main(int argc, char** argv)
{
  CommandLine line;
  const po::options_description visible = describe(&line);
  try
  {
    po::options_description all;
    all.add(visible).add_options()("recording", po::value(&line.recording));
    po::positional_options_description positional;
    positional.add("recording", 1);
    po::variables_map values;
    po::store(po::command_line_parser(argc, argv).options(all).positional(positional).run(), values);
    po::notify(values);
    if (values.count("help") > 0)
    {
      std::cout << visible;
      return 0;
    }
    if (line.recording.empty())
    {
      throw po::error("EUROC_DIR or BAG is missing; evaluate_sequence --help shows all options");
    }
    pi_node::StopSignal::install();
    return evaluate(line);
  }
  catch (const po::error& error)
  {
    std::cerr << "evaluate_sequence: " << error.what() << "\n";
    return 2;
  }
  catch (const std::exception& exception)
  {
    std::cerr << "evaluate_sequence: " << exception.what() << "\n";
    return 1;
  }
}
