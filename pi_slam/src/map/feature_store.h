#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "map/feature_set.h"

namespace pi_slam::map
{

class TileFile;

/// A set of features on disk. Its room there is used again once the last pointer has gone. Any thread may load it.
class StoredFeatures
{
public:
  /// @throws MapError if there is no room, or the disk fails.
  StoredFeatures(std::shared_ptr<TileFile> file, const FeatureSet& set);
  ~StoredFeatures();
  StoredFeatures(const StoredFeatures&) = delete;
  StoredFeatures& operator=(const StoredFeatures&) = delete;

  /// Number of features.
  size_t size() const { return features_; }
  /// @throws MapError if the disk does not give it back as it was written.
  FeatureSetPtr load() const;

private:
  const std::shared_ptr<TileFile> file_;
  const size_t features_;
  uint64_t at_ = 0;
  size_t bytes_ = 0;
  uint64_t checksum_ = 0;
};
using StoredFeaturesPtr = std::shared_ptr<const StoredFeatures>;

/// Feature sets of keyframes that lie too far away to be kept in memory: in a file without a name, which goes with the
/// process. Any thread may use it.
class FeatureStore
{
public:
  /// @param folder  on a disk: a file system in memory would gain nothing.
  /// @throws MapError for a folder in which no file can be made.
  explicit FeatureStore(const std::string& folder);

  /// @throws MapError if there is no room, or the disk fails.
  StoredFeaturesPtr write(const FeatureSet& features);
  /// Size of the file [bytes].
  uint64_t bytes() const;

private:
  std::shared_ptr<TileFile> file_;
};

}  // namespace pi_slam::map
