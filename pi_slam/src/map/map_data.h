#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <optional>
#include <vector>

#include "map/earth.h"
#include "map/feature_set.h"
#include "map/feature_store.h"
#include "map/packed_cells.h"

namespace pi_slam::map
{

/// A place where the body was. With features, in memory or on disk, it is a keyframe.
///
/// In map it stands as odometry has it, turned about z: R_map_body = Rz(heading) * R_odom_body, so that no axis of the
/// body has to be the one from which a heading could be read.
struct MapNode
{
  uint64_t serial = 0;  ///< unique in the map
  int64_t stamp_ns = 0;
  uint32_t segment = 0;      ///< stretch of odometry without a reset
  bool loaded = false;       ///< from a file, not of this run
  double travelled_m = 0.0;  ///< way of its segment up to here
  Eigen::Isometry3d T_odom_body = Eigen::Isometry3d::Identity();
  double heading = 0.0;  ///< of the odom frame in map, as at this node [rad]
  Eigen::Vector3d p_map_body = Eigen::Vector3d::Zero();
  FeatureSetPtr features;    ///< null: not in memory
  StoredFeaturesPtr stored;  ///< null: not on disk

  bool isKeyframe() const { return features || stored; }
  size_t featureCount() const { return features ? features->size() : stored ? stored->size() : 0; }
  /// From memory, or from the disk; null if the node is no keyframe. @throws MapError if the disk fails.
  FeatureSetPtr allFeatures() const { return features || !stored ? features : stored->load(); }
  Eigen::Isometry3d T_map_body() const
  {
    Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
    T.linear() = Eigen::AngleAxisd(heading, Eigen::Vector3d::UnitZ()) * T_odom_body.linear();
    T.translation() = p_map_body;
    return T;
  }
  Eigen::Isometry3d T_map_odom() const { return T_map_body() * T_odom_body.inverse(); }
};

/// A measurement between two nodes: p_to - p_from = Rz(heading_from) shift, heading_to - heading_from = turn.
struct MapEdge
{
  uint32_t from = 0;  ///< index of the node
  uint32_t to = 0;
  bool loop = false;  ///< a recognised place; else odometry
  Eigen::Vector3d shift = Eigen::Vector3d::Zero();
  double turn = 0.0;
  double position_deviation = 1.0;  ///< per axis [m]
  double heading_deviation = 1.0;   ///< [rad]
};

/// Cells of a grid as seen at a place, in odom of its segment. They stand in map as the segment's node does whose way
/// is nearest.
struct GridPatch
{
  uint32_t segment = 0;
  double travelled_m = 0.0;  ///< way of the segment up to the middle of the patch
  PackedCells cells;         ///< in odom
};

/// What GNSS measured near a node: p_antenna = p_node + Rz(heading_node) shift is `p_local` in the frame of the map's
/// GeoPoint.
struct MapFix
{
  uint32_t node = 0;
  Eigen::Vector3d shift = Eigen::Vector3d::Zero();
  Eigen::Vector3d p_local = Eigen::Vector3d::Zero();
  double deviation = 1.0;     ///< to each side [m]
  double up_deviation = 2.0;  ///< [m]
};

struct MapData
{
  std::vector<MapNode> nodes;  ///< in the order in which they were made
  std::vector<MapEdge> edges;
  std::vector<GridPatch> patches;   ///< oldest first
  std::optional<GeoPoint> origin;   ///< of the local frame on earth; nullopt: nothing is known of it
  std::vector<MapFix> fixes;        ///< oldest first
  std::optional<EarthPlace> earth;  ///< in that frame; nullopt: not known yet
};

/// How odometry drifts: a random walk over the way, so that errors of position and heading grow with its root.
constexpr double DRIFT_POSITION = 0.008;          ///< [m / sqrt(m)]
constexpr double DRIFT_HEADING = 0.0008;          ///< [rad / sqrt(m)]
constexpr double DRIFT_HEADING_PER_TURN = 0.001;  ///< [rad / sqrt(rad)]
constexpr double DRIFT_POSITION_LEAST = 0.002;    ///< of any step [m]
constexpr double DRIFT_HEADING_LEAST = 0.0003;    ///< [rad]

}  // namespace pi_slam::map
