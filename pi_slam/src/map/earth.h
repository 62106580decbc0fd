#pragma once

#include <Eigen/Geometry>
#include <optional>
#include <vector>

namespace pi_slam::map
{

/// On the ellipsoid WGS 84.
struct GeoPoint
{
  double latitude_deg = 0.0;
  double longitude_deg = 0.0;
  double height_m = 0.0;

  bool isValid() const;
};

/// The plane frame at a point of the earth: x east, y north, z up [m].
class LocalFrame
{
public:
  explicit LocalFrame(const GeoPoint& origin) : origin_(origin) {}
  Eigen::Vector3d toLocal(const GeoPoint& point) const;
  GeoPoint toGeo(const Eigen::Vector3d& p_local) const;
  /// Earth-centred and earth-fixed, as REP 105 has the frame `earth`.
  Eigen::Isometry3d T_earth_local() const;

private:
  GeoPoint origin_;
};

/// Where map lies in a local frame: p_local = Rz(heading) p_map + position. Both have z up.
struct EarthPlace
{
  Eigen::Vector3d position = Eigen::Vector3d::Zero();
  double heading = 0.0;  ///< of map's x axis, from east to north [rad]

  Eigen::Isometry3d T_local_map() const;
};

/// A place in map, and what GNSS says of it.
struct PlacePair
{
  Eigen::Vector3d p_map;
  Eigen::Vector3d p_local;
  double deviation;  ///< of p_local, along each axis of the plane [m]
};

/// The place that most pairs agree with, roughly; a third of them may be wrong. nullopt: they are too few, or too near
/// to each other for a heading.
std::optional<EarthPlace> findEarthPlace(const std::vector<PlacePair>& pairs);

}  // namespace pi_slam::map
