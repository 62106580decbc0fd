#include <gtest/gtest.h>
#include <pi_node/test_support/message_of.h>
#include <pi_node/test_support/temporary_folder.h>
#include <pi_runtime/runtime.h>
#include <pi_slam/trajectory_file.h>
#include "drives/vehicle_path.h"
#include "map/mapper.h"
#include "renderer/stereo_renderer.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <map>
#include <opencv2/imgcodecs.hpp>

namespace
{

using namespace pi_simulation;
using namespace pi_slam;
using pi_node::test_support::messageOf;
using pi_node::test_support::TemporaryFolder;

constexpr int64_t SECOND_ROUND_NS = 1000000000000LL;

MapperOptions testOptions()
{
  MapperOptions options;
  options.threaded = false;
  return options;
}

Eigen::Isometry3d turnZ(double angle_deg)
{
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = Eigen::AngleAxisd(angle_deg * M_PI / 180.0, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  return T;
}

/// 12 m of a street in steps of 0.6 m, rendered once.
class Street : public ::testing::Test
{
protected:
  static void SetUpTestSuite()
  {
    VehiclePathOptions path;
    path.shape = PathShape::STRAIGHT;
    path.duration_s = 12.0;
    const std::vector<StampedPose> drive = makeVehiclePath(path);
    SyntheticWorldOptions options;
    options.crossing = false;
    options.road = pathLine(path.shape, 40.0);
    calibration_ = StereoCalibration::makeForwardPair();
    StereoRendererOptions renderer_options;
    renderer_options.threads = 2;
    SyntheticWorldOptions later = options;
    later.parked = false;
    StereoRendererOptions dim = renderer_options;
    dim.brightness *= 0.5;
    later_ = std::make_unique<StereoRenderer>(SyntheticWorld::build(later, drive), calibration_, dim);
    renderer_ = std::make_unique<StereoRenderer>(SyntheticWorld::build(options, drive), calibration_, renderer_options);
    start_ = drive.front().T_world_body;
    for (int i = 0; i <= 20; ++i)
    {
      frames_.push_back(shoot(0.6 * i, 0.0, 0.0));
    }
  }
  static void TearDownTestSuite()
  {
    frames_.clear();
    renderer_.reset();
    later_.reset();
  }

  /// A frame whose odometry is the truth; the map's origin is the start of the drive.
  static MapFrame shoot(double along_m, double side_m, double turn_deg, StereoRenderer* renderer = renderer_.get())
  {
    Eigen::Isometry3d T = start_;
    T.translation() += Eigen::Vector3d(along_m, side_m, 0.0);
    T = T * turnZ(turn_deg);
    const StereoFrame pictures = renderer->render(T, 1700000000000000000LL);
    MapFrame frame;
    frame.stamp_ns = 1000000 * static_cast<int64_t>(1000.0 * along_m + 1.0);
    frame.T_odom_body = T;
    frame.T_odom_body.translation() -= start_.translation();
    frame.left = pictures.left;
    frame.right = pictures.right;
    return frame;
  }
  /// The same picture, with odometry that began elsewhere: T_odom_map.
  static MapFrame seenBy(MapFrame frame, const Eigen::Isometry3d& T_odom_map)
  {
    frame.T_odom_body = T_odom_map * frame.T_odom_body;
    frame.stamp_ns += SECOND_ROUND_NS;
    return frame;
  }
  static void drive(Mapper* mapper, const Eigen::Isometry3d& T_odom_map = Eigen::Isometry3d::Identity())
  {
    for (const MapFrame& frame : frames_)
    {
      mapper->add(seenBy(frame, T_odom_map));
    }
  }

  static StereoCalibration calibration_;
  static std::unique_ptr<StereoRenderer> renderer_;
  static std::unique_ptr<StereoRenderer> later_;  ///< all that was parked has left, half the light
  static Eigen::Isometry3d start_;
  static std::vector<MapFrame> frames_;
};

StereoCalibration Street::calibration_;
std::unique_ptr<StereoRenderer> Street::renderer_;
std::unique_ptr<StereoRenderer> Street::later_;
Eigen::Isometry3d Street::start_;
std::vector<MapFrame> Street::frames_;

TEST(MapperOptions, NamesFieldValueAndBound)
{
  MapperOptions options;
  options.validate();
  options.min_inliers = 3;
  EXPECT_EQ("map/min_inliers = 3, must be in [8, 1000]", messageOf<std::invalid_argument>([&] { options.validate(); }));
  options = MapperOptions();
  options.voxel_m = std::nan("");
  EXPECT_THROW(options.validate(), std::invalid_argument);
  options = MapperOptions();
  options.max_keyframes = 9;
  EXPECT_THROW(Mapper(StereoCalibration::makeForwardPair(), options), std::invalid_argument);
  options = MapperOptions();
  options.kernel_tasks = true;
  EXPECT_NE("", messageOf<std::invalid_argument>([&] { Mapper(StereoCalibration::makeForwardPair(), options); }));
}

TEST_F(Street, RefusesFramesThatAreNone)
{
  Mapper mapper(calibration_, testOptions());
  MapFrame frame = frames_[0];
  frame.T_odom_body.translation().x() = std::nan("");
  EXPECT_NE(std::string::npos, messageOf<std::invalid_argument>([&] { mapper.add(frame); }).find("T_odom_body"));
  frame = frames_[0];
  frame.left = frame.left.colRange(0, 600);
  EXPECT_NE(std::string::npos, messageOf<std::invalid_argument>([&] { mapper.add(frame); }).find("600 x 480"));
  frame = frames_[0];
  frame.right = cv::Mat(480, 640, CV_8UC3);
  EXPECT_THROW(mapper.add(frame), std::invalid_argument);
  frame = frames_[0];
  frame.left.release();
  frame.right.release();
  mapper.add(frame);  // cameras that give nothing are no mistake of the caller's
  EXPECT_EQ(0u, mapper.statistics().keyframes);
  EXPECT_EQ(1u, mapper.path().size());
}

TEST_F(Street, AddsKeyframesOnTheWayAndNoneAtRest)
{
  Mapper mapper(calibration_, testOptions());
  EXPECT_TRUE(mapper.cloud().empty());
  EXPECT_TRUE(mapper.path().empty());
  EXPECT_THROW(mapper.save("/nowhere/a.map"), MapError);
  drive(&mapper);
  const MapStatistics once = mapper.statistics();
  EXPECT_EQ(frames_.size(), once.keyframes);
  EXPECT_GT(once.landmarks, 100 * once.keyframes);
  EXPECT_TRUE(once.localized);
  EXPECT_FALSE(once.loaded);
  EXPECT_TRUE(mapper.T_map_odom().isApprox(Eigen::Isometry3d::Identity()));
  for (int i = 0; i < 5; ++i)
  {
    mapper.add(frames_.back());
  }
  EXPECT_EQ(once.keyframes, mapper.statistics().keyframes);
  EXPECT_EQ(frames_.size(), mapper.path().size());
}

TEST_F(Street, CorrectsOdometryThatDriftedAndAddsNothingOnKnownGround)
{
  Mapper mapper(calibration_, testOptions());
  for (const MapFrame& frame : frames_)
  {
    mapper.add(frame);
  }
  const size_t keyframes = mapper.statistics().keyframes;
  // Back to the start (12 m unseen), and along the street again, with 0.4 m and 1.5 degrees of drift by then.
  const Eigen::Isometry3d drift = Eigen::Translation3d(0.3, -0.25, 0.05) * turnZ(1.5);
  drive(&mapper, drift);
  const MapStatistics twice = mapper.statistics();
  EXPECT_GE(twice.loops, 10u);
  EXPECT_LE(twice.keyframes, keyframes + 3);
  // Both rounds lie on each other. Where the drift came from nobody knows: half of the way was seen, and bends, too.
  std::map<int64_t, Eigen::Isometry3d> poses;
  for (const auto& pose : mapper.path())
  {
    poses.insert(pose);
  }
  for (const MapFrame& frame : frames_)
  {
    const Eigen::Isometry3d& first = poses.at(frame.stamp_ns);
    const Eigen::Isometry3d& second = poses.at(frame.stamp_ns + SECOND_ROUND_NS);
    EXPECT_LT((first.translation() - second.translation()).norm(), 0.05) << frame.stamp_ns;
    EXPECT_LT(Eigen::AngleAxisd(first.linear().transpose() * second.linear()).angle(), 0.005) << frame.stamp_ns;
  }
  const Eigen::Isometry3d now = mapper.T_map_odom() * drift * frames_.back().T_odom_body;
  EXPECT_LT((now.translation() - poses.at(frames_.back().stamp_ns).translation()).norm(), 0.05);
}

TEST_F(Street, JoinsWhatCameAfterAResetByAKnownPlaceOnly)
{
  Mapper mapper(calibration_, testOptions());
  drive(&mapper);
  mapper.odometryReset();
  const Eigen::Isometry3d T_odom_map = Eigen::Translation3d(-70.0, 30.0, 2.0) * turnZ(130.0);
  for (size_t i = 4; i < 9; ++i)
  {
    mapper.add(seenBy(frames_[i], T_odom_map));
  }
  EXPECT_GE(mapper.statistics().loops, 1u);
  const Eigen::Isometry3d error = mapper.T_map_odom() * T_odom_map;
  const Eigen::Vector3d p = frames_[8].T_odom_body.translation();
  EXPECT_LT((error * p - p).norm(), 0.08);
  for (const auto& pose : mapper.path())
  {
    EXPECT_LT(pose.second.translation().norm(), 13.0);  // all of it is in the street
  }
}

TEST_F(Street, StartsLocalizedInALoadedMapFromAnotherHeading)
{
  const TemporaryFolder folder;
  const std::string file = folder.path() + "/street.map";
  {
    Mapper mapper(calibration_, testOptions());
    drive(&mapper);
    mapper.save(file);
  }
  Mapper mapper(calibration_, testOptions());
  mapper.load(file);
  MapStatistics statistics = mapper.statistics();
  EXPECT_TRUE(statistics.loaded);
  EXPECT_FALSE(statistics.localized);
  EXPECT_EQ(frames_.size(), statistics.keyframes);
  EXPECT_TRUE(mapper.path().empty());
  const Eigen::Isometry3d T_odom_map = Eigen::Translation3d(5.0, 5.0, 0.0) * turnZ(-100.0);
  MapFrame dark = seenBy(frames_[8], T_odom_map);
  dark.left = cv::Mat(480, 640, CV_8UC1, cv::Scalar(0));
  mapper.add(dark);
  EXPECT_FALSE(mapper.statistics().localized);
  EXPECT_TRUE(mapper.path().empty());  // nothing is added before
  for (int i = 0; i < 5 && !mapper.statistics().localized; ++i)
  {
    const MapFrame frame = seenBy(shoot(5.1 + 0.2 * i, 0.4, 38.0), T_odom_map);
    mapper.add(frame);
  }
  statistics = mapper.statistics();
  ASSERT_TRUE(statistics.localized);
  const Eigen::Isometry3d error = mapper.T_map_odom() * T_odom_map;
  const Eigen::Vector3d p(5.5, 0.4, 0.0);
  EXPECT_LT((error * p - p).norm(), 0.1);
  EXPECT_LT(Eigen::AngleAxisd(error.linear()).angle(), 0.01);
  EXPECT_GE(mapper.path().size(), 1u);
}

TEST_F(Street, IsRecognisedAfterAChangeFromAnotherPlaceAndInHalfTheLight)
{
  const TemporaryFolder folder;
  const std::string file = folder.path() + "/street.map";
  {
    Mapper mapper(calibration_, testOptions());
    drive(&mapper);
    mapper.save(file);
  }
  const Eigen::Isometry3d T_odom_map = Eigen::Translation3d(5.0, 5.0, 0.0) * turnZ(-100.0);
  for (const double side : {1.0, -1.0})
  {
    Mapper mapper(calibration_, testOptions());
    mapper.load(file);
    Eigen::Vector3d p = Eigen::Vector3d::Zero();
    for (int i = 0; i < 8 && !mapper.statistics().localized; ++i)
    {
      const MapFrame frame = shoot(4.0 + 0.3 * i, 1.5 * side, -30.0 * side, later_.get());
      p = frame.T_odom_body.translation();
      mapper.add(seenBy(frame, T_odom_map));
    }
    ASSERT_TRUE(mapper.statistics().localized) << side;
    EXPECT_LT((mapper.T_map_odom() * T_odom_map * p - p).norm(), 0.4);
  }
}

TEST_F(Street, IsPutWhereItIsSaidToBeAndTakesItsMapAlong)
{
  Mapper mapper(calibration_, testOptions());
  const Eigen::Isometry3d T_map_world = Eigen::Translation3d(40.0, -25.0, 0.6) * turnZ(115.0);
  const auto expectThere = [&](size_t frames)
  {
    // Roll and pitch of what is said do not count: odometry knows gravity.
    EXPECT_LT((mapper.T_map_odom().matrix() - T_map_world.matrix()).norm(), 1e-9);
    const auto path = mapper.path();
    ASSERT_EQ(frames, path.size());
    for (size_t i = 0; i < path.size(); ++i)
    {
      EXPECT_LT((path[i].second.matrix() - (T_map_world * frames_[i].T_odom_body).matrix()).norm(), 1e-9) << i;
    }
  };
  const Eigen::Isometry3d tilt(Eigen::AngleAxisd(0.05, Eigen::Vector3d::UnitX()));
  mapper.setPose(frames_[0].T_odom_body, T_map_world * frames_[0].T_odom_body);  // before the first frame
  expectThere(0);
  for (size_t i = 0; i < 10; ++i)
  {
    mapper.add(frames_[i]);
  }
  expectThere(10);
  mapper.setPose(frames_[9].T_odom_body, frames_[3].T_odom_body * tilt);  // elsewhere, and back
  EXPECT_LT(
      ((mapper.T_map_odom() * frames_[9].T_odom_body).translation() - frames_[3].T_odom_body.translation()).norm(),
      1e-9);
  mapper.setPose(frames_[9].T_odom_body, T_map_world * frames_[9].T_odom_body);
  for (size_t i = 10; i < frames_.size(); ++i)
  {
    mapper.add(frames_[i]);
  }
  expectThere(frames_.size());
  EXPECT_EQ(frames_.size(), mapper.statistics().keyframes);
  for (const MapPoint& point : mapper.cloud())
  {
    ASSERT_LT((T_map_world.inverse() * point.p_map.cast<double>()).norm(), 60.0);
  }

  // A second round that drifted is corrected as if nobody had said anything.
  const Eigen::Isometry3d drift = Eigen::Translation3d(0.3, -0.25, 0.05) * turnZ(1.5);
  drive(&mapper, drift);
  EXPECT_GE(mapper.statistics().loops, 10u);
  std::map<int64_t, Eigen::Isometry3d> poses;
  for (const auto& pose : mapper.path())
  {
    poses.insert(pose);
  }
  for (const MapFrame& frame : frames_)
  {
    EXPECT_LT(
        (poses.at(frame.stamp_ns).translation() - poses.at(frame.stamp_ns + SECOND_ROUND_NS).translation()).norm(),
        0.05);
  }
  EXPECT_LT((poses.at(frames_[0].stamp_ns).translation() - T_map_world.translation()).norm(), 1.0);

  const Eigen::Isometry3d before = mapper.T_map_odom();
  Eigen::Isometry3d none = before;
  none.translation().x() = std::nan("");
  EXPECT_THROW(mapper.setPose(frames_[0].T_odom_body, none), std::invalid_argument);
  none = before;
  none.linear().setZero();
  EXPECT_THROW(mapper.setPose(none, frames_[0].T_odom_body), std::invalid_argument);
  EXPECT_EQ(before.matrix(), mapper.T_map_odom().matrix());
}

TEST_F(Street, IsPutSomewhereAfterAResetWithoutTheWayBefore)
{
  Mapper mapper(calibration_, testOptions());
  for (size_t i = 0; i < 12; ++i)
  {
    mapper.add(frames_[i]);
  }
  mapper.odometryReset();
  // Odometry begins at its origin; the body is said to be 0.15 m beside of where it is.
  const Eigen::Isometry3d T_odom_map = frames_[6].T_odom_body.inverse();
  const Eigen::Isometry3d said = Eigen::Translation3d(0.1, 0.1, 0.0) * frames_[6].T_odom_body;
  mapper.setPose(T_odom_map * frames_[6].T_odom_body, said);
  EXPECT_LT((mapper.T_map_odom().translation() - said.translation()).norm(), 1e-9);
  const auto path = mapper.path();
  ASSERT_EQ(12u, path.size());
  EXPECT_LT((path[11].second.matrix() - frames_[11].T_odom_body.matrix()).norm(), 1e-9);  // the old way stays
  for (size_t i = 6; i < 12; ++i)
  {
    mapper.add(seenBy(frames_[i], T_odom_map));
  }
  EXPECT_GE(mapper.statistics().loops, 1u);  // recognised places know better
  const Eigen::Vector3d p = frames_[11].T_odom_body.translation();
  EXPECT_LT((mapper.T_map_odom() * T_odom_map * p - p).norm(), 0.05);
}

TEST_F(Street, RecognisedPlacesOfAFileOverrideWhatIsSaid)
{
  const TemporaryFolder folder;
  const std::string file = folder.path() + "/street.map";
  {
    Mapper mapper(calibration_, testOptions());
    drive(&mapper);
    mapper.save(file);
  }
  Mapper mapper(calibration_, testOptions());
  mapper.load(file);
  const Eigen::Isometry3d T_odom_map = Eigen::Translation3d(5.0, 5.0, 0.0) * turnZ(-100.0);
  const Eigen::Isometry3d wrong = Eigen::Translation3d(7.0, 3.0, 0.0) * turnZ(20.0);
  const auto say = [&](size_t i) { mapper.setPose(T_odom_map * frames_[i].T_odom_body, wrong); };
  const auto expectThere = [&](size_t i)
  {
    const Eigen::Vector3d p = frames_[i].T_odom_body.translation();
    EXPECT_LT((mapper.T_map_odom() * T_odom_map * p - p).norm(), 0.1);
    EXPECT_TRUE(mapper.statistics().localized);
  };
  say(8);
  EXPECT_FALSE(mapper.statistics().localized);
  EXPECT_LT(((mapper.T_map_odom() * T_odom_map * frames_[8].T_odom_body).translation() - wrong.translation()).norm(),
            1e-9);
  size_t i = 8;
  for (; i < 14 && !mapper.statistics().localized; ++i)
  {
    mapper.add(seenBy(frames_[i], T_odom_map));
  }
  expectThere(i - 1);
  // Localised: the map of the file stays where it is, and is recognised again.
  mapper.add(seenBy(frames_[i], T_odom_map));
  say(i);
  EXPECT_FALSE(mapper.statistics().localized);
  const size_t said_at = i;
  for (++i; i < 20 && !mapper.statistics().localized; ++i)
  {
    mapper.add(seenBy(frames_[i], T_odom_map));
  }
  expectThere(i - 1);
  EXPECT_GT(i, said_at + 1);
}

TEST_F(Street, KeepsItsMapIfAFileCannotBeLoaded)
{
  const TemporaryFolder folder;
  Mapper mapper(calibration_, testOptions());
  mapper.add(frames_[0]);
  mapper.add(frames_[3]);
  const std::string file = folder.path() + "/a.map";
  mapper.save(file);
  std::string content;
  {
    std::ifstream stream(file, std::ios::binary);
    content.assign(std::istreambuf_iterator<char>(stream), std::istreambuf_iterator<char>());
  }
  content[content.size() / 2] = static_cast<char>(content[content.size() / 2] ^ 4);
  EXPECT_THROW(mapper.load(folder.file("damaged.map", content)), MapError);
  EXPECT_THROW(mapper.load(folder.file("short.map", content.substr(0, 1000))), MapError);
  EXPECT_THROW(mapper.load(folder.path() + "/missing.map"), MapError);
  EXPECT_EQ(2u, mapper.statistics().keyframes);
  EXPECT_FALSE(mapper.statistics().loaded);
  Mapper other(StereoCalibration::makeForwardPair(752, 480), testOptions());
  EXPECT_THROW(other.load(file), MapError);
}

TEST_F(Street, StaysWithinItsBound)
{
  MapperOptions options = testOptions();
  options.max_keyframes = 10;
  Mapper mapper(calibration_, options);
  for (const MapFrame& frame : frames_)
  {
    mapper.add(frame);
    EXPECT_LE(mapper.statistics().keyframes, 10u);
  }
  EXPECT_GE(mapper.statistics().keyframes, 9u);
  EXPECT_LE(mapper.path().size(), frames_.size());
}

TEST_F(Street, KeepsOnDiskWhatGoesBeyondItsBound)
{
  const TemporaryFolder folder;
  MapperOptions options = testOptions();
  options.max_keyframes = 25;
  options.tile_folder = folder.path();
  options.loop_closure = false;  // the way between both places is none that can be driven
  std::vector<MapFrame> far;     // the street looked at backwards, as another one 200 m away
  for (int i = 0; i <= 20; ++i)
  {
    far.push_back(shoot(0.6 * i, 0.0, 175.0));
    far.back().T_odom_body.translation().x() += 200.0;
  }
  const std::string file = folder.path() + "/two_streets.map";
  {
    Mapper mapper(calibration_, options);
    for (const std::vector<MapFrame>* frames : {&frames_, &far})
    {
      for (const MapFrame& frame : *frames)
      {
        mapper.add(frame);
        EXPECT_LE(mapper.statistics().keyframes_in_memory, 25u);
      }
    }
    const MapStatistics statistics = mapper.statistics();
    EXPECT_EQ(42u, statistics.keyframes);
    EXPECT_GT(statistics.bytes_on_disk, 15u * 5000u);
    EXPECT_EQ("", statistics.disk_defect);
    mapper.save(file);
  }
  // Any place of it is found, though not all of them fit into memory.
  const Eigen::Isometry3d T_odom_map = Eigen::Translation3d(5.0, 5.0, 0.0) * turnZ(-100.0);
  for (const MapFrame& place : {frames_[2], frames_[18], far[4], far[16]})
  {
    Mapper mapper(calibration_, options);
    mapper.load(file);
    EXPECT_EQ(42u, mapper.statistics().keyframes);
    EXPECT_LE(mapper.statistics().keyframes_in_memory, 25u);
    for (int attempt = 0; attempt < 40 && !mapper.statistics().localized; ++attempt)
    {
      MapFrame frame = seenBy(place, T_odom_map);
      frame.stamp_ns += 400000000LL * attempt;  // at rest
      mapper.add(frame);
    }
    ASSERT_TRUE(mapper.statistics().localized);
    const Eigen::Vector3d p = place.T_odom_body.translation();
    EXPECT_LT((mapper.T_map_odom() * T_odom_map * p - p).norm(), 0.1);
  }
}

TEST(MapperOptions, NamesAFolderOfTilesThatIsMissing)
{
  MapperOptions options;
  options.tile_folder = "/nowhere";
  EXPECT_EQ("map/tile_folder = \"/nowhere\", must be a folder that exists, or empty",
            messageOf<std::invalid_argument>([&] { options.validate(); }));
}

TEST_F(Street, JoinsASecondDriveThatBeganElsewhereToTheMapOfAFile)
{
  const TemporaryFolder folder;
  const std::string file = folder.path() + "/street.map";
  {
    Mapper mapper(calibration_, testOptions());
    for (size_t i = 12; i < frames_.size(); ++i)
    {
      mapper.add(frames_[i]);
    }
    mapper.save(file);
  }
  const Eigen::Isometry3d T_odom_map = Eigen::Translation3d(5.0, 5.0, 0.0) * turnZ(-100.0);
  Mapper mapper(calibration_, testOptions());
  mapper.load(file);
  const size_t known = mapper.statistics().keyframes;
  mapper.add(seenBy(frames_[0], T_odom_map));
  EXPECT_FALSE(mapper.statistics().localized);
  EXPECT_TRUE(mapper.path().empty());  // where it lies in the map nobody knows yet
  EXPECT_TRUE(mapper.cloud().size() > 0);
  mapper.save(file);
  {
    Mapper unchanged(calibration_, testOptions());
    unchanged.load(file);
    EXPECT_EQ(known, unchanged.statistics().keyframes) << "what is not joined must not go into the file";
  }
  drive(&mapper, T_odom_map);
  EXPECT_TRUE(mapper.statistics().localized);
  EXPECT_GE(mapper.statistics().keyframes, known + 8);
  for (const auto& [stamp_ns, T_map_body] : mapper.path())
  {
    const auto frame = std::find_if(frames_.begin(), frames_.end(),
                                    [stamp = stamp_ns](const MapFrame& candidate)
                                    { return candidate.stamp_ns + SECOND_ROUND_NS == stamp; });
    ASSERT_NE(frames_.end(), frame);
    EXPECT_LT((T_map_body.translation() - frame->T_odom_body.translation()).norm(), 0.15);
  }
  // A third drive is recognised where only the second one was.
  mapper.save(file);
  Mapper third(calibration_, testOptions());
  third.load(file);
  for (size_t i = 2; i < 6; ++i)
  {
    third.add(seenBy(frames_[i], T_odom_map));
  }
  EXPECT_TRUE(third.statistics().localized);
}

TEST_F(Street, GrowsWithTheGroundAndNotWithTheTimeOnIt)
{
  constexpr size_t PLAIN_NODES = 100;  // without features, that any map may have
  Mapper mapper(calibration_, testOptions());
  size_t added = 0;
  for (int64_t round = 0; round < 12; ++round)
  {
    for (MapFrame frame : frames_)
    {
      frame.stamp_ns += round * SECOND_ROUND_NS;
      mapper.add(frame);
      ++added;
    }
  }
  const MapStatistics statistics = mapper.statistics();
  EXPECT_LE(statistics.keyframes, frames_.size() + 3);
  const size_t nodes = mapper.path().size();
  EXPECT_LE(nodes, statistics.keyframes + PLAIN_NODES);
  EXPECT_GT(added, 2 * nodes) << "so little was driven that nothing is shown";
  // What went is missing nowhere: odometry was right, and the map says so.
  EXPECT_LT((mapper.T_map_odom() * frames_.back().T_odom_body.translation() - frames_.back().T_odom_body.translation())
                .norm(),
            0.05);
}

TEST_F(Street, GivesTheSameTwiceAndOnItsThread)
{
  const auto run = [&](bool threaded, std::shared_ptr<pi_runtime::Runtime> runtime, bool kernel_tasks = false)
  {
    MapperOptions options = testOptions();
    options.threaded = threaded;
    options.kernel_tasks = kernel_tasks;
    Mapper mapper(calibration_, options, runtime);
    const Eigen::Isometry3d drift(Eigen::Translation3d(0.2, 0.1, 0.0));
    for (size_t i = 0; i < 30; ++i)
    {
      mapper.add(i < 20 ? frames_[i] : seenBy(frames_[i - 20], drift));
      mapper.flush();
    }
    EXPECT_GE(mapper.statistics().loops, 1u);
    return mapper.T_map_odom().matrix().eval();
  };
  const Eigen::Matrix4d once = run(false, nullptr);
  EXPECT_EQ(once, run(false, nullptr));
  EXPECT_EQ(once, run(true, nullptr));
  EXPECT_EQ(once, run(false, std::make_shared<pi_runtime::Runtime>(), true));
  EXPECT_EQ(once, run(true, std::make_shared<pi_runtime::Runtime>(pi_runtime::RuntimeOptions::forService())));
}

TEST_F(Street, ReplacesAWaitingFrameByANewerOneAndEndsInGoodOrder)
{
  MapperOptions options = testOptions();
  options.threaded = true;
  Mapper mapper(calibration_, options);
  for (const MapFrame& frame : frames_)
  {
    mapper.add(frame);
  }
  mapper.flush();
  const MapStatistics statistics = mapper.statistics();
  EXPECT_EQ(frames_.size(), mapper.path().size() + statistics.skipped);
  EXPECT_EQ(frames_.back().stamp_ns, mapper.path().back().first);  // the newest one is never dropped
  mapper.add(frames_.front());                                     // destroyed with a frame in work
}

TEST_F(Street, ShowsTheGroundInItsCloud)
{
  MapperOptions options = testOptions();
  Mapper mapper(calibration_, options);
  drive(&mapper);
  const std::vector<MapPoint> cloud = mapper.cloud();
  ASSERT_GT(cloud.size(), 300u);
  size_t ground = 0;
  for (const MapPoint& point : cloud)
  {
    EXPECT_GT(point.p_map.z(), -1.6F);  // the body is 1 m above the ground
    ground += std::abs(point.p_map.z() + 1.0F) < 0.15F ? 1 : 0;
  }
  EXPECT_GT(ground, cloud.size() / 10);
  options.voxel_m = 1.0;
  Mapper coarse(calibration_, options);
  drive(&coarse);
  EXPECT_LT(coarse.cloud().size(), cloud.size() / 2);
  EXPECT_EQ(coarse.cloud().size(), coarse.cloud().size());
}

/// Real pictures: a map of the first half of the clip, and the second half started in it.
TEST(Recording, IsNeverPutInAWrongPlaceOfItsOwnMap)
{
  const char* data = std::getenv("PI_EDGE_DATA");
  const std::filesystem::path clip = std::filesystem::path(data == nullptr ? "" : data) / "slam" / "mh01_first10s";
  if (data == nullptr || !std::filesystem::exists(clip))
  {
    GTEST_SKIP() << "PI_EDGE_DATA has no slam/mh01_first10s";
  }
  const auto mav = clip / "mav0";
  const StereoCalibration calibration =
      StereoCalibration::loadEuroc((mav / "cam0" / "sensor.yaml").string(), (mav / "cam1" / "sensor.yaml").string());
  const std::vector<StampedPose> truth = readTrajectory((clip / "groundtruth_tum.txt").string());
  std::vector<MapFrame> frames;
  std::vector<std::filesystem::path> files(std::filesystem::directory_iterator(mav / "cam0" / "data"), {});
  std::sort(files.begin(), files.end());
  for (size_t i = 0; i < files.size(); i += 4)
  {
    MapFrame frame;
    frame.stamp_ns = std::stoll(files[i].stem().string());
    const auto pose =
        std::min_element(truth.begin(), truth.end(),
                         [&](const StampedPose& a, const StampedPose& b)
                         { return std::abs(a.stamp_ns - frame.stamp_ns) < std::abs(b.stamp_ns - frame.stamp_ns); });
    frame.T_odom_body = pose->T_world_body;  // within 2.5 ms
    frame.left = cv::imread(files[i].string(), cv::IMREAD_GRAYSCALE);
    frame.right = cv::imread((mav / "cam1" / "data" / files[i].filename()).string(), cv::IMREAD_GRAYSCALE);
    if (!frame.left.empty() && !frame.right.empty())
    {
      frames.push_back(frame);
    }
  }
  ASSERT_GT(frames.size(), 40u);
  const TemporaryFolder folder;
  MapperOptions options = testOptions();
  options.keyframe_distance_m = 0.1;
  options.keyframe_angle_deg = 5.0;
  Mapper first(calibration, options);
  for (size_t i = 0; i < frames.size() / 2; ++i)
  {
    first.add(frames[i]);
  }
  first.save(folder.path() + "/half.map");
  int localized = 0;
  for (size_t begin = frames.size() / 2; begin + 5 < frames.size(); begin += 3)
  {
    Mapper mapper(calibration, options);
    mapper.load(folder.path() + "/half.map");
    const Eigen::Isometry3d T_odom_map = Eigen::Translation3d(3.0, -7.0, 1.0) * turnZ(77.0);
    for (size_t i = begin; i < begin + 5; ++i)
    {
      MapFrame frame = frames[i];
      frame.T_odom_body = T_odom_map * frame.T_odom_body;
      mapper.add(frame);
      if (mapper.statistics().localized)
      {
        ++localized;
        const Eigen::Isometry3d error = mapper.T_map_odom() * T_odom_map;
        const Eigen::Vector3d& p = frames[i].T_odom_body.translation();
        EXPECT_LT((error * p - p).norm(), 0.1) << i;
        EXPECT_LT(Eigen::AngleAxisd(error.linear()).angle(), 0.02) << i;
        break;
      }
    }
  }
  std::cout << localized << " starts localised\n";
  EXPECT_GE(localized, 1);
}

}  // namespace
