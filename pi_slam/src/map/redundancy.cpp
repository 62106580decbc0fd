#include "map/redundancy.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace pi_slam::map
{

namespace
{

constexpr size_t NEWEST_KEPT = 5;    ///< keyframes that never go
constexpr size_t NEWEST_NODES = 50;  ///< nodes that are not taken out
constexpr size_t MOST_LOOPS = 4;     ///< that a node takes over

Eigen::Vector3d turned(double angle, const Eigen::Vector3d& v)
{
  return Eigen::AngleAxisd(angle, Eigen::Vector3d::UnitZ()) * v;
}

}  // namespace

std::vector<size_t> redundantKeyframes(const MapData& map, size_t most, double distance_m, double angle_rad)
{
  std::vector<size_t> keyframes;
  for (size_t i = 0; i < map.nodes.size(); ++i)
  {
    if (map.nodes[i].isKeyframe())
    {
      keyframes.push_back(i);
    }
  }
  if (keyframes.size() <= most)
  {
    return {};
  }
  const size_t count = keyframes.size();
  std::vector<Eigen::Vector3d> positions(count);
  std::vector<Eigen::Quaterniond> turns(count);
  for (size_t i = 0; i < count; ++i)
  {
    const Eigen::Isometry3d T = map.nodes[keyframes[i]].T_map_body();
    positions[i] = T.translation() / distance_m;
    turns[i] = Eigen::Quaterniond(T.linear());
  }
  struct Neighbour
  {
    double distance = std::numeric_limits<double>::max();
    size_t self = 0;
    size_t other = 0;
  };
  std::vector<Neighbour> nearest(count);
  for (size_t i = 0; i < count; ++i)
  {
    nearest[i].self = i;
    for (size_t j = 0; j < count; ++j)
    {
      const double apart = i == j ? nearest[i].distance : (positions[i] - positions[j]).norm();
      if (apart < nearest[i].distance)
      {
        const double distance = apart + turns[i].angularDistance(turns[j]) / angle_rad;
        if (distance < nearest[i].distance)
        {
          nearest[i].distance = distance;
          nearest[i].other = j;
        }
      }
    }
  }
  std::vector<Neighbour> order(nearest.begin(), nearest.end() - static_cast<int64_t>(std::min(NEWEST_KEPT, count)));
  std::sort(order.begin(), order.end(),
            [](const Neighbour& a, const Neighbour& b)
            { return a.distance != b.distance ? a.distance < b.distance : a.self < b.self; });
  const size_t wanted = std::max(count - most, count / 20);
  std::vector<bool> gone(count, false);
  std::vector<size_t> chosen;
  // First those whose neighbour stays, then the others.
  for (const bool any : {false, true})
  {
    for (const Neighbour& candidate : order)
    {
      if (chosen.size() < wanted && !gone[candidate.self] && (any || !gone[candidate.other]))
      {
        gone[candidate.self] = true;
        chosen.push_back(keyframes[candidate.self]);
      }
    }
  }
  return chosen;
}

MapEdge compose(const MapEdge& first, const MapEdge& second)
{
  MapEdge edge;
  edge.from = first.from;
  edge.to = second.to;
  edge.loop = first.loop || second.loop;
  edge.shift = first.shift + turned(first.turn, second.shift);
  edge.turn = std::remainder(first.turn + second.turn, 2.0 * M_PI);
  edge.position_deviation = std::hypot(std::hypot(first.position_deviation, second.position_deviation),
                                       first.heading_deviation * second.shift.norm());
  edge.heading_deviation = std::hypot(first.heading_deviation, second.heading_deviation);
  return edge;
}

MapEdge inverse(const MapEdge& edge)
{
  MapEdge back = edge;
  back.from = edge.to;
  back.to = edge.from;
  back.shift = turned(-edge.turn, -edge.shift);
  back.turn = -edge.turn;
  return back;
}

std::optional<std::vector<int64_t>> thinOut(MapData* map, size_t most)
{
  if (map->nodes.size() <= most)
  {
    return std::nullopt;
  }
  const size_t count = map->nodes.size();
  // Odometry's edge to the node after it, by node.
  std::vector<int64_t> next(count, -1);
  for (size_t e = 0; e < map->edges.size(); ++e)
  {
    if (!map->edges[e].loop)
    {
      next[map->edges[e].from] = static_cast<int64_t>(e);
    }
  }
  std::vector<size_t> plain;
  for (size_t i = 0; i + NEWEST_NODES < count; ++i)
  {
    if (!map->nodes[i].isKeyframe() && next[i] >= 0)
    {
      plain.push_back(i);
    }
  }
  std::vector<int64_t> to(count, -1);  // where the edges of a node that goes lead to
  for (size_t k = 0; k < (plain.size() + 1) / 2; k += 2)
  {
    to[plain[k]] = static_cast<int64_t>(map->edges[static_cast<size_t>(next[plain[k]])].to);
  }
  if (plain.empty())
  {
    return std::nullopt;
  }
  std::vector<int64_t> moved(count, -1);
  std::vector<MapNode> nodes;
  for (size_t i = 0; i < count; ++i)
  {
    if (to[i] < 0)
    {
      moved[i] = static_cast<int64_t>(nodes.size());
      nodes.push_back(std::move(map->nodes[i]));
    }
  }
  std::vector<MapEdge> edges;
  std::vector<size_t> taken(count, 0);
  for (size_t e = 0; e < map->edges.size(); ++e)
  {
    MapEdge edge = map->edges[e];
    if (!edge.loop && to[edge.from] >= 0)
    {
      continue;  // the way out of a node that goes: part of the others
    }
    const bool changed = to[edge.to] >= 0 || to[edge.from] >= 0;
    const bool loop = edge.loop;
    while (to[edge.to] >= 0)
    {
      edge = compose(edge, map->edges[static_cast<size_t>(next[edge.to])]);
    }
    while (to[edge.from] >= 0)
    {
      edge = compose(inverse(map->edges[static_cast<size_t>(next[edge.from])]), edge);
    }
    edge.loop = loop;
    if (edge.from == edge.to || (changed && loop && taken[edge.to]++ >= MOST_LOOPS))
    {
      continue;
    }
    edge.from = static_cast<uint32_t>(moved[edge.from]);
    edge.to = static_cast<uint32_t>(moved[edge.to]);
    edges.push_back(edge);
  }
  for (MapFix& fix : map->fixes)
  {
    for (; to[fix.node] >= 0; fix.node = static_cast<uint32_t>(to[fix.node]))
    {
      const MapEdge& edge = map->edges[static_cast<size_t>(next[fix.node])];
      fix.shift = turned(-edge.turn, fix.shift - edge.shift);
    }
    fix.node = static_cast<uint32_t>(moved[fix.node]);
  }
  map->nodes = std::move(nodes);
  map->edges = std::move(edges);
  return moved;
}

}  // namespace pi_slam::map
