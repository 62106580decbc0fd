#include "map/feature_store.h"

#include <fcntl.h>
#include <pi_node/unique_fd.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <map>
#include <mutex>
#include <vector>

#include "map/map_file.h"

namespace pi_slam::map
{

namespace
{

constexpr uint64_t BLOCK_BYTES = 1024;  ///< room is given in blocks, so that most gaps fit the next set

}  // namespace

/// A file without a name, and which parts of it are in use. Any thread may use it.
class TileFile
{
public:
  explicit TileFile(const std::string& folder) : folder_(folder)
  {
    std::string name = folder + "/pi_slam_tiles.XXXXXX";
    descriptor_ = pi_node::UniqueFd(::mkostemp(name.data(), O_CLOEXEC));
    if (!descriptor_)
    {
      fail("make a file in it");
    }
    ::unlink(name.c_str());
  }

  /// @return the place of so many bytes.
  uint64_t take(size_t bytes)
  {
    std::lock_guard<std::mutex> lock(mutex_);
    std::vector<uint64_t>& free = free_[blocks(bytes)];
    if (free.empty())
    {
      free.push_back(end_);
      end_ += blocks(bytes) * BLOCK_BYTES;
    }
    const uint64_t at = free.back();
    free.pop_back();
    return at;
  }
  void giveBack(uint64_t at, size_t bytes)
  {
    std::lock_guard<std::mutex> lock(mutex_);
    free_[blocks(bytes)].push_back(at);
  }
  void write(uint64_t at, const std::vector<uint8_t>& bytes)
  {
    for (size_t done = 0; done < bytes.size();)
    {
      const ssize_t count =
          ::pwrite(descriptor_.get(), bytes.data() + done, bytes.size() - done, static_cast<off_t>(at + done));
      if (count < 0 && errno != EINTR)
      {
        fail("write to its file");
      }
      done += count > 0 ? static_cast<size_t>(count) : 0;
    }
  }
  std::vector<uint8_t> read(uint64_t at, size_t size) const
  {
    std::vector<uint8_t> bytes(size);
    for (size_t done = 0; done < size;)
    {
      const ssize_t count = ::pread(descriptor_.get(), bytes.data() + done, size - done, static_cast<off_t>(at + done));
      if (count == 0 || (count < 0 && errno != EINTR))
      {
        fail("read its file");
      }
      done += count > 0 ? static_cast<size_t>(count) : 0;
    }
    return bytes;
  }
  uint64_t end() const
  {
    std::lock_guard<std::mutex> lock(mutex_);
    return end_;
  }
  [[noreturn]] void fail(const std::string& action) const
  {
    throw MapError("map/tile_folder " + folder_ + ": cannot " + action + ": " + std::strerror(errno) +
                   "; give a folder on a disk with room");
  }

private:
  static uint64_t blocks(size_t bytes) { return (bytes + BLOCK_BYTES - 1) / BLOCK_BYTES; }

  const std::string folder_;
  pi_node::UniqueFd descriptor_;
  mutable std::mutex mutex_;
  uint64_t end_ = 0;
  std::map<uint64_t, std::vector<uint64_t>> free_;  ///< places of rooms that were given back, by their blocks
};

StoredFeatures::StoredFeatures(std::shared_ptr<TileFile> file, const FeatureSet& set)
  : file_(std::move(file)), features_(set.size())
{
  const std::vector<uint8_t> bytes = encodeFeatures(set);
  bytes_ = bytes.size();
  checksum_ = crc64(bytes.data(), bytes_);
  at_ = file_->take(bytes_);
  try
  {
    file_->write(at_, bytes);
  }
  catch (const MapError&)
  {
    file_->giveBack(at_, bytes_);
    throw;
  }
}

StoredFeatures::~StoredFeatures()
{
  file_->giveBack(at_, bytes_);
}

FeatureSetPtr StoredFeatures::load() const
{
  const std::vector<uint8_t> bytes = file_->read(at_, bytes_);
  if (crc64(bytes.data(), bytes_) != checksum_)
  {
    errno = EIO;
    file_->fail("read back what was written to its file");
  }
  return decodeFeatures(bytes, features_, "of tiles");
}

FeatureStore::FeatureStore(const std::string& folder) : file_(std::make_shared<TileFile>(folder)) {}

StoredFeaturesPtr FeatureStore::write(const FeatureSet& features)
{
  return std::make_shared<const StoredFeatures>(file_, features);
}

uint64_t FeatureStore::bytes() const
{
  return file_->end();
}

}  // namespace pi_slam::map
