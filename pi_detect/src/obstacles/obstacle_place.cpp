#include "obstacles/obstacle_place.h"

#include <algorithm>

namespace pi_detect::obstacles
{

namespace
{

constexpr double EDGE_PART = 0.06;  // of its extent by which a box's middle may be wrong: seen from another side, ...
constexpr double CUT_PART = 0.25;   // likewise where both ends are not seen
constexpr double SHORT_M = 0.6;     // along x: of what is cut and longer, the near end may be out of view
constexpr double LEAST_SIDE_M = 0.05;

}  // namespace

bool showsOneEnd(const ObstacleMeasurement& measurement)
{
  return measurement.cut_left != measurement.cut_right && !measurement.piece &&
         measurement.max.y() - measurement.min.y() < BULKY_M;
}

Place placeOf(const ObstacleMeasurement& measurement, const Eigen::Vector2d& known_size, const VehiclePlace& vehicle,
              double most_edge_m)
{
  const Eigen::Vector2d size = (measurement.max - measurement.min).head<2>();
  const double width = known_size.y();
  const bool one_end = showsOneEnd(measurement);
  Place place;
  place.position = {measurement.min.x(), 0.5 * (measurement.min.y() + measurement.max.y())};
  if (one_end || (measurement.cut_left != measurement.cut_right && width > size.y()))
  {
    place.position.y() = measurement.cut_left ? measurement.min.y() + 0.5 * width : measurement.max.y() - 0.5 * width;
  }
  // When a piece joins or leaves, the middle moves by half of what the width changes, the near end of a side that is
  // seen at an angle by as much as the length. A cut end may be the near one.
  Eigen::Vector2d edge_sigma = EDGE_PART * size;
  if (one_end)
  {
    edge_sigma.x() += std::max(0.0, size.x() - SHORT_M);
  }
  else if (measurement.cut_left || measurement.cut_right)
  {
    edge_sigma = CUT_PART * size.cwiseMax(known_size);
  }
  const Eigen::Vector2d changed = 0.5 * (size - known_size).cwiseAbs();
  edge_sigma += one_end ? Eigen::Vector2d(changed.x(), 0.0) : changed;
  edge_sigma = edge_sigma.cwiseMin(most_edge_m);
  const double depth_sigma = EDGE_PART * std::min(BULKY_M, size.y());
  place.covariance = measurement.covariance.topLeftCorner<2, 2>();
  place.covariance(0, 0) += depth_sigma * depth_sigma;
  place.covariance.diagonal() += edge_sigma.cwiseAbs2();
  place.position = vehicle.toOdom(place.position);
  place.covariance = vehicle.R_odom_base * place.covariance * vehicle.R_odom_base.transpose();
  return place;
}

OutlineBounds footprintOf(const ObstacleMeasurement& measurement)
{
  return {measurement.min.head<2>(), measurement.max.head<2>()};
}

double commonPart(const OutlineBounds& a, const OutlineBounds& b)
{
  const Eigen::Vector2d size = a.high.cwiseMin(b.high) - a.low.cwiseMax(b.low);
  if (size.minCoeff() <= 0.0)
  {
    return 0.0;
  }
  const auto area = [](const Eigen::Vector2d& sides) { return sides.cwiseMax(LEAST_SIDE_M).prod(); };
  return area(size) / std::min(area(a.size()), area(b.size()));
}

}  // namespace pi_detect::obstacles
