// bench_map: what a map costs: a frame on new ground, a frame that looks for its place in maps of several sizes, the
// correction of the pose graph, memory, file and cloud. Pictures are rendered; odometry is the truth.
#include <unistd.h>
#include "drives/vehicle_path.h"
#include "map/mapper.h"
#include "renderer/stereo_renderer.h"

#include <chrono>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <random>
#include <thread>

#include "map/feature_extractor.h"
#include "map/map_graph.h"
#include "map/place_index.h"
#include "map/place_verifier.h"
#include "map/pose_graph.h"

namespace
{

using namespace pi_simulation;
using namespace pi_slam;
using namespace pi_slam::map;

template <typename Action>
double millisecondsOf(int repetitions, const Action& action)
{
  const auto start = std::chrono::steady_clock::now();
  for (int i = 0; i < repetitions; ++i)
  {
    action();
  }
  return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count() / repetitions;
}

/// Features like those of `set` of another place: the same spread, other bits.
FeatureSetPtr elsewhere(const FeatureSet& set, std::mt19937_64* random)
{
  auto other = std::make_shared<FeatureSet>(set);
  for (size_t i = 0; i < other->size(); ++i)
  {
    // Real descriptors are not uniform: whole bytes are taken from other features.
    for (size_t byte = 0; byte < DESCRIPTOR_BYTES; ++byte)
    {
      other->descriptors[i * DESCRIPTOR_BYTES + byte] = set.descriptor((*random)() % set.size())[byte];
    }
  }
  return other;
}

/// A circle driven again and again; every node recognises the one a round before.
MapData gridOfRounds(int count, int round)
{
  std::mt19937_64 random(1);
  std::normal_distribution<double> noise;
  MapData map;
  const double radius = 36.0 / 450.0 * round;
  for (int i = 0; i < count; ++i)
  {
    const double angle = 2.0 * M_PI * i / round;
    MapNode node;
    node.p_map_body = Eigen::Vector3d(radius * std::cos(angle), radius * std::sin(angle), 0.0) +
                      1e-3 * i * Eigen::Vector3d{noise(random), noise(random), noise(random)};
    map.nodes.push_back(node);
    for (const int back : {1, round})
    {
      if (i >= back)
      {
        MapEdge edge;
        edge.from = static_cast<uint32_t>(i - back);
        edge.to = static_cast<uint32_t>(i);
        edge.loop = back != 1;
        const double before = 2.0 * M_PI * (i - back) / round;
        edge.shift =
            radius * Eigen::Vector3d(std::cos(angle) - std::cos(before), std::sin(angle) - std::sin(before), 0.0);
        edge.position_deviation = 0.01;
        edge.heading_deviation = 0.002;
        map.edges.push_back(edge);
      }
    }
  }
  return map;
}

double residentMegabytes()
{
  std::ifstream stream("/proc/self/statm");
  double pages = 0.0;
  stream >> pages >> pages;
  return 1e-6 * pages * static_cast<double>(sysconf(_SC_PAGESIZE));
}

/// A drive of many kilometres over new ground, a keyframe every half metre; what lies far away goes to the disk.
void driveFar(const StereoCalibration& calibration, const std::vector<FeatureSetPtr>& sets, size_t keyframes)
{
  const size_t most = MapperOptions().max_keyframes;
  const std::string folder = std::filesystem::temp_directory_path().string();
  std::mt19937_64 random(1);
  MapGraph graph(calibration, PlaceVerifierOptions(), nullptr, folder);
  const uint32_t segment = graph.beginSegment();
  std::optional<uint32_t> last;
  double worst_ms = 0.0;
  double sum_ms = 0.0;
  std::printf("far drive, tiles in %s\n", folder.c_str());
  for (size_t i = 0; i < keyframes; ++i)
  {
    MapNode node;
    node.segment = segment;
    node.travelled_m = 0.5 * static_cast<double>(i);
    node.T_odom_body.translation() = Eigen::Vector3d(node.travelled_m, 0.0, 0.0);
    node.p_map_body = node.T_odom_body.translation();
    node.features = elsewhere(*sets[i % sets.size()], &random);
    last = graph.add(std::move(node), last, 1.0);
    if (graph.counts().in_memory > most)
    {
      const double ms =
          millisecondsOf(1, [&] { graph.loadAround(graph.data().nodes[*last].p_map_body, 0, most * 9 / 10); });
      worst_ms = std::max(worst_ms, ms);
      sum_ms += ms;
    }
    if ((i + 1) % (keyframes / 5) == 0)
    {
      std::printf(
          "%7.1f km, %5zu keyframes    %5zu in memory, map %6.1f MB, process %6.1f MB, disk %6.1f MB, tiles "
          "%.2f ms per keyframe (worst %.1f)\n",
          0.5e-3 * static_cast<double>(i + 1), graph.counts().keyframes, graph.counts().in_memory,
          1e-6 * static_cast<double>(graph.bytes()), residentMegabytes(),
          1e-6 * static_cast<double>(graph.bytesOnDisk()), sum_ms / static_cast<double>(i + 1), worst_ms);
    }
  }
  const auto back = [&] { graph.loadAround(Eigen::Vector3d::Zero(), 0, most * 9 / 10); };
  std::printf("back at the start           %8.2f ms for %zu keyframes\n", millisecondsOf(1, back),
              graph.counts().in_memory);
}

}  // namespace

int main()
{
  VehiclePathOptions path;
  path.duration_s = 20.0;
  const std::vector<StampedPose> drive = makeVehiclePath(path);
  SyntheticWorldOptions world;
  world.road = pathLine(path.shape, 60.0);
  const StereoCalibration calibration = StereoCalibration::makeForwardPair(752, 480, 0.11);
  StereoRendererOptions renderer_options;
  renderer_options.threads = 2;
  StereoRenderer renderer(SyntheticWorld::build(world, drive), calibration, renderer_options);
  std::vector<MapFrame> frames;
  for (size_t i = 200; i + 1 < drive.size(); i += 10)
  {
    const StereoFrame pictures = renderer.render(drive[i].T_world_body, drive[i].stamp_ns);
    MapFrame frame;
    frame.stamp_ns = drive[i].stamp_ns;
    frame.T_odom_body = drive[i].T_world_body;
    frame.left = pictures.left;
    frame.right = pictures.right;
    frames.push_back(frame);
  }
  std::printf("752x480, %zu frames, %u cores; times on one core\n", frames.size(), std::thread::hardware_concurrency());

  const MapperOptions defaults;
  FeatureExtractor extractor(calibration, defaults.features);
  std::vector<FeatureSetPtr> sets;
  for (const MapFrame& frame : frames)
  {
    sets.push_back(extractor.extract(frame));
  }
  size_t turn = 0;
  std::printf("features of a keyframe      %8.2f ms (%zu features)\n",
              millisecondsOf(50, [&] { extractor.extract(frames[turn++ % frames.size()]); }), sets[10]->size());
  PlaceVerifier verifier(calibration, PlaceVerifierOptions());
  std::printf("verification, right place   %8.2f ms\n",
              millisecondsOf(50,
                             [&]
                             {
                               const size_t i = 2 + turn++ % (sets.size() - 4);
                               verifier.verify(*sets[i], frames[i].T_odom_body,
                                               {{sets[i - 1], frames[i - 1].T_odom_body},
                                                {sets[i - 2], frames[i - 2].T_odom_body},
                                                {sets[i + 1], frames[i + 1].T_odom_body},
                                                {sets[i + 2], frames[i + 2].T_odom_body}});
                             }));
  std::mt19937_64 random(1);
  for (const uint32_t size : {100U, 1000U, 3000U})
  {
    PlaceIndex index;
    size_t bytes = 0;
    for (uint32_t i = 0; i < size; ++i)
    {
      const FeatureSetPtr set = elsewhere(*sets[i % sets.size()], &random);
      bytes += set->bytes();
      index.add(i, set);
    }
    std::printf("search of %4u keyframes    %8.2f ms, index %.1f MB, keyframes %.1f MB\n", size,
                millisecondsOf(30, [&] { index.query(*sets[turn++ % sets.size()]); }),
                1e-6 * static_cast<double>(index.bytes()), 1e-6 * static_cast<double>(bytes));
  }
  for (const auto& [size, round] : {std::pair(100, 450), {1000, 450}, {3000, 450}, {30000, 15000}})
  {
    MapData map = gridOfRounds(size, round);
    std::printf("correction of %5d nodes   %8.2f ms (%zu edges)\n", size,
                millisecondsOf(1, [&] { optimizePoseGraph(&map); }), map.edges.size());
  }
  driveFar(calibration, sets, MapperOptions().max_stored_keyframes);

  MapperOptions options;
  options.threaded = false;
  Mapper mapper(calibration, options);
  double sum = 0.0;
  for (const MapFrame& frame : frames)
  {
    mapper.add(frame);
    sum += mapper.statistics().last_add_ms;
  }
  const std::string file =
      (std::filesystem::temp_directory_path() / ("bench_map_" + std::to_string(getpid()) + ".map")).string();
  std::printf("add, new ground             %8.2f ms mean\n", sum / static_cast<double>(frames.size()));
  std::printf("cloud, first and again      %8.2f ms, ", millisecondsOf(1, [&] { mapper.cloud(); }));
  std::printf("%.2f ms (%zu points)\n", millisecondsOf(5, [&] { mapper.cloud(); }), mapper.cloud().size());
  std::printf("save, load                  %8.2f ms, ", millisecondsOf(1, [&] { mapper.save(file); }));
  std::printf("%.2f ms (%zu keyframes)\n", millisecondsOf(1, [&] { mapper.load(file); }),
              mapper.statistics().keyframes);
  std::filesystem::remove(file);
  return 0;
}
