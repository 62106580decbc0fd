#include <gtest/gtest.h>
#include <pi_node/test_support/message_of.h>
#include <pi_node/test_support/temporary_folder.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <random>
#include <sstream>

#include "map/map_file.h"

namespace
{

using namespace pi_slam;
using pi_node::test_support::messageOf;
using pi_node::test_support::TemporaryFolder;
using namespace pi_slam::map;

std::vector<uint8_t> encodeMap(const MapData& map, const StereoCalibration& calibration)
{
  std::ostringstream stream;
  pi_slam::map::encodeMap(map, calibration, &stream);
  const std::string bytes = stream.str();
  return {bytes.begin(), bytes.end()};
}

MapData decodeMap(const std::vector<uint8_t>& bytes, const StereoCalibration& calibration, const std::string& name)
{
  std::istringstream stream(std::string(bytes.begin(), bytes.end()));
  return pi_slam::map::decodeMap(&stream, bytes.size(), calibration, name, [](MapNode*) {});
}

MapData makeMap()
{
  std::mt19937_64 random(1);
  std::uniform_real_distribution<double> unit(-1.0, 1.0);
  MapData map;
  for (uint32_t i = 0; i < 4; ++i)
  {
    MapNode node;
    node.serial = i;
    node.stamp_ns = 1700000000000000000LL + i;
    node.segment = i / 2;
    node.travelled_m = 0.5 * i;
    node.T_odom_body.linear() = Eigen::Quaterniond::UnitRandom().toRotationMatrix();
    node.T_odom_body.translation() = Eigen::Vector3d(unit(random), unit(random), unit(random));
    node.heading = unit(random);
    node.p_map_body = 100.0 * Eigen::Vector3d(unit(random), unit(random), unit(random));
    if (i != 2)
    {
      auto set = std::make_shared<FeatureSet>();
      set->p_body_camera = Eigen::Vector3f(0.1F, 0.2F, 0.3F);
      for (int k = 0; k < 3; ++k)
      {
        MapFeature feature;
        feature.bearing = Eigen::Vector3d(unit(random), unit(random), unit(random)).normalized().cast<float>();
        feature.inverse_distance = 0.1F * static_cast<float>(k);
        feature.inverse_deviation = 0.01F;
        feature.grey = static_cast<uint8_t>(40 * k);
        feature.level = static_cast<uint8_t>(k);
        set->features.push_back(feature);
      }
      set->descriptors.resize(3 * DESCRIPTOR_BYTES);
      for (uint8_t& byte : set->descriptors)
      {
        byte = static_cast<uint8_t>(random());
      }
      node.features = set;
    }
    map.nodes.push_back(node);
  }
  MapEdge edge;
  edge.from = 0;
  edge.to = 3;
  edge.loop = true;
  edge.shift = Eigen::Vector3d(1.0, 2.0, 3.0);
  edge.turn = 0.25;
  edge.position_deviation = 0.02;
  edge.heading_deviation = 0.004;
  map.edges.push_back(edge);
  GridPatch patch;
  patch.segment = 1;
  patch.travelled_m = 1.5;
  patch.cells = OccupancyCells{{-3.0, 4.0}, 0.1, 3, 2, {-1, 0, 100, 50, 7, -1}};
  map.patches.push_back(patch);
  map.origin = GeoPoint{47.3769, 8.5417, 408.0};
  map.earth = EarthPlace{{12.5, -3.0, 1.5}, 0.75};
  map.fixes.push_back({1, {0.3, -0.2, 1.0}, {14.0, -2.0, 2.5}, 1.5, 3.0});
  return map;
}

/// Length and checksum made right again after a change.
std::vector<uint8_t> sealed(std::vector<uint8_t> bytes)
{
  const uint64_t length = bytes.size();
  std::memcpy(bytes.data() + 16, &length, sizeof(length));
  const uint64_t checksum = crc64(bytes.data(), bytes.size() - 8);
  std::memcpy(bytes.data() + bytes.size() - 8, &checksum, sizeof(checksum));
  return bytes;
}

TEST(MapFile, ChecksumIsThatOfXz)
{
  const std::string text = "123456789";  // check value of CRC-64/XZ
  EXPECT_EQ(0x995DC9BBDF1939FAULL, crc64(reinterpret_cast<const uint8_t*>(text.data()), text.size()));
  EXPECT_EQ(0u, crc64(nullptr, 0));
}

TEST(MapFile, GivesBackWhatWasWritten)
{
  const StereoCalibration calibration = StereoCalibration::makeForwardPair();
  const MapData map = makeMap();
  const MapData back = decodeMap(encodeMap(map, calibration), calibration, "file");
  ASSERT_EQ(map.nodes.size(), back.nodes.size());
  for (size_t i = 0; i < map.nodes.size(); ++i)
  {
    const MapNode& a = map.nodes[i];
    const MapNode& b = back.nodes[i];
    EXPECT_TRUE(b.loaded);
    EXPECT_EQ(a.stamp_ns, b.stamp_ns);
    EXPECT_EQ(a.segment, b.segment);
    EXPECT_EQ(a.travelled_m, b.travelled_m);
    EXPECT_EQ(a.heading, b.heading);
    EXPECT_EQ(a.p_map_body, b.p_map_body);
    EXPECT_TRUE(a.T_odom_body.isApprox(b.T_odom_body, 1e-12));
    ASSERT_EQ(a.features == nullptr, b.features == nullptr);
    if (a.features)
    {
      EXPECT_EQ(a.features->descriptors, b.features->descriptors);
      EXPECT_EQ(a.features->p_body_camera, b.features->p_body_camera);
      for (size_t k = 0; k < a.features->size(); ++k)
      {
        const MapFeature& f = a.features->features[k];
        const MapFeature& g = b.features->features[k];
        EXPECT_EQ(f.bearing, g.bearing);
        EXPECT_EQ(f.inverse_distance, g.inverse_distance);
        EXPECT_EQ(f.inverse_deviation, g.inverse_deviation);
        EXPECT_EQ(f.grey, g.grey);
        EXPECT_EQ(f.level, g.level);
      }
    }
  }
  ASSERT_EQ(1u, back.edges.size());
  EXPECT_EQ(3u, back.edges[0].to);
  EXPECT_TRUE(back.edges[0].loop);
  EXPECT_EQ(map.edges[0].shift, back.edges[0].shift);
  EXPECT_EQ(0.25, back.edges[0].turn);
  ASSERT_EQ(1u, back.patches.size());
  EXPECT_EQ(1u, back.patches[0].segment);
  EXPECT_EQ(1.5, back.patches[0].travelled_m);
  const OccupancyCells grid = back.patches[0].cells.unpack();
  EXPECT_EQ(Eigen::Vector2d(-3.0, 4.0), grid.origin);
  EXPECT_EQ(0.1, grid.cell_m);
  EXPECT_EQ(3, grid.width);
  EXPECT_EQ(2, grid.height);
  EXPECT_EQ((std::vector<int8_t>{-1, 0, 100, 50, 7, -1}), grid.cells);
  ASSERT_TRUE(back.origin && back.earth);
  EXPECT_EQ(8.5417, back.origin->longitude_deg);
  EXPECT_EQ(map.earth->position, back.earth->position);
  EXPECT_EQ(0.75, back.earth->heading);
  ASSERT_EQ(1u, back.fixes.size());
  EXPECT_EQ(1u, back.fixes[0].node);
  EXPECT_EQ(map.fixes[0].shift, back.fixes[0].shift);
  EXPECT_EQ(map.fixes[0].p_local, back.fixes[0].p_local);
  EXPECT_EQ(3.0, back.fixes[0].up_deviation);
}

TEST(MapFile, ReadsOlderVersionsWhichHaveNoGridOrNoPlaceOnEarth)
{
  constexpr std::ptrdiff_t CHECKSUM = 8;
  constexpr std::ptrdiff_t PATCHES = 8;                        // their number
  constexpr std::ptrdiff_t EARTH = 4 + 3 * 8 + 4 + 4 * 8 + 8;  // without fixes
  const StereoCalibration calibration = StereoCalibration::makeForwardPair();
  MapData map = makeMap();
  map.patches.clear();
  map.fixes.clear();
  const std::vector<uint8_t> newest = encodeMap(map, calibration);
  for (const uint8_t version : {1, 2})
  {
    std::vector<uint8_t> bytes = newest;
    bytes.erase(bytes.end() - CHECKSUM - EARTH - (version == 1 ? PATCHES : 0), bytes.end() - CHECKSUM);
    bytes[8] = version;
    const MapData back = decodeMap(sealed(bytes), calibration, "file");
    EXPECT_EQ(map.nodes.size(), back.nodes.size());
    EXPECT_TRUE(back.patches.empty());
    EXPECT_FALSE(back.origin || back.earth);
  }
}

TEST(MapFile, RefusesEveryTruncation)
{
  const StereoCalibration calibration = StereoCalibration::makeForwardPair();
  const std::vector<uint8_t> bytes = encodeMap(makeMap(), calibration);
  for (size_t length = 0; length < bytes.size(); ++length)
  {
    const std::vector<uint8_t> cut(bytes.begin(), bytes.begin() + static_cast<int64_t>(length));
    EXPECT_THROW(decodeMap(cut, calibration, "file"), MapError) << length;
    if (length >= 32)
    {
      // Even with length and checksum made to fit, records end where the file does.
      EXPECT_THROW(decodeMap(sealed(cut), calibration, "file"), MapError) << length;
    }
  }
}

TEST(MapFile, RefusesEveryFlippedBit)
{
  const StereoCalibration calibration = StereoCalibration::makeForwardPair();
  std::vector<uint8_t> bytes = encodeMap(makeMap(), calibration);
  for (size_t bit = 0; bit < 8 * bytes.size(); ++bit)
  {
    bytes[bit / 8] = static_cast<uint8_t>(bytes[bit / 8] ^ 1U << bit % 8);
    EXPECT_THROW(decodeMap(bytes, calibration, "file"), MapError) << bit;
    bytes[bit / 8] = static_cast<uint8_t>(bytes[bit / 8] ^ 1U << bit % 8);
  }
}

TEST(MapFile, SurvivesAnyBytesUnderARightChecksum)
{
  const StereoCalibration calibration = StereoCalibration::makeForwardPair();
  const std::vector<uint8_t> bytes = encodeMap(makeMap(), calibration);
  std::mt19937_64 random(1);
  int refused = 0;
  for (int i = 0; i < 3000; ++i)
  {
    std::vector<uint8_t> changed = bytes;
    for (int k = 0; k < 3; ++k)
    {
      const uint8_t value = k == 0 ? 0xFF : static_cast<uint8_t>(random());
      changed[24 + random() % (changed.size() - 32)] = value;
    }
    try
    {
      const MapData map = decodeMap(sealed(changed), calibration, "file");
      for (const MapNode& node : map.nodes)
      {
        EXPECT_TRUE(node.T_map_body().matrix().allFinite());
      }
      for (const MapEdge& edge : map.edges)
      {
        EXPECT_LT(edge.from, map.nodes.size());
        EXPECT_LT(edge.to, map.nodes.size());
      }
      for (const MapFix& fix : map.fixes)
      {
        EXPECT_LT(fix.node, map.nodes.size());
      }
    }
    catch (const MapError&)
    {
      ++refused;
    }
  }
  EXPECT_GT(refused, 300);  // the others hit descriptors, grey values and the like
}

TEST(MapFile, SaysWhatIsWrong)
{
  const StereoCalibration calibration = StereoCalibration::makeForwardPair();
  std::vector<uint8_t> bytes = encodeMap(makeMap(), calibration);
  const auto decode = [&](const std::vector<uint8_t>& content, const StereoCalibration& cameras)
  { return messageOf<MapError>([&] { decodeMap(content, cameras, "a.map"); }); };
  EXPECT_EQ("map a.map: it was made with a left camera of 640 x 480 px, this one has 752 x 480; make the map anew",
            decode(bytes, StereoCalibration::makeForwardPair(752, 480)));
  std::vector<uint8_t> longer = bytes;
  longer.push_back(0);
  EXPECT_NE(std::string::npos, decode(longer, calibration).find("bytes, should have"));
  bytes[100] ^= 1;
  EXPECT_EQ("map a.map: its checksum is wrong, the file is damaged; make the map anew", decode(bytes, calibration));
  bytes[8] = 9;
  EXPECT_EQ("map a.map: it is of version 9, only 1 to 3 can be read; make the map anew", decode(bytes, calibration));
  bytes[0] = 'X';
  EXPECT_EQ("map a.map: it is no map of this program; make the map anew", decode(bytes, calibration));
}

TEST(MapFile, ReplacesAFileAsAWholeAndLeavesNothingBehind)
{
  const TemporaryFolder folder;
  const std::string file = folder.file("a.map", "old");
  writeFileAtomically(file, [](std::ostream* stream) { *stream << "new"; });
  std::ifstream stream(file);
  EXPECT_EQ("new", std::string(std::istreambuf_iterator<char>(stream), {}));
  size_t files = 0;
  for (const auto& entry : std::filesystem::directory_iterator(folder.path()))
  {
    files += entry.is_regular_file() ? 1 : 0;
  }
  EXPECT_EQ(1u, files);
}

TEST(MapFile, NamesAFileThatCannotBeWrittenOrRead)
{
  const TemporaryFolder folder;
  const std::string missing = folder.path() + "/no/a.map";
  const StereoCalibration calibration = StereoCalibration::makeForwardPair();
  const MapData map = makeMap();
  const auto readingOf = [&](const std::string& file)
  { return messageOf<MapError>([&] { readMap(file, calibration, [](MapNode*) {}); }); };
  EXPECT_NE(std::string::npos, messageOf<MapError>([&] { writeMap(missing, map, calibration); }).find(missing));
  EXPECT_NE(std::string::npos, readingOf(missing).find("No such file"));
  EXPECT_NE(std::string::npos, readingOf(folder.path()).find("no plain file"));
  // A folder in the file's place: what was written beside it goes away again.
  EXPECT_THROW(writeMap(folder.path(), map, calibration), MapError);
  writeMap(folder.path() + "/a.map", map, calibration);
  EXPECT_EQ("", readingOf(folder.path() + "/a.map"));
}

}  // namespace
