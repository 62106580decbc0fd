// Processor time of the renderer per stereo pair, without writing pictures. Run: bench_renderer [--picture FILE.png]

#include "drives/vehicle_path.h"
#include "renderer/stereo_renderer.h"

#include <boost/program_options.hpp>
#include <chrono>
#include <cstdio>
#include <ctime>
#include <exception>
#include <fstream>
#include <iostream>
#include <opencv2/imgcodecs.hpp>
#include <string>

namespace po = boost::program_options;
using namespace pi_simulation;

namespace
{

struct Variant
{
  const char* name;
  RenderQuality quality;
  Supersampling supersampling;
  bool color;
};

constexpr Variant VARIANTS[] = {
    {"recording, edges (render_sequence)", RenderQuality::RECORDING, Supersampling::EDGES, false},
    {"recording, one ray per pixel", RenderQuality::RECORDING, Supersampling::NONE, false},
    {"live, edges", RenderQuality::LIVE, Supersampling::EDGES, false},
    {"live, one ray per pixel", RenderQuality::LIVE, Supersampling::NONE, false},
    {"live, one ray per pixel, colour", RenderQuality::LIVE, Supersampling::NONE, true},
};

double processSeconds()
{
  timespec time = {};
  ::clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &time);
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

std::string processor()
{
  std::ifstream file("/proc/cpuinfo");
  for (std::string line; std::getline(file, line);)
  {
    if (line.rfind("model name", 0) == 0)
    {
      return line.substr(line.find(':') + 2);
    }
  }
  return "unknown";
}

void run(int pairs, int only, const std::string& picture)
{
  VehiclePathOptions path;
  path.duration_s = 60.0;
  path.start_standstill_s = 0.0;
  const std::vector<pi_slam::StampedPose> drive = makeVehiclePath(path);
  const pi_slam::SplineTrajectory trajectory = pi_slam::SplineTrajectory::fit(drive);
  SyntheticWorldOptions options;
  options.road = pathLine(path.shape, 0.0);
  const auto world = SyntheticWorld::build(options, drive);
  std::printf("%s; campus, 640x480, one thread, %d pairs along 180 m\n\n", processor().c_str(), pairs);
  std::printf("| what | CPU per pair [ms] |\n|---|---|\n");
  int number = 0;
  for (const Variant& variant : VARIANTS)
  {
    if (only >= 0 && number++ != only)
    {
      continue;
    }
    StereoRendererOptions renderer_options;
    renderer_options.quality = variant.quality;
    renderer_options.supersampling = variant.supersampling;
    renderer_options.color = variant.color;
    StereoRenderer renderer(world, pi_slam::StereoCalibration::makeForwardPair(), renderer_options);
    renderer.render(trajectory, trajectory.startNs());
    const double before = processSeconds();
    StereoFrame frame;
    for (int i = 0; i < pairs; ++i)
    {
      frame = renderer.render(trajectory, trajectory.startNs() + i * (59'000'000'000LL / pairs));
    }
    std::printf("| %s | %.1f |\n", variant.name, 1e3 * (processSeconds() - before) / pairs);
    std::fflush(stdout);
    if (!picture.empty())
    {
      cv::imwrite(picture, frame.left);
    }
  }
}

}  // namespace

int main(int argc, char** argv)
{
  int pairs = 0;
  int only = -1;
  std::string picture;
  po::options_description options("Usage: bench_renderer [options]");
  options.add_options()("help,h", "show this text")("pairs,n", po::value(&pairs)->default_value(60), "per variant")(
      "only", po::value(&only)->default_value(-1), "number of the one variant to run; -1: all")(
      "picture", po::value(&picture), "write the last left picture to this file");
  try
  {
    po::variables_map values;
    po::store(po::parse_command_line(argc, argv, options), values);
    po::notify(values);
    if (values.count("help") > 0)
    {
      std::cout << options;
      return 0;
    }
    run(pairs, only, picture);
    return 0;
  }
  catch (const std::exception& error)
  {
    std::cerr << "bench_renderer: " << error.what() << "\n";
    return 1;
  }
}
