#include "map/map_graph.h"

#include <malloc.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <future>
#include <map>
#include <utility>

#include "map/map_grid.h"
#include "map/mapper.h"
#include "map/pose_graph.h"
#include "map/redundancy.h"

namespace pi_slam::map
{

namespace
{

constexpr size_t NODES_PER_CORRECTION = 20;  ///< the graph is corrected when so many nodes came,
constexpr size_t CORRECTION_PART = 20;       ///< and one in so many of the whole graph
constexpr double LOOP_DEVIATION = 1.5;       ///< factor on the deviations of loops: neighbours share errors
constexpr double FIX_FACTOR = 2.0;           ///< on the deviations of GNSS, as errors of neighbours are alike
constexpr size_t MOST_FIXES = 4000;
constexpr double TILE_M = 30.0;      ///< side of a tile: as far as a camera recognises anything
constexpr size_t PLAIN_NODES = 100;  ///< without features, that any map may have; else as many as keyframes

/// The nodes that `keep` selects, and what ties them.
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
  part.origin = map.origin;
  for (MapFix fix : map.fixes)
  {
    if (moved[fix.node] >= 0)
    {
      fix.node = static_cast<uint32_t>(moved[fix.node]);
      part.fixes.push_back(fix);
    }
  }
  part.earth = part.fixes.empty() ? std::nullopt : map.earth;
  return part;
}

}  // namespace

double headingOf(const Eigen::Isometry3d& T)
{
  return std::atan2(T.linear()(1, 0), T.linear()(0, 0));
}

double angleBetween(const Eigen::Isometry3d& a, const Eigen::Isometry3d& b)
{
  return Eigen::AngleAxisd(a.linear().transpose() * b.linear()).angle();
}

MapGraph::MapGraph(const StereoCalibration& calibration, const PlaceVerifierOptions& options,
                   std::shared_ptr<pi_runtime::Runtime> runtime, const std::string& tile_folder)
  : recognizer_(calibration, options, std::move(runtime))
{
  try
  {
    store_ = tile_folder.empty() ? nullptr : std::make_unique<FeatureStore>(tile_folder);
  }
  catch (const MapError& error)
  {
    disk_defect_ = error.what();
  }
}

void MapGraph::clear()
{
  data_ = MapData();
  counts_.reset();
  recognizer_.clear();
  next_serial_ = 0;
  part_of_segment_.clear();
  searched_.reset();
  nodes_since_correction_ = 0;
  ties_pending_ = false;
}

void MapGraph::load(MapData data)
{
  clear();
  std::map<uint32_t, uint32_t> segments;  // the file's numbers, from 0 on
  for (MapNode& node : data.nodes)
  {
    node.segment = segments.emplace(node.segment, static_cast<uint32_t>(segments.size())).first->second;
  }
  const auto lost = [&](const GridPatch& patch) { return segments.count(patch.segment) == 0; };
  data.patches.erase(std::remove_if(data.patches.begin(), data.patches.end(), lost), data.patches.end());
  for (GridPatch& patch : data.patches)
  {
    patch.segment = segments.at(patch.segment);
  }
  part_of_segment_.assign(segments.size(), 0);
  data_ = std::move(data);
  counts_.reset();
  next_serial_ = data_.nodes.size();
  for (const MapNode& node : data_.nodes)
  {
    if (node.features)
    {
      recognizer_.add(node);
    }
  }
}

void MapGraph::store(MapNode* node) const
{
  if (store_ && node->features)
  {
    node->stored = store_->write(*node->features);
    node->features.reset();
  }
}

const MapGraph::Counts& MapGraph::counts() const
{
  if (!counts_)
  {
    counts_.emplace();
    for (const MapNode& node : data_.nodes)
    {
      counts_->keyframes += node.isKeyframe() ? 1 : 0;
      counts_->in_memory += node.features ? 1 : 0;
      counts_->landmarks += node.featureCount();
      counts_->bytes += node.features ? node.features->bytes() : 0;
    }
  }
  return *counts_;
}

size_t MapGraph::bytes() const
{
  size_t bytes = counts().bytes + recognizer_.bytes() + data_.nodes.capacity() * sizeof(MapNode) +
                 data_.edges.capacity() * sizeof(MapEdge);
  for (const GridPatch& patch : data_.patches)
  {
    bytes += patch.cells.bytes();
  }
  return bytes;
}

uint32_t MapGraph::beginSegment()
{
  const auto segment = static_cast<uint32_t>(part_of_segment_.size());
  part_of_segment_.push_back(segment);
  return segment;
}

void MapGraph::movePart(uint32_t part, const Eigen::Isometry3d& shift)
{
  const double turn = headingOf(shift);
  if (data_.earth && !data_.fixes.empty() && partOf(data_.nodes[data_.fixes.front().node].segment) == part)
  {
    const Eigen::Isometry3d T_local_map = data_.earth->T_local_map() * shift.inverse();
    data_.earth = EarthPlace{T_local_map.translation(), headingOf(T_local_map)};
  }
  for (MapNode& node : data_.nodes)
  {
    if (partOf(node.segment) == part)
    {
      node.p_map_body = shift * node.p_map_body;
      node.heading += turn;
    }
  }
}

void MapGraph::joinParts(uint32_t a, uint32_t b)
{
  std::replace(part_of_segment_.begin(), part_of_segment_.end(), std::max(a, b), std::min(a, b));
}

uint32_t MapGraph::largestPart() const
{
  std::map<uint32_t, size_t> keyframes;
  for (const MapNode& node : data_.nodes)
  {
    keyframes[partOf(node.segment)] += node.isKeyframe() ? 1 : 0;
  }
  const auto most = std::max_element(keyframes.begin(), keyframes.end(),
                                     [](const auto& a, const auto& b) { return a.second < b.second; });
  return most == keyframes.end() ? 0 : most->first;
}

MapData MapGraph::copyOf(uint32_t part, const std::optional<GridPatch>& newest) const
{
  const auto isIn = [&](uint32_t segment) { return partOf(segment) == part; };
  MapData copy = selected(data_, [&](const MapNode& node) { return isIn(node.segment); });
  copy.patches = data_.patches;
  if (newest)
  {
    copy.patches.push_back(*newest);
  }
  copy.patches.erase(std::remove_if(copy.patches.begin(), copy.patches.end(),
                                    [&](const GridPatch& patch) { return !isIn(patch.segment); }),
                     copy.patches.end());
  return copy;
}

uint32_t MapGraph::add(MapNode node, std::optional<uint32_t> before, double odometry_factor)
{
  node.serial = next_serial_++;
  if (node.features)
  {
    recognizer_.add(node);
  }
  const auto index = static_cast<uint32_t>(data_.nodes.size());
  data_.nodes.push_back(std::move(node));
  counts_.reset();
  ++nodes_since_correction_;
  if (!before)
  {
    return index;
  }
  const MapNode& from = data_.nodes[*before];
  const MapNode& to = data_.nodes[index];
  const double way = to.travelled_m - from.travelled_m;
  const double turned = angleBetween(from.T_odom_body, to.T_odom_body);
  MapEdge edge;
  edge.from = *before;
  edge.to = index;
  edge.shift = to.T_odom_body.translation() - from.T_odom_body.translation();
  edge.position_deviation = odometry_factor * std::hypot(DRIFT_POSITION_LEAST, DRIFT_POSITION * std::sqrt(way));
  edge.heading_deviation =
      odometry_factor * std::sqrt(DRIFT_HEADING_LEAST * DRIFT_HEADING_LEAST + DRIFT_HEADING * DRIFT_HEADING * way +
                                  DRIFT_HEADING_PER_TURN * DRIFT_HEADING_PER_TURN * turned);
  data_.edges.push_back(edge);
  return index;
}

void MapGraph::addLoop(uint32_t to, const RecognizedPlace& place)
{
  const MapNode& from = data_.nodes[place.node];
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
  data_.edges.push_back(edge);
  ties_pending_ = true;
}

void MapGraph::doubtOdometry(uint32_t segment, double from_m, double factor)
{
  for (MapEdge& edge : data_.edges)
  {
    const MapNode& to = data_.nodes[edge.to];
    if (!edge.loop && !to.loaded && to.segment == segment && to.travelled_m > from_m)
    {
      edge.position_deviation *= factor;
      edge.heading_deviation *= factor;
    }
  }
}

void MapGraph::addPatch(GridPatch patch)
{
  map::addPatch(&data_, std::move(patch));
}

bool MapGraph::addFix(uint32_t node, const Eigen::Vector3d& shift, const GeoPoint& antenna, double deviation,
                      double up_deviation)
{
  if (!data_.fixes.empty() && data_.fixes.back().node == node)
  {
    return false;
  }
  if (!data_.origin)
  {
    data_.origin = antenna;
  }
  data_.fixes.push_back(
      {node, shift, LocalFrame(*data_.origin).toLocal(antenna), FIX_FACTOR * deviation, FIX_FACTOR * up_deviation});
  ties_pending_ = true;
  return !data_.earth && locateOnEarth(data_);
}

bool MapGraph::isCorrectionDue() const
{
  return ties_pending_ && nodes_since_correction_ >= NODES_PER_CORRECTION + data_.nodes.size() / CORRECTION_PART;
}

bool MapGraph::correct()
{
  // On a thread of its own: solving needs several times the memory of the map in small pieces. On another thread glibc
  // takes them from another arena than the map's, which is given back after each solution.
  auto solved = std::async(std::launch::async, [this] { return optimizePoseGraph(&data_); });
  const bool usable = solved.get();
  malloc_trim(0);
  nodes_since_correction_ = 0;
  ties_pending_ = false;
  return usable;
}

std::optional<std::vector<int64_t>> MapGraph::bound(size_t most_keyframes, double distance_m, double angle_rad)
{
  for (const size_t node : redundantKeyframes(data_, most_keyframes, distance_m, angle_rad))
  {
    recognizer_.remove(data_.nodes[node]);
    data_.nodes[node].features.reset();
    data_.nodes[node].stored.reset();
    counts_.reset();
  }
  if (data_.fixes.size() > MOST_FIXES)
  {
    // Of the older half every other one goes.
    size_t number = 0;
    const auto middle = data_.fixes.begin() + static_cast<std::ptrdiff_t>(MOST_FIXES / 2);
    data_.fixes.erase(
        std::remove_if(data_.fixes.begin(), middle, [&number](const MapFix&) { return number++ % 2 != 0; }), middle);
  }
  // The map must grow with the area that was seen, not with time.
  const size_t there = counts().keyframes;
  return thinOut(&data_, there + std::max(there, PLAIN_NODES));
}

MapGraph::Tile MapGraph::tileOf(const MapNode& node) const
{
  const auto index = [](double metres) { return static_cast<int>(std::floor(metres / TILE_M)); };
  return {static_cast<int>(partOf(node.segment)), index(node.p_map_body.x()), index(node.p_map_body.y())};
}

/// The map's tiles, each with its number of keyframes.
std::map<MapGraph::Tile, size_t> MapGraph::tiles() const
{
  std::map<Tile, size_t> counts;
  for (const MapNode& node : data_.nodes)
  {
    if (node.isKeyframe())
    {
      ++counts[tileOf(node)];
    }
  }
  return counts;
}

void MapGraph::bringIn(MapNode* node)
{
  try
  {
    node->features = node->stored->load();
    recognizer_.add(*node);
  }
  catch (const MapError& error)
  {
    disk_defect_ = error.what();
    node->stored.reset();
  }
}

void MapGraph::bringOut(MapNode* node)
{
  try
  {
    node->stored = node->stored ? node->stored : store_->write(*node->features);
  }
  catch (const MapError& error)
  {
    disk_defect_ = error.what();
  }
  recognizer_.remove(*node);
  node->features.reset();
}

/// @param tiles  sorted.
void MapGraph::keepInMemory(const std::vector<Tile>& tiles)
{
  counts_.reset();
  // Out first, so that memory never holds both.
  for (const bool inside : {false, true})
  {
    for (MapNode& node : data_.nodes)
    {
      if (node.isKeyframe() && std::binary_search(tiles.begin(), tiles.end(), tileOf(node)) == inside &&
          (node.features != nullptr) != inside)
      {
        inside ? bringIn(&node) : bringOut(&node);
      }
    }
  }
}

void MapGraph::loadAround(const Eigen::Vector3d& p_map, uint32_t part, size_t most)
{
  if (!store_)
  {
    return;
  }
  const std::map<Tile, size_t> counts = tiles();
  struct Candidate
  {
    double distance;
    Tile tile;
    size_t keyframes;
  };
  std::vector<Candidate> order;
  for (const auto& [tile, count] : counts)
  {
    // Where other parts lie nobody knows: they come last.
    const Eigen::Vector2d middle = TILE_M * Eigen::Vector2d(tile[1] + 0.5, tile[2] + 0.5);
    const double distance = (middle - p_map.head<2>()).norm();
    order.push_back({tile[0] == static_cast<int>(part) ? distance : distance + 1e9, tile, count});
  }
  std::sort(order.begin(), order.end(),
            [](const Candidate& a, const Candidate& b)
            { return a.distance != b.distance ? a.distance < b.distance : a.tile < b.tile; });
  std::vector<Tile> chosen;
  size_t sum = 0;
  for (const Candidate& candidate : order)
  {
    sum += candidate.keyframes;
    if (sum > most && !chosen.empty())
    {
      break;
    }
    chosen.push_back(candidate.tile);
  }
  std::sort(chosen.begin(), chosen.end());
  keepInMemory(chosen);
}

void MapGraph::loadNext(size_t most)
{
  if (!store_)
  {
    return;
  }
  const std::map<Tile, size_t> counts = tiles();
  std::vector<Tile> chosen;
  size_t sum = 0;
  auto next = searched_ ? counts.upper_bound(*searched_) : counts.begin();
  for (size_t i = 0; i < counts.size(); ++i, ++next)
  {
    next = next == counts.end() ? counts.begin() : next;
    sum += next->second;
    if (sum > most && !chosen.empty())
    {
      break;
    }
    chosen.push_back(next->first);
    searched_ = next->first;
  }
  std::sort(chosen.begin(), chosen.end());
  keepInMemory(chosen);
}

int MapGraph::countNear(const Eigen::Isometry3d& T_map_body, uint32_t part, double distance_m, double angle_rad) const
{
  return static_cast<int>(std::count_if(data_.nodes.begin(), data_.nodes.end(),
                                        [&](const MapNode& node)
                                        {
                                          return node.isKeyframe() && partOf(node.segment) == part &&
                                                 (node.p_map_body - T_map_body.translation()).norm() < distance_m &&
                                                 angleBetween(node.T_map_body(), T_map_body) < angle_rad;
                                        }));
}

void MapGraph::fillOwnPart(PlaceQuery* query) const
{
  const uint32_t own = partOf(query->segment);
  query->own_part.clear();
  for (const uint32_t part : part_of_segment_)
  {
    query->own_part.push_back(part == own);
  }
}

std::vector<RecognizedPlace> MapGraph::placesNear(PlaceQuery query, const Eigen::Isometry3d& T_map_body,
                                                  double radius_m, size_t most)
{
  fillOwnPart(&query);
  return recognizer_.near(data_, query, T_map_body, radius_m, most);
}

std::optional<RecognizedPlace> MapGraph::placeAnywhere(PlaceQuery query)
{
  fillOwnPart(&query);
  return recognizer_.anywhere(data_, query, partOf(query.segment) != 0);
}

}  // namespace pi_slam::map
