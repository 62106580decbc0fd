#pragma once

#include <chrono>
#include <condition_variable>
#include <deque>
#include <mutex>
#include <optional>
#include <thread>
#include <vector>

#include <pi_runtime/stage.h>

#include "map/drift_filter.h"
#include "map/feature_extractor.h"
#include "map/map_graph.h"
#include "map/mapper.h"
#include "map/voxel_cloud.h"
#include "odometry/pose_history.h"

namespace pi_slam
{

using namespace map;

inline bool isApart(const Eigen::Isometry3d& a, const Eigen::Isometry3d& b, double distance_m, double angle_rad)
{
  return (a.translation() - b.translation()).norm() >= distance_m || angleBetween(a, b) >= angle_rad;
}

/// A place that a picture showed, as a witness for those that come.
struct Witness
{
  Eigen::Isometry3d T_odom_body;
  Eigen::Isometry3d T_map_odom;
  uint32_t part;
  double travelled_m;
};

/// The stretch of odometry that is being driven: since the start, or since odometry began anew.
struct Segment
{
  static constexpr int64_t HISTORY_NS = 3000000000;

  uint32_t number = 0;
  double travelled_m = 0.0;
  double recognized_at_m = 0.0;      ///< way when a place was recognised last; where it began if none was
  bool recognized_any = false;       ///< a place, so far
  Eigen::Isometry3d T_odom_last;     ///< of the frame before
  Eigen::Isometry3d T_odom_attempt;  ///< of the frame that was looked at last
  int64_t attempt_ns = 0;
  Eigen::Isometry3d T_odom_anywhere;        ///< of the frame that was looked for in the whole map last
  std::optional<uint32_t> last_node;        ///< index of the newest node
  double odometry_factor = 1.0;             ///< on the deviations of the next edge of odometry
  OccupancyCells last_grid;                 ///< around the vehicle, in odom; empty: none so far
  double gridded_m = 0.0;                   ///< way up to the last patch of a grid
  std::optional<Eigen::Vector3d> tiles_at;  ///< where the body was in map when tiles were loaded around it
  int attempts = 0;                         ///< in vain to recognise a place of another part
  std::vector<Witness> witnesses;           ///< oldest first
  PoseHistory recent{HISTORY_NS, 0};        ///< T_odom_body of the last frames
};

/// mapper.cpp has queue, thread and files; mapper_frames.cpp adds frames to the map; mapper_places.cpp recognises
/// places.
struct Mapper::Impl
{
  Impl(const StereoCalibration& camera_calibration, const MapperOptions& mapper_options,
       const std::shared_ptr<pi_runtime::Runtime>& runtime)
    : calibration(camera_calibration)
    , options(mapper_options)
    , extractor(calibration, options.features, options.kernel_tasks ? runtime : nullptr)
    , graph(calibration, verifierOptions(options), options.kernel_tasks ? runtime : nullptr, options.tile_folder)
    , voxels(options.voxel_m, options.max_landmark_range_m)
    // Tasks within a run would wait for the unit that the run is on.
    , stage(options.kernel_tasks ? nullptr : runtime, {"slam_map", std::chrono::nanoseconds(0), STAGE_DEADLINE})
  {
    reset();
  }

  static PlaceVerifierOptions verifierOptions(const MapperOptions& options)
  {
    PlaceVerifierOptions verifier;
    verifier.min_inliers = options.min_inliers;
    return verifier;
  }

  void run();
  void dropWaiting();
  void process(const MapFrame& frame, bool begins_anew);

  // What follows works on the map: under map_mutex.
  void beginSegment(const MapFrame& frame);
  bool isNodeDue(const MapFrame& frame) const;
  bool isAttemptDue(const MapFrame& frame) const;
  std::vector<RecognizedPlace> recognize(const MapFrame& frame, const FeatureSet& features);
  void recognizeNear(const MapFrame& frame, const PlaceQuery& query, std::vector<RecognizedPlace>* places);
  void recognizeAnywhere(const MapFrame& frame, const PlaceQuery& query, std::vector<RecognizedPlace>* places);
  bool fits(const RecognizedPlace& place) const;
  bool hasWitness(const MapFrame& frame, const RecognizedPlace& place);
  void joinParts(const MapFrame& frame, RecognizedPlace* place);
  void moveTo(const Eigen::Isometry3d& T_map_odom);
  bool isKeyframe(const FeatureSet& features, const std::vector<RecognizedPlace>& places) const;
  void addNode(const MapFrame& frame, FeatureSetPtr features, const std::vector<RecognizedPlace>& places);
  void doubtOdometry(const RecognizedPlace& place);
  void correct();
  void boundMap();
  void settleTiles();
  void tieFixes(const MapFrame& frame);
  void tieFix(const GnssFix& fix, const Eigen::Isometry3d& T_odom_body);
  void keepGrid(double behind_m);
  std::optional<GridPatch> newestGrid() const;
  void reset();
  void publish();
  double keyframeAngle() const { return options.keyframe_angle_deg * M_PI / 180.0; }
  size_t mostKeyframes() const;
  /// There is a map from a file, in which the body is not localised yet. What is driven is a part of its own.
  bool isWaiting() const { return loaded && !was_localized; }
  /// Whether a segment lies in map as it should: not while it is a part beside a map from a file.
  bool isPlaced(uint32_t number) const { return !loaded || graph.partOf(number) == 0; }
  MapData placedNodes() const;
  uint32_t ownPart() const { return graph.partOf(segment->number); }

  const StereoCalibration calibration;
  const MapperOptions options;

  mutable std::mutex map_mutex;  ///< taken after queue_mutex
  FeatureExtractor extractor;
  MapGraph graph;
  DriftFilter filter;              ///< the body in map
  std::optional<Segment> segment;  ///< nullopt: the next frame begins one
  bool loaded = false;
  bool was_localized = true;  ///< at least once since the map was loaded
  bool large_correction = false;
  std::deque<GnssFix> waiting_fixes;  ///< that no frame has passed yet
  size_t loops = 0;
  double last_add_ms = 0.0;

  mutable std::mutex cloud_mutex;  ///< taken before map_mutex
  mutable VoxelCloud voxels;
  static constexpr std::chrono::milliseconds STAGE_DEADLINE{1000};  ///< a place may be known again so late
  pi_runtime::Stage stage;

  mutable std::mutex published_mutex;  ///< taken last
  MapStatistics published;
  Eigen::Isometry3d published_T_map_odom = Eigen::Isometry3d::Identity();

  mutable std::mutex queue_mutex;
  std::condition_variable queue_changed;
  std::optional<MapFrame> next_frame;
  bool next_begins_anew = false;
  bool busy = false;
  bool stopping = false;
  size_t skipped = 0;
  std::thread thread;
};

}  // namespace pi_slam
