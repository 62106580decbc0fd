// render_sequence FOLDER: renders a drive through a synthetic world as an EuRoC recording. Needs no ROS master.

#include "drives/sequence_writer.h"
#include "drives/vehicle_path.h"

#include <pi_node/progress.h>
#include <pi_node/stop_signal.h>

#include <algorithm>
#include <boost/program_options.hpp>
#include <cstdlib>
#include <filesystem>
#include <iomanip>
#include <iostream>
#include <sstream>
#include <thread>

namespace
{

namespace po = boost::program_options;
using namespace pi_simulation;

/// What the command line says that is not part of a library's options as it is.
struct CommandLine
{
  std::string path;
  std::string trajectory;
  std::string world;
  std::string obstacles;
  std::string calibration;
  std::string size;
  double baseline_m = 0.0;
  std::string supersampling;
  std::string quality;
  double exposure_ms = 0.0;
  double noise = 0.0;
  bool ideal_imu = false;
  double knot_interval_s = 0.0;
  uint64_t seed = 0;
  std::vector<std::string> black;
  std::vector<std::string> drop;
  std::vector<std::string> late;
  std::vector<std::string> imu_gap;
  VehiclePathOptions vehicle;
  SequenceOptions sequence;
};

[[noreturn]] void refuse(const std::string& option, const std::string& value, const std::string& expected)
{
  throw po::error("--" + option + " \"" + value + "\", expected " + expected);
}

struct SpanArgument
{
  TimeSpan span;
  std::string extra;  ///< third field
};

/// "FROM,TO" or "FROM,TO,EXTRA".
SpanArgument parseSpan(const std::string& option, const std::string& value)
{
  SpanArgument argument;
  char* end = nullptr;
  argument.span.from_s = std::strtod(value.c_str(), &end);
  if (end == value.c_str() || *end != ',')
  {
    refuse(option, value, "two times in seconds, as in 5,7.5");
  }
  const char* second = end + 1;
  argument.span.to_s = std::strtod(second, &end);
  if (end == second || (*end != '\0' && *end != ','))
  {
    refuse(option, value, "two times in seconds, as in 5,7.5");
  }
  argument.extra = *end == ',' ? end + 1 : "";
  return argument;
}

TimeSpan parsePlainSpan(const std::string& option, const std::string& value)
{
  const SpanArgument argument = parseSpan(option, value);
  if (!argument.extra.empty())
  {
    refuse(option, value, "two times in seconds, as in 5,7.5");
  }
  return argument.span;
}

void readFaults(const CommandLine& line, SequenceFaults* faults)
{
  using Cameras = SequenceFaults::Cameras;
  for (const std::string& value : line.black)
  {
    const SpanArgument argument = parseSpan("black", value);
    if (argument.extra != "" && argument.extra != "left" && argument.extra != "right")
    {
      refuse("black", value, "left or right as third field, or none");
    }
    faults->black.push_back({argument.span, argument.extra == ""       ? Cameras::BOTH
                                            : argument.extra == "left" ? Cameras::LEFT
                                                                       : Cameras::RIGHT});
  }
  for (const std::string& value : line.late)
  {
    faults->late.push_back(parsePlainSpan("late", value));
  }
  for (const std::string& value : line.drop)
  {
    faults->dropped.push_back(parsePlainSpan("drop", value));
  }
  for (const std::string& value : line.imu_gap)
  {
    faults->imu_gaps.push_back(parsePlainSpan("imu-gap", value));
  }
}

pi_slam::StereoCalibration readCalibration(const CommandLine& line)
{
  namespace fs = std::filesystem;
  if (line.calibration.empty())
  {
    int width = 0;
    int height = 0;
    char by = 0;
    std::istringstream stream(line.size);
    if (!(stream >> width >> by >> height) || by != 'x')
    {
      refuse("size", line.size, "WIDTHxHEIGHT, as in 640x480");
    }
    return pi_slam::StereoCalibration::makeForwardPair(width, height, line.baseline_m);
  }
  if (!fs::is_directory(line.calibration))
  {
    return pi_slam::StereoCalibration::loadKalibr(line.calibration);
  }
  const fs::path folder(line.calibration);
  const fs::path mav = fs::exists(folder / "mav0") ? folder / "mav0" : folder;
  return pi_slam::StereoCalibration::loadEuroc((mav / "cam0" / "sensor.yaml").string(),
                                               (mav / "cam1" / "sensor.yaml").string());
}

Supersampling parseSupersampling(const std::string& name)
{
  if (name != "none" && name != "edges" && name != "full")
  {
    refuse("supersampling", name, "none, edges or full");
  }
  return name == "none" ? Supersampling::NONE : name == "edges" ? Supersampling::EDGES : Supersampling::FULL;
}

RenderQuality parseQuality(const std::string& name)
{
  if (name != "recording" && name != "live")
  {
    refuse("quality", name, "recording or live");
  }
  return name == "live" ? RenderQuality::LIVE : RenderQuality::RECORDING;
}

void readObstacles(const std::string& list, SyntheticWorldOptions* world)
{
  world->parked = world->crossing = list == "all";
  if (list == "all" || list == "none")
  {
    return;
  }
  std::istringstream stream(list);
  for (std::string word; std::getline(stream, word, ',');)
  {
    if (word != "parked" && word != "crossing")
    {
      refuse("obstacles", list, "all, none, parked or crossing");
    }
    (word == "parked" ? world->parked : world->crossing) = true;
  }
}

/// CAMPUS for a path longer than 40 m across whose height varies by less than 1 m, else HALL.
WorldKind suitableWorld(const std::vector<pi_slam::StampedPose>& drive)
{
  if (drive.size() < 2)
  {
    throw std::invalid_argument("world: the drive has " + std::to_string(drive.size()) + " poses, needs two or more");
  }
  Eigen::AlignedBox3d extent;
  for (const pi_slam::StampedPose& pose : drive)
  {
    extent.extend(pose.T_world_body.translation());
  }
  const Eigen::Vector3d size = extent.sizes();
  return size.head<2>().norm() > 40.0 && size.z() < 1.0 ? WorldKind::CAMPUS : WorldKind::HALL;
}

WorldKind parseWorld(const std::string& name, WorldKind automatic)
{
  if (name != "auto" && name != "campus" && name != "hall")
  {
    refuse("world", name, "auto, campus or hall");
  }
  return name == "auto" ? automatic : name == "campus" ? WorldKind::CAMPUS : WorldKind::HALL;
}

/// Poses of the drive, and the world that suits them.
std::vector<pi_slam::StampedPose> readDrive(const CommandLine& line, bool ground_given, SyntheticWorldOptions* world)
{
  if (line.trajectory.empty())
  {
    const PathShape shape = parsePathShape(line.path);
    VehiclePathOptions vehicle = line.vehicle;
    vehicle.shape = shape;
    vehicle.seed = line.seed;
    vehicle.duration_s = line.sequence.start_s + line.sequence.duration_s;
    if (line.sequence.duration_s == 0.0 && vehicle.rounds == 0)
    {
      throw po::error("--duration 0 (all) needs a --trajectory or --rounds; a built-in path has no end");
    }
    world->kind = parseWorld(line.world, shape == PathShape::HALL_LOOP ? WorldKind::HALL : WorldKind::CAMPUS);
    world->road = pathLine(shape, vehicle.speed * vehicle.duration_s);  // closed ones have a length of their own
    return makeVehiclePath(vehicle);
  }
  std::vector<pi_slam::StampedPose> drive = pi_slam::readTrajectory(line.trajectory);
  world->kind = parseWorld(line.world, suitableWorld(drive));
  if (!ground_given)
  {
    constexpr double SENSOR_HEIGHT_M = 0.6;  // at the lowest point of a path whose ground is unknown
    const auto lowest = std::min_element(drive.begin(), drive.end(),
                                         [](const pi_slam::StampedPose& a, const pi_slam::StampedPose& b) {
                                           return a.T_world_body.translation().z() < b.T_world_body.translation().z();
                                         });
    world->ground_z = lowest->T_world_body.translation().z() - SENSOR_HEIGHT_M;
  }
  return drive;
}

int render(CommandLine* line, bool ground_given, SyntheticWorldOptions* world_options)
{
  readFaults(*line, &line->sequence.faults);
  readObstacles(line->obstacles, world_options);
  StereoRendererOptions& renderer = line->sequence.renderer;
  renderer.supersampling = parseSupersampling(line->supersampling);
  renderer.quality = parseQuality(line->quality);
  renderer.exposure_s = 1e-3 * line->exposure_ms;
  renderer.shot_noise *= line->noise * line->noise;
  renderer.read_noise *= line->noise;
  world_options->seed = line->seed;
  renderer.seed = line->seed;
  pi_slam::ImuSimulatorOptions& imu = line->sequence.imu;
  if (line->ideal_imu)
  {
    const double rate_hz = imu.rate_hz;
    imu = pi_slam::ImuSimulatorOptions::makeIdeal();
    imu.rate_hz = rate_hz;
  }
  imu.seed = line->seed;
  line->sequence.validate();

  const pi_slam::StereoCalibration calibration = readCalibration(*line);
  const std::vector<pi_slam::StampedPose> drive = readDrive(*line, ground_given, world_options);
  const pi_slam::SplineTrajectory trajectory = pi_slam::SplineTrajectory::fit(drive, line->knot_interval_s);
  const auto world = SyntheticWorld::build(*world_options, drive);
  SequenceReport report;
  double seconds = 0.0;
  {
    pi_node::Progress progress("pairs", false);
    report = writeSequence(world, trajectory, calibration, line->sequence,
                           [&](size_t done, size_t total)
                           {
                             progress.show(done, total);
                             return !pi_node::StopSignal::came();
                           });
    seconds = progress.seconds();
  }
  if (!report.complete)
  {
    std::cerr << "stopped; the partial recording was removed\n";
    return pi_node::StopSignal::exitStatus();
  }
  std::cout << line->sequence.folder << ": " << report.pairs << " pairs, " << report.imu_samples << " IMU samples, "
            << (world_options->kind == WorldKind::CAMPUS ? "campus" : "hall") << " with "
            << world->obstaclesAt(drive.front().stamp_ns).size() << " objects, " << std::fixed << std::setprecision(1)
            << seconds << " s\n";
  return 0;
}

po::options_description describe(CommandLine* line, SyntheticWorldOptions* world)
{
  SequenceOptions& sequence = line->sequence;
  StereoRendererOptions& renderer = sequence.renderer;
  const int cores = static_cast<int>(std::clamp(std::thread::hardware_concurrency(), 1u, 64u));
  po::options_description drive("Drive");
  drive.add_options()("path", po::value(&line->path)->default_value("campus_loop"),
                      "built-in path: campus_loop, hall_loop, straight, figure_eight")(
      "trajectory,t", po::value(&line->trajectory),
      "file of poses in place of a built-in path: TUM (t x y z qx qy qz qw) or EuRoC ground truth csv")(
      "start", po::value(&sequence.start_s)->default_value(0.0), "seconds of the path to leave out")(
      "duration,d", po::value(&sequence.duration_s)->default_value(20.0), "seconds; 0: all of a trajectory file")(
      "rounds", po::value(&line->vehicle.rounds)->default_value(0),
      "of a closed built-in path, in place of --duration: ends where it began")(
      "speed", po::value(&line->vehicle.speed)->default_value(3.0), "of the built-in paths [m/s]")(
      "start-standstill", po::value(&line->vehicle.start_standstill_s)->default_value(2.0), "seconds")(
      "end-standstill", po::value(&line->vehicle.end_standstill_s)->default_value(0.0), "seconds")(
      "stops", po::value(&line->vehicle.stops)->default_value(0), "on the way, of 3 s each")(
      "bumps", po::value(&line->vehicle.bumps)->default_value(1.0), "scale of the road's unevenness")(
      "knot-interval", po::value(&line->knot_interval_s)->default_value(0.0), "of the spline [s]; 0: by the data");
  po::options_description scene("World");
  scene.add_options()("world", po::value(&line->world)->default_value("auto"), "campus, hall, or auto: by the path")(
      "obstacles", po::value(&line->obstacles)->default_value("all"), "all, none, parked, crossing")(
      "ground-z", po::value(&world->ground_z), "height of the ground [m]; default 0, for files 0.6 below the path")(
      "seed", po::value(&line->seed)->default_value(1), "of everything random");
  po::options_description cameras("Cameras and IMU");
  cameras.add_options()("calibration,c", po::value(&line->calibration),
                        "EuRoC folder (cam0/sensor.yaml, cam1/sensor.yaml) or Kalibr's camchain-imucam.yaml")(
      "size", po::value(&line->size)->default_value("640x480"), "of the built-in camera, 90 degrees wide")(
      "baseline", po::value(&line->baseline_m)->default_value(0.12), "of the built-in camera [m]")(
      "rate,r", po::value(&sequence.frame_rate_hz)->default_value(20.0), "pairs per second")(
      "blur", po::value(&renderer.blur_samples)->default_value(1), "samples of motion blur, 1: off")(
      "exposure", po::value(&line->exposure_ms)->default_value(8.0), "[ms]; matters with blur")(
      "brightness", po::value(&renderer.brightness)->default_value(renderer.brightness), "of the pictures")(
      "gain-variation", po::value(&renderer.gain_variation)->default_value(0.0), "amplitude, in [0, 0.9]")(
      "vignetting", po::value(&renderer.vignetting)->default_value(renderer.vignetting), "in [0, 1]")(
      "noise", po::value(&line->noise)->default_value(1.0), "scale of the pictures' noise, 0: none")(
      "supersampling", po::value(&line->supersampling)->default_value("edges"), "none, edges, full")(
      "quality", po::value(&line->quality)->default_value("recording"), "recording, or live: cheaper random detail")(
      "color", po::bool_switch(&renderer.color), "BGR pictures")(
      "imu-rate", po::value(&sequence.imu.rate_hz)->default_value(200.0), "[Hz]")(
      "ideal-imu", po::bool_switch(&line->ideal_imu), "without noise and bias")(
      "imu-log", po::value(&sequence.imu_log), "EuRoC csv of a real IMU, passed on unchanged");
  po::options_description faults("Faults; times in seconds of the recording, may be repeated");
  faults.add_options()("black", po::value(&line->black), "FROM,TO[,left|right]: black pictures")(
      "drop", po::value(&line->drop), "FROM,TO: missing pairs")(
      "drop-probability", po::value(&sequence.faults.drop_probability)->default_value(0.0), "of every pair")(
      "late", po::value(&line->late), "FROM,TO: pairs stamped too late")(
      "late-by", po::value(&sequence.faults.late_s)->default_value(0.2), "seconds")(
      "imu-gap", po::value(&line->imu_gap), "FROM,TO: missing IMU samples")(
      "swap-cameras", po::bool_switch(&sequence.faults.swapped_cameras), "left pictures in cam1");
  po::options_description output("Output");
  output.add_options()("help,h", "show this text")("depth", po::bool_switch(&sequence.depth),
                                                   "truth/depth: 16-bit PNG, [mm], of the left camera")(
      "obstacle-truth", po::bool_switch(&sequence.obstacles), "truth/obstacles.json")(
      "threads,j", po::value(&renderer.threads)->default_value(cores), "")(
      "force,f", po::bool_switch(&sequence.overwrite), "replace a recording in FOLDER");
  po::options_description all(
      "Usage: render_sequence [options] FOLDER\n"
      "Renders a drive through a synthetic world to FOLDER, in the layout of an EuRoC recording.\n");
  all.add(drive).add(scene).add(cameras).add(faults).add(output);
  return all;
}

}  // namespace

int main(int argc, char** argv)
{
  CommandLine line;
  SyntheticWorldOptions world;
  const po::options_description visible = describe(&line, &world);
  try
  {
    po::options_description all;
    all.add(visible).add_options()("folder", po::value(&line.sequence.folder));
    po::positional_options_description positional;
    positional.add("folder", 1);
    po::variables_map values;
    po::store(po::command_line_parser(argc, argv).options(all).positional(positional).run(), values);
    po::notify(values);
    if (values.count("help") > 0)
    {
      std::cout << visible;
      return 0;
    }
    if (line.sequence.folder.empty())
    {
      throw po::error("FOLDER is missing; render_sequence --help shows all options");
    }
    if (line.vehicle.rounds > 0 && line.trajectory.empty())
    {
      line.sequence.duration_s = 0.0;  // all of them
    }
    pi_node::StopSignal::install();
    return render(&line, values.count("ground-z") > 0, &world);
  }
  catch (const po::error& error)
  {
    std::cerr << "render_sequence: " << error.what() << "\n";
    return 2;
  }
  catch (const std::exception& exception)
  {
    std::cerr << "render_sequence: " << exception.what() << "\n";
    return 1;
  }
}
