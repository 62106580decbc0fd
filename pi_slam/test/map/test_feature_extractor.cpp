#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "map/descriptor_matcher.h"
#include "map/feature_extractor.h"

namespace
{

using namespace pi_slam;
using namespace pi_slam::map;

/// Grey levels on the inside of a sphere around the origin: smooth noise, so that there are corners everywhere.
class SpherePicture
{
public:
  explicit SpherePicture(double radius_m) : radius_m_(radius_m)
  {
    std::mt19937 random(5);
    std::uniform_real_distribution<float> grey(20.0F, 235.0F);
    cells_.resize(SIDE * SIDE * SIDE);
    for (float& cell : cells_)
    {
      cell = grey(random);
    }
  }

  /// Picture of a camera near the middle of the sphere.
  cv::Mat render(const CameraModel& camera, const Eigen::Isometry3d& T_world_camera) const
  {
    cv::Mat picture(camera.height, camera.width, CV_8UC1);
    const Eigen::Vector3d p = T_world_camera.translation();
    for (int y = 0; y < camera.height; ++y)
    {
      for (int x = 0; x < camera.width; ++x)
      {
        const Eigen::Vector3d ray = T_world_camera.linear() * *camera.unproject({x, y});
        const double along = ray.dot(p);
        const double length = -along + std::sqrt(along * along + radius_m_ * radius_m_ - p.squaredNorm());
        picture.at<uint8_t>(y, x) = static_cast<uint8_t>(grey((p + length * ray) / radius_m_));
      }
    }
    return picture;
  }

private:
  static constexpr int SIDE = 64;
  static constexpr float CELLS = 13.0F;  ///< per unit of direction

  float cell(int x, int y, int z) const
  {
    return cells_[static_cast<size_t>(((x & 63) * SIDE + (y & 63)) * SIDE + (z & 63))];
  }
  float grey(const Eigen::Vector3d& direction) const
  {
    const Eigen::Vector3f c = CELLS * direction.cast<float>();
    const Eigen::Vector3f base = c.array().floor();
    // Cells with sharp borders: corners where three of them meet.
    const Eigen::Vector3f part = ((c - base).array() - 0.5F) * 8.0F;
    const Eigen::Vector3f w = (part.array() + 0.5F).min(1.0F).max(0.0F);
    float sum = 0.0F;
    for (int i = 0; i < 8; ++i)
    {
      const int x = i & 1;
      const int y = i >> 1 & 1;
      const int z = i >> 2;
      sum += (x ? w.x() : 1.0F - w.x()) * (y ? w.y() : 1.0F - w.y()) * (z ? w.z() : 1.0F - w.z()) *
             cell(static_cast<int>(base.x()) + x, static_cast<int>(base.y()) + y, static_cast<int>(base.z()) + z);
    }
    return sum;
  }

  const double radius_m_;
  std::vector<float> cells_;
};

constexpr double RADIUS_M = 4.0;

Eigen::Isometry3d turnedBy(double yaw_deg, double pitch_deg, double roll_deg)
{
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = (Eigen::AngleAxisd(yaw_deg * M_PI / 180.0, Eigen::Vector3d::UnitZ()) *
                Eigen::AngleAxisd(pitch_deg * M_PI / 180.0, Eigen::Vector3d::UnitY()) *
                Eigen::AngleAxisd(roll_deg * M_PI / 180.0, Eigen::Vector3d::UnitX()))
                   .toRotationMatrix();
  return T;
}

MapFrame frameAt(const StereoCalibration& calibration, const Eigen::Isometry3d& T_odom_body)
{
  static const SpherePicture world(RADIUS_M);
  MapFrame frame;
  frame.stamp_ns = 1;
  frame.T_odom_body = T_odom_body;
  frame.left = world.render(calibration.left.model, T_odom_body * calibration.left.T_body_camera);
  frame.right = world.render(calibration.right.model, T_odom_body * calibration.right.T_body_camera);
  return frame;
}

StereoCalibration makeCalibration(Distortion distortion)
{
  StereoCalibration calibration = StereoCalibration::makeForwardPair(480, 360, 0.12);
  for (MountedCamera* camera : {&calibration.left, &calibration.right})
  {
    camera->model.distortion = distortion;
    if (distortion == Distortion::RADTAN)
    {
      camera->model.coefficients = {-0.2, 0.03, 0.0005, -0.0003};
    }
    if (distortion == Distortion::EQUIDISTANT)
    {
      camera->model.coefficients = {0.02, -0.003, 0.001, 0.0};
    }
  }
  return calibration;
}

class FeatureExtractorTest : public ::testing::TestWithParam<Distortion>
{
};

TEST_P(FeatureExtractorTest, KnowsHowFarCornersAreWithAnyLens)
{
  const StereoCalibration calibration = makeCalibration(GetParam());
  FeatureExtractor extractor(calibration, 300);
  const auto set = extractor.extract(frameAt(calibration, Eigen::Isometry3d::Identity()));
  ASSERT_GT(set->size(), 100u);
  ASSERT_EQ(set->size() * DESCRIPTOR_BYTES, set->descriptors.size());
  size_t good = 0;
  bool levels[FeatureExtractor::LEVELS] = {};
  for (const MapFeature& feature : set->features)
  {
    EXPECT_NEAR(1.0F, feature.bearing.norm(), 1e-5F);
    EXPECT_GT(feature.inverse_deviation, 0.0F);
    // The left camera is 6 cm off the middle of the sphere.
    good += std::abs(feature.inverse_distance - 1.0 / RADIUS_M) < 3.0 * feature.inverse_deviation + 0.005 ? 1 : 0;
    levels[feature.level] = true;
  }
  EXPECT_GT(good, set->size() * 9 / 10);
  EXPECT_TRUE(levels[0] && levels[1] && levels[2]);
}

TEST_P(FeatureExtractorTest, DescribesTheSameWhicheverWayTheCameraTurns)
{
  const StereoCalibration calibration = makeCalibration(GetParam());
  FeatureExtractor extractor(calibration, 300);
  DescriptorMatcher matcher;
  const auto before = extractor.extract(frameAt(calibration, Eigen::Isometry3d::Identity()));
  for (const Eigen::Isometry3d& T : {turnedBy(35.0, 0.0, 0.0), turnedBy(0.0, 15.0, 0.0), turnedBy(10.0, 5.0, 40.0)})
  {
    const auto after = extractor.extract(frameAt(calibration, T));
    size_t right = 0;
    size_t wrong = 0;
    for (const DescriptorMatch& match : matcher.match(*before, *after, 50))
    {
      const Eigen::Vector3f then = before->features[match.query].bearing;
      const Eigen::Vector3f now = T.linear().cast<float>() * after->features[match.train].bearing;
      (std::acos(std::min(1.0F, then.dot(now))) < 0.02F ? right : wrong) += 1;  // some 5 px, of them 6 cm of parallax
    }
    EXPECT_GT(right, 25u);
    EXPECT_LT(wrong, right / 3);  // neighbours in this regular world look alike
  }
}

INSTANTIATE_TEST_SUITE_P(Lenses, FeatureExtractorTest,
                         ::testing::Values(Distortion::NONE, Distortion::RADTAN, Distortion::EQUIDISTANT));

TEST(FeatureExtractor, TakesOverWhatOdometryKnowsWell)
{
  const StereoCalibration calibration = makeCalibration(Distortion::NONE);
  FeatureExtractor extractor(calibration, 300);
  MapFrame frame = frameAt(calibration, Eigen::Isometry3d::Identity());
  MapFrame::Landmark landmark;
  landmark.id = 7;
  landmark.pixel = Eigen::Vector2f(200.25F, 150.5F);
  const Eigen::Vector3d ray =
      calibration.left.T_body_camera.linear() * *calibration.left.model.unproject({200.25, 150.5});
  landmark.p_body = calibration.left.T_body_camera.translation() + 7.5 * ray;
  landmark.deviation_m = 0.05;
  frame.landmarks.push_back(landmark);
  landmark.p_body = Eigen::Vector3d(std::nan(""), 0.0, 0.0);  // of no use, and of no harm
  frame.landmarks.push_back(landmark);
  landmark.p_body = Eigen::Vector3d(4.0, 0.0, 0.0);
  landmark.deviation_m = 3.0;
  frame.landmarks.push_back(landmark);
  landmark.pixel = Eigen::Vector2f(-1000.0F, 1e9F);
  landmark.deviation_m = 0.1;
  frame.landmarks.push_back(landmark);
  const auto set = extractor.extract(frame);
  size_t found = 0;
  for (const MapFeature& feature : set->features)
  {
    found +=
        std::abs(feature.inverse_distance - 1.0F / 7.5F) < 1e-5F && feature.bearing.isApprox(ray.cast<float>(), 1e-4F)
            ? 1
            : 0;
  }
  EXPECT_EQ(1u, found);
}

TEST(FeatureExtractor, AnswersMissingAndBlankPicturesWithLess)
{
  const StereoCalibration calibration = makeCalibration(Distortion::NONE);
  FeatureExtractor extractor(calibration, 300);
  MapFrame frame = frameAt(calibration, Eigen::Isometry3d::Identity());
  MapFrame no_left = frame;
  no_left.left.release();
  EXPECT_EQ(0u, extractor.extract(no_left)->size());
  MapFrame no_right = frame;
  no_right.right.release();
  EXPECT_EQ(0u, extractor.extract(no_right)->size());  // nobody knows a distance
  MapFrame black = frame;
  black.left = cv::Mat(360, 480, CV_8UC1, cv::Scalar(0));
  EXPECT_EQ(0u, extractor.extract(black)->size());
  EXPECT_GT(extractor.extract(frame)->size(), 100u);  // and goes on afterwards
}

TEST(DescriptorMatcher, KeepsPairsThatAreEachOthersNearest)
{
  FeatureSet a;
  FeatureSet b;
  const auto add = [](FeatureSet* set, std::vector<int> bits)
  {
    set->features.emplace_back();
    std::vector<uint8_t> descriptor(DESCRIPTOR_BYTES, 0);
    for (const int bit : bits)
    {
      descriptor[static_cast<size_t>(bit / 8)] |= static_cast<uint8_t>(1 << bit % 8);
    }
    set->descriptors.insert(set->descriptors.end(), descriptor.begin(), descriptor.end());
  };
  add(&a, {0, 1, 2, 3});
  add(&a, {0, 1, 2});
  add(&a, {100, 101, 102, 103, 104, 105});
  add(&b, {0, 1});
  add(&b, {100});
  DescriptorMatcher matcher;
  const auto pairs = matcher.match(a, b, 4);
  ASSERT_EQ(1u, pairs.size());  // 0 wants b's first, too, but 1 is nearer; 2 is 5 bits off
  EXPECT_EQ(1u, pairs[0].query);
  EXPECT_EQ(0u, pairs[0].train);
  EXPECT_EQ(1, pairs[0].distance);
  EXPECT_TRUE(matcher.match(FeatureSet(), b, 4).empty());
  EXPECT_TRUE(matcher.match(a, FeatureSet(), 4).empty());
}

}  // namespace
