#pragma once

#include <pi_slam/stereo_calibration.h>

#include <array>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "map/map_data.h"
#include "map/place_recognizer.h"

namespace pi_slam::map
{

/// The turn about z of a transform [rad].
double headingOf(const Eigen::Isometry3d& T);

/// By how much two poses are turned against each other [rad].
double angleBetween(const Eigen::Isometry3d& a, const Eigen::Isometry3d& b);

/// The nodes of the map, what ties them to each other, and the index of their looks. Segments of odometry that nothing
/// ties together are parts of their own: places are comparable within a part only. With a store, features of far
/// keyframes lie on disk, in square tiles of ground that come and go as a whole. Not thread safe.
class MapGraph
{
public:
  /// @param tile_folder  empty: all features stay in memory; so they do if nothing can be written there, see
  /// diskDefect().
  MapGraph(const StereoCalibration& calibration, const PlaceVerifierOptions& options,
           std::shared_ptr<pi_runtime::Runtime> runtime, const std::string& tile_folder = "");

  void clear();
  /// Replaces the map by one from a file, as part 0.
  void load(MapData data);
  /// Brings features of a node that is none of this map yet from memory to the disk, if there is a store. Any thread.
  /// @throws MapError if the disk refuses them.
  void store(MapNode* node) const;
  const MapData& data() const { return data_; }
  bool isEmpty() const { return data_.nodes.empty(); }
  struct Counts
  {
    size_t keyframes = 0;
    size_t in_memory = 0;  ///< of them
    size_t landmarks = 0;
    size_t bytes = 0;  ///< of features in memory
  };
  const Counts& counts() const;
  /// Memory, about.
  size_t bytes() const;
  bool hasStore() const { return store_ != nullptr; }
  /// Size of the file of tiles.
  uint64_t bytesOnDisk() const { return store_ ? store_->bytes() : 0; }
  /// What the disk refused; empty: nothing.
  const std::string& diskDefect() const { return disk_defect_; }

  /// A new segment, a part of its own. @return its number.
  uint32_t beginSegment();
  uint32_t partOf(uint32_t segment) const { return part_of_segment_[segment]; }
  /// Moves all nodes of a part.
  void movePart(uint32_t part, const Eigen::Isometry3d& shift);
  /// Both parts lie in map as they should: from now on they are one, with the smaller number.
  void joinParts(uint32_t a, uint32_t b);
  /// The part with the most keyframes; 0 if there is none.
  uint32_t largestPart() const;
  /// A part as a map of its own.
  /// @param newest  a patch of the grid beyond those of the map; nullopt: none.
  MapData copyOf(uint32_t part, const std::optional<GridPatch>& newest) const;

  /// Appends a node, with its serial, and the edge of odometry from the one before.
  /// @param before           the newest node of its segment; nullopt: it is the first.
  /// @param odometry_factor  on the deviations of that edge.
  /// @return its index.
  uint32_t add(MapNode node, std::optional<uint32_t> before, double odometry_factor);
  /// Ties a node to a place that was recognised there.
  void addLoop(uint32_t to, const RecognizedPlace& place);
  /// Odometry of a segment counts less from `from_m` of its way on.
  void doubtOdometry(uint32_t segment, double from_m, double factor);
  void addPatch(GridPatch patch);
  /// Ties a position by GNSS to a node, one per node: standing still for an hour must not outweigh the drive.
  /// @param shift  of the antenna from the node, in axes of odom.
  /// @return whether the map's place on earth is known only now.
  bool addFix(uint32_t node, const Eigen::Vector3d& shift, const GeoPoint& antenna, double deviation,
              double up_deviation);

  /// Whether enough came since the last correction; it costs as the map is large.
  bool isCorrectionDue() const;
  /// Moves nodes so that they fit what ties them. @return false if there is no usable solution: nothing moved.
  bool correct();

  /// Takes out what is most redundant beyond `most_keyframes`, and nodes without features beyond as many again.
  /// @return where each node has gone (-1: taken out); nullopt if the indices are as they were.
  std::optional<std::vector<int64_t>> bound(size_t most_keyframes, double distance_m, double angle_rad);

  /// Brings the tiles around a place into memory, and others to the disk, so that memory holds some `most` keyframes.
  /// A set that the disk refuses is lost: its node is a keyframe no more, and diskDefect() tells why.
  void loadAround(const Eigen::Vector3d& p_map, uint32_t part, size_t most);
  /// Brings the tiles after those of the last call into memory instead: call by call the whole map can be searched.
  void loadNext(size_t most);

  /// Keyframes of a part near a pose, in distance and angle.
  int countNear(const Eigen::Isometry3d& T_map_body, uint32_t part, double distance_m, double angle_rad) const;
  /// As PlaceRecognizer. @param query  its own_part is filled in.
  std::vector<RecognizedPlace> placesNear(PlaceQuery query, const Eigen::Isometry3d& T_map_body, double radius_m,
                                          size_t most);
  std::optional<RecognizedPlace> placeAnywhere(PlaceQuery query);

private:
  using Tile = std::array<int, 3>;  ///< part, and which square of ground
  Tile tileOf(const MapNode& node) const;
  std::map<Tile, size_t> tiles() const;
  void keepInMemory(const std::vector<Tile>& tiles);
  void bringIn(MapNode* node);
  void bringOut(MapNode* node);
  void fillOwnPart(PlaceQuery* query) const;

  MapData data_;
  std::unique_ptr<FeatureStore> store_;  ///< null: none
  std::string disk_defect_;
  mutable std::optional<Counts> counts_;  ///< nullopt: nodes have changed since
  std::optional<Tile> searched_;          ///< the last tile of loadNext()
  PlaceRecognizer recognizer_;
  uint64_t next_serial_ = 0;
  /// Segments with the same number are tied to each other in the map. 0: the part of the oldest segment, or the loaded
  /// one.
  std::vector<uint32_t> part_of_segment_;
  size_t nodes_since_correction_ = 0;
  bool ties_pending_ = false;  ///< loops or fixes came since the last correction
};

}  // namespace pi_slam::map
