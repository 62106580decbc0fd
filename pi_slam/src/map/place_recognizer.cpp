#include "map/place_recognizer.h"

#include <algorithm>
#include <cmath>

namespace pi_slam::map
{

namespace
{

constexpr double RECENT_M = 10.0;        ///< way within which the same things are in view anyway
constexpr double MAX_VIEW_ANGLE = 0.96;  ///< between directions of view: beyond 61 degrees one of 10 was known [rad]
constexpr double NEIGHBOUR_M = 3.5;      ///< way within which keyframes help each other: seven new ones, or thinned out
constexpr size_t NEIGHBOURS = 2;         ///< on each side
constexpr size_t CANDIDATES = 6;         ///< places by looks that are verified
constexpr float NEIGHBOUR_WEIGHT = 0.5F;  ///< of their votes
/// Results that agree: each is off by at most 0.3 m and 1.6 degrees, measured after changes of the place.
constexpr double SAME_PLACE_M = 0.7;
constexpr double SAME_HEADING_RAD = 0.07;
constexpr double AMBIGUOUS = 0.6;  ///< part of the best one's inliers with which another place makes it doubtful
/// What needs no second picture that agrees. These and the one above are by experience, and were not varied.
constexpr double STRONG_INLIERS = 1.6;  ///< times the least number
constexpr double STRONG_SUPPORT = 0.45;

}  // namespace

PlaceRecognizer::PlaceRecognizer(const StereoCalibration& calibration, const PlaceVerifierOptions& options,
                                 std::shared_ptr<pi_runtime::Runtime> runtime)
  : options_(options)
  , axis_(calibration.left.T_body_camera.linear().col(2))
  , verifier_(calibration, options, std::move(runtime))
{
}

void PlaceRecognizer::add(const MapNode& node)
{
  uint32_t slot = static_cast<uint32_t>(serials_.size());
  if (free_slots_.empty())
  {
    serials_.push_back(node.serial);
  }
  else
  {
    slot = free_slots_.back();
    free_slots_.pop_back();
    serials_[slot] = node.serial;
  }
  slots_[node.serial] = slot;
  index_.add(slot, node.features);
}

void PlaceRecognizer::remove(const MapNode& node)
{
  const auto found = slots_.find(node.serial);
  if (found != slots_.end())
  {
    index_.remove(found->second);
    free_slots_.push_back(found->second);
    slots_.erase(found);
  }
}

void PlaceRecognizer::clear()
{
  index_.clear();
  slots_.clear();
  serials_.clear();
  free_slots_.clear();
}

bool PlaceRecognizer::isRecent(const MapNode& node, const PlaceQuery& query) const
{
  return !node.loaded && node.segment == query.segment && query.travelled_m - node.travelled_m < RECENT_M;
}

/// The node and keyframes before and behind it on the way.
std::vector<PlaceView> PlaceRecognizer::viewsAt(const MapData& map, size_t node, const PlaceQuery& query) const
{
  const MapNode& middle = map.nodes[node];
  std::vector<PlaceView> views{{middle.features, middle.T_map_body()}};
  for (const int step : {-1, 1})
  {
    size_t found = 0;
    for (auto k = static_cast<int64_t>(node) + step;
         k >= 0 && k < static_cast<int64_t>(map.nodes.size()) && found < NEIGHBOURS; k += step)
    {
      const MapNode& other = map.nodes[static_cast<size_t>(k)];
      if (other.segment != middle.segment || other.loaded != middle.loaded || isRecent(other, query) ||
          std::abs(other.travelled_m - middle.travelled_m) > NEIGHBOUR_M)
      {
        break;
      }
      if (other.features)
      {
        views.push_back({other.features, other.T_map_body()});
        ++found;
      }
    }
  }
  return views;
}

std::optional<RecognizedPlace> PlaceRecognizer::verify(const MapData& map, size_t node, const PlaceQuery& query,
                                                       bool expected)
{
  const std::optional<PlaceMatch> match =
      verifier_.verify(*query.features, query.T_odom_body, viewsAt(map, node, query), expected);
  if (!match)
  {
    return std::nullopt;
  }
  RecognizedPlace place;
  place.node = static_cast<uint32_t>(node);
  place.match = *match;
  place.strong = match->inliers >= STRONG_INLIERS * options_.min_inliers && match->support >= STRONG_SUPPORT;
  return place;
}

std::vector<RecognizedPlace> PlaceRecognizer::near(const MapData& map, const PlaceQuery& query,
                                                   const Eigen::Isometry3d& T_map_body, double radius_m, size_t most)
{
  struct Candidate
  {
    double distance;
    size_t node;
  };
  std::vector<Candidate> found;
  for (size_t i = 0; i < map.nodes.size(); ++i)
  {
    const MapNode& node = map.nodes[i];
    if (!node.features || !query.own_part[node.segment] || isRecent(node, query))
    {
      continue;
    }
    const double distance = (node.p_map_body - T_map_body.translation()).norm();
    if (distance > radius_m)
    {
      continue;
    }
    const double cosine = (T_map_body.linear() * axis_).dot(node.T_map_body().linear() * axis_);
    const double angle = std::acos(std::clamp(cosine, -1.0, 1.0));
    if (angle <= MAX_VIEW_ANGLE)
    {
      found.push_back({distance + 3.0 * angle, i});  // a turn by 20 degrees costs as much as a metre
    }
  }
  std::sort(found.begin(), found.end(),
            [](const Candidate& a, const Candidate& b)
            { return a.distance != b.distance ? a.distance < b.distance : a.node < b.node; });
  std::vector<RecognizedPlace> places;
  std::vector<size_t> tried;
  for (const Candidate& candidate : found)
  {
    const MapNode& node = map.nodes[candidate.node];
    const bool same_stretch = std::any_of(tried.begin(), tried.end(),
                                          [&](size_t other)
                                          {
                                            const MapNode& before = map.nodes[other];
                                            return before.segment == node.segment && before.loaded == node.loaded &&
                                                   std::abs(before.travelled_m - node.travelled_m) < NEIGHBOUR_M;
                                          });
    if (same_stretch)
    {
      continue;
    }
    tried.push_back(candidate.node);
    if (const auto place = verify(map, candidate.node, query, true))
    {
      places.push_back(*place);
    }
    if (tried.size() == most)
    {
      break;
    }
  }
  return places;
}

/// Nodes whose keyframes got the most votes, together with their neighbours on the way, one per stretch.
std::vector<size_t> PlaceRecognizer::candidates(const MapData& map, const PlaceQuery& query, bool others_only)
{
  std::vector<float> votes(serials_.size(), 0.0F);
  for (const PlaceIndex::Vote& vote : index_.query(*query.features))
  {
    votes[vote.keyframe] = vote.weight;
  }
  std::vector<size_t> nodes;  // keyframes that are not recent, in the order of the way
  std::vector<float> own;
  for (size_t i = 0; i < map.nodes.size(); ++i)
  {
    const MapNode& node = map.nodes[i];
    if (node.features && !isRecent(node, query) && !(others_only && query.own_part[node.segment]))
    {
      nodes.push_back(i);
      own.push_back(votes[slots_.at(node.serial)]);
    }
  }
  std::vector<std::pair<float, size_t>> sums(nodes.size());  // of votes, position in nodes
  for (size_t k = 0; k < nodes.size(); ++k)
  {
    float sum = own[k];
    for (size_t other = k - std::min(k, NEIGHBOURS); other < std::min(nodes.size(), k + NEIGHBOURS + 1); ++other)
    {
      const MapNode& a = map.nodes[nodes[k]];
      const MapNode& b = map.nodes[nodes[other]];
      if (other != k && a.segment == b.segment && std::abs(a.travelled_m - b.travelled_m) < NEIGHBOUR_M)
      {
        sum += NEIGHBOUR_WEIGHT * own[other];
      }
    }
    sums[k] = {sum, k};
  }
  std::sort(sums.begin(), sums.end(),
            [](const auto& a, const auto& b) { return a.first != b.first ? a.first > b.first : a.second < b.second; });
  std::vector<size_t> chosen;
  std::vector<bool> covered(nodes.size(), false);
  for (const auto& [sum, k] : sums)
  {
    if (sum <= 0.0F || chosen.size() == CANDIDATES)
    {
      break;
    }
    if (covered[k])
    {
      continue;
    }
    chosen.push_back(nodes[k]);
    for (size_t other = k - std::min(k, 2 * NEIGHBOURS); other < std::min(nodes.size(), k + 2 * NEIGHBOURS + 1);
         ++other)
    {
      covered[other] = true;
    }
  }
  return chosen;
}

std::optional<RecognizedPlace> PlaceRecognizer::anywhere(const MapData& map, const PlaceQuery& query, bool others_only)
{
  std::optional<RecognizedPlace> best;
  std::vector<RecognizedPlace> places;
  for (const size_t node : candidates(map, query, others_only))
  {
    if (const auto place = verify(map, node, query, false))
    {
      places.push_back(*place);
      if (!best || place->match.inliers > best->match.inliers)
      {
        best = place;
      }
    }
  }
  for (const RecognizedPlace& place : places)
  {
    const Eigen::Isometry3d difference = best->match.T_map_body.inverse() * place.match.T_map_body;
    const bool same = difference.translation().norm() < SAME_PLACE_M &&
                      Eigen::AngleAxisd(difference.linear()).angle() < SAME_HEADING_RAD;
    if (!same && place.match.inliers > AMBIGUOUS * best->match.inliers)
    {
      return std::nullopt;
    }
  }
  return best;
}

}  // namespace pi_slam::map
