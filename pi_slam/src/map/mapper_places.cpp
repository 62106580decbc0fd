#include "map/mapper_impl.h"

namespace pi_slam
{

namespace
{

constexpr double GATE_CHI2 = 25.0;  ///< of a place that fits what is known: five deviations
/// Odometry is not off by more than this, and this part of the way since a place was recognised: ten times the 0.5 %
/// and 0.01 degrees per metre that it drifted at worst in measured drives.
constexpr double GATE_M = 1.0;
constexpr double GATE_PER_M = 0.05;
constexpr double GATE_RAD = 0.1;
constexpr double GATE_RAD_PER_M = 0.003;
constexpr double USUAL_DEVIATIONS = 2.0;  ///< of a place from what is known
/// Between pictures that say the same: results are off by at most 0.3 m and 1.6 degrees, measured after changes.
constexpr double AGREEMENT_M = 0.35;
constexpr double AGREEMENT_RAD = 0.03;
constexpr double AGREEMENT_WAY_M = 4.0;  ///< within which they must come
constexpr double OTHER_VIEW_M = 0.1;     ///< pictures from the same spot are one,
constexpr double OTHER_VIEW_RAD = 0.05;
constexpr size_t MOST_WITNESSES = 10;
/// Of a place: the graph is corrected at once. A cell of the grid is 0.1 m.
constexpr double LARGE_CORRECTION_M = 0.12;
constexpr double LARGE_CORRECTION_RAD = 0.015;
constexpr double SEARCH_M = 2.5;  ///< about the expected place
constexpr double MOST_SEARCH_M = 8.0;
constexpr size_t PLACES_NEAR = 2;   ///< recognised per picture
constexpr double ANYWHERE_M = 1.0;  ///< way between searches of the whole map, while the place is known
constexpr double ANYWHERE_RAD = 0.5;

}  // namespace

/// Odometry does not drift by more: a place that needs more is a false recognition.
bool Mapper::Impl::fits(const RecognizedPlace& place) const
{
  const DriftFilter::Innovation innovation = filter.innovation(place.match);
  const double way = segment->travelled_m - segment->recognized_at_m;
  return innovation.distance_m < GATE_M + GATE_PER_M * way && innovation.angle_rad < GATE_RAD + GATE_RAD_PER_M * way;
}

/// Whether a picture taken shortly before, at another place, gives the same T_map_odom.
bool Mapper::Impl::hasWitness(const MapFrame& frame, const RecognizedPlace& place)
{
  const Eigen::Isometry3d& T_map_odom = place.match.T_map_odom;
  const uint32_t part = graph.partOf(graph.data().nodes[place.node].segment);
  bool agreed = false;
  for (const Witness& witness : segment->witnesses)
  {
    // Both are measurements of odom; compared at the body.
    const Eigen::Isometry3d before = witness.T_map_odom * frame.T_odom_body;
    agreed = agreed || (witness.part == part && segment->travelled_m - witness.travelled_m < AGREEMENT_WAY_M &&
                        isApart(witness.T_odom_body, frame.T_odom_body, OTHER_VIEW_M, OTHER_VIEW_RAD) &&
                        !isApart(before, place.match.T_map_body, AGREEMENT_M, AGREEMENT_RAD));
  }
  std::vector<Witness>& witnesses = segment->witnesses;
  if (witnesses.size() == MOST_WITNESSES)
  {
    witnesses.erase(witnesses.begin());
  }
  witnesses.push_back({frame.T_odom_body, T_map_odom, part, segment->travelled_m});
  return agreed;
}

/// A place of another part of the map was recognised: joins both parts.
void Mapper::Impl::joinParts(const MapFrame& frame, RecognizedPlace* place)
{
  const uint32_t own = ownPart();
  const uint32_t other = graph.partOf(graph.data().nodes[place->node].segment);
  const Eigen::Isometry3d shift = place->match.T_map_odom * filter.T_map_odom().inverse();
  if (own != 0)
  {
    graph.movePart(own, shift);
    filter.start(frame.T_odom_body, place->match.T_map_odom, place->match.covariance);
  }
  else
  {
    graph.movePart(other, shift.inverse());
    place->match.T_map_odom = filter.T_map_odom();
    place->match.T_map_body = filter.T_map_body();
  }
  graph.joinParts(own, other);
  segment->tiles_at.reset();
  was_localized = was_localized || ownPart() == 0;
}

/// Moves odom, and what was mapped by it; a map from a file stays.
void Mapper::Impl::moveTo(const Eigen::Isometry3d& T_map_odom)
{
  if (segment && ownPart() == 0 && loaded)
  {
    segment.reset();  // what comes is a part of its own
  }
  else if (segment)
  {
    graph.movePart(ownPart(), T_map_odom * filter.T_map_odom().inverse());
    segment->witnesses.clear();
    segment->tiles_at.reset();  // places are looked for about the new pose first
  }
  filter.turn(T_map_odom);
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
  segment->odometry_factor = factor;
  graph.doubtOdometry(segment->number, segment->recognized_at_m, factor);
}

/// Recognises places near where the body should be.
void Mapper::Impl::recognizeNear(const MapFrame& frame, const PlaceQuery& query, std::vector<RecognizedPlace>* places)
{
  const double deviation = std::sqrt(filter.covariance().topLeftCorner<3, 3>().trace());
  const double radius = std::min(MOST_SEARCH_M, SEARCH_M + 2.0 * deviation);
  for (const RecognizedPlace& place : graph.placesNear(query, filter.T_map_body(), radius, PLACES_NEAR))
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
  segment->T_odom_anywhere = frame.T_odom_body;
  std::optional<RecognizedPlace> place = graph.placeAnywhere(query);
  if (!place)
  {
    return;
  }
  const bool same_part = graph.partOf(graph.data().nodes[place->node].segment) == ownPart();
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
  query.segment = segment->number;
  query.travelled_m = segment->travelled_m;
  std::vector<RecognizedPlace> places;
  const bool is_placed = ownPart() == 0;  // else a place of another part comes first: it tells where this one lies
  if (!is_placed)
  {
    recognizeAnywhere(frame, query, &places);
  }
  if (places.empty())
  {
    recognizeNear(frame, query, &places);
  }
  if (places.empty() && is_placed && isApart(frame.T_odom_body, segment->T_odom_anywhere, ANYWHERE_M, ANYWHERE_RAD))
  {
    recognizeAnywhere(frame, query, &places);
  }
  if (!places.empty())
  {
    ++loops;
    segment->recognized_at_m = segment->travelled_m;
    segment->recognized_any = true;
  }
  return places;
}

}  // namespace pi_slam
