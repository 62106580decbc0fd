#include "map/map_file.h"

#include <fcntl.h>
#include <pi_node/unique_fd.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <boost/crc.hpp>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <sstream>

namespace pi_slam::map
{

namespace
{

constexpr char MAGIC[8] = "PISLMAP";
constexpr uint32_t VERSION = 3;
constexpr uint32_t EARTH_VERSION = 3;  ///< the first with a place on earth
constexpr uint32_t GRID_VERSION = 2;   ///< the first with patches of the grid
constexpr uint32_t OLDEST_VERSION = 1;
constexpr size_t HEADER_BYTES = 24;
constexpr size_t CHECKSUM_BYTES = 8;
constexpr uint64_t MOST_BYTES = 8ULL << 30;
constexpr double FARTHEST = 1e7;  ///< no position is beyond [m]

static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "maps are written as they lie in memory");

constexpr uint64_t ALL_ONES = ~uint64_t{0};
using Crc64 = boost::crc_optimal<64, 0x42F0E1EBA9EA3693ULL, ALL_ONES, ALL_ONES, true, true>;

class Writer
{
public:
  template <typename T>
  void put(const T& value)
  {
    static_assert(std::is_arithmetic<T>::value, "numbers only");
    const auto* const begin = reinterpret_cast<const uint8_t*>(&value);
    bytes.insert(bytes.end(), begin, begin + sizeof(T));
  }
  template <typename Derived>
  void putMatrix(const Eigen::MatrixBase<Derived>& matrix)
  {
    for (Eigen::Index i = 0; i < matrix.size(); ++i)
    {
      put(matrix(i));
    }
  }
  void putPose(const Eigen::Isometry3d& T)
  {
    putMatrix(T.translation());
    putMatrix(Eigen::Quaterniond(T.linear()).coeffs());
  }

  /// Hands on what was put so far, so that memory never holds the whole map.
  void flush(std::ostream* stream)
  {
    crc_.process_bytes(bytes.data(), bytes.size());
    stream->write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
    bytes.clear();
  }
  /// Of all that was handed on.
  uint64_t checksum() const { return crc_.checksum(); }

  std::vector<uint8_t> bytes;

private:
  Crc64 crc_;
};

/// Reads numbers from a stream, and refuses those out of range.
class Reader
{
public:
  /// @param count  bytes that the stream has from where it stands.
  Reader(std::istream* stream, size_t count, std::string name) : stream_(stream), left_(count), name_(std::move(name))
  {
  }

  [[noreturn]] void refuse(const std::string& defect) const
  {
    throw MapError("map " + name_ + ": " + defect + "; make the map anew");
  }

  template <typename T>
  T get()
  {
    T value;
    copy(&value, sizeof(T));
    return value;
  }
  template <typename T>
  T getBetween(const char* what, T least, T most)
  {
    const T value = get<T>();
    if (!(value >= least && value <= most))
    {
      refuse(std::string(what) + " = " + std::to_string(value) + " is out of range");
    }
    return value;
  }
  uint64_t getCount(const char* what, uint64_t bytes_each) { return getBetween<uint64_t>(what, 0, left_ / bytes_each); }
  Eigen::Vector3d getPosition(const char* what)
  {
    Eigen::Vector3d p;
    for (int i = 0; i < 3; ++i)
    {
      p(i) = getBetween(what, -FARTHEST, FARTHEST);
    }
    return p;
  }
  Eigen::Isometry3d getPose(const char* what)
  {
    Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
    T.translation() = getPosition(what);
    Eigen::Quaterniond q;
    for (int i = 0; i < 4; ++i)
    {
      q.coeffs()(i) = getBetween(what, -1.001, 1.001);
    }
    if (std::abs(q.norm() - 1.0) > 1e-3)
    {
      refuse(std::string(what) + " has no unit quaternion");
    }
    T.linear() = q.normalized().toRotationMatrix();
    return T;
  }
  void copy(void* target, size_t bytes)
  {
    if (left_ < bytes)
    {
      refuse("its records go beyond its end");
    }
    if (bytes > 0 && !stream_->read(static_cast<char*>(target), static_cast<std::streamsize>(bytes)))
    {
      refuse("it cannot be read to its end");
    }
    left_ -= bytes;
  }
  size_t left() const { return left_; }

private:
  std::istream* const stream_;
  size_t left_;
  const std::string name_;
};

constexpr size_t FEATURE_BYTES = 5 * 4 + 2 + DESCRIPTOR_BYTES;
constexpr size_t NODE_BYTES = 8 + 4 + 8 + 7 * 8 + 4 * 8 + 4 + 3 * 4;
constexpr size_t EDGE_BYTES = 4 + 4 + 1 + 6 * 8;
constexpr size_t PATCH_BYTES = 4 + 4 * 8 + 4 + 4;
constexpr size_t FIX_BYTES = 4 + 8 * 8;

void putCamera(const MountedCamera& camera, Writer* writer)
{
  writer->put<int32_t>(camera.model.width);
  writer->put<int32_t>(camera.model.height);
  for (const double value : {camera.model.fx, camera.model.fy, camera.model.cx, camera.model.cy})
  {
    writer->put(value);
  }
  writer->put(static_cast<int32_t>(camera.model.distortion));
  for (size_t i = 0; i < 4; ++i)
  {
    writer->put(camera.model.coefficients[i]);
  }
  writer->putPose(camera.T_body_camera);
}

void checkCamera(const MountedCamera& camera, const char* side, Reader* reader)
{
  const auto width = reader->get<int32_t>();
  const auto height = reader->get<int32_t>();
  if (width != camera.model.width || height != camera.model.height)
  {
    reader->refuse(std::string("it was made with a ") + side + " camera of " + std::to_string(width) + " x " +
                   std::to_string(height) + " px, this one has " + std::to_string(camera.model.width) + " x " +
                   std::to_string(camera.model.height));
  }
  // The other numbers are only kept for information: features are rays, which do not depend on the lens.
  for (int i = 0; i < 4; ++i)
  {
    reader->get<double>();
  }
  reader->get<int32_t>();
  for (int i = 0; i < 4; ++i)
  {
    reader->get<double>();
  }
  reader->getPose("T_body_camera");
}

void putFeatures(const FeatureSet& set, Writer* writer)
{
  writer->putMatrix(set.p_body_camera);
  for (const MapFeature& feature : set.features)
  {
    writer->putMatrix(feature.bearing);
    writer->put(feature.inverse_distance);
    writer->put(feature.inverse_deviation);
    writer->put(feature.grey);
    writer->put(feature.level);
  }
  writer->bytes.insert(writer->bytes.end(), set.descriptors.begin(), set.descriptors.end());
}

void putNode(const MapNode& node, Writer* writer)
{
  writer->put(node.stamp_ns);
  writer->put(node.segment);
  writer->put(node.travelled_m);
  writer->putPose(node.T_odom_body);
  writer->put(node.heading);
  writer->putMatrix(node.p_map_body);
  const FeatureSet none;
  const FeatureSetPtr features = node.allFeatures();
  const FeatureSet& set = features ? *features : none;
  writer->put(static_cast<uint32_t>(set.size()));
  putFeatures(set, writer);
}

FeatureSetPtr getFeatures(uint32_t count, Reader* reader)
{
  auto set = std::make_shared<FeatureSet>();
  for (int i = 0; i < 3; ++i)
  {
    set->p_body_camera(i) = reader->getBetween("position of a camera", -1e4F, 1e4F);
  }
  if (count == 0)
  {
    return nullptr;
  }
  set->features.resize(count);
  for (MapFeature& feature : set->features)
  {
    for (int i = 0; i < 3; ++i)
    {
      feature.bearing(i) = reader->getBetween("bearing", -1.001F, 1.001F);
    }
    if (std::abs(feature.bearing.norm() - 1.0F) > 1e-3F)
    {
      reader->refuse("a bearing is not of unit length");
    }
    feature.inverse_distance = reader->getBetween("inverse distance", 0.0F, 1e3F);
    feature.inverse_deviation = reader->getBetween("deviation", 1e-9F, 1e3F);
    feature.grey = reader->get<uint8_t>();
    feature.level = reader->getBetween<uint8_t>("level", 0, 15);
  }
  set->descriptors.resize(count * DESCRIPTOR_BYTES);
  reader->copy(set->descriptors.data(), set->descriptors.size());
  return set;
}

MapNode getNode(Reader* reader)
{
  MapNode node;
  node.loaded = true;
  node.stamp_ns = reader->get<int64_t>();
  node.segment = reader->getBetween<uint32_t>("segment", 0, 1U << 30);
  node.travelled_m = reader->getBetween("way", 0.0, 1e9);
  node.T_odom_body = reader->getPose("pose of odometry");
  node.heading = reader->getBetween("heading", -1e6, 1e6);
  node.p_map_body = reader->getPosition("position");
  const auto count = reader->get<uint32_t>();
  if (count > (reader->left() - std::min<size_t>(reader->left(), 3 * sizeof(float))) / FEATURE_BYTES)
  {
    reader->refuse("number of features = " + std::to_string(count) + " is out of range");
  }
  node.features = getFeatures(count, reader);
  return node;
}

void putEdge(const MapEdge& edge, Writer* writer)
{
  writer->put(edge.from);
  writer->put(edge.to);
  writer->put(static_cast<uint8_t>(edge.loop));
  writer->putMatrix(edge.shift);
  writer->put(edge.turn);
  writer->put(edge.position_deviation);
  writer->put(edge.heading_deviation);
}

MapEdge getEdge(uint32_t nodes, Reader* reader)
{
  MapEdge edge;
  if (nodes == 0)
  {
    reader->refuse("it has edges without nodes");
  }
  edge.from = reader->getBetween<uint32_t>("start of an edge", 0, nodes - 1);
  edge.to = reader->getBetween<uint32_t>("end of an edge", 0, nodes - 1);
  if (edge.from == edge.to)
  {
    reader->refuse("an edge ends where it starts");
  }
  edge.loop = reader->getBetween<uint8_t>("kind of an edge", 0, 1) == 1;
  edge.shift = reader->getPosition("edge");
  edge.turn = reader->getBetween("turn of an edge", -1e6, 1e6);
  edge.position_deviation = reader->getBetween("deviation of an edge", 1e-6, 1e6);
  edge.heading_deviation = reader->getBetween("deviation of an edge", 1e-6, 1e6);
  return edge;
}

void putPatch(const GridPatch& patch, Writer* writer)
{
  const OccupancyCells grid = patch.cells.unpack();
  writer->put(patch.segment);
  writer->put(patch.travelled_m);
  writer->putMatrix(grid.origin);
  writer->put(grid.cell_m);
  writer->put(static_cast<uint32_t>(grid.width));
  writer->put(static_cast<uint32_t>(grid.height));
  writer->bytes.insert(writer->bytes.end(), grid.cells.begin(), grid.cells.end());
}

GridPatch getPatch(Reader* reader)
{
  GridPatch patch;
  patch.segment = reader->getBetween<uint32_t>("segment of a grid", 0, 1U << 30);
  patch.travelled_m = reader->getBetween("way of a grid", 0.0, 1e9);
  OccupancyCells grid;
  for (int i = 0; i < 2; ++i)
  {
    grid.origin(i) = reader->getBetween("corner of a grid", -FARTHEST, FARTHEST);
  }
  grid.cell_m = reader->getBetween("cell of a grid", 0.01, 10.0);
  const auto width = reader->getBetween<uint32_t>("width of a grid", 1, 1U << 15);
  const auto height = reader->getBetween<uint32_t>("height of a grid", 1, 1U << 15);
  grid.width = static_cast<int>(width);
  grid.height = static_cast<int>(height);
  const size_t count = static_cast<size_t>(width) * height;
  if (count > reader->left())
  {
    reader->refuse("a grid of " + std::to_string(count) + " cells goes beyond its end");
  }
  grid.cells.resize(count);
  reader->copy(grid.cells.data(), count);
  if (std::any_of(grid.cells.begin(), grid.cells.end(), [](int8_t cell) { return cell < -1 || cell > 100; }))
  {
    reader->refuse("a cell of a grid is not in [-1, 100]");
  }
  patch.cells = grid;
  return patch;
}

void putEarth(const MapData& map, Writer* writer)
{
  const GeoPoint origin = map.origin.value_or(GeoPoint());
  writer->put<uint32_t>(map.origin ? 1 : 0);
  for (const double value : {origin.latitude_deg, origin.longitude_deg, origin.height_m})
  {
    writer->put(value);
  }
  const EarthPlace place = map.earth.value_or(EarthPlace());
  writer->put<uint32_t>(map.earth ? 1 : 0);
  writer->putMatrix(place.position);
  writer->put(place.heading);
  writer->put<uint64_t>(map.fixes.size());
  for (const MapFix& fix : map.fixes)
  {
    writer->put(fix.node);
    writer->putMatrix(fix.shift);
    writer->putMatrix(fix.p_local);
    writer->put(fix.deviation);
    writer->put(fix.up_deviation);
  }
}

void getEarth(uint32_t nodes, MapData* map, Reader* reader)
{
  const bool has_origin = reader->getBetween<uint32_t>("whether an origin on earth is known", 0, 1) == 1;
  GeoPoint origin;
  origin.latitude_deg = reader->getBetween("latitude", -90.0, 90.0);
  origin.longitude_deg = reader->getBetween("longitude", -360.0, 360.0);
  origin.height_m = reader->getBetween("height", -1e5, 1e5);
  map->origin = has_origin ? std::make_optional(origin) : std::nullopt;
  const bool has_place = reader->getBetween<uint32_t>("whether the place on earth is known", 0, 1) == 1;
  EarthPlace place;
  place.position = reader->getPosition("place on earth");
  place.heading = reader->getBetween("heading on earth", -1e6, 1e6);
  map->earth = has_origin && has_place ? std::make_optional(place) : std::nullopt;
  const uint64_t fixes = reader->getCount("number of fixes", FIX_BYTES);
  if (fixes > 0 && (!has_origin || nodes == 0))
  {
    reader->refuse("it has " + std::to_string(fixes) + " fixes of GNSS, but no origin on earth or no keyframe");
  }
  for (uint64_t i = 0; i < fixes; ++i)
  {
    MapFix fix;
    fix.node = reader->getBetween<uint32_t>("node of a fix", 0, nodes - 1);
    fix.shift = reader->getPosition("shift of a fix");
    fix.p_local = reader->getPosition("place of a fix");
    fix.deviation = reader->getBetween("deviation of a fix", 1e-6, 1e7);
    fix.up_deviation = reader->getBetween("deviation of a fix", 1e-6, 1e7);
    map->fixes.push_back(fix);
  }
}

[[noreturn]] void failed(const std::string& file, const char* action)
{
  throw MapError("map " + file + ": cannot " + action + ": " + std::strerror(errno));
}

}  // namespace

uint64_t crc64(const uint8_t* bytes, size_t count)
{
  Crc64 crc;
  crc.process_bytes(bytes, count);
  return crc.checksum();
}

std::vector<uint8_t> encodeFeatures(const FeatureSet& set)
{
  Writer writer;
  putFeatures(set, &writer);
  return std::move(writer.bytes);
}

FeatureSetPtr decodeFeatures(const std::vector<uint8_t>& bytes, size_t count, const std::string& name)
{
  std::istringstream stream(std::string(bytes.begin(), bytes.end()));
  Reader reader(&stream, bytes.size(), name);
  return getFeatures(static_cast<uint32_t>(count), &reader);
}

void encodeMap(const MapData& map, const StereoCalibration& calibration, std::ostream* stream)
{
  Writer earth;
  putEarth(map, &earth);
  uint64_t patch_bytes = 0;
  for (const GridPatch& patch : map.patches)
  {
    patch_bytes += PATCH_BYTES + patch.cells.count();
  }
  Writer cameras;
  putCamera(calibration.left, &cameras);
  putCamera(calibration.right, &cameras);
  size_t features = 0;
  for (const MapNode& node : map.nodes)
  {
    features += node.featureCount();
  }

  Writer writer;
  writer.bytes.insert(writer.bytes.end(), MAGIC, MAGIC + sizeof(MAGIC));
  writer.put(VERSION);
  writer.put<uint32_t>(0);
  writer.put<uint64_t>(HEADER_BYTES + cameras.bytes.size() + 2 * sizeof(uint64_t) + map.nodes.size() * NODE_BYTES +
                       features * FEATURE_BYTES + map.edges.size() * EDGE_BYTES + sizeof(uint64_t) + patch_bytes +
                       earth.bytes.size() + CHECKSUM_BYTES);
  writer.bytes.insert(writer.bytes.end(), cameras.bytes.begin(), cameras.bytes.end());
  writer.put<uint64_t>(map.nodes.size());
  writer.put<uint64_t>(map.edges.size());
  for (const MapNode& node : map.nodes)
  {
    putNode(node, &writer);
    writer.flush(stream);
  }
  for (const MapEdge& edge : map.edges)
  {
    putEdge(edge, &writer);
  }
  writer.put<uint64_t>(map.patches.size());
  for (const GridPatch& patch : map.patches)
  {
    putPatch(patch, &writer);
    writer.flush(stream);
  }
  writer.bytes.insert(writer.bytes.end(), earth.bytes.begin(), earth.bytes.end());
  writer.flush(stream);
  writer.put(writer.checksum());
  writer.flush(stream);
}

namespace
{

/// Of the stream's first `count` bytes; leaves it at their end.
uint64_t checksumOf(std::istream* stream, uint64_t count)
{
  Crc64 crc;
  std::vector<char> chunk(1U << 20);
  for (uint64_t left = count; left > 0 && *stream;)
  {
    stream->read(chunk.data(), static_cast<std::streamsize>(std::min<uint64_t>(left, chunk.size())));
    crc.process_bytes(chunk.data(), static_cast<size_t>(stream->gcount()));
    left -= static_cast<uint64_t>(stream->gcount());
  }
  return crc.checksum();
}

/// @return the version.
uint32_t checkHeader(std::istream* stream, uint64_t size, const std::string& name)
{
  Reader header(stream, std::min<uint64_t>(size, HEADER_BYTES), name);
  if (size < HEADER_BYTES + CHECKSUM_BYTES)
  {
    header.refuse("it has " + std::to_string(size) + " bytes, too few for a map");
  }
  char magic[sizeof(MAGIC)];
  header.copy(magic, sizeof(magic));
  if (std::memcmp(magic, MAGIC, sizeof(MAGIC)) != 0)
  {
    header.refuse("it is no map of this program");
  }
  const auto version = header.get<uint32_t>();
  header.get<uint32_t>();
  const auto length = header.get<uint64_t>();
  if (version < OLDEST_VERSION || version > VERSION)
  {
    header.refuse("it is of version " + std::to_string(version) + ", only " + std::to_string(OLDEST_VERSION) + " to " +
                  std::to_string(VERSION) + " can be read");
  }
  if (length != size)
  {
    header.refuse("it has " + std::to_string(size) + " bytes, should have " + std::to_string(length));
  }
  stream->seekg(0);
  const uint64_t checksum = checksumOf(stream, size - CHECKSUM_BYTES);
  Reader end(stream, CHECKSUM_BYTES, name);
  if (end.get<uint64_t>() != checksum)
  {
    header.refuse("its checksum is wrong, the file is damaged");
  }
  stream->seekg(HEADER_BYTES);
  return version;
}

}  // namespace

MapData decodeMap(std::istream* stream, uint64_t size, const StereoCalibration& calibration, const std::string& name,
                  const std::function<void(MapNode*)>& taken)
{
  const uint32_t version = checkHeader(stream, size, name);
  Reader reader(stream, size - HEADER_BYTES - CHECKSUM_BYTES, name);
  checkCamera(calibration.left, "left", &reader);
  checkCamera(calibration.right, "right", &reader);
  const auto nodes = reader.getCount("number of keyframes", NODE_BYTES);
  const auto edges = reader.getCount("number of edges", EDGE_BYTES);
  if (nodes >= 1U << 30)
  {
    reader.refuse("number of keyframes = " + std::to_string(nodes) + " is out of range");
  }
  MapData map;
  map.nodes.reserve(nodes);
  for (uint64_t i = 0; i < nodes; ++i)
  {
    map.nodes.push_back(getNode(&reader));
    map.nodes.back().serial = i;
    taken(&map.nodes.back());
  }
  map.edges.reserve(edges);
  for (uint64_t i = 0; i < edges; ++i)
  {
    map.edges.push_back(getEdge(static_cast<uint32_t>(nodes), &reader));
  }
  const auto patches = version >= GRID_VERSION ? reader.getCount("number of grids", PATCH_BYTES) : 0;
  for (uint64_t i = 0; i < patches; ++i)
  {
    map.patches.push_back(getPatch(&reader));
  }
  if (version >= EARTH_VERSION)
  {
    getEarth(static_cast<uint32_t>(nodes), &map, &reader);
  }
  if (reader.left() != 0)
  {
    reader.refuse(std::to_string(reader.left()) + " bytes are left over");
  }
  return map;
}

void writeMap(const std::string& file, const MapData& map, const StereoCalibration& calibration)
{
  writeFileAtomically(file, [&](std::ostream* stream) { encodeMap(map, calibration, stream); });
}

MapData readMap(const std::string& file, const StereoCalibration& calibration,
                const std::function<void(MapNode*)>& taken)
{
  namespace fs = std::filesystem;
  std::ifstream stream(file, std::ios::binary);
  if (!stream)
  {
    failed(file, "open it");
  }
  std::error_code unknown;
  const uint64_t size = fs::is_regular_file(file, unknown) ? fs::file_size(file, unknown) : MOST_BYTES + 1;
  if (unknown || size > MOST_BYTES)
  {
    throw MapError("map " + file + ": it is no plain file of at most 8 GiB; give the file of a saved map");
  }
  return decodeMap(&stream, size, calibration, file, taken);
}

void writeFileAtomically(const std::string& file, const std::function<void(std::ostream*)>& write)
{
  std::string beside = file + ".XXXXXX";
  pi_node::UniqueFd descriptor(::mkostemp(beside.data(), O_CLOEXEC));
  if (!descriptor)
  {
    failed(file, "write beside it");
  }
  try
  {
    ::fchmod(descriptor.get(), 0644);
    std::ofstream stream(beside, std::ios::binary);
    write(&stream);
    stream.close();
    if (!stream)
    {
      failed(file, "write");
    }
    if (::fsync(descriptor.get()) != 0 || !descriptor.reset())
    {
      failed(file, "bring it to the disk");
    }
    if (std::rename(beside.c_str(), file.c_str()) != 0)
    {
      failed(file, "put it in its place");
    }
  }
  catch (const MapError&)
  {
    ::unlink(beside.c_str());
    throw;
  }
  // The new name must outlive a loss of power, too; not all file systems can do that.
  const std::string folder = std::filesystem::path(file).parent_path().string();
  const pi_node::UniqueFd parent(::open(folder.empty() ? "." : folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (parent)
  {
    ::fsync(parent.get());
  }
}

}  // namespace pi_slam::map
