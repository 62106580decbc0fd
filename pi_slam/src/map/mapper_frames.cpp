#include "map/mapper_impl.h"

#include <pi_node/durations.h>

#include <chrono>
#include <utility>

#include "map/map_grid.h"

namespace pi_slam
{

namespace
{

constexpr double FIRST_DEVIATION = 1e-3;  ///< where a segment begins [m, rad]
constexpr double KNOWN_GROUND_M = 3.0;    ///< way since a place was recognised
constexpr double AT_REST_M = 0.01;        ///< while waiting, pictures from the same spot are looked at
constexpr double AT_REST_RAD = 0.01;
constexpr int64_t AT_REST_NS = 300000000;  ///< only so often
constexpr int MAX_PER_PLACE = 3;           ///< keyframes that look the same way
constexpr double WELL_KNOWN = 2.0;         ///< times the least inliers: needs no further keyframe
constexpr double TILES_STEP_M = 15.0;      ///< way after which tiles are loaded anew
constexpr double TILES_PART = 0.9;         ///< of the keyframes in memory that may be, after that
constexpr int ATTEMPTS_PER_TURN = 8;       ///< to recognise a place, until other tiles are loaded
constexpr double GRID_STEP_M = 5.0;        ///< way between patches of the grid
constexpr double GRID_BEHIND_M = 6.0;   ///< when a patch is cut out, its middle is so far behind: nothing nearer comes
constexpr double GRID_REACH_M = 12.0;   ///< of a patch to each side
constexpr double FARTHEST_FIX_M = 5.0;  ///< of the antenna from the node, by the way since it

}  // namespace

void Mapper::Impl::beginSegment(const MapFrame& frame)
{
  segment.emplace();
  segment->number = graph.beginSegment();
  segment->T_odom_last = frame.T_odom_body;
  segment->T_odom_attempt = frame.T_odom_body;
  segment->T_odom_anywhere = frame.T_odom_body;
  segment->attempt_ns = frame.stamp_ns - AT_REST_NS;
  filter.start(frame.T_odom_body, filter.T_map_odom(), Eigen::Matrix4d::Identity() * FIRST_DEVIATION * FIRST_DEVIATION);
}

bool Mapper::Impl::isNodeDue(const MapFrame& frame) const
{
  const bool full =
      isWaiting() && graph.counts().keyframes >= mostKeyframes();  // no place of the file's map must go for it
  return !full &&
         (!segment->last_node || isApart(frame.T_odom_body, graph.data().nodes[*segment->last_node].T_odom_body,
                                         options.keyframe_distance_m, keyframeAngle()));
}

/// Whether it is worth looking for known places in this frame.
bool Mapper::Impl::isAttemptDue(const MapFrame& frame) const
{
  if (isWaiting())
  {
    return isApart(frame.T_odom_body, segment->T_odom_attempt, AT_REST_M, AT_REST_RAD) ||
           std::abs(frame.stamp_ns - segment->attempt_ns) >= AT_REST_NS;
  }
  const bool known_ground = segment->recognized_any && segment->travelled_m - segment->recognized_at_m < KNOWN_GROUND_M;
  return (known_ground || ownPart() != 0) &&
         isApart(frame.T_odom_body, segment->T_odom_attempt, 0.5 * options.keyframe_distance_m, 0.5 * keyframeAngle());
}

void Mapper::Impl::process(const MapFrame& frame, bool begins_anew)
{
  std::lock_guard<std::mutex> lock(map_mutex);
  const auto start = std::chrono::steady_clock::now();
  if (!segment || begins_anew)
  {
    beginSegment(frame);
  }
  segment->travelled_m += (frame.T_odom_body.translation() - segment->T_odom_last.translation()).norm();
  segment->T_odom_last = frame.T_odom_body;
  filter.predict(frame.T_odom_body);
  const bool node_due = isNodeDue(frame);
  if (node_due || isAttemptDue(frame))
  {
    segment->T_odom_attempt = frame.T_odom_body;
    segment->attempt_ns = frame.stamp_ns;
    const FeatureSetPtr features = extractor.extract(frame);
    std::vector<RecognizedPlace> places;
    if (options.loop_closure || isWaiting())
    {
      places = recognize(frame, *features);
    }
    if (node_due || (!places.empty() && (!segment->last_node || large_correction)))
    {
      addNode(frame, features, places);
    }
    if (large_correction || graph.isCorrectionDue())
    {
      correct();
    }
    boundMap();
    segment->attempts += places.empty() ? 1 : 0;
    settleTiles();
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
  const int there =
      graph.countNear(filter.T_map_body(), ownPart(), 0.9 * options.keyframe_distance_m, 0.9 * keyframeAngle());
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
  node.stamp_ns = frame.stamp_ns;
  node.segment = segment->number;
  node.travelled_m = segment->travelled_m;
  node.T_odom_body = frame.T_odom_body;
  node.heading = headingOf(filter.T_map_odom());
  node.p_map_body = filter.T_map_body().translation();
  if (isKeyframe(*features, places))
  {
    node.features = std::move(features);
  }
  segment->last_node = graph.add(std::move(node), segment->last_node, segment->odometry_factor);
  segment->odometry_factor = 1.0;
  for (const RecognizedPlace& place : places)
  {
    graph.addLoop(*segment->last_node, place);
  }
}

void Mapper::Impl::correct()
{
  if (graph.correct() && segment->last_node)
  {
    // The motion of odometry since the newest node is added to it.
    filter.move(graph.data().nodes[*segment->last_node].T_map_odom());
  }
  large_correction = false;
}

/// Ties the fixes that a frame has passed to the segment's newest node. Those of receivers that are later than the
/// history is long are lost.
void Mapper::Impl::tieFixes(const MapFrame& frame)
{
  segment->recent.add(frame.stamp_ns, frame.T_odom_body);
  while (!waiting_fixes.empty() && waiting_fixes.front().stamp_ns <= frame.stamp_ns)
  {
    if (const std::optional<Eigen::Isometry3d> T_odom_body = segment->recent.at(waiting_fixes.front().stamp_ns))
    {
      tieFix(waiting_fixes.front(), *T_odom_body);
    }
    waiting_fixes.pop_front();
  }
}

void Mapper::Impl::tieFix(const GnssFix& fix, const Eigen::Isometry3d& T_odom_body)
{
  if (!segment->last_node || isWaiting())
  {
    return;
  }
  const MapNode& node = graph.data().nodes[*segment->last_node];
  const Eigen::Vector3d shift = T_odom_body * fix.p_body_antenna - node.T_odom_body.translation();
  if (shift.norm() <= FARTHEST_FIX_M + fix.p_body_antenna.norm())
  {
    const bool located = graph.addFix(*segment->last_node, shift, fix.antenna, fix.deviation, fix.up_deviation);
    large_correction = large_correction || located;
  }
}

/// Cuts a patch out of the last grid if the vehicle went far enough. @param behind_m  of its middle.
void Mapper::Impl::keepGrid(double behind_m)
{
  const double middle_m = segment->travelled_m - behind_m;
  if (segment->last_grid.cells.empty() || !segment->last_node || middle_m < segment->gridded_m)
  {
    return;
  }
  GridPatch patch;
  patch.segment = segment->number;
  patch.travelled_m = middle_m;
  const MapNode* middle = nodeOf(graph.data(), patch);
  patch.travelled_m = middle->travelled_m;
  patch.cells = cutOut(segment->last_grid, middle->T_odom_body.translation().head<2>(), GRID_REACH_M);
  if (patch.cells.count() > 0)
  {
    graph.addPatch(std::move(patch));
  }
  segment->gridded_m = middle_m + GRID_STEP_M;
}

std::optional<GridPatch> Mapper::Impl::newestGrid() const
{
  if (!segment || segment->last_grid.cells.empty() || !segment->last_node)
  {
    return std::nullopt;
  }
  return GridPatch{segment->number, segment->travelled_m,
                   cutOut(segment->last_grid, segment->T_odom_last.translation().head<2>(), GRID_REACH_M)};
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
  if (impl_->segment && !impl_->isWaiting())
  {
    impl_->segment->last_grid = grid;
    impl_->keepGrid(GRID_BEHIND_M);
  }
}

std::optional<OccupancyCells> Mapper::grid() const
{
  MapData copy;
  std::optional<GridPatch> newest;
  {
    std::lock_guard<std::mutex> lock(impl_->map_mutex);
    copy = impl_->placedNodes();
    for (const GridPatch& patch : impl_->graph.data().patches)
    {
      if (impl_->isPlaced(patch.segment))
      {
        copy.patches.push_back(patch);
      }
    }
    newest = impl_->segment && impl_->isPlaced(impl_->segment->number) ? impl_->newestGrid() : std::nullopt;
  }
  return composeGrid(copy, newest ? &*newest : nullptr);
}

size_t Mapper::Impl::mostKeyframes() const
{
  return graph.hasStore() ? options.max_stored_keyframes : options.max_keyframes;
}

void Mapper::Impl::boundMap()
{
  if (isWaiting())
  {
    return;  // which keyframes look at the same ground is known once the body is localised
  }
  const auto moved = graph.bound(mostKeyframes(), options.keyframe_distance_m, keyframeAngle());
  if (moved && segment && segment->last_node)
  {
    segment->last_node = static_cast<uint32_t>((*moved)[*segment->last_node]);
  }
}

/// Keeps the ground about the body in memory. While nobody knows where it is in the map, all of the map in turns.
void Mapper::Impl::settleTiles()
{
  const auto most = static_cast<size_t>(TILES_PART * static_cast<double>(options.max_keyframes));
  const size_t in_memory = graph.counts().in_memory;
  if (!graph.hasStore() || (in_memory <= options.max_keyframes && in_memory == graph.counts().keyframes))
  {
    return;
  }
  const Eigen::Vector3d p_map_body = filter.T_map_body().translation();
  const bool moved = segment->tiles_at && (p_map_body - *segment->tiles_at).norm() > TILES_STEP_M;
  if (!segment->tiles_at || in_memory > options.max_keyframes || (moved && ownPart() == 0))
  {
    graph.loadAround(p_map_body, 0, most);
    segment->tiles_at = p_map_body;
    segment->attempts = 0;
  }
  else if (ownPart() != 0 && segment->attempts >= ATTEMPTS_PER_TURN)
  {
    graph.loadNext(most);
    segment->attempts = 0;
  }
}

}  // namespace pi_slam
