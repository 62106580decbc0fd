#include "map/earth.h"

#include <GeographicLib/Geocentric.hpp>
#include <GeographicLib/LocalCartesian.hpp>

#include <algorithm>
#include <cmath>
#include <limits>

namespace pi_slam::map
{
namespace
{

constexpr size_t LEAST_PAIRS = 10;
constexpr double LEAST_SPREAD = 8.0;  ///< of places, times the deviation: then the heading is known to a few degrees
constexpr int HEADINGS = 72;
constexpr double AGREES = 3.0;  ///< within so many deviations

double median(std::vector<double>* values)
{
  const auto middle = values->begin() + static_cast<std::ptrdiff_t>(values->size() / 2);
  std::nth_element(values->begin(), middle, values->end());
  return *middle;
}

Eigen::Matrix3d aboutZ(double angle)
{
  return Eigen::AngleAxisd(angle, Eigen::Vector3d::UnitZ()).toRotationMatrix();
}

GeographicLib::LocalCartesian cartesian(const GeoPoint& origin)
{
  return {origin.latitude_deg, origin.longitude_deg, origin.height_m};
}

}  // namespace

bool GeoPoint::isValid() const
{
  return std::abs(latitude_deg) <= 90.0 && std::abs(longitude_deg) <= 360.0 && std::abs(height_m) < 1e5;
}

Eigen::Vector3d LocalFrame::toLocal(const GeoPoint& point) const
{
  Eigen::Vector3d p;
  cartesian(origin_).Forward(point.latitude_deg, point.longitude_deg, point.height_m, p.x(), p.y(), p.z());
  return p;
}

GeoPoint LocalFrame::toGeo(const Eigen::Vector3d& p) const
{
  GeoPoint point;
  cartesian(origin_).Reverse(p.x(), p.y(), p.z(), point.latitude_deg, point.longitude_deg, point.height_m);
  return point;
}

Eigen::Isometry3d LocalFrame::T_earth_local() const
{
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  std::vector<double> rotation(9);  // row by row, of earth by local
  Eigen::Vector3d p;
  GeographicLib::Geocentric::WGS84().Forward(origin_.latitude_deg, origin_.longitude_deg, origin_.height_m, p.x(),
                                             p.y(), p.z(), rotation);
  T.linear() = Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(rotation.data());
  T.translation() = p;
  return T;
}

Eigen::Isometry3d EarthPlace::T_local_map() const
{
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = aboutZ(heading);
  T.translation() = position;
  return T;
}

std::optional<EarthPlace> findEarthPlace(const std::vector<PlacePair>& pairs)
{
  if (pairs.size() < LEAST_PAIRS)
  {
    return std::nullopt;
  }
  std::vector<double> values;
  for (const PlacePair& pair : pairs)
  {
    values.push_back(pair.deviation);
  }
  const double deviation = median(&values);
  Eigen::AlignedBox3d box;
  for (const PlacePair& pair : pairs)
  {
    box.extend(pair.p_map);
  }
  if (box.diagonal().head<2>().norm() < LEAST_SPREAD * deviation)
  {
    return std::nullopt;
  }
  EarthPlace best;
  double least = std::numeric_limits<double>::infinity();
  for (int i = 0; i < HEADINGS; ++i)
  {
    EarthPlace place;
    place.heading = 2.0 * M_PI * i / HEADINGS;
    const Eigen::Matrix3d R = aboutZ(place.heading);
    for (int axis = 0; axis < 3; ++axis)
    {
      values.clear();
      for (const PlacePair& pair : pairs)
      {
        values.push_back(pair.p_local[axis] - (R * pair.p_map)[axis]);
      }
      place.position[axis] = median(&values);
    }
    double cost = 0.0;
    for (const PlacePair& pair : pairs)
    {
      const double off = (place.T_local_map() * pair.p_map - pair.p_local).head<2>().norm() / pair.deviation;
      cost += std::min(off * off, AGREES * AGREES);
    }
    if (cost < least)
    {
      least = cost;
      best = place;
    }
  }
  return best;
}

}  // namespace pi_slam::map
