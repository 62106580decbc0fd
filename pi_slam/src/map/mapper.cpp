#include "map/mapper.h"
#include <malloc.h>
#include <pthread.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <condition_variable>
#include <functional>
#include <future>
#include <map>
#include <mutex>
#include <thread>
#include <utility>

#include <pi_node/option_check.h>
#include "map/drift_filter.h"
#include "map/feature_extractor.h"
#include "map/map_data.h"
#include "map/map_file.h"
#include "map/place_recognizer.h"
#include "map/pose_graph.h"
#include "map/redundancy.h"
#include "map/voxel_cloud.h"

namespace pi_slam
{

using namespace map;

namespace
{

constexpr double FIRST_DEVIATION = 1e-3;  ///< where a segment begins [m, rad]
constexpr double GATE_CHI2 = 25.0;        ///< of a place that fits what is known
constexpr double GATE_M = 1.0;            ///< odometry is not off by more than this,
constexpr double GATE_PER_M = 0.05;       ///< and this part of the way since a place was recognised
constexpr double GATE_RAD = 0.1;
constexpr double GATE_RAD_PER_M = 0.003;
constexpr double USUAL_DEVIATIONS = 2.0;  ///< of a place from what is known
constexpr double AGREEMENT_M = 0.35;      ///< between pictures that say the same
constexpr double AGREEMENT_RAD = 0.03;
constexpr double AGREEMENT_WAY_M = 4.0;  ///< within which they must come
constexpr double OTHER_VIEW_M = 0.1;     ///< pictures from the same spot are one,
constexpr double OTHER_VIEW_RAD = 0.05;
constexpr size_t MOST_WITNESSES = 10;
constexpr double LARGE_CORRECTION_M = 0.12;  ///< of a place: the graph is corrected at once
constexpr double LARGE_CORRECTION_RAD = 0.015;
constexpr size_t NODES_PER_CORRECTION = 20;  ///< else when so many nodes came,
constexpr size_t CORRECTION_PART = 20;       ///< and one in so many of the whole graph: it costs as it is large
constexpr double LOOP_DEVIATION = 1.5;       ///< factor on the deviations of loops: neighbours share errors
constexpr double SEARCH_M = 2.5;             ///< about the expected place
constexpr double MOST_SEARCH_M = 8.0;
constexpr size_t PLACES_NEAR = 2;       ///< recognised per picture
constexpr double KNOWN_GROUND_M = 3.0;  ///< way since a place was recognised
constexpr double ANYWHERE_M = 1.0;      ///< way between searches of the whole map, while the place is known
constexpr double ANYWHERE_RAD = 0.5;
constexpr double AT_REST_M = 0.01;  ///< while waiting, pictures from the same spot are looked at
constexpr double AT_REST_RAD = 0.01;
constexpr int64_t AT_REST_NS = 300000000;  ///< only so often
constexpr int MAX_PER_PLACE = 3;           ///< keyframes that look the same way
constexpr double WELL_KNOWN = 2.0;         ///< times the least inliers: needs no further keyframe
constexpr size_t PLAIN_NODES = 100;        ///< without features, that any map may have; else as many as keyframes

double angleBetween(const Eigen::Isometry3d& a, const Eigen::Isometry3d& b)
{
  return Eigen::AngleAxisd(a.linear().transpose() * b.linear()).angle();
}

bool isApart(const Eigen::Isometry3d& a, const Eigen::Isometry3d& b, double distance_m, double angle_rad)
{
  return (a.translation() - b.translation()).norm() >= distance_m || angleBetween(a, b) >= angle_rad;
}

/// The pose of odom in map, turned about z alone, that puts the body there.
Eigen::Isometry3d uprightMapOdom(const Eigen::Isometry3d& T_odom_body, const Eigen::Isometry3d& T_map_body)
{
  const Eigen::Matrix3d R = T_map_body.linear() * T_odom_body.linear().transpose();
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  // The turn about z that is nearest to R.
  T.linear() =
      Eigen::AngleAxisd(std::atan2(R(1, 0) - R(0, 1), R(0, 0) + R(1, 1)), Eigen::Vector3d::UnitZ()).toRotationMatrix();
  T.translation() = T_map_body.translation() - T.linear() * T_odom_body.translation();
  return T;
}

double headingOf(const Eigen::Isometry3d& T_map_odom)
{
  return std::atan2(T_map_odom.linear()(1, 0), T_map_odom.linear()(0, 0));
}

void checkPicture(const cv::Mat& picture, const CameraModel& camera, const char* side)
{
  if (!picture.empty() && (picture.type() != CV_8UC1 || picture.cols != camera.width || picture.rows != camera.height))
  {
    throw std::invalid_argument(std::string("map frame: the ") + side + " picture has " + std::to_string(picture.cols) +
                                " x " + std::to_string(picture.rows) + " px of type " + std::to_string(picture.type()) +
                                ", must be CV_8UC1 of " + std::to_string(camera.width) + " x " +
                                std::to_string(camera.height));
  }
}

bool isPose(const Eigen::Isometry3d& T)
{
  const Eigen::Matrix3d R = T.linear();
  return T.matrix().allFinite() && (R * R.transpose() - Eigen::Matrix3d::Identity()).norm() <= 1e-3 &&
         T.translation().norm() < 1e6;
}

void checkFrame(const MapFrame& frame, const StereoCalibration& calibration)
{
  checkPicture(frame.left, calibration.left.model, "left");
  checkPicture(frame.right, calibration.right.model, "right");
  if (!isPose(frame.T_odom_body))
  {
    throw std::invalid_argument("map frame: T_odom_body of " + std::to_string(frame.stamp_ns) +
                                " ns is no pose within 1000 km; give odometry's pose, or leave the frame out");
  }
}

/// The nodes that `keep` selects, and the edges between them.
MapData selected(const MapData& map, const std::function<bool(const MapNode&)>& keep)
{
  MapData part;
  std::vector<int64_t> moved(map.nodes.size(), -1);
  for (size_t i = 0; i < map.nodes.size(); ++i)
  {
    if (keep(map.nodes[i]))
    {
      moved[i] = static_cast<int64_t>(part.nodes.size());
      part.nodes.push_back(map.nodes[i]);
    }
  }
  for (MapEdge edge : map.edges)
  {
    if (moved[edge.from] >= 0 && moved[edge.to] >= 0)
    {
      edge.from = static_cast<uint32_t>(moved[edge.from]);
      edge.to = static_cast<uint32_t>(moved[edge.to]);
      part.edges.push_back(edge);
    }
  }
  return part;
}

size_t countKeyframes(const MapData& map)
{
  return static_cast<size_t>(
      std::count_if(map.nodes.begin(), map.nodes.end(), [](const MapNode& node) { return node.features != nullptr; }));
}

}  // namespace

void MapperOptions::validate() const
{
  const pi_node::OptionCheck check("map");
  check.range("keyframe_distance_m", keyframe_distance_m, 0.05, 10.0);
  check.range("keyframe_angle_deg", keyframe_angle_deg, 1.0, 90.0);
  check.range("features", features, 50, 2000);
  check.range<size_t>("max_keyframes", max_keyframes, 10, 100000);
  check.range("max_landmark_range_m", max_landmark_range_m, 1.0, 200.0);
  check.range("voxel_m", voxel_m, 0.01, 5.0);
  check.range("min_inliers", min_inliers, 8, 1000);
}

struct Mapper::Impl
{
  Impl(const StereoCalibration& camera_calibration, const MapperOptions& mapper_options,
       const std::shared_ptr<pi_runtime::Runtime>& runtime)
    : calibration(camera_calibration)
    , options(mapper_options)
    , extractor(calibration, options.features, runtime)
    , recognizer(calibration, verifierOptions(options), runtime)
    , voxels(options.voxel_m, options.max_landmark_range_m)
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
  void processOne(const MapFrame& frame, bool begins_anew);

  // What follows works on the map: under map_mutex.
  void process(const MapFrame& frame, bool begins_anew);
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
  void movePart(uint32_t part, const Eigen::Isometry3d& shift);
  bool isKeyframe(const FeatureSet& features, const std::vector<RecognizedPlace>& places) const;
  void addNode(const MapFrame& frame, FeatureSetPtr features, const std::vector<RecognizedPlace>& places);
  void doubtOdometry(const RecognizedPlace& place);
  void addOdometry(uint32_t to);
  void addLoop(uint32_t to, const RecognizedPlace& place);
  void correct();
  void boundMap();
  void reset();
  void publish();
  bool isCorrectionDue() const
  {
    return loops_pending && nodes_since_correction >= NODES_PER_CORRECTION + data.nodes.size() / CORRECTION_PART;
  }
  /// Frames are not added: there is a map from a file, in which the body is not localised yet.
  bool isWaiting() const { return loaded && !was_localized; }
  uint32_t ownPart() const { return part_of_segment[segment]; }

  const StereoCalibration calibration;
  const MapperOptions options;

  mutable std::mutex map_mutex;  ///< taken after queue_mutex
  FeatureExtractor extractor;
  PlaceRecognizer recognizer;
  DriftFilter filter;
  MapData data;
  uint64_t next_serial = 0;
  /// Segments with the same number are tied to each other in the map. 0: the part of the oldest segment, or the loaded
  /// one.
  std::vector<uint32_t> part_of_segment;
  uint32_t segment = 0;
  bool segment_begun = false;
  double travelled_m = 0.0;      ///< way of this segment
  double recognized_at_m = 0.0;  ///< of it, when a place was recognised last; where it began if none was
  bool recognized_any = false;   ///< in this segment
  bool loaded = false;
  bool was_localized = true;         ///< at least once since the map was loaded
  Eigen::Isometry3d T_odom_last;     ///< of the frame before
  Eigen::Isometry3d T_odom_attempt;  ///< of the frame that was looked at last
  int64_t attempt_ns = 0;
  Eigen::Isometry3d T_odom_anywhere;  ///< of the frame that was looked for in the whole map last
  int64_t last_node = -1;             ///< index of the segment's newest node
  size_t nodes_since_correction = 0;
  bool loops_pending = false;
  bool large_correction = false;
  double odometry_factor = 1.0;  ///< on the deviations of the next edge of odometry
  struct Witness
  {
    Eigen::Isometry3d T_odom_body;
    Eigen::Isometry3d T_map_odom;
    uint32_t part;
    double travelled_m;
  };
  std::vector<Witness> witnesses;
  size_t loops = 0;
  int64_t last_recognized_ns = 0;
  double last_add_ms = 0.0;

  mutable std::mutex cloud_mutex;  ///< taken before map_mutex
  mutable VoxelCloud voxels;

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

void Mapper::Impl::beginSegment(const MapFrame& frame)
{
  segment = static_cast<uint32_t>(part_of_segment.size());
  part_of_segment.push_back(segment);  // a part of its own
  segment_begun = true;
  travelled_m = 0.0;
  recognized_at_m = 0.0;
  recognized_any = false;
  odometry_factor = 1.0;
  last_node = -1;
  witnesses.clear();
  filter.start(frame.T_odom_body, filter.T_map_odom(), Eigen::Matrix4d::Identity() * FIRST_DEVIATION * FIRST_DEVIATION);
  T_odom_last = frame.T_odom_body;
  T_odom_attempt = frame.T_odom_body;
  T_odom_anywhere = frame.T_odom_body;
  attempt_ns = frame.stamp_ns - AT_REST_NS;
}

bool Mapper::Impl::isNodeDue(const MapFrame& frame) const
{
  return !isWaiting() &&
         (last_node < 0 || isApart(frame.T_odom_body, data.nodes[static_cast<size_t>(last_node)].T_odom_body,
                                   options.keyframe_distance_m, options.keyframe_angle_deg * M_PI / 180.0));
}

/// Whether it is worth looking for known places in this frame.
bool Mapper::Impl::isAttemptDue(const MapFrame& frame) const
{
  if (isWaiting())
  {
    return isApart(frame.T_odom_body, T_odom_attempt, AT_REST_M, AT_REST_RAD) ||
           std::abs(frame.stamp_ns - attempt_ns) >= AT_REST_NS;
  }
  const bool known_ground = recognized_any && travelled_m - recognized_at_m < KNOWN_GROUND_M;
  return (known_ground || ownPart() != 0) &&
         isApart(frame.T_odom_body, T_odom_attempt, 0.5 * options.keyframe_distance_m,
                 0.5 * options.keyframe_angle_deg * M_PI / 180.0);
}

void Mapper::Impl::process(const MapFrame& frame, bool begins_anew)
{
  const auto start = std::chrono::steady_clock::now();
  if (!segment_begun || begins_anew)
  {
    beginSegment(frame);
  }
  travelled_m += (frame.T_odom_body.translation() - T_odom_last.translation()).norm();
  T_odom_last = frame.T_odom_body;
  filter.predict(frame.T_odom_body);
  const bool node_due = isNodeDue(frame);
  if (node_due || isAttemptDue(frame))
  {
    T_odom_attempt = frame.T_odom_body;
    attempt_ns = frame.stamp_ns;
    const FeatureSetPtr features = extractor.extract(frame);
    std::vector<RecognizedPlace> places;
    if (options.loop_closure || isWaiting())
    {
      places = recognize(frame, *features);
    }
    if (node_due || (!places.empty() && (last_node < 0 || large_correction)))
    {
      addNode(frame, features, places);
    }
    if (large_correction || isCorrectionDue())
    {
      correct();
    }
    boundMap();
  }
  last_add_ms = std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
  publish();
}

/// Odometry does not drift by more: a place that needs more is a false recognition.
bool Mapper::Impl::fits(const RecognizedPlace& place) const
{
  const DriftFilter::Innovation innovation = filter.innovation(place.match);
  const double way = travelled_m - recognized_at_m;
  return innovation.distance_m < GATE_M + GATE_PER_M * way && innovation.angle_rad < GATE_RAD + GATE_RAD_PER_M * way;
}

/// Whether a picture taken shortly before, at another place, gives the same T_map_odom.
bool Mapper::Impl::hasWitness(const MapFrame& frame, const RecognizedPlace& place)
{
  const Eigen::Isometry3d& T_map_odom = place.match.T_map_odom;
  const uint32_t part = part_of_segment[data.nodes[place.node].segment];
  bool agreed = false;
  for (const Witness& witness : witnesses)
  {
    // Both are measurements of odom; compared at the body.
    const Eigen::Isometry3d before = witness.T_map_odom * frame.T_odom_body;
    agreed = agreed || (witness.part == part && travelled_m - witness.travelled_m < AGREEMENT_WAY_M &&
                        isApart(witness.T_odom_body, frame.T_odom_body, OTHER_VIEW_M, OTHER_VIEW_RAD) &&
                        !isApart(before, place.match.T_map_body, AGREEMENT_M, AGREEMENT_RAD));
  }
  if (witnesses.size() == MOST_WITNESSES)
  {
    witnesses.erase(witnesses.begin());
  }
  witnesses.push_back({frame.T_odom_body, T_map_odom, part, travelled_m});
  return agreed;
}

void Mapper::Impl::movePart(uint32_t part, const Eigen::Isometry3d& shift)
{
  const double turn = headingOf(shift);
  for (MapNode& node : data.nodes)
  {
    if (part_of_segment[node.segment] == part)
    {
      node.p_map_body = shift * node.p_map_body;
      node.heading += turn;
    }
  }
}

/// A place of another part of the map was recognised: joins both parts.
void Mapper::Impl::joinParts(const MapFrame& frame, RecognizedPlace* place)
{
  const uint32_t own = ownPart();
  const uint32_t other = part_of_segment[data.nodes[place->node].segment];
  const Eigen::Isometry3d shift = place->match.T_map_odom * filter.T_map_odom().inverse();
  if (own != 0)
  {
    movePart(own, shift);
    filter.start(frame.T_odom_body, place->match.T_map_odom, place->match.covariance);
  }
  else
  {
    movePart(other, shift.inverse());
    place->match.T_map_odom = filter.T_map_odom();
    place->match.T_map_body = filter.T_map_body();
  }
  for (uint32_t& part : part_of_segment)
  {
    part = part == std::max(own, other) ? std::min(own, other) : part;
  }
  was_localized = was_localized || ownPart() == 0;
}

/// Moves odom, and what was mapped by it; a map from a file stays.
void Mapper::Impl::moveTo(const Eigen::Isometry3d& T_map_odom)
{
  if (segment_begun && ownPart() == 0 && loaded)
  {
    segment_begun = false;  // what comes is a part of its own
  }
  else if (segment_begun)
  {
    movePart(ownPart(), T_map_odom * filter.T_map_odom().inverse());
    witnesses.clear();
  }
  filter.turn(T_map_odom);
}

/// Recognises places near where the body should be.
void Mapper::Impl::recognizeNear(const MapFrame& frame, const PlaceQuery& query, std::vector<RecognizedPlace>* places)
{
  const double deviation = std::sqrt(filter.covariance().topLeftCorner<3, 3>().trace());
  const double radius = std::min(MOST_SEARCH_M, SEARCH_M + 2.0 * deviation);
  for (const RecognizedPlace& place : recognizer.near(data, query, filter.T_map_body(), radius, PLACES_NEAR))
  {
    const DriftFilter::Innovation innovation = filter.innovation(place.match);
    if (!fits(place))
    {
      continue;
    }
    if (innovation.chi2 < GATE_CHI2)
    {
      large_correction =
          large_correction || innovation.distance_m > LARGE_CORRECTION_M || innovation.angle_rad > LARGE_CORRECTION_RAD;
      filter.update(place.match);
      places->push_back(place);
    }
    else if (hasWitness(frame, place))
    {
      large_correction = true;
      doubtOdometry(place);
      filter.start(frame.T_odom_body, place.match.T_map_odom, place.match.covariance);
      places->push_back(place);
    }
  }
}

void Mapper::Impl::recognizeAnywhere(const MapFrame& frame, const PlaceQuery& query,
                                     std::vector<RecognizedPlace>* places)
{
  T_odom_anywhere = frame.T_odom_body;
  std::optional<RecognizedPlace> place = recognizer.anywhere(data, query, ownPart() != 0);
  if (!place)
  {
    return;
  }
  const bool same_part = query.own_part[data.nodes[place->node].segment];
  if ((same_part && !fits(*place)) || !(place->strong || hasWitness(frame, *place)))
  {
    return;
  }
  large_correction = true;
  if (same_part)
  {
    doubtOdometry(*place);
    filter.start(frame.T_odom_body, place->match.T_map_odom, place->match.covariance);
  }
  else
  {
    joinParts(frame, &*place);
  }
  places->push_back(*place);
}

std::vector<RecognizedPlace> Mapper::Impl::recognize(const MapFrame& frame, const FeatureSet& features)
{
  PlaceQuery query;
  query.features = &features;
  query.T_odom_body = frame.T_odom_body;
  query.segment = segment;
  query.travelled_m = travelled_m;
  for (const uint32_t part : part_of_segment)
  {
    query.own_part.push_back(part == ownPart());
  }
  std::vector<RecognizedPlace> places;
  recognizeNear(frame, query, &places);
  if (places.empty() && (ownPart() != 0 || isApart(frame.T_odom_body, T_odom_anywhere, ANYWHERE_M, ANYWHERE_RAD)))
  {
    recognizeAnywhere(frame, query, &places);
  }
  if (!places.empty())
  {
    ++loops;
    last_recognized_ns = frame.stamp_ns;
    recognized_at_m = travelled_m;
    recognized_any = true;
  }
  return places;
}

/// On known ground a frame becomes a keyframe only where the map covers it badly.
bool Mapper::Impl::isKeyframe(const FeatureSet& features, const std::vector<RecognizedPlace>& places) const
{
  if (features.size() < static_cast<size_t>(options.min_inliers))
  {
    return false;
  }
  const Eigen::Isometry3d T_map_body = filter.T_map_body();
  int there = 0;
  for (const MapNode& node : data.nodes)
  {
    there += node.features && part_of_segment[node.segment] == ownPart() &&
                     !isApart(node.T_map_body(), T_map_body, 0.9 * options.keyframe_distance_m,
                              0.9 * options.keyframe_angle_deg * M_PI / 180.0)
                 ? 1
                 : 0;
  }
  int inliers = 0;
  for (const RecognizedPlace& place : places)
  {
    inliers = std::max(inliers, place.match.inliers);
  }
  return there == 0 || (there < MAX_PER_PLACE && inliers < WELL_KNOWN * options.min_inliers);
}

void Mapper::Impl::addNode(const MapFrame& frame, FeatureSetPtr features, const std::vector<RecognizedPlace>& places)
{
  MapNode node;
  node.serial = next_serial++;
  node.stamp_ns = frame.stamp_ns;
  node.segment = segment;
  node.travelled_m = travelled_m;
  node.T_odom_body = frame.T_odom_body;
  node.heading = headingOf(filter.T_map_odom());
  node.p_map_body = filter.T_map_body().translation();
  if (isKeyframe(*features, places))
  {
    node.features = std::move(features);
    recognizer.add(node);
  }
  const auto index = static_cast<uint32_t>(data.nodes.size());
  data.nodes.push_back(std::move(node));
  addOdometry(index);
  for (const RecognizedPlace& place : places)
  {
    addLoop(index, place);
  }
  last_node = index;
  ++nodes_since_correction;
}

/// By this place, odometry drifted more than expected since the last recognised place. Odometry gets less weight there;
/// otherwise the graph would not follow.
void Mapper::Impl::doubtOdometry(const RecognizedPlace& place)
{
  const double factor = std::sqrt(filter.innovation(place.match).chi2) / USUAL_DEVIATIONS;
  if (factor <= 1.0)
  {
    return;
  }
  odometry_factor = factor;
  for (MapEdge& edge : data.edges)
  {
    const MapNode& to = data.nodes[edge.to];
    if (!edge.loop && !to.loaded && to.segment == segment && to.travelled_m > recognized_at_m)
    {
      edge.position_deviation *= factor;
      edge.heading_deviation *= factor;
    }
  }
}

/// From the segment's newest node.
void Mapper::Impl::addOdometry(uint32_t to)
{
  if (last_node < 0)
  {
    return;
  }
  const MapNode& before = data.nodes[static_cast<size_t>(last_node)];
  const MapNode& now = data.nodes[to];
  const double way = now.travelled_m - before.travelled_m;
  const double turned = angleBetween(before.T_odom_body, now.T_odom_body);
  MapEdge edge;
  edge.from = static_cast<uint32_t>(last_node);
  edge.to = to;
  edge.shift = now.T_odom_body.translation() - before.T_odom_body.translation();
  edge.position_deviation = odometry_factor * std::hypot(DRIFT_POSITION_LEAST, DRIFT_POSITION * std::sqrt(way));
  edge.heading_deviation =
      odometry_factor * std::sqrt(DRIFT_HEADING_LEAST * DRIFT_HEADING_LEAST + DRIFT_HEADING * DRIFT_HEADING * way +
                                  DRIFT_HEADING_PER_TURN * DRIFT_HEADING_PER_TURN * turned);
  data.edges.push_back(edge);
  odometry_factor = 1.0;
}

void Mapper::Impl::addLoop(uint32_t to, const RecognizedPlace& place)
{
  const MapNode& from = data.nodes[place.node];
  const Eigen::Matrix4d& covariance = place.match.covariance;
  MapEdge edge;
  edge.from = place.node;
  edge.to = to;
  edge.loop = true;
  edge.shift = Eigen::AngleAxisd(-from.heading, Eigen::Vector3d::UnitZ()) *
               (place.match.T_map_body.translation() - from.p_map_body);
  edge.turn = std::remainder(headingOf(place.match.T_map_odom) - from.heading, 2.0 * M_PI);
  edge.position_deviation = LOOP_DEVIATION * std::sqrt(covariance.topLeftCorner<3, 3>().trace() / 3.0);
  edge.heading_deviation = LOOP_DEVIATION * std::sqrt(covariance(3, 3));
  data.edges.push_back(edge);
  loops_pending = true;
}

void Mapper::Impl::correct()
{
  // On a thread of its own: solving needs several times the memory of the map in small pieces. On another thread glibc
  // takes them from another arena than the map's, which is given back after each solution.
  auto solved = std::async(std::launch::async, [this] { return optimizePoseGraph(&data).usable; });
  const bool usable = solved.get();
  malloc_trim(0);
  if (usable && last_node >= 0)
  {
    // The motion of odometry since the newest node is added to it.
    filter.move(data.nodes[static_cast<size_t>(last_node)].T_map_odom());
  }
  nodes_since_correction = 0;
  loops_pending = false;
  large_correction = false;
}

void Mapper::Impl::boundMap()
{
  for (const size_t node : redundantKeyframes(data, options.max_keyframes, options.keyframe_distance_m,
                                              options.keyframe_angle_deg * M_PI / 180.0))
  {
    recognizer.remove(data.nodes[node]);
    data.nodes[node].features.reset();
  }
  // The map must grow with the area that was seen, not with time.
  const size_t keyframes = countKeyframes(data);
  if (const auto moved = thinOut(&data, keyframes + std::max(keyframes, PLAIN_NODES)))
  {
    last_node = last_node >= 0 ? (*moved)[static_cast<size_t>(last_node)] : -1;
  }
}

void Mapper::Impl::reset()
{
  recognizer.clear();
  data = MapData();
  next_serial = 0;
  part_of_segment.clear();
  segment_begun = false;
  recognized_any = false;
  last_node = -1;
  loaded = false;
  was_localized = true;
  nodes_since_correction = 0;
  loops_pending = false;
  large_correction = false;
  witnesses.clear();
  loops = 0;
  last_recognized_ns = 0;
  last_add_ms = 0.0;
  filter = DriftFilter();
}

void Mapper::Impl::publish()
{
  MapStatistics statistics;
  statistics.bytes =
      recognizer.bytes() + data.nodes.capacity() * sizeof(MapNode) + data.edges.capacity() * sizeof(MapEdge);
  for (const MapNode& node : data.nodes)
  {
    if (node.features)
    {
      ++statistics.keyframes;
      statistics.landmarks += node.features->size();
      statistics.bytes += node.features->bytes();
    }
  }
  statistics.loops = loops;
  statistics.loaded = loaded;
  statistics.localized = !loaded || (was_localized && segment_begun && ownPart() == 0);
  statistics.covariance = filter.covariance();
  statistics.last_recognized_ns = last_recognized_ns;
  statistics.last_add_ms = last_add_ms;
  std::lock_guard<std::mutex> lock(published_mutex);
  published = statistics;
  published_T_map_odom = filter.T_map_odom();
}

void Mapper::Impl::processOne(const MapFrame& frame, bool begins_anew)
{
  std::lock_guard<std::mutex> lock(map_mutex);
  process(frame, begins_anew);
}

void Mapper::Impl::dropWaiting()
{
  std::lock_guard<std::mutex> lock(queue_mutex);
  skipped += next_frame ? 1 : 0;
  next_frame.reset();
  queue_changed.notify_all();
}

void Mapper::Impl::run()
{
  std::unique_lock<std::mutex> lock(queue_mutex);
  for (;;)
  {
    queue_changed.wait(lock, [&] { return next_frame || stopping; });
    if (!next_frame)
    {
      return;
    }
    const MapFrame frame = std::move(*next_frame);
    const bool begins_anew = std::exchange(next_begins_anew, false);
    next_frame.reset();
    busy = true;
    lock.unlock();
    processOne(frame, begins_anew);
    lock.lock();
    busy = false;
    queue_changed.notify_all();
  }
}

Mapper::Mapper(const StereoCalibration& calibration, const MapperOptions& options,
               std::shared_ptr<pi_runtime::Runtime> runtime)
{
  options.validate();
  calibration.left.model.validate();
  calibration.right.model.validate();
  if (calibration.left.model.width != calibration.right.model.width ||
      calibration.left.model.height != calibration.right.model.height)
  {
    throw std::invalid_argument("map: the cameras have pictures of different sizes; give a pair of the same size");
  }
  if (options.use_runtime && !runtime)
  {
    throw std::invalid_argument("map/use_runtime = true, but there is no runtime; give one, or set it to false");
  }
  impl_ = std::make_unique<Impl>(calibration, options, options.use_runtime ? runtime : nullptr);
  if (options.threaded)
  {
    impl_->thread = std::thread([this] { impl_->run(); });
    pthread_setname_np(impl_->thread.native_handle(), "pi_slam_map");
  }
}

Mapper::~Mapper()
{
  {
    std::lock_guard<std::mutex> lock(impl_->queue_mutex);
    impl_->stopping = true;
    impl_->next_frame.reset();
  }
  impl_->queue_changed.notify_all();
  if (impl_->thread.joinable())
  {
    impl_->thread.join();
  }
}

void Mapper::add(const MapFrame& frame)
{
  checkFrame(frame, impl_->calibration);
  std::unique_lock<std::mutex> lock(impl_->queue_mutex);
  if (impl_->options.threaded)
  {
    impl_->skipped += impl_->next_frame ? 1 : 0;
    impl_->next_frame = frame;
    impl_->queue_changed.notify_all();
    return;
  }
  const bool begins_anew = std::exchange(impl_->next_begins_anew, false);
  lock.unlock();
  impl_->processOne(frame, begins_anew);
}

void Mapper::flush()
{
  std::unique_lock<std::mutex> lock(impl_->queue_mutex);
  impl_->queue_changed.wait(lock, [&] { return !impl_->next_frame && !impl_->busy; });
}

void Mapper::odometryReset()
{
  impl_->dropWaiting();  // it is of the segment that has ended
  std::lock_guard<std::mutex> lock(impl_->queue_mutex);
  impl_->next_begins_anew = true;
}

void Mapper::setPose(const Eigen::Isometry3d& T_odom_body, const Eigen::Isometry3d& T_map_body)
{
  if (!isPose(T_odom_body) || !isPose(T_map_body))
  {
    throw std::invalid_argument("map: the pose to be set, or that of odometry, is no pose within 1000 km");
  }
  // Not while a frame is in work: it may be the first one after a reset.
  std::unique_lock<std::mutex> queue_lock(impl_->queue_mutex);
  impl_->queue_changed.wait(queue_lock, [&] { return !impl_->busy; });
  std::lock_guard<std::mutex> lock(impl_->map_mutex);
  if (impl_->next_begins_anew)
  {
    impl_->segment_begun = false;  // it has ended: its frames stay where they are
  }
  impl_->moveTo(uprightMapOdom(T_odom_body, T_map_body));
  impl_->publish();
}

Eigen::Isometry3d Mapper::T_map_odom() const
{
  std::lock_guard<std::mutex> lock(impl_->published_mutex);
  return impl_->published_T_map_odom;
}

std::vector<std::pair<int64_t, Eigen::Isometry3d>> Mapper::path() const
{
  std::lock_guard<std::mutex> lock(impl_->map_mutex);
  std::vector<std::pair<int64_t, Eigen::Isometry3d>> path;
  for (const MapNode& node : impl_->data.nodes)
  {
    if (!node.loaded)
    {
      path.emplace_back(node.stamp_ns, node.T_map_body());
    }
  }
  return path;
}

std::vector<MapPoint> Mapper::cloud() const
{
  std::lock_guard<std::mutex> cloud_lock(impl_->cloud_mutex);
  MapData copy;  // features are shared
  {
    std::lock_guard<std::mutex> lock(impl_->map_mutex);
    copy.nodes = impl_->data.nodes;
  }
  return impl_->voxels.update(copy);
}

MapStatistics Mapper::statistics() const
{
  MapStatistics statistics;
  {
    std::lock_guard<std::mutex> lock(impl_->published_mutex);
    statistics = impl_->published;
  }
  std::lock_guard<std::mutex> lock(impl_->queue_mutex);
  statistics.skipped = impl_->skipped;
  return statistics;
}

void Mapper::save(const std::string& file) const
{
  MapData largest;  // of the parts whose places relative to each other are not known
  {
    std::lock_guard<std::mutex> lock(impl_->map_mutex);
    std::map<uint32_t, size_t> keyframes;
    for (const MapNode& node : impl_->data.nodes)
    {
      keyframes[impl_->part_of_segment[node.segment]] += node.features ? 1 : 0;
    }
    const auto most = std::max_element(keyframes.begin(), keyframes.end(),
                                       [](const auto& a, const auto& b) { return a.second < b.second; });
    if (most != keyframes.end())
    {
      largest = selected(impl_->data,
                         [&](const MapNode& node) { return impl_->part_of_segment[node.segment] == most->first; });
    }
  }
  if (countKeyframes(largest) == 0)
  {
    throw MapError("map " + file + ": there are no keyframes to be saved; drive first");
  }
  writeFileAtomically(file, encodeMap(largest, impl_->calibration));
}

void Mapper::load(const std::string& file)
{
  MapData loaded = decodeMap(readFile(file), impl_->calibration, file);
  if (countKeyframes(loaded) == 0)
  {
    throw MapError("map " + file + ": it has no keyframes; make the map anew");
  }
  std::map<uint32_t, uint32_t> segments;  // the file's numbers, from 0 on
  for (MapNode& node : loaded.nodes)
  {
    node.segment = segments.emplace(node.segment, static_cast<uint32_t>(segments.size())).first->second;
  }
  impl_->dropWaiting();
  std::lock_guard<std::mutex> lock(impl_->map_mutex);
  impl_->reset();
  impl_->part_of_segment.assign(segments.size(), 0);
  impl_->data = std::move(loaded);
  impl_->next_serial = impl_->data.nodes.size();
  for (const MapNode& node : impl_->data.nodes)
  {
    if (node.features)
    {
      impl_->recognizer.add(node);
    }
  }
  impl_->loaded = true;
  impl_->was_localized = false;
  impl_->boundMap();
  impl_->publish();
}

void Mapper::clear()
{
  impl_->dropWaiting();
  std::lock_guard<std::mutex> lock(impl_->map_mutex);
  impl_->reset();
  impl_->publish();
}

}  // namespace pi_slam
