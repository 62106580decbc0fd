// bench_relocalisation: a map of a drive through a synthetic world is saved and loaded; then the vehicle starts at
// random places beside the path, turned by up to 45 degrees, and has to find out where it is. Starts in another world
// show whether it claims to know where it cannot.
#include <unistd.h>
#include "drives/vehicle_path.h"
#include "map/mapper.h"
#include "renderer/stereo_renderer.h"

#include <boost/program_options.hpp>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <iostream>
#include <random>

namespace
{

namespace po = boost::program_options;
using namespace pi_simulation;
using namespace pi_slam;

struct Arguments
{
  uint64_t seed = 1;
  int starts = 20;
  int strangers = 20;
  double drive_s = 85.0;
  double map_rate_hz = 5.0;
  double rate_hz = 10.0;
  double limit_s = 2.0;
  double speed = 0.5;
  double turn_deg = 45.0;
  double side_m = 0.5;
  bool exactly = false;
  bool parked_left = false;
  double light = 1.0;
  std::string path = "campus_loop";
  int threads = 2;
};

struct World
{
  std::vector<StampedPose> drive;
  std::shared_ptr<const SyntheticWorld> world;
};

World makeWorld(const Arguments& arguments, uint64_t seed, bool parked)
{
  World world;
  VehiclePathOptions path;
  path.shape = parsePathShape(arguments.path);
  path.duration_s = arguments.drive_s;
  path.seed = seed;
  world.drive = makeVehiclePath(path);
  SyntheticWorldOptions options;
  options.kind = path.shape == PathShape::HALL_LOOP ? WorldKind::HALL : WorldKind::CAMPUS;
  options.seed = seed;
  options.parked = parked;
  options.road = pathLine(path.shape, path.speed * path.duration_s);
  world.world = SyntheticWorld::build(options, world.drive);
  return world;
}

MapFrame frameAt(StereoRenderer* renderer, const Eigen::Isometry3d& T_world_body, const Eigen::Isometry3d& T_odom_world,
                 int64_t stamp_ns)
{
  const StereoFrame pictures = renderer->render(T_world_body, stamp_ns);
  MapFrame frame;
  frame.stamp_ns = stamp_ns;
  frame.T_odom_body = T_odom_world * T_world_body;
  frame.left = pictures.left;
  frame.right = pictures.right;
  return frame;
}

/// An odom frame that begins at a pose, with z up.
Eigen::Isometry3d odomAt(const Eigen::Isometry3d& T_world_body)
{
  const Eigen::Vector3d ahead = T_world_body.linear().col(0);
  Eigen::Isometry3d T_world_odom = Eigen::Isometry3d::Identity();
  T_world_odom.linear() =
      Eigen::AngleAxisd(std::atan2(ahead.y(), ahead.x()), Eigen::Vector3d::UnitZ()).toRotationMatrix();
  T_world_odom.translation() = T_world_body.translation();
  return T_world_odom;
}

Eigen::Isometry3d startOf(const World& world, const Arguments& arguments, std::mt19937_64* random, double* turn_deg,
                          int64_t* stamp_ns)
{
  std::uniform_real_distribution<double> unit(-1.0, 1.0);
  std::uniform_int_distribution<size_t> any(0, world.drive.size() - 1);
  const StampedPose& pose = world.drive[any(*random)];
  const auto offset = [&](double most)
  {
    const double part = unit(*random);
    return most * (arguments.exactly ? std::copysign(1.0, part) : part);
  };
  *turn_deg = offset(arguments.turn_deg);
  *stamp_ns = world.drive[any(*random) / 2].stamp_ns;  // things that move are elsewhere now
  Eigen::Isometry3d T = pose.T_world_body;
  T.translate(Eigen::Vector3d(0.0, offset(arguments.side_m), 0.0));
  T.rotate(Eigen::AngleAxisd(*turn_deg * M_PI / 180.0, Eigen::Vector3d::UnitZ()));
  return T;
}

struct Outcome
{
  bool localized = false;
  double time_s = 0.0;
  Eigen::Isometry3d T_map_body = Eigen::Isometry3d::Identity();    ///< as the mapper says
  Eigen::Isometry3d T_world_body = Eigen::Isometry3d::Identity();  ///< the truth then
  double mean_ms = 0.0;
};

Outcome start(const std::string& file, const Arguments& arguments, StereoRenderer* renderer,
              const StereoCalibration& calibration, const Eigen::Isometry3d& T_world_start, int64_t stamp_ns)
{
  MapperOptions options;
  options.threaded = false;
  Mapper mapper(calibration, options);
  mapper.load(file);
  const Eigen::Isometry3d T_odom_world = odomAt(T_world_start).inverse();
  Outcome outcome;
  int frames = 0;
  for (double time = 0.0; time <= arguments.limit_s && !outcome.localized; time += 1.0 / arguments.rate_hz)
  {
    Eigen::Isometry3d T = T_world_start;
    T.translate(Eigen::Vector3d(arguments.speed * time, 0.0, 0.0));
    const MapFrame frame = frameAt(renderer, T, T_odom_world, stamp_ns + static_cast<int64_t>(1e9 * time));
    mapper.add(frame);
    ++frames;
    outcome.mean_ms += mapper.statistics().last_add_ms;
    outcome.localized = mapper.statistics().localized;
    outcome.time_s = time;
    outcome.T_map_body = mapper.T_map_odom() * frame.T_odom_body;
    outcome.T_world_body = T;
  }
  outcome.mean_ms /= frames;
  return outcome;
}

int run(const Arguments& arguments)
{
  const World world = makeWorld(arguments, arguments.seed, true);
  const StereoCalibration calibration = StereoCalibration::makeForwardPair();
  StereoRendererOptions renderer_options;
  renderer_options.threads = arguments.threads;
  renderer_options.seed = arguments.seed;
  StereoRenderer renderer(world.world, calibration, renderer_options);

  MapperOptions options;
  options.threaded = false;
  Mapper mapper(calibration, options);
  const Eigen::Isometry3d T_world_map = odomAt(world.drive.front().T_world_body);
  const auto step = static_cast<size_t>(50.0 / arguments.map_rate_hz);
  double worst_ms = 0.0;
  double sum_ms = 0.0;
  size_t frames = 0;
  for (size_t i = 0; i < world.drive.size(); i += step, ++frames)
  {
    mapper.add(frameAt(&renderer, world.drive[i].T_world_body, T_world_map.inverse(), world.drive[i].stamp_ns));
    sum_ms += mapper.statistics().last_add_ms;
    worst_ms = std::max(worst_ms, mapper.statistics().last_add_ms);
  }
  const MapStatistics map = mapper.statistics();
  std::printf("map: seed %lu, %zu frames, %zu keyframes, %zu landmarks, %.1f MB, %zu loops, add %.1f ms (worst %.1f)\n",
              arguments.seed, frames, map.keyframes, map.landmarks, 1e-6 * static_cast<double>(map.bytes), map.loops,
              sum_ms / static_cast<double>(frames), worst_ms);
  const std::string file =
      (std::filesystem::temp_directory_path() / ("bench_relocalisation_" + std::to_string(getpid()) + ".map")).string();
  mapper.save(file);

  // The starts are later: parked things may have left, and the light may be another.
  renderer_options.brightness *= arguments.light;
  const World later = makeWorld(arguments, arguments.seed, !arguments.parked_left);
  StereoRenderer later_renderer(later.world, calibration, renderer_options);

  std::mt19937_64 random(arguments.seed);
  int good = 0;
  int wrong = 0;
  std::printf("%5s %9s %9s %8s %10s %10s %8s\n", "start", "turn deg", "localised", "time s", "error m", "yaw deg",
              "ms");
  for (int i = 0; i < arguments.starts; ++i)
  {
    double turn_deg = 0.0;
    int64_t stamp_ns = 0;
    const Eigen::Isometry3d T = startOf(world, arguments, &random, &turn_deg, &stamp_ns);
    const Outcome outcome = start(file, arguments, &later_renderer, calibration, T, stamp_ns);
    const Eigen::Isometry3d error = (T_world_map * outcome.T_map_body).inverse() * outcome.T_world_body;
    const double distance = error.translation().norm();
    const double yaw_deg = Eigen::AngleAxisd(error.linear()).angle() * 180.0 / M_PI;
    good += outcome.localized && distance < 0.5 && yaw_deg < 5.0 ? 1 : 0;
    wrong += outcome.localized && !(distance < 0.5 && yaw_deg < 5.0) ? 1 : 0;
    std::printf("%5d %9.1f %9s %8.1f ", i, turn_deg, outcome.localized ? "yes" : "no", outcome.time_s);
    outcome.localized ? std::printf("%10.3f %10.3f", distance, yaw_deg) : std::printf("%10s %10s", "-", "-");
    std::printf(" %8.1f\n", outcome.mean_ms);
  }
  int mistaken = 0;
  const World other = makeWorld(arguments, arguments.seed + 1000, true);
  StereoRenderer other_renderer(other.world, calibration, renderer_options);
  for (int i = 0; i < arguments.strangers; ++i)
  {
    double turn_deg = 0.0;
    int64_t stamp_ns = 0;
    const Eigen::Isometry3d T = startOf(other, arguments, &random, &turn_deg, &stamp_ns);
    const Outcome outcome = start(file, arguments, &other_renderer, calibration, T, stamp_ns);
    if (outcome.localized)
    {
      ++mistaken;
      const Eigen::Isometry3d error = (T_world_map * outcome.T_map_body).inverse() * outcome.T_world_body;
      std::printf("stranger %d claims a place, %.2f m from where it would be in that world\n", i,
                  error.translation().norm());
    }
  }
  std::filesystem::remove(file);
  std::printf("seed %lu: %d of %d localised rightly, %d wrongly; in another world %d of %d claimed\n", arguments.seed,
              good, arguments.starts, wrong, mistaken, arguments.strangers);
  return wrong == 0 && mistaken == 0 && 10 * good >= 9 * arguments.starts ? 0 : 1;
}

}  // namespace

int main(int argc, char** argv)
{
  Arguments arguments;
  po::options_description all("Usage: bench_relocalisation [options]");
  all.add_options()("help,h", "show this text")("seed", po::value(&arguments.seed)->default_value(1), "of the world")(
      "starts", po::value(&arguments.starts)->default_value(arguments.starts), "in the world of the map")(
      "strangers", po::value(&arguments.strangers)->default_value(arguments.strangers), "starts in another world")(
      "drive", po::value(&arguments.drive_s)->default_value(arguments.drive_s), "length of the drive [s]")(
      "map-rate", po::value(&arguments.map_rate_hz)->default_value(arguments.map_rate_hz), "frames of the drive [Hz]")(
      "rate", po::value(&arguments.rate_hz)->default_value(arguments.rate_hz), "frames after the start [Hz]")(
      "limit", po::value(&arguments.limit_s)->default_value(arguments.limit_s), "time to find out [s]")(
      "speed", po::value(&arguments.speed)->default_value(arguments.speed), "after the start [m/s]")(
      "turn", po::value(&arguments.turn_deg)->default_value(arguments.turn_deg), "largest, off the path [deg]")(
      "side", po::value(&arguments.side_m)->default_value(arguments.side_m), "largest, off the path [m]")(
      "exactly", po::bool_switch(&arguments.exactly), "every start is off by turn and side, to a side by chance")(
      "parked-left", po::bool_switch(&arguments.parked_left), "all parked things have left when the starts come")(
      "light", po::value(&arguments.light)->default_value(arguments.light), "of the starts, as part of the map's")(
      "path", po::value(&arguments.path)->default_value(arguments.path), "campus_loop, hall_loop, ...")(
      "threads,j", po::value(&arguments.threads)->default_value(arguments.threads), "of the renderer");
  try
  {
    po::variables_map values;
    po::store(po::command_line_parser(argc, argv).options(all).run(), values);
    po::notify(values);
    if (values.count("help") > 0)
    {
      std::cout << all;
      return 0;
    }
    return run(arguments);
  }
  catch (const std::exception& exception)
  {
    std::cerr << "bench_relocalisation: " << exception.what() << "\n";
    return 2;
  }
}
