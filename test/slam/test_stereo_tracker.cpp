#include <gtest/gtest.h>
#include <pi_node/test_support/message_of.h>
#include <pi_runtime/runtime.h>
#include "drives/vehicle_path.h"
#include "front_end/stereo_tracker.h"
#include "renderer/stereo_renderer.h"

#include <algorithm>
#include <cstdlib>
#include <fstream>
#include <limits>
#include <map>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <set>
#include <stdexcept>

using namespace pi_simulation;
using namespace pi_slam;
using pi_node::test_support::messageOf;

namespace
{

using Vector3 = Eigen::Vector3d;

constexpr int WIDTH = 320;
constexpr int HEIGHT = 240;
constexpr int64_t PERIOD_NS = 50000000;

/// A hall without moving things, and a place in it from which there is much to see.
struct Hall
{
  std::shared_ptr<const SyntheticWorld> world;
  Eigen::Isometry3d T_world_body;
  int64_t start_ns;
};

const Hall& hall()
{
  static const Hall hall = []
  {
    VehiclePathOptions path;
    path.shape = PathShape::HALL_LOOP;
    path.duration_s = 30.0;
    path.start_standstill_s = 0.0;
    const std::vector<StampedPose> poses = makeVehiclePath(path);
    SyntheticWorldOptions options;
    options.kind = WorldKind::HALL;
    options.crossing = false;
    return Hall{SyntheticWorld::build(options, poses), poses[100].T_world_body, poses[100].stamp_ns};
  }();
  return hall;
}

StereoCalibration makeCalibration(Distortion distortion, int width = WIDTH, int height = HEIGHT)
{
  StereoCalibration calibration = StereoCalibration::makeForwardPair(width, height, 0.12);
  for (CameraModel* camera : {&calibration.left.model, &calibration.right.model})
  {
    camera->distortion = distortion;
    camera->coefficients = {-0.20, 0.04, 0.0005, -0.0004};
  }
  calibration.right.model.fx *= 1.02;  // cameras of a pair differ
  calibration.right.T_body_camera.rotate(Eigen::AngleAxisd(0.01, Vector3(0.3, 0.9, 0.3).normalized()));
  return calibration;
}

StereoTrackerOptions smallOptions()
{
  StereoTrackerOptions options;
  options.max_features = 80;
  options.cell_px = 30;
  options.min_distance_px = 10.0;
  return options;
}

/// A camera carried through the hall, and the tracker that sees it.
class Walk
{
public:
  explicit Walk(const StereoCalibration& calibration = makeCalibration(Distortion::NONE),
                const StereoTrackerOptions& options = smallOptions(),
                std::shared_ptr<pi_runtime::Runtime> runtime = nullptr)
    : calibration_(calibration)
    , renderer_(hall().world, calibration, rendererOptions())
    , tracker_(calibration, options, std::move(runtime))
    , max_features_(options.max_features)
    , pose_(hall().T_world_body)
  {
  }

  /// The next pair after a step of the body [m] and a turn [rad], both in the body's axes.
  const StereoFrame& move(const Vector3& step, const Vector3& turn = Vector3::Zero())
  {
    const Eigen::Isometry3d before = pose_;
    pose_.translate(step);
    if (turn.norm() > 0.0)
    {
      pose_.rotate(Eigen::AngleAxisd(turn.norm(), turn.normalized()));
    }
    stamp_ns_ += PERIOD_NS;
    frame_ = renderer_.render(pose_, stamp_ns_);
    prediction_ = TrackerPrediction();
    prediction_.R_last_now = Eigen::Quaterniond(before.linear().transpose() * pose_.linear()).normalized();
    T_before_now_ = before.inverse() * pose_;
    return frame_;
  }

  const FrameFeatures& track() { return track(frame_.left, frame_.right); }
  const FrameFeatures& track(const cv::Mat& left, const cv::Mat& right)
  {
    last_ = features_;
    features_ = tracker_.process(stamp_ns_, left, right, prediction_, max_features_, &report_);
    return features_;
  }

  /// Part of the stereo matches whose place is within 1 px of the rendered depth's. Pixels beside an outline may
  /// belong to what is in front or behind: any depth of the 3 x 3 pixels around counts.
  double rightDepths() const
  {
    const CameraModel& left = calibration_.left.model;
    const Eigen::Isometry3d T_right_left = calibration_.right.T_body_camera.inverse() * calibration_.left.T_body_camera;
    int right = 0;
    int all = 0;
    for (const FeatureObservation& feature : features_.features)
    {
      if (!(feature.seen[LEFT] && feature.seen[RIGHT]))
      {
        continue;
      }
      ++all;
      const Vector3 ray = feature.bearing[LEFT] / feature.bearing[LEFT].z();
      bool good = false;
      for (int dy = -1; dy <= 1; ++dy)
      {
        for (int dx = -1; dx <= 1; ++dx)
        {
          const int x =
              std::min(std::max(static_cast<int>(std::lround(feature.pixel[LEFT].x())) + dx, 0), left.width - 1);
          const int y =
              std::min(std::max(static_cast<int>(std::lround(feature.pixel[LEFT].y())) + dy, 0), left.height - 1);
          const auto pixel = calibration_.right.model.project(T_right_left * (ray * frame_.depth.at<float>(y, x)));
          good = good || (pixel && (*pixel - feature.pixel[RIGHT].cast<double>()).norm() < 1.0);
        }
      }
      right += good ? 1 : 0;
    }
    return all > 0 ? static_cast<double>(right) / all : 0.0;
  }

  /// Distances of tracked features from where the last pair's stereo depth and the true motion put them [px].
  std::vector<double> motionErrors() const
  {
    std::vector<double> errors;
    std::map<int64_t, const FeatureObservation*> before;
    for (const FeatureObservation& feature : last_.features)
    {
      before[feature.id] = &feature;
    }
    const Eigen::Isometry3d& T_body_left = calibration_.left.T_body_camera;
    const Eigen::Isometry3d& T_body_right = calibration_.right.T_body_camera;
    for (const FeatureObservation& feature : features_.features)
    {
      const auto old = before.find(feature.id);
      if (old == before.end() || !old->second->seen[LEFT] || !old->second->seen[RIGHT] || !feature.seen[LEFT])
      {
        continue;
      }
      // Point that is nearest to both rays.
      const Vector3 a = T_body_left.linear() * old->second->bearing[LEFT];
      const Vector3 b = T_body_right.linear() * old->second->bearing[RIGHT];
      const Vector3 c = T_body_right.translation() - T_body_left.translation();
      const double distance = c.cross(b).dot(a.cross(b)) / a.cross(b).squaredNorm();
      const Vector3 p_before = T_body_left.translation() + a * distance;
      const auto pixel = calibration_.left.model.project(T_body_left.inverse() * (T_before_now_.inverse() * p_before));
      errors.push_back(pixel ? (*pixel - feature.pixel[LEFT].cast<double>()).norm() : 1e3);
    }
    std::sort(errors.begin(), errors.end());
    return errors;
  }

  /// Number of features of the last call that the one before had, too.
  int common() const
  {
    std::set<int64_t> before;
    for (const FeatureObservation& feature : last_.features)
    {
      before.insert(feature.id);
    }
    return static_cast<int>(std::count_if(features_.features.begin(), features_.features.end(),
                                          [&before](const FeatureObservation& f) { return before.count(f.id) > 0; }));
  }

  /// Where the features of the last call are, by the rendered depth: in the body frame of that pair.
  std::map<int64_t, Vector3> positions() const
  {
    std::map<int64_t, Vector3> p_body;
    for (const FeatureObservation& feature : features_.features)
    {
      const float depth = frame_.depth.at<float>(static_cast<int>(std::lround(feature.pixel[LEFT].y())),
                                                 static_cast<int>(std::lround(feature.pixel[LEFT].x())));
      p_body[feature.id] =
          calibration_.left.T_body_camera * Vector3(feature.bearing[LEFT] / feature.bearing[LEFT].z() * depth);
    }
    return p_body;
  }

  const Eigen::Isometry3d& T_before_now() const { return T_before_now_; }
  StereoTracker& tracker() { return tracker_; }
  TrackerPrediction& prediction() { return prediction_; }
  const TrackerReport& report() const { return report_; }
  const FrameFeatures& features() const { return features_; }
  const StereoFrame& frame() const { return frame_; }
  void wait(int64_t time_ns) { stamp_ns_ += time_ns; }

private:
  static StereoRendererOptions rendererOptions()
  {
    StereoRendererOptions options;
    options.truth = true;
    options.threads = 2;
    options.supersampling = Supersampling::NONE;  // jagged outlines, but a third of the time
    return options;
  }

  StereoCalibration calibration_;
  StereoRenderer renderer_;
  StereoTracker tracker_;
  int max_features_;
  Eigen::Isometry3d pose_;
  Eigen::Isometry3d T_before_now_ = Eigen::Isometry3d::Identity();
  int64_t stamp_ns_ = hall().start_ns;
  StereoFrame frame_;
  TrackerPrediction prediction_;
  FrameFeatures features_;
  FrameFeatures last_;
  TrackerReport report_;
};

const Vector3 AHEAD(0.05, 0.01, 0.0);
const Vector3 TURN(0.0, 0.005, 0.02);
const Vector3 NO_STEP = Vector3::Zero();

cv::Mat black()
{
  return cv::Mat::zeros(HEIGHT, WIDTH, CV_8UC1);
}

bool equal(const FrameFeatures& a, const FrameFeatures& b)
{
  return a.stamp_ns == b.stamp_ns &&
         std::equal(a.features.begin(), a.features.end(), b.features.begin(), b.features.end(),
                    [](const FeatureObservation& x, const FeatureObservation& y)
                    {
                      bool same = x.id == y.id && x.age == y.age;
                      for (int c = LEFT; c <= RIGHT; ++c)
                      {
                        same = same && x.seen[c] == y.seen[c] &&
                               (!x.seen[c] || (x.pixel[c] == y.pixel[c] && x.bearing[c] == y.bearing[c]));
                      }
                      return same;
                    });
}

}  // namespace

class Lenses : public testing::TestWithParam<Distortion>
{
};

class Sizes : public testing::TestWithParam<cv::Size>
{
};

TEST_P(Lenses, StereoFindsTheDepthOfTheWorld)
{
  Walk walk(makeCalibration(GetParam()));
  walk.move(NO_STEP);
  walk.track();
  EXPECT_GE(walk.features().features.size(), 60U);
  EXPECT_GT(walk.report().stereo, 0.8 * walk.features().features.size());
  EXPECT_GT(walk.rightDepths(), 0.9);
}

TEST_P(Lenses, FeaturesGoWhereTheMotionTakesThem)
{
  Walk walk(makeCalibration(GetParam()));
  walk.move(NO_STEP);
  walk.track();
  for (int i = 0; i < 5; ++i)
  {
    walk.move(AHEAD, TURN);
    walk.track();
    const std::vector<double> errors = walk.motionErrors();
    ASSERT_GE(errors.size(), 40U);
    EXPECT_LT(errors[errors.size() / 2], 0.2) << "pair " << i;
    EXPECT_LT(errors[errors.size() * 9 / 10], 1.0) << "pair " << i;
    EXPECT_EQ(walk.report().tracked, walk.common());
  }
  EXPECT_GT(walk.rightDepths(), 0.9);
}

INSTANTIATE_TEST_SUITE_P(All, Lenses, testing::Values(Distortion::NONE, Distortion::RADTAN, Distortion::EQUIDISTANT));

TEST_P(Sizes, AreAllTracked)
{
  const cv::Size size = GetParam();
  Walk walk(makeCalibration(Distortion::RADTAN, size.width, size.height));
  walk.move(NO_STEP);
  const size_t created = walk.track().features.size();
  EXPECT_GT(created, 40U);
  walk.move(0.5 * AHEAD, 0.5 * TURN);
  walk.track();
  EXPECT_GT(walk.report().tracked, 0.7 * created);
  EXPECT_GT(walk.rightDepths(), 0.9);
}

INSTANTIATE_TEST_SUITE_P(All, Sizes, testing::Values(cv::Size(161, 121), cv::Size(320, 240), cv::Size(1280, 720)));

TEST(StereoTracker, FollowsATurnOfTenDegreesThatTheGyroKnows)
{
  Walk walk;
  walk.move(NO_STEP);
  walk.track();
  walk.move(AHEAD, Vector3(0.0, 0.0, 10.0 * M_PI / 180.0));
  walk.track();
  // 10 of 90 degrees leave the picture, and with them every ninth feature at least.
  EXPECT_GT(walk.report().tracked, 50);
  const std::vector<double> errors = walk.motionErrors();
  EXPECT_LT(errors[errors.size() / 2], 0.3);
  EXPECT_GT(walk.report().flow_px, 20.0);
  EXPECT_LT(walk.report().parallax_px, 4.0);
}

TEST(StereoTracker, StandsARotationThatIsWrongByAGyroBias)
{
  Walk walk;
  walk.move(NO_STEP);
  walk.track();
  walk.move(AHEAD);
  walk.prediction().R_last_now = Eigen::AngleAxisd(0.005, Vector3(0.3, -0.5, 0.8).normalized());  // 0.1 rad/s
  walk.track();
  EXPECT_GT(walk.report().tracked, 60);
}

TEST(StereoTracker, StartsFromKnownPositionsWhereTheyAreGiven)
{
  // Without smaller pictures, the search itself goes a few pixels only.
  StereoTrackerOptions options = smallOptions();
  options.levels = 1;
  const Vector3 far_ahead(0.4, 0.2, 0.0);
  const auto trackedWith = [&far_ahead, &options](bool known)
  {
    Walk walk(makeCalibration(Distortion::NONE), options);
    walk.move(NO_STEP);
    walk.track();
    const std::map<int64_t, Vector3> p_before = walk.positions();
    walk.move(far_ahead);
    const Eigen::Isometry3d T_now_before = walk.T_before_now().inverse();
    walk.prediction().p_body = [&p_before, T_now_before, known](int64_t id) -> std::optional<Vector3>
    {
      const auto found = p_before.find(id);
      if (found == p_before.end())
      {
        return std::nullopt;
      }
      return known ? Vector3(T_now_before * found->second) : Vector3::Constant(std::nan(""));
    };
    walk.track();
    return walk.report().tracked;
  };
  const int with = trackedWith(true);
  const int without = trackedWith(false);  // not a number counts as not known
  EXPECT_GT(with, 30);
  EXPECT_GT(with, 2 * without);
}

/// To the side by 0.5 mm per pair, which is less than 0.05 px: features go as far as their disparity says. (They lagged
/// by some percent while their patches were cut out anew in each picture.)
TEST(StereoTracker, FollowsASlowMotionWithoutLag)
{
  constexpr double STEP_M = 5e-4;
  constexpr int STEPS = 150;
  Walk walk(StereoCalibration::makeForwardPair(WIDTH, HEIGHT, 0.12));
  walk.move(Vector3::Zero());
  std::map<int64_t, FeatureObservation> first;
  for (const FeatureObservation& feature : walk.track().features)
  {
    first[feature.id] = feature;
  }
  for (int i = 0; i < STEPS; ++i)
  {
    walk.move(Vector3(0.0, STEP_M, 0.0));
    walk.track();
  }
  double way_px = 0.0;
  double disparity_px = 0.0;
  int count = 0;
  for (const FeatureObservation& is : walk.features().features)
  {
    const auto was = first.find(is.id);
    if (was != first.end() && was->second.seen[LEFT] && was->second.seen[RIGHT] && is.seen[LEFT])
    {
      way_px += is.pixel[LEFT].x() - was->second.pixel[LEFT].x();
      disparity_px += was->second.pixel[LEFT].x() - was->second.pixel[RIGHT].x();
      ++count;
    }
  }
  ASSERT_GT(count, 40);
  EXPECT_NEAR(way_px / disparity_px, STEPS * STEP_M / 0.12, 0.015 * STEPS * STEP_M / 0.12);
}

TEST(StereoTracker, SurvivesAChangeOfExposure)
{
  Walk walk;
  walk.move(NO_STEP);
  walk.track();
  walk.move(AHEAD, TURN);
  cv::Mat left;
  cv::Mat right;
  walk.frame().left.convertTo(left, -1, 0.6);
  walk.frame().right.convertTo(right, -1, 0.8);
  walk.track(left, right);
  EXPECT_GT(walk.report().tracked, 60);
  EXPECT_GT(walk.report().stereo, 55);
  EXPECT_GT(walk.rightDepths(), 0.9);
  EXPECT_LT(walk.motionErrors()[walk.report().tracked / 3], 0.3);
}

TEST(StereoTracker, GoesOnWithTheRightCameraWhileTheLeftOneIsBlank)
{
  Walk walk;
  walk.move(NO_STEP);
  walk.track();
  const FrameFeatures before = walk.features();
  walk.move(AHEAD, TURN);
  walk.track(black(), walk.frame().right);
  EXPECT_TRUE(walk.report().blank[LEFT]);
  EXPECT_FALSE(walk.report().blank[RIGHT]);
  EXPECT_EQ(walk.report().stereo, 0);
  EXPECT_GT(walk.report().tracked, 40);
  for (const FeatureObservation& feature : walk.features().features)
  {
    EXPECT_FALSE(feature.seen[LEFT]);
    EXPECT_TRUE(feature.seen[RIGHT]);
  }
  walk.move(AHEAD, TURN);
  walk.track(black(), walk.frame().right);
  EXPECT_GT(walk.report().tracked, 40);
  EXPECT_GT(walk.features().features.size(), 60U);  // new ones in the right picture

  walk.move(AHEAD, TURN);
  walk.track();
  EXPECT_GT(walk.report().stereo, 40);
  EXPECT_GT(walk.rightDepths(), 0.9);
  int from_the_start = 0;
  for (const FeatureObservation& feature : walk.features().features)
  {
    from_the_start += feature.seen[LEFT] && feature.id <= before.features.back().id ? 1 : 0;
  }
  EXPECT_GT(from_the_start, 30);
}

TEST(StereoTracker, GoesOnWithTheLeftCameraWhileTheRightOneIsMissing)
{
  Walk walk;
  walk.move(NO_STEP);
  walk.track();
  for (int i = 0; i < 3; ++i)
  {
    walk.move(AHEAD, TURN);
    walk.track(walk.frame().left, cv::Mat());
    EXPECT_TRUE(walk.report().blank[RIGHT]);
    EXPECT_EQ(walk.report().stereo, 0);
    EXPECT_GT(walk.report().tracked, 60);
  }
  walk.move(AHEAD, TURN);
  walk.track();
  EXPECT_GT(walk.report().stereo, 50);
  EXPECT_GT(walk.rightDepths(), 0.9);
}

TEST(StereoTracker, FindsFeaturesAgainAfterAFlash)
{
  Walk walk;
  walk.move(NO_STEP);
  walk.track();
  const FrameFeatures before = walk.features();
  walk.move(AHEAD, TURN);
  walk.track(cv::Mat(HEIGHT, WIDTH, CV_8UC1, cv::Scalar(255)), black());
  EXPECT_TRUE(walk.features().features.empty());
  EXPECT_TRUE(walk.report().blank[LEFT] && walk.report().blank[RIGHT]);
  walk.move(AHEAD, TURN);
  walk.track();
  EXPECT_GT(walk.report().tracked, 50);
  EXPECT_LE(walk.features().features.front().id, before.features.back().id);
}

TEST(StereoTracker, ForgetsFeaturesInALongDarkness)
{
  Walk walk;
  walk.move(NO_STEP);
  walk.track();
  const int64_t last_id = walk.features().features.back().id;
  walk.wait(1500000000);
  walk.move(NO_STEP);
  walk.track(black(), black());
  walk.move(NO_STEP);
  walk.track();
  EXPECT_EQ(walk.report().tracked, 0);
  ASSERT_GT(walk.features().features.size(), 50U);
  EXPECT_GT(walk.features().features.front().id, last_id);
}

TEST(StereoTracker, AnEmptyPairHasNoFeatures)
{
  Walk walk;
  walk.move(NO_STEP);
  walk.track(cv::Mat(), cv::Mat());
  EXPECT_TRUE(walk.features().features.empty());
  EXPECT_TRUE(walk.report().blank[LEFT] && walk.report().blank[RIGHT]);
}

TEST(StereoTracker, FindsCornersInDarkPictures)
{
  Walk walk;
  for (int i = 0; i < 12; ++i)
  {
    walk.move(0.2 * AHEAD);
    cv::Mat left;
    cv::Mat right;
    walk.frame().left.convertTo(left, -1, 0.15);
    walk.frame().right.convertTo(right, -1, 0.15);
    walk.track(left, right);
  }
  EXPECT_GT(walk.features().features.size(), 50U);
}

TEST(StereoTracker, IdsIncreaseAndAreNeverUsedAgain)
{
  Walk walk;
  std::set<int64_t> gone;
  std::set<int64_t> present;
  for (int i = 0; i < 8; ++i)
  {
    walk.move(3.0 * AHEAD, 3.0 * TURN);
    if (i == 4)
    {
      walk.tracker().reset();
      gone.insert(present.begin(), present.end());
      present.clear();
    }
    walk.track();
    EXPECT_EQ(walk.report().tracked == 0, i % 4 == 0);
    std::set<int64_t> now;
    int64_t last = 0;
    for (const FeatureObservation& feature : walk.features().features)
    {
      EXPECT_GT(feature.id, last);
      last = feature.id;
      now.insert(feature.id);
      EXPECT_EQ(gone.count(feature.id), 0U);
      EXPECT_EQ(present.count(feature.id) > 0, feature.age > 0);
    }
    for (const int64_t id : present)
    {
      if (now.count(id) == 0)
      {
        gone.insert(id);
      }
    }
    present = now;
  }
  EXPECT_FALSE(gone.empty());
}

TEST(StereoTracker, DroppedFeaturesDoNotComeBack)
{
  Walk walk;
  walk.move(NO_STEP);
  walk.track();
  std::vector<int64_t> dropped{-5, 1000000};  // unknown ones are nobody's
  for (size_t i = 0; i < walk.features().features.size(); i += 2)
  {
    dropped.push_back(walk.features().features[i].id);
  }
  walk.tracker().drop(dropped);
  walk.move(AHEAD);
  walk.track();
  EXPECT_GT(walk.report().tracked, 25);
  for (const FeatureObservation& feature : walk.features().features)
  {
    EXPECT_EQ(std::count(dropped.begin(), dropped.end(), feature.id), 0);
  }
}

TEST(StereoTracker, KeepsToTheNumberOfFeaturesAskedFor)
{
  const StereoCalibration calibration = makeCalibration(Distortion::NONE);
  Walk walk(calibration);
  walk.move(NO_STEP);
  StereoTracker tracker(calibration, smallOptions());
  const cv::Mat& left = walk.frame().left;
  const cv::Mat& right = walk.frame().right;
  for (const int asked : {80, 30, 0, -3, 1000000})
  {
    const FrameFeatures features = tracker.process(walk.frame().stamp_ns, left, right, {}, asked, nullptr);
    const size_t most = static_cast<size_t>(std::min(std::max(asked, 0), 80));
    EXPECT_LE(features.features.size(), most);
    EXPECT_GE(features.features.size(), most * 3 / 4);
  }
}

TEST(StereoTracker, SpreadsFeatures)
{
  Walk walk;
  walk.move(NO_STEP);
  walk.track();
  const std::vector<FeatureObservation>& features = walk.features().features;
  for (size_t i = 0; i < features.size(); ++i)
  {
    for (size_t k = 0; k < i; ++k)
    {
      EXPECT_GE((features[i].pixel[LEFT] - features[k].pixel[LEFT]).norm(), 10.0F);
    }
  }
}

TEST(StereoTracker, ASceneCutLosesFeaturesAndGoesOn)
{
  Walk walk;
  walk.move(NO_STEP);
  walk.track();
  walk.move(Vector3(0.0, 0.0, 0.0), Vector3(0.0, 0.0, 2.5));
  walk.prediction().R_last_now.setIdentity();  // nobody has told
  walk.track();
  EXPECT_LT(walk.report().tracked, 10);
  EXPECT_GT(walk.report().created, 50);
  walk.move(AHEAD);
  walk.track();
  EXPECT_GT(walk.report().tracked, 50);
}

TEST(StereoTracker, IsDeterministicAndTheSameWithARuntime)
{
  pi_runtime::RuntimeOptions runtime_options;
  runtime_options.opencl_cpu = false;
  runtime_options.opencl_gpu = false;
  runtime_options.arbitration = false;
  StereoTrackerOptions with_runtime = smallOptions();
  with_runtime.kernel_tasks = true;
  const StereoCalibration calibration = makeCalibration(Distortion::RADTAN);
  Walk walk(calibration);
  StereoTracker same(calibration, smallOptions());
  StereoTracker tasks(calibration, with_runtime, std::make_shared<pi_runtime::Runtime>(runtime_options));
  for (int i = 0; i < 6; ++i)
  {
    const StereoFrame& frame = walk.move(AHEAD, TURN);
    const cv::Mat left = i == 3 ? black() : frame.left;
    walk.track(left, frame.right);
    TrackerReport report;
    EXPECT_TRUE(
        equal(walk.features(), same.process(frame.stamp_ns, left, frame.right, walk.prediction(), 80, &report)));
    EXPECT_TRUE(
        equal(walk.features(), tasks.process(frame.stamp_ns, left, frame.right, walk.prediction(), 80, &report)));
    EXPECT_EQ(report.tracked, walk.report().tracked);
    EXPECT_GT(walk.features().features.size(), 30U);
  }
}

TEST(StereoTracker, StampsThatStandStillOrGoBackDoNoHarm)
{
  Walk walk;
  walk.move(NO_STEP);
  walk.track();
  walk.wait(-PERIOD_NS);
  walk.move(AHEAD);
  walk.track();
  walk.wait(-5 * PERIOD_NS);
  walk.move(AHEAD);
  walk.track();
  EXPECT_GT(walk.report().tracked, 50);
}

TEST(StereoTracker, RefusesPicturesOfAnotherSizeOrType)
{
  const StereoCalibration calibration = makeCalibration(Distortion::NONE);
  StereoTracker tracker(calibration, smallOptions());
  const cv::Mat other(HEIGHT, WIDTH - 1, CV_8UC1, cv::Scalar(1));
  const cv::Mat colour(HEIGHT, WIDTH, CV_8UC3, cv::Scalar(1, 2, 3));
  EXPECT_NE(messageOf<std::invalid_argument>([&] { tracker.process(1, black(), other, {}, 80, nullptr); })
                .find("right picture is 319 x 240"),
            std::string::npos);
  EXPECT_NE(
      messageOf<std::invalid_argument>([&] { tracker.process(1, colour, black(), {}, 80, nullptr); }).find("CV_8UC3"),
      std::string::npos);
}

TEST(StereoTracker, RefusesARotationThatIsNone)
{
  StereoTracker tracker(makeCalibration(Distortion::NONE), smallOptions());
  TrackerPrediction prediction;
  prediction.R_last_now.coeffs().setConstant(std::nan(""));
  EXPECT_THROW(tracker.process(1, black(), black(), prediction, 80, nullptr), std::invalid_argument);
  prediction.R_last_now.coeffs().setZero();
  EXPECT_THROW(tracker.process(1, black(), black(), prediction, 80, nullptr), std::invalid_argument);
}

TEST(StereoTracker, RefusesOptionsOutOfRange)
{
  const auto messageWith = [](const std::function<void(StereoTrackerOptions*)>& change)
  {
    StereoTrackerOptions options;
    change(&options);
    return messageOf<std::invalid_argument>([&options] { StereoTracker(makeCalibration(Distortion::NONE), options); });
  };
  const auto names = [](const std::string& message, const std::string& field)
  { return message.find("tracker/" + field + " = ") != std::string::npos; };
  EXPECT_TRUE(names(messageWith([](auto* o) { o->max_features = 19; }), "max_features"));
  EXPECT_TRUE(names(messageWith([](auto* o) { o->cell_px = 0; }), "cell_px"));
  EXPECT_TRUE(names(messageWith([](auto* o) { o->min_distance_px = std::nan(""); }), "min_distance_px"));
  EXPECT_TRUE(names(messageWith([](auto* o) { o->fast_threshold = 0; }), "fast_threshold"));
  EXPECT_TRUE(names(messageWith([](auto* o) { o->levels = 9; }), "levels"));
  EXPECT_TRUE(names(messageWith([](auto* o) { o->window_px = 12; }), "window_px"));
  EXPECT_TRUE(names(messageWith([](auto* o) { o->max_iterations = 0; }), "max_iterations"));
  EXPECT_TRUE(names(messageWith([](auto* o) { o->epsilon_px = 0.0; }), "epsilon_px"));
  EXPECT_TRUE(names(messageWith([](auto* o) { o->max_residual = 300.0; }), "max_residual"));
  EXPECT_TRUE(names(messageWith([](auto* o) { o->epipolar_px = -1.0; }), "epipolar_px"));
  EXPECT_TRUE(names(messageWith([](auto* o) { o->min_depth_m = 0.0; }), "min_depth_m"));
  EXPECT_TRUE(messageWith([](auto* o) { o->max_features = 20; }).empty());
  EXPECT_NE(messageWith([](auto* o) { o->kernel_tasks = true; }).find("runtime"), std::string::npos);
}

TEST(StereoTracker, RefusesCamerasThatAreNoPair)
{
  StereoCalibration sizes = makeCalibration(Distortion::NONE);
  sizes.right.model.width += 2;
  EXPECT_NE(messageOf<std::invalid_argument>([&] { StereoTracker(sizes, smallOptions()); }).find("322 x 240"),
            std::string::npos);
  StereoCalibration same_place = makeCalibration(Distortion::NONE);
  same_place.right.T_body_camera = same_place.left.T_body_camera;
  EXPECT_NE(messageOf<std::invalid_argument>([&] { StereoTracker(same_place, smallOptions()); }).find("T_body_camera"),
            std::string::npos);
  StereoCalibration focal = makeCalibration(Distortion::NONE);
  focal.left.model.fx = 0.0;
  EXPECT_THROW(StereoTracker(focal, smallOptions()), std::invalid_argument);
}

TEST(StereoTracker, TracksARealRecording)
{
  const char* data = std::getenv("PI_EDGE_DATA");
  if (data == nullptr)
  {
    GTEST_SKIP() << "PI_EDGE_DATA is not set";
  }
  const std::string folder = std::string(data) + "/slam/mh01_first10s/mav0/";
  std::ifstream list(folder + "cam0/data.csv");
  if (!list)
  {
    GTEST_SKIP() << folder << " is not there";
  }
  StereoTracker tracker(StereoCalibration::loadEuroc(folder + "cam0/sensor.yaml", folder + "cam1/sensor.yaml"), {});
  int pairs = 0;
  int tracked = 0;
  int stereo = 0;
  int features = 0;
  std::string line;
  while (pairs < 40 && std::getline(list, line))
  {
    if (line.empty() || line[0] == '#')
    {
      continue;
    }
    const std::string name = "data/" + line.substr(0, line.find(',')) + ".png";
    const cv::Mat left = cv::imread(folder + "cam0/" + name, cv::IMREAD_GRAYSCALE);
    const cv::Mat right = cv::imread(folder + "cam1/" + name, cv::IMREAD_GRAYSCALE);
    TrackerReport report;
    // Without a gyro: flow of up to 20 px must do.
    features += static_cast<int>(tracker.process(std::stoll(line), left, right, {}, 160, &report).features.size());
    tracked += report.tracked;
    stereo += report.stereo;
    ++pairs;
  }
  ASSERT_EQ(pairs, 40);
  EXPECT_GT(features, 40 * 140);
  EXPECT_GT(stereo, 0.8 * features);
  EXPECT_GT(tracked, 0.85 * features);
}
