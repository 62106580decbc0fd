#include "vio_drive.h"

namespace pi_slam
{
namespace
{

TEST_F(VioTest, FollowsADriveFromRestToRest)
{
  Vio vio(Drive::instance().calibration, makeOptions());
  const std::vector<Outcome> outcomes = run(&vio);
  const auto first = std::find_if(outcomes.begin(), outcomes.end(), [](const Outcome& o) { return o.known; });
  ASSERT_NE(first, outcomes.end()) << allMessages();
  EXPECT_LT(first->time_s, 1.5);
  for (auto it = first; it != outcomes.end(); ++it)
  {
    ASSERT_TRUE(it->known) << "lost at " << it->time_s << " s: " << it->report.message;
  }
  // 15 m with a camera of 160 px focal length: 1 % is three times what is reached.
  EXPECT_LT(outcomes.back().error_m, 0.15);
  EXPECT_EQ(outcomes.back().report.status, VioStatus::STANDSTILL);
  EXPECT_LT(outcomes.back().state.v.norm(), 1e-9);
}

TEST_F(VioTest, GivesAPosePerSampleOfTheImu)
{
  Vio vio(Drive::instance().calibration, makeOptions());
  const std::vector<Outcome> outcomes = run(&vio);
  const auto first = std::find_if(outcomes.begin(), outcomes.end(), [](const Outcome& o) { return o.known; });
  ASSERT_NE(first, outcomes.end());
  const double known_s = outcomes.back().time_s - first->time_s;
  EXPECT_NEAR(static_cast<double>(propagated_), 200.0 * known_s, 5.0);
}

TEST_F(VioTest, TheSameInputGivesTheSameResult)
{
  std::vector<Outcome> runs[2];
  for (std::vector<Outcome>& outcomes : runs)
  {
    Vio vio(Drive::instance().calibration, makeOptions());
    outcomes = run(&vio);
  }
  ASSERT_EQ(runs[0].size(), runs[1].size());
  for (size_t i = 0; i < runs[0].size(); ++i)
  {
    ASSERT_EQ(runs[0][i].known, runs[1][i].known);
    EXPECT_EQ(runs[0][i].state.p, runs[1][i].state.p);
  }
}

/// 3 s at rest, then over a road without bumps.
std::vector<StampedPose> levelPathFromRest(PathShape shape, double duration_s)
{
  VehiclePathOptions path;
  path.shape = shape;
  path.duration_s = duration_s;
  path.start_standstill_s = 3.0;
  path.bumps = 0.0;
  return makeVehiclePath(path);
}

/// On a straight road at a constant speed only the accelerometer tells up from down, by what is known of its bias.
TEST_F(VioTest, KeepsUprightOnAStraightRoad)
{
  const std::vector<StampedPose> path = levelPathFromRest(PathShape::STRAIGHT, 50.0);
  for (const uint64_t seed : {1, 3})
  {
    const Drive drive(path, seed, WorldKind::CAMPUS);
    Vio vio(drive.calibration, makeOptions());
    double most = 0.0;
    for (const Outcome& outcome : run(&vio, Faults(), drive))
    {
      if (outcome.known)
      {
        most = std::max(most, std::acos(std::min(1.0, (outcome.state.q * Eigen::Vector3d::UnitZ()).z())));
      }
    }
    EXPECT_GT(most, 0.0);
    EXPECT_LT(most * 180.0 / M_PI, 0.6) << "seed " << seed;
  }
}

/// The detector of standstill looks over a window: when it notices the end, the vehicle has moved for a while.
TEST_F(VioTest, KnowsItsSpeedWhenItHasSetOff)
{
  const std::vector<StampedPose> path = levelPathFromRest(PathShape::HALL_LOOP, 4.0);
  for (const uint64_t seed : {1, 2, 3})
  {
    const Drive drive(path, seed);
    Vio vio(drive.calibration, makeOptions());
    const std::vector<Outcome> outcomes = run(&vio, Faults(), drive);
    const auto off = std::find_if(outcomes.begin(), outcomes.end(),
                                  [](const Outcome& outcome)
                                  { return outcome.time_s > 2.0 && outcome.report.status == VioStatus::TRACKING; });
    ASSERT_NE(off, outcomes.end());
    const double speed = drive.trajectory.at(off->report.stamp_ns).v_world.norm();
    EXPECT_GT(speed, 0.05) << "seed " << seed;
    EXPECT_NEAR(off->state.v.norm(), speed, 0.005) << "seed " << seed;
  }
}

/// At 2 cm/s, then at 4 cm/s: less than what the detector of standstill sees between two pairs.
TEST_F(VioTest, LosesNoWayWhenItCreeps)
{
  const std::vector<StampedPose> path = creepingPath();
  for (const WorldKind kind : {WorldKind::HALL, WorldKind::CAMPUS})
  {
    const Drive drive(path, 2, kind);
    aligned_ = false;
    Vio vio(drive.calibration, makeOptions());
    const std::vector<Outcome> outcomes = run(&vio, Faults(), drive);
    ASSERT_EQ(at(outcomes, 3.5).report.status, VioStatus::STANDSTILL);
    EXPECT_EQ(outcomes.back().report.status, VioStatus::STANDSTILL);
    double most = 0.0;
    for (const Outcome& outcome : outcomes)
    {
      most = std::max(most, outcome.error_m);
      EXPECT_LT(outcome.error_m, 0.02) << "at " << outcome.time_s << " s of "
                                       << path.back().T_world_body.translation().x() << " m";
    }
    std::cout << "creep: " << most << " m lost at most, " << outcomes.back().error_m << " at the end\n";
  }
}

TEST_F(VioTest, StandsStillWithoutDrift)
{
  Vio vio(Drive::instance().calibration, makeOptions());
  const std::vector<Outcome> outcomes = run(&vio);
  const Outcome& early = at(outcomes, 14.5);
  ASSERT_EQ(early.report.status, VioStatus::STANDSTILL) << toString(early.report.status);
  EXPECT_LT((outcomes.back().state.p - early.state.p).norm(), 1e-3);
  EXPECT_GT(early.report.front_end_cpu_ms, 0.0);
  EXPECT_LT(early.report.front_end_cpu_ms, early.report.front_end_ms + 0.1);  // two clocks
}

TEST_F(VioTest, DrivesOnInTheDark)
{
  Faults faults;
  faults.pair = [](double time_s, cv::Mat* left, cv::Mat* right, int64_t*)
  {
    if (time_s > 5.0 && time_s < 7.5)
    {
      *left = black(*left);
      *right = black(*right);
    }
    return true;
  };
  Vio vio(Drive::instance().calibration, makeOptions());
  const std::vector<Outcome> outcomes = run(&vio, faults);
  EXPECT_TRUE(said("without content")) << allMessages();
  EXPECT_EQ(at(outcomes, 7.0).report.status, VioStatus::BLIND);
  EXPECT_GT(deviation(at(outcomes, 6.2)), deviation(at(outcomes, 5.0)));
  EXPECT_GT(deviation(at(outcomes, 7.4)), deviation(at(outcomes, 6.2)));
  EXPECT_LT(correctedAfter(outcomes, 7.5), 8.0);
  // 2.5 s by IMU alone: half of the accelerometer's bias error (0.05 m/s^2 at most) times the square.
  EXPECT_LT(outcomes.back().error_m, 0.4);
}

/// Longer than an estimate lives without pictures: where it is then is not known, how it has turned is.
TEST_F(VioTest, KnowsItsHeadingAfterALongDarkness)
{
  Faults faults;
  faults.pair = [](double time_s, cv::Mat* left, cv::Mat* right, int64_t*)
  {
    if (time_s > 7.0 && time_s < 11.5)
    {
      *left = black(*left);
      *right = black(*right);
    }
    return true;
  };
  VioOptions options = makeOptions();
  options.max_blind_s = 0.5;
  Vio vio(Drive::instance().calibration, options);
  const std::vector<Outcome> outcomes = run(&vio, faults);
  EXPECT_TRUE(said("no pictures that help")) << allMessages();
  EXPECT_EQ(at(outcomes, 9.0).report.status, VioStatus::LOST);
  const Outcome& before = at(outcomes, 7.0);
  const Outcome& after = at(outcomes, correctedAfter(outcomes, 11.5));
  ASSERT_TRUE(after.known) << allMessages();
  const auto turned = [](const Eigen::Matrix3d& from, const Eigen::Matrix3d& to)
  {
    const Eigen::Matrix3d turn = to * from.transpose();
    return std::atan2(turn(1, 0) - turn(0, 1), turn(0, 0) + turn(1, 1)) * 180.0 / M_PI;
  };
  const auto truth = [](const Outcome& outcome) -> Eigen::Matrix3d
  { return Drive::instance().trajectory.at(outcome.report.stamp_ns).T_world_body.linear(); };
  const double really = turned(truth(at(outcomes, 7.7)), truth(after));
  EXPECT_GT(std::abs(really), 30.0);  // without an estimate
  EXPECT_NEAR(turned(before.state.q.toRotationMatrix(), after.state.q.toRotationMatrix()),
              turned(truth(before), truth(after)), 1.0);
  // And it knows how little it knows of where it is, from then on.
  for (const Outcome& outcome : {after, outcomes.back()})
  {
    EXPECT_GT(outcome.error_m, 0.3);
    EXPECT_LT(outcome.error_m, 3.0 * deviation(outcome));
    EXPECT_GT(outcome.error_m, 0.1 * deviation(outcome));
  }
}

TEST_F(VioTest, GoesOnWithOneCamera)
{
  for (int dark : {LEFT, RIGHT})
  {
    messages_.clear();
    aligned_ = false;
    Faults faults;
    faults.pair = [dark](double time_s, cv::Mat* left, cv::Mat* right, int64_t*)
    {
      if (time_s > 5.0)
      {
        cv::Mat* const picture = dark == LEFT ? left : right;
        *picture = black(*picture);
      }
      return true;
    };
    Vio vio(Drive::instance().calibration, makeOptions());
    const std::vector<Outcome> outcomes = run(&vio, faults);
    EXPECT_TRUE(said(dark == LEFT ? "left picture" : "right picture")) << allMessages();
    EXPECT_TRUE(outcomes.back().known);
    EXPECT_LT(correctedAfter(outcomes, 6.0), 8.0);
    EXPECT_LT(outcomes.back().error_m, 0.5) << "camera " << dark;
  }
}

TEST_F(VioTest, BridgesAGapOfTheImu)
{
  Faults faults;
  faults.imu = [](double time_s, ImuSample*) { return time_s < 6.0 || time_s > 7.0; };
  Vio vio(Drive::instance().calibration, makeOptions());
  const std::vector<Outcome> outcomes = run(&vio, faults);
  ASSERT_FALSE(imu_messages_.empty());
  EXPECT_NE(imu_messages_.front().find("gap of 1.0"), std::string::npos) << imu_messages_.front();
  EXPECT_LT(correctedAfter(outcomes, 7.0), 8.0);
  EXPECT_LT(outcomes.back().error_m, 0.5) << allMessages();
}

TEST_F(VioTest, IsWhereItIsAfterALongGapOfTheImu)
{
  constexpr int HALLS = 4;
  // At 1.5 m/s on, and braking from it to a standstill: what the samples at the ends of the gap do not tell.
  for (const double begin_s : {6.0, 10.5})
  {
    double grown_m = 0.0;
    for (uint64_t seed = 1; seed <= HALLS; ++seed)
    {
      messages_.clear();
      imu_messages_.clear();
      aligned_ = false;
      const double end_s = begin_s + 3.5;
      Faults faults;
      faults.imu = [=](double time_s, ImuSample*) { return time_s < begin_s || time_s > end_s; };
      const Drive& drive = Drive::instance(seed);
      Vio vio(drive.calibration, makeOptions());
      const std::vector<Outcome> outcomes = run(&vio, faults, drive);
      ASSERT_FALSE(imu_messages_.empty());
      EXPECT_NE(imu_messages_.front().find("gap of 3.5"), std::string::npos) << imu_messages_.front();
      const Outcome& before = at(outcomes, begin_s - 0.1);
      const Outcome& after = at(outcomes, end_s + 0.5);
      EXPECT_TRUE(after.known) << allMessages();
      grown_m += after.error_m - before.error_m;
      EXPECT_LT(after.error_m, 3.0 * deviation(after)) << "hall " << seed;
      EXPECT_LT(outcomes.back().error_m, 0.5) << "hall " << seed << ": " << allMessages();
    }
    EXPECT_LT(grown_m / HALLS, 0.15) << "gap from " << begin_s << " s";
  }
}

TEST_F(VioTest, GivesNoPoseBetweenALongGapOfTheImuAndTheNextPair)
{
  const Drive& drive = Drive::instance();
  Vio vio(drive.calibration, makeOptions());
  size_t next = 0;
  for (const StereoFrame& frame : drive.frames)
  {
    if (drive.seconds(frame.stamp_ns) > 4.0)
    {
      break;
    }
    for (; next < drive.imu.size() && !vio.imuCovers(frame.stamp_ns); ++next)
    {
      vio.addImu(drive.imu[next]);
    }
    vio.addPair(frame.stamp_ns, frame.left, frame.right);
  }
  ASSERT_TRUE(vio.addImu(drive.imu[next]));
  EXPECT_TRUE(vio.addImu(drive.imu[next + 20]));   // 0.1 s
  EXPECT_FALSE(vio.addImu(drive.imu[next + 80]));  // 0.3 s
  EXPECT_FALSE(vio.addImu(drive.imu[next + 81]));
  const auto frame = std::find_if(drive.frames.begin(), drive.frames.end(),
                                  [&](const StereoFrame& one) { return one.stamp_ns > drive.imu[next + 81].stamp_ns; });
  for (next += 82; !vio.imuCovers(frame->stamp_ns); ++next)
  {
    EXPECT_FALSE(vio.addImu(drive.imu[next]));
  }
  vio.addPair(frame->stamp_ns, frame->left, frame->right);
  EXPECT_TRUE(vio.addImu(drive.imu[next]));
}

TEST_F(VioTest, SurvivesPicturesStampedLate)
{
  Faults faults;
  faults.pair = [](double time_s, cv::Mat*, cv::Mat*, int64_t* stamp_ns)
  {
    if (time_s > 5.0 && time_s < 6.5)
    {
      *stamp_ns += 200000000;
    }
    return time_s < 6.5 || time_s > 6.75;
  };
  Vio vio(Drive::instance().calibration, makeOptions());
  const std::vector<Outcome> outcomes = run(&vio, faults);
  EXPECT_TRUE(outcomes.back().known) << allMessages();
  EXPECT_LT(correctedAfter(outcomes, 6.8), 9.5);
  EXPECT_LT(outcomes.back().error_m, 0.8) << allMessages();
}

TEST_F(VioTest, IgnoresPairsAndSamplesOutOfOrder)
{
  const Drive& drive = Drive::instance();
  Vio vio(drive.calibration, makeOptions());
  run(&vio);
  const FrameReport report =
      vio.addPair(drive.frames.front().stamp_ns, drive.frames.front().left, drive.frames.front().right);
  EXPECT_FALSE(report.processed);
  EXPECT_NE(report.message.find("goes back"), std::string::npos) << report.message;
  EXPECT_FALSE(vio.addImu(drive.imu.front()));
  EXPECT_NE(vio.imuMessage().find("goes back"), std::string::npos);
  EXPECT_TRUE(vio.newestCorrected());
}

TEST_F(VioTest, SaysThatThereIsNoImu)
{
  const Drive& drive = Drive::instance();
  Vio vio(drive.calibration, makeOptions());
  const FrameReport report =
      vio.addPair(drive.frames.front().stamp_ns, drive.frames.front().left, drive.frames.front().right);
  EXPECT_FALSE(report.processed);
  EXPECT_NE(report.message.find("imu/data"), std::string::npos) << report.message;
}

TEST_F(VioTest, IgnoresSamplesThatAreNotFinite)
{
  const Drive& drive = Drive::instance();
  Vio vio(drive.calibration, makeOptions());
  ImuSample sample = drive.imu.front();
  sample.w.x() = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(vio.addImu(sample));
  EXPECT_NE(vio.imuMessage().find("not finite"), std::string::npos);
  EXPECT_FALSE(vio.imuCovers(sample.stamp_ns));
}

TEST_F(VioTest, DoesLessRatherThanFallBehind)
{
  VioOptions options = makeOptions();
  options.frame_budget_s = 1e-6;  // no machine is as fast
  Vio vio(Drive::instance().calibration, options);
  const std::vector<Outcome> outcomes = run(&vio);
  EXPECT_TRUE(outcomes.back().report.reduced);
  EXPECT_TRUE(outcomes.back().known);
  EXPECT_LT(outcomes.back().report.features, options.tracker.max_features / 2);
  EXPECT_LT(outcomes.back().error_m, 0.5);
}

TEST_F(VioTest, OffersKeyframesWithLandmarksInView)
{
  const Drive& drive = Drive::instance();
  Vio vio(drive.calibration, makeOptions());
  size_t keyframes = 0;
  size_t landmarks = 0;
  vio.setKeyframeCallback(
      [&](const MapFrame& frame)
      {
        ++keyframes;
        landmarks += frame.landmarks.size();
        for (const MapFrame::Landmark& landmark : frame.landmarks)
        {
          const std::optional<Eigen::Vector2d> pixel =
              drive.calibration.left.model.project(drive.calibration.left.T_body_camera.inverse() * landmark.p_body);
          ASSERT_TRUE(pixel);
          EXPECT_LT((*pixel - landmark.pixel.cast<double>()).norm(), 10.0);
        }
      });
  run(&vio);
  EXPECT_GT(keyframes, 10u);
  EXPECT_GT(landmarks, 30 * keyframes);
}

TEST(VioOptions, NameFieldValueAndBound)
{
  VioOptions options;
  options.max_blind_s = 0.0;
  try
  {
    Vio vio(StereoCalibration::makeForwardPair(320, 240, 0.12), options);
    FAIL() << "was accepted";
  }
  catch (const std::invalid_argument& error)
  {
    EXPECT_STREQ(error.what(), "vio/max_blind_s = 0, must be in [0.5, 60]");
  }
}

}  // namespace
}  // namespace pi_slam
