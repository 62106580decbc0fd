#pragma once

#include <pi_slam/stereo_calibration.h>

#include <memory>
#include <optional>
#include <unordered_map>
#include <vector>

#include "map/map_data.h"
#include "map/place_index.h"
#include "map/place_verifier.h"

namespace pi_slam::map
{

/// A node of the map from whose features the body was found in map.
struct RecognizedPlace
{
  uint32_t node = 0;  ///< index
  PlaceMatch match;
  bool strong = false;  ///< enough on its own; else another picture has to say the same
};

/// The picture of now and its place on the path: nodes shortly before it are not recognised again.
struct PlaceQuery
{
  const FeatureSet* features = nullptr;
  Eigen::Isometry3d T_odom_body = Eigen::Isometry3d::Identity();
  uint32_t segment = 0;
  double travelled_m = 0.0;
  /// Which segments are known to lie in the map as the body's own does, by number of the segment.
  std::vector<bool> own_part;
};

/// Finds known places: near the expected pose of the body, or anywhere by appearance. Keeps an index of the map's
/// keyframes. Not thread safe. Deterministic.
class PlaceRecognizer
{
public:
  PlaceRecognizer(const StereoCalibration& calibration, const PlaceVerifierOptions& options,
                  std::shared_ptr<pi_runtime::Runtime> runtime);

  void add(const MapNode& node);
  void remove(const MapNode& node);
  void clear();
  size_t bytes() const { return index_.bytes(); }

  /// Places of the own part about T_map_body, at most `most`, on different stretches of the way, the likeliest first.
  std::vector<RecognizedPlace> near(const MapData& map, const PlaceQuery& query, const Eigen::Isometry3d& T_map_body,
                                    double radius_m, size_t most);

  /// The place anywhere in the map that the picture shows; nullopt if there is none, or two that differ show it.
  /// @param others_only  places that are not of the own part.
  std::optional<RecognizedPlace> anywhere(const MapData& map, const PlaceQuery& query, bool others_only);

private:
  bool isRecent(const MapNode& node, const PlaceQuery& query) const;
  std::vector<PlaceView> viewsAt(const MapData& map, size_t node, const PlaceQuery& query) const;
  std::optional<RecognizedPlace> verify(const MapData& map, size_t node, const PlaceQuery& query, bool expected);
  std::vector<size_t> candidates(const MapData& map, const PlaceQuery& query, bool others_only);

  const PlaceVerifierOptions options_;
  const Eigen::Vector3d axis_;  ///< of the left camera, in the body frame
  PlaceIndex index_;
  PlaceVerifier verifier_;
  std::unordered_map<uint64_t, uint32_t> slots_;  ///< number in the index by serial
  std::vector<uint64_t> serials_;                 ///< the opposite
  std::vector<uint32_t> free_slots_;
};

}  // namespace pi_slam::map
