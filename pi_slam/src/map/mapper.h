#pragma once

#include <pi_slam/stereo_calibration.h>
#include "map/earth.h"
#include "map/map_frame.h"
#include "map/occupancy_cells.h"

#include <Eigen/Geometry>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

namespace pi_runtime
{
class Runtime;
}

namespace pi_slam
{

/// A map file that cannot be used or written. what() names the file and the defect.
class MapError : public std::runtime_error
{
public:
  using std::runtime_error::runtime_error;
};

struct MapperOptions
{
  double keyframe_distance_m = 0.5;     ///< between keyframes of the map; in [0.05, 10]
  double keyframe_angle_deg = 15.0;     ///< likewise; in [1, 90]
  int features = 300;                   ///< with descriptor, per keyframe; in [50, 2000]
  size_t max_keyframes = 3000;          ///< in memory; beyond it, the most redundant ones go; in [10, 100000]
  std::string tile_folder;              ///< where others than these are kept for this run; empty: nowhere
  size_t max_stored_keyframes = 30000;  ///< with it: beyond it the most redundant ones go; in [10, 1000000]
  double max_landmark_range_m = 25.0;   ///< of points in the cloud; in [1, 200]
  double voxel_m = 0.1;                 ///< of the cloud's filter; in [0.01, 5]
  bool loop_closure = true;
  int min_inliers = 25;       ///< of a place recognised again; in [8, 1000]
  bool threaded = true;       ///< a thread of its own with a queue of one; false: add() does the work
  bool kernel_tasks = false;  ///< kernels of descriptors and matching as tasks of pi_runtime

  /// @throws std::invalid_argument that names field, value and bound.
  void validate() const;
};

/// A position by GNSS.
struct GnssFix
{
  int64_t stamp_ns = 0;
  map::GeoPoint antenna;
  double deviation = 1.0;                                    ///< east and north [m]; > 0
  double up_deviation = 2.0;                                 ///< [m]; > 0
  Eigen::Vector3d p_body_antenna = Eigen::Vector3d::Zero();  ///< the lever arm [m]
};

/// Where the map lies on earth.
struct MapOnEarth
{
  Eigen::Isometry3d T_earth_map = Eigen::Isometry3d::Identity();  ///< earth as in REP 105: earth-centred, earth-fixed
  map::GeoPoint origin;                                           ///< of the map's frame
  double heading_rad = 0.0;                                       ///< of its x axis, from east to north
};

struct MapStatistics
{
  size_t keyframes = 0;
  size_t keyframes_in_memory = 0;  ///< the others' features lie on disk
  size_t landmarks = 0;
  size_t bytes = 0;            ///< memory of the map, about
  uint64_t bytes_on_disk = 0;  ///< of its tiles
  std::string disk_defect;     ///< what the disk refused, so that places are lost; empty: nothing
  size_t loops = 0;            ///< places recognised again so far
  bool loaded = false;         ///< there is a map from a file
  bool localized = false;      ///< map and odom belong together: always true without a loaded map
  /// Of x, y, z of the body in map [m] and heading [rad], by recognised places and the way since.
  Eigen::Matrix4d covariance = Eigen::Matrix4d::Zero();
  double last_add_ms = 0.0;            ///< work for the last frame
  size_t skipped = 0;                  ///< frames for which there was no time
  size_t fixes = 0;                    ///< of GNSS, in the map
  std::optional<MapOnEarth> on_earth;  ///< nullopt: not known
};

struct MapPoint
{
  Eigen::Vector3f p_map;
  uint8_t grey;
};

/// The map: keyframes with landmarks and descriptors, recognised again (loop closure, relocalisation), corrected by a
/// pose graph. Odometry stays as it is: only T_map_odom changes (REP 105).
///
/// All methods may be called from any thread. Without `threaded` the result depends on the input only.
class Mapper
{
public:
  /// @param runtime  runs the stage slam_map, and the kernels with options.kernel_tasks, which needs one; null: all is
  /// called directly.
  /// @throws std::invalid_argument for options or a calibration out of range, or cameras of different size.
  Mapper(const StereoCalibration& calibration, const MapperOptions& options,
         std::shared_ptr<pi_runtime::Runtime> runtime = nullptr);
  /// Finishes the frame in work.
  ~Mapper();

  /// Offers a frame. Returns at once with `threaded`; a frame that waits is replaced by a newer one. A missing picture
  /// is an empty one. Nothing is done for frames near the last one, so any rate will do; before localisation, and on
  /// known ground, frames between keyframes help.
  /// @throws std::invalid_argument for pictures of another size or type, or a pose that is none.
  void add(const MapFrame& frame);
  /// Offers a position by GNSS, in order of time. It is tied to the keyframe before it as soon as frames have passed
  /// it. The map gets its place on earth when the fixes tell a heading; from then on they straighten it, as much as
  /// they are worth beside odometry and loops. Wrong ones (multipath) hardly count.
  /// @throws std::invalid_argument for numbers that are none.
  void addFix(const GnssFix& fix);
  /// Returns when no frame waits or is in work.
  void flush();

  /// Odometry was restarted at another place. From now on only recognised places connect new keyframes to old ones.
  void odometryReset();

  /// Sets the place of the body in map: T_map_odom becomes so that T_odom_body is at the position and heading of
  /// T_map_body. Roll and pitch stay those of odometry, which measures gravity. Waits for the frame in work; has taken
  /// effect when it returns.
  ///
  /// The map since odometry started, with all parts joined to it, moves along; path and cloud stay consistent. A map
  /// from a file keeps its place: statistics().localized becomes false, and the next recognised place of it overrides
  /// this pose. The search for that place covers the whole map.
  /// @throws std::invalid_argument for matrices that are no poses; changes nothing then.
  void setPose(const Eigen::Isometry3d& T_odom_body, const Eigen::Isometry3d& T_map_body);

  Eigen::Isometry3d T_map_odom() const;

  /// Corrected path: the keyframes' poses in the map frame by their stamps (those of this run).
  std::vector<std::pair<int64_t, Eigen::Isometry3d>> path() const;

  /// Landmarks in the map frame, voxel-filtered (PCL).
  std::vector<MapPoint> cloud() const;

  /// Takes the grid around the vehicle, in odom as it is now. Of places that were left behind, a part is kept with the
  /// map: it moves with the keyframes, and is saved and loaded. Waits for the frame in work.
  /// @throws std::invalid_argument for a grid whose numbers do not agree.
  void addGrid(const OccupancyCells& grid);

  /// What is free and what is occupied, in map: the parts that were kept, and around the vehicle the last grid.
  /// nullopt: nothing is known, or the map is too large for one grid (MOST_CELLS). Waits for the frame in work.
  std::optional<OccupancyCells> grid() const;

  MapStatistics statistics() const;
  /// How the stage slam_map does.
  std::string stage() const;

  /// Writes the map, with a checksum, first beside the file and then in its place. Of parts that nothing joins (after
  /// odometryReset()) the largest one is written; of a loaded map, that one and what was joined to it.
  /// @throws MapError for a file that cannot be written, or an empty map.
  void save(const std::string& file) const;
  /// Replaces the map. Until the first place in it is recognised, statistics().localized is false, and what is driven
  /// is a map of its own beside it, which neither path nor cloud show. Then T_map_odom jumps there, and both are one.
  /// @throws MapError for a file that is missing, truncated, damaged, of another version, or made with cameras of
  ///         another size; the map is unchanged then.
  void load(const std::string& file);

private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace pi_slam
