#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "map/earth.h"
#include "map/mapper.h"
#include "map/pose_graph.h"
#include "map/redundancy.h"

namespace
{

using namespace pi_slam;
using namespace pi_slam::map;

const GeoPoint ZURICH = {47.3769, 8.5417, 408.0};

Eigen::Vector3d turned(double angle, const Eigen::Vector3d& v)
{
  return Eigen::AngleAxisd(angle, Eigen::Vector3d::UnitZ()) * v;
}

/// A drive whose odometry drifts, with GNSS that has 1.5 m of noise, and is 20 to 60 m off in one of ten fixes.
class DriveWithGnss
{
public:
  static constexpr double NODE_M = 0.5;
  static constexpr double FIX_M = 3.0;
  static constexpr double HEADING = 0.8;  ///< of map on earth [rad]

  explicit DriveWithGnss(double length_m, bool outliers = true, uint64_t seed = 5) : random_(seed)
  {
    map.origin = ZURICH;
    double direction = 0.0;
    double odom_heading = 0.0;  // of the drifting odometry in map
    Eigen::Vector3d p = Eigen::Vector3d::Zero();
    Eigen::Vector3d p_odom = Eigen::Vector3d::Zero();
    const auto count = static_cast<uint32_t>(length_m / NODE_M);
    for (uint32_t i = 0; i < count; ++i)
    {
      MapNode node;
      node.serial = i;
      node.travelled_m = NODE_M * i;
      node.T_odom_body.translation() = p_odom;
      node.p_map_body = p_odom;  // nothing corrects it
      map.nodes.push_back(node);
      truth.push_back(p);
      if (i > 0)
      {
        MapEdge edge;
        edge.from = i - 1;
        edge.to = i;
        edge.shift = p_odom - map.nodes[i - 1].T_odom_body.translation();
        edge.position_deviation = DRIFT_POSITION * std::sqrt(NODE_M);
        edge.heading_deviation = DRIFT_HEADING * std::sqrt(NODE_M);
        map.edges.push_back(edge);
      }
      if (i % static_cast<uint32_t>(FIX_M / NODE_M) == 0)
      {
        addFix(i, outliers);
      }
      direction = 1.2 * std::sin(NODE_M * i / 130.0);
      const Eigen::Vector3d step = NODE_M * Eigen::Vector3d(std::cos(direction), std::sin(direction), 0.0);
      odom_heading += 0.0015 * normal_(random_);
      p += step;
      p_odom += 1.004 * turned(odom_heading, step);
    }
  }

  Eigen::Vector3d onEarth(const Eigen::Vector3d& p) const
  {
    return turned(HEADING, p) + Eigen::Vector3d(3.0, -7.0, 2.0);
  }

  /// RMS of the places of all nodes on the plane [m].
  double off() const
  {
    double sum = 0.0;
    for (size_t i = 0; i < truth.size(); ++i)
    {
      sum += (map.earth->T_local_map() * map.nodes[i].p_map_body - onEarth(truth[i])).head<2>().squaredNorm();
    }
    return std::sqrt(sum / static_cast<double>(truth.size()));
  }

  MapData map;
  std::vector<Eigen::Vector3d> truth;  ///< of the nodes

private:
  void addFix(uint32_t node, bool outliers)
  {
    MapFix fix;
    fix.node = node;
    fix.shift = Eigen::Vector3d(0.2, -0.1, 1.2);  // the antenna
    fix.p_local = onEarth(truth[node] + fix.shift) +
                  1.5 * Eigen::Vector3d{normal_(random_), normal_(random_), 2.0 * normal_(random_)};
    if (outliers && uniform_(random_) < 0.1)
    {
      const double direction = 2.0 * M_PI * uniform_(random_);
      fix.p_local += turned(direction, {20.0 + 40.0 * uniform_(random_), 0.0, 10.0});
    }
    fix.deviation = 3.0;
    fix.up_deviation = 6.0;
    map.fixes.push_back(fix);
  }

  std::mt19937_64 random_;
  std::normal_distribution<double> normal_;
  std::uniform_real_distribution<double> uniform_;
};

TEST(LocalFrame, KnowsEastNorthAndUp)
{
  const LocalFrame frame(ZURICH);
  EXPECT_LT(frame.toLocal(ZURICH).norm(), 1e-6);
  const Eigen::Vector3d east = frame.toLocal({47.3769, 8.5417 + 1e-3, 408.0});
  EXPECT_NEAR(75.5, east.x(), 0.3);
  EXPECT_NEAR(0.0, east.y(), 0.01);
  const Eigen::Vector3d north = frame.toLocal({47.3769 + 1e-3, 8.5417, 408.0});
  EXPECT_NEAR(111.2, north.y(), 0.3);
  const GeoPoint back = frame.toGeo({100.0, -200.0, 30.0});
  EXPECT_LT((frame.toLocal(back) - Eigen::Vector3d(100.0, -200.0, 30.0)).norm(), 1e-6);
  const Eigen::Isometry3d T_earth_local = frame.T_earth_local();
  EXPECT_NEAR(6.367e6, T_earth_local.translation().norm(), 2e4);
  EXPECT_GT(T_earth_local.translation().normalized().dot(T_earth_local.linear().col(2)), 0.999) << "up";
  EXPECT_NEAR(0.0, T_earth_local.linear()(2, 0), 1e-12) << "east is level";
  EXPECT_FALSE((GeoPoint{91.0, 0.0, 0.0}).isValid());
  EXPECT_FALSE((GeoPoint{NAN, 0.0, 0.0}).isValid());
}

TEST(EarthPlace, IsFoundAmongWrongFixesWhenTheWayTellsTheHeading)
{
  const DriveWithGnss drive(120.0);
  const std::optional<EarthPlace> place = locateOnEarth(drive.map);
  ASSERT_TRUE(place);
  EXPECT_NEAR(DriveWithGnss::HEADING, std::remainder(place->heading, 2.0 * M_PI), 0.1);
  EXPECT_FALSE(locateOnEarth(DriveWithGnss(15.0).map)) << "five fixes";
  DriveWithGnss standing(120.0);
  for (MapNode& node : standing.map.nodes)
  {
    node.p_map_body.setZero();
  }
  EXPECT_FALSE(locateOnEarth(standing.map)) << "a vehicle that stands has no heading";
}

TEST(PoseGraph, IsPlacedOnEarthByFixesOfWhichSomeAreWrong)
{
  DriveWithGnss drive(1800.0);
  MapData without = drive.map;
  without.fixes.clear();
  ASSERT_TRUE(optimizePoseGraph(&without));
  EXPECT_FALSE(without.earth);
  double moved = 0.0;
  for (size_t i = 0; i < without.nodes.size(); ++i)
  {
    moved = std::max(moved, (without.nodes[i].p_map_body - drive.map.nodes[i].p_map_body).norm());
  }
  EXPECT_LT(moved, 1e-6) << "nothing to correct by";
  constexpr int DRIVES = 20;
  double drifted = 0.0;
  double off = 0.0;
  for (uint64_t seed = 1; seed <= DRIVES; ++seed)
  {
    drive = DriveWithGnss(1800.0, true, seed);
    drifted += (drive.map.nodes.back().p_map_body - drive.truth.back()).squaredNorm() / DRIVES;
    ASSERT_TRUE(optimizePoseGraph(&drive.map));
    ASSERT_TRUE(drive.map.earth);
    EXPECT_LT(drive.off(), 0.6) << "seed " << seed;
    off += drive.off() * drive.off() / DRIVES;
  }
  EXPECT_GT(std::sqrt(drifted), 7.0);
  EXPECT_LT(std::sqrt(off), 0.5);
  RecordProperty("off_mm", static_cast<int>(1e3 * std::sqrt(off)));
  std::cout << "after 1800 m, RMS of " << DRIVES << " drives: " << std::sqrt(drifted) << " m of drift, "
            << std::sqrt(off) << " m off on earth\n";
}

TEST(PoseGraph, KeepsFixesWhenNodesAreTakenOut)
{
  DriveWithGnss drive(300.0, false);
  MapData thinned = drive.map;
  ASSERT_TRUE(thinOut(&thinned, 200));
  ASSERT_EQ(drive.map.fixes.size(), thinned.fixes.size());
  for (size_t i = 0; i < thinned.fixes.size(); ++i)
  {
    const auto antenna = [](const MapData& map, const MapFix& fix)
    { return Eigen::Vector3d(map.nodes[fix.node].p_map_body + turned(map.nodes[fix.node].heading, fix.shift)); };
    ASSERT_LT(thinned.fixes[i].node, thinned.nodes.size());
    EXPECT_LT((antenna(thinned, thinned.fixes[i]) - antenna(drive.map, drive.map.fixes[i])).norm(), 1e-6);
  }
}

/// Frames without pictures: the map is the way alone.
TEST(Mapper, GetsItsPlaceOnEarth)
{
  MapperOptions options;
  options.threaded = false;
  options.loop_closure = false;
  Mapper mapper(StereoCalibration::makeForwardPair(), options);
  std::mt19937_64 random(7);
  std::normal_distribution<double> normal;
  const LocalFrame local(ZURICH);
  const auto poseAt = [](double time_s)
  {
    Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
    const double angle = 3.0 * time_s / 40.0;  // a circle of 40 m
    T.linear() = Eigen::AngleAxisd(angle, Eigen::Vector3d::UnitZ()).toRotationMatrix();
    T.translation() = 40.0 * Eigen::Vector3d(std::sin(angle), 1.0 - std::cos(angle), 0.0);
    return T;
  };
  const EarthPlace truth{{100.0, 50.0, 3.0}, -1.1};
  bool known_early = false;
  for (int i = 0; i < 1600; ++i)
  {
    const double time_s = 0.05 * i;
    if (i % 20 == 10)
    {
      GnssFix fix;
      fix.stamp_ns = 1000000000 + std::llround(1e9 * (time_s - 0.02));
      fix.deviation = 3.0;
      fix.up_deviation = 3.0;
      fix.p_body_antenna = Eigen::Vector3d(-0.5, 0.3, 1.0);
      fix.antenna = local.toGeo(truth.T_local_map() * (poseAt(time_s - 0.02) * fix.p_body_antenna) +
                                1.5 * Eigen::Vector3d{normal(random), normal(random), normal(random)});
      mapper.addFix(fix);
    }
    MapFrame frame;
    frame.stamp_ns = 1000000000 + std::llround(1e9 * time_s);
    frame.T_odom_body = poseAt(time_s);
    mapper.add(frame);
    known_early = known_early || (time_s < 5.0 && mapper.statistics().on_earth);
  }
  EXPECT_FALSE(known_early);
  const MapStatistics statistics = mapper.statistics();
  EXPECT_GT(statistics.fixes, 70u);
  ASSERT_TRUE(statistics.on_earth);
  const Eigen::Isometry3d T_earth_map = local.T_earth_local() * truth.T_local_map();
  EXPECT_LT((statistics.on_earth->T_earth_map.translation() - T_earth_map.translation()).norm(), 1.2);
  EXPECT_NEAR(truth.heading, std::remainder(statistics.on_earth->heading_rad, 2.0 * M_PI), 0.03);
  GnssFix wrong;
  wrong.antenna = ZURICH;
  wrong.deviation = 0.0;
  EXPECT_THROW(mapper.addFix(wrong), std::invalid_argument);
}

}  // namespace
