#include "map/mapper_impl.h"

#include <malloc.h>
#include <pi_node/durations.h>

#include <chrono>
#include <future>
#include <utility>

#include "map/map_grid.h"
#include "map/pose_graph.h"
#include "map/redundancy.h"

namespace pi_slam
{

namespace
{

constexpr double FIRST_DEVIATION = 1e-3;     ///< where a segment begins [m, rad]
constexpr size_t NODES_PER_CORRECTION = 20;  ///< the graph is corrected when so many nodes came,
constexpr size_t CORRECTION_PART = 20;       ///< and one in so many of the whole graph: it costs as it is large
constexpr double LOOP_DEVIATION = 1.5;       ///< factor on the deviations of loops: neighbours share errors
constexpr double KNOWN_GROUND_M = 3.0;       ///< way since a place was recognised
constexpr double AT_REST_M = 0.01;           ///< while waiting, pictures from the same spot are looked at
constexpr double AT_REST_RAD = 0.01;
constexpr int64_t AT_REST_NS = 300000000;  ///< only so often
constexpr int MAX_PER_PLACE = 3;           ///< keyframes that look the same way
constexpr double WELL_KNOWN = 2.0;         ///< times the least inliers: needs no further keyframe
constexpr double GRID_STEP_M = 5.0;        ///< way between patches of the grid
constexpr double GRID_BEHIND_M = 6.0;   ///< when a patch is cut out, its middle is so far behind: nothing nearer comes
constexpr double GRID_REACH_M = 12.0;   ///< of a patch to each side
constexpr double FARTHEST_FIX_M = 5.0;  ///< of the antenna from the node, by the way since it
constexpr double FIX_FACTOR = 2.0;      ///< on the deviations of GNSS, as errors of neighbours are alike
constexpr size_t MOST_FIXES = 4000;
constexpr size_t PLAIN_NODES = 100;  ///< without features, that any map may have; else as many as keyframes

}  // namespace

void Mapper::Impl::beginSegment(const MapFrame& frame)
{
  segment = static_cast<uint32_t>(part_of_segment.size());
  part_of_segment.push_back(segment);  // a part of its own
  segment_begun = true;
  travelled_m = 0.0;
  recognized_at_m = 0.0;
  recognized_any = false;
  last_grid = OccupancyCells();
  gridded_m = 0.0;
  odometry_factor = 1.0;
  last_node = -1;
  witnesses.clear();
  recent.clear();
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

bool Mapper::Impl::isCorrectionDue() const
{
  return (loops_pending || fixes_pending) &&
         nodes_since_correction >= NODES_PER_CORRECTION + data.nodes.size() / CORRECTION_PART;
}

void Mapper::Impl::process(const MapFrame& frame, bool begins_anew)
{
  std::lock_guard<std::mutex> lock(map_mutex);
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
  tieFixes(frame);
  last_add_ms = 1e3 * pi_node::secondsSince(start);
  publish();
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
  auto solved = std::async(std::launch::async, [this] { return optimizePoseGraph(&data); });
  const bool usable = solved.get();
  malloc_trim(0);
  if (usable && last_node >= 0)
  {
    // The motion of odometry since the newest node is added to it.
    filter.move(data.nodes[static_cast<size_t>(last_node)].T_map_odom());
  }
  nodes_since_correction = 0;
  loops_pending = false;
  fixes_pending = false;
  large_correction = false;
}

/// Ties the fixes that a frame has passed to the segment's newest node. Those of receivers that are later than the
/// history is long are lost.
void Mapper::Impl::tieFixes(const MapFrame& frame)
{
  recent.add(frame.stamp_ns, frame.T_odom_body);
  while (!waiting_fixes.empty() && waiting_fixes.front().stamp_ns <= frame.stamp_ns)
  {
    if (const std::optional<Eigen::Isometry3d> T_odom_body = recent.at(waiting_fixes.front().stamp_ns))
    {
      tieFix(waiting_fixes.front(), *T_odom_body);
    }
    waiting_fixes.pop_front();
  }
}

void Mapper::Impl::tieFix(const GnssFix& fix, const Eigen::Isometry3d& T_odom_body)
{
  if (last_node < 0 || isWaiting())
  {
    return;
  }
  const MapNode& node = data.nodes[static_cast<size_t>(last_node)];
  const Eigen::Vector3d shift = T_odom_body * fix.p_body_antenna - node.T_odom_body.translation();
  const bool same_node = !data.fixes.empty() && static_cast<int64_t>(data.fixes.back().node) == last_node;
  if (same_node || shift.norm() > FARTHEST_FIX_M + fix.p_body_antenna.norm())
  {
    return;  // one fix for a place: standing still for an hour must not outweigh the drive
  }
  if (!data.origin)
  {
    data.origin = fix.antenna;
  }
  data.fixes.push_back({static_cast<uint32_t>(last_node), shift, LocalFrame(*data.origin).toLocal(fix.antenna),
                        FIX_FACTOR * fix.deviation, FIX_FACTOR * fix.up_deviation});
  fixes_pending = true;
  large_correction = large_correction || (!data.earth && locateOnEarth(data));
}

/// Cuts a patch out of the last grid if the vehicle went far enough. @param behind_m  of its middle.
void Mapper::Impl::keepGrid(double behind_m)
{
  const double middle_m = travelled_m - behind_m;
  if (last_grid.cells.empty() || last_node < 0 || middle_m < gridded_m)
  {
    return;
  }
  GridPatch patch;
  patch.segment = segment;
  patch.travelled_m = middle_m;
  const MapNode* middle = nodeOf(data, patch);
  patch.travelled_m = middle->travelled_m;
  patch.cells = cutOut(last_grid, middle->T_odom_body.translation().head<2>(), GRID_REACH_M);
  if (!patch.cells.cells.empty())
  {
    addPatch(&data, std::move(patch));
  }
  gridded_m = middle_m + GRID_STEP_M;
}

std::optional<GridPatch> Mapper::Impl::newestGrid() const
{
  if (last_grid.cells.empty() || last_node < 0)
  {
    return std::nullopt;
  }
  return GridPatch{segment, travelled_m, cutOut(last_grid, T_odom_last.translation().head<2>(), GRID_REACH_M)};
}

void Mapper::addGrid(const OccupancyCells& grid)
{
  if (grid.width <= 0 || grid.height <= 0 || !(grid.cell_m >= 0.01 && grid.cell_m <= 10.0) ||
      !grid.origin.allFinite() ||
      grid.cells.size() != static_cast<size_t>(grid.width) * static_cast<size_t>(grid.height))
  {
    throw std::invalid_argument("grid: " + std::to_string(grid.width) + " x " + std::to_string(grid.height) +
                                " cells of " + std::to_string(grid.cell_m) + " m, but " +
                                std::to_string(grid.cells.size()) + " values; give one per cell, of 0.01 to 10 m");
  }
  std::lock_guard<std::mutex> lock(impl_->map_mutex);
  if (impl_->segment_begun && !impl_->isWaiting())
  {
    impl_->last_grid = grid;
    impl_->keepGrid(GRID_BEHIND_M);
  }
}

std::optional<OccupancyCells> Mapper::grid() const
{
  MapData copy;
  std::optional<GridPatch> newest;
  {
    std::lock_guard<std::mutex> lock(impl_->map_mutex);
    copy.nodes = impl_->data.nodes;
    copy.patches = impl_->data.patches;
    newest = impl_->newestGrid();
  }
  return composeGrid(copy, newest ? &*newest : nullptr);
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
  if (data.fixes.size() > MOST_FIXES)
  {
    // Of the older half every other one goes.
    size_t number = 0;
    const auto middle = data.fixes.begin() + static_cast<std::ptrdiff_t>(MOST_FIXES / 2);
    data.fixes.erase(std::remove_if(data.fixes.begin(), middle, [&number](const MapFix&) { return number++ % 2 != 0; }),
                     middle);
  }
}

}  // namespace pi_slam
