#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <random>

#include "map/drift_filter.h"
#include "map/place_verifier.h"

namespace
{

using namespace pi_slam;
using namespace pi_slam::map;

/// Points about a room, each with a descriptor of its own, and what a camera sees of them.
class Room
{
public:
  explicit Room(uint64_t seed) : calibration_(StereoCalibration::makeForwardPair())
  {
    std::mt19937_64 random(seed);
    std::uniform_real_distribution<double> unit(-1.0, 1.0);
    for (int i = 0; i < 1500; ++i)
    {
      Eigen::Vector3d p(12.0 * unit(random), 12.0 * unit(random), 2.5 * unit(random));
      if (std::max(std::abs(p.x()), std::abs(p.y())) < 6.0)
      {
        p.head<2>() *= 2.0;
      }
      points_.push_back(p);
      std::array<uint8_t, DESCRIPTOR_BYTES> descriptor;
      for (uint8_t& byte : descriptor)
      {
        byte = static_cast<uint8_t>(random());
      }
      descriptors_.push_back(descriptor);
    }
  }

  FeatureSetPtr see(const Eigen::Isometry3d& T_map_body, uint64_t seed, double noise_px = 0.5) const
  {
    std::mt19937_64 random(seed);
    std::normal_distribution<double> noise;
    auto set = std::make_shared<FeatureSet>();
    const MountedCamera& left = calibration_.left;
    set->p_body_camera = left.T_body_camera.translation().cast<float>();
    const Eigen::Isometry3d T_camera_map = (T_map_body * left.T_body_camera).inverse();
    for (size_t i = 0; i < points_.size(); ++i)
    {
      const Eigen::Vector3d p = T_camera_map * points_[i];
      const auto pixel = left.model.project(p);
      if (!pixel || !left.model.contains(*pixel) || p.norm() > 18.0 || set->size() == 250)
      {
        continue;
      }
      MapFeature feature;
      const auto bearing = left.model.unproject(*pixel + noise_px * Eigen::Vector2d{noise(random), noise(random)});
      feature.bearing = (left.T_body_camera.linear() * *bearing).cast<float>();
      feature.inverse_deviation = 0.01F;
      feature.inverse_distance =
          std::max(0.0F, static_cast<float>(1.0 / p.norm()) + 0.01F * static_cast<float>(noise(random)));
      set->features.push_back(feature);
      // One bit in twelve differs.
      for (uint8_t byte : descriptors_[i])
      {
        for (int bit = 0; bit < 8; ++bit)
        {
          byte = static_cast<uint8_t>(byte ^ (random() % 12 == 0 ? 1 << bit : 0));
        }
        set->descriptors.push_back(byte);
      }
    }
    return set;
  }

  const StereoCalibration& calibration() const { return calibration_; }

private:
  StereoCalibration calibration_;
  std::vector<Eigen::Vector3d> points_;
  std::vector<std::array<uint8_t, DESCRIPTOR_BYTES>> descriptors_;
};

Eigen::Isometry3d pose(double x, double y, double z, double yaw, double pitch = 0.0, double roll = 0.0)
{
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.translation() = Eigen::Vector3d(x, y, z);
  T.linear() = (Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ()) * Eigen::AngleAxisd(pitch, Eigen::Vector3d::UnitY()) *
                Eigen::AngleAxisd(roll, Eigen::Vector3d::UnitX()))
                   .toRotationMatrix();
  return T;
}

double angleOf(const Eigen::Isometry3d& a, const Eigen::Isometry3d& b)
{
  return Eigen::AngleAxisd(a.linear().transpose() * b.linear()).angle();
}

TEST(PlaceVerifier, FindsThePoseFromAnotherPlaceAndHeading)
{
  const Room room(1);
  PlaceVerifier verifier(room.calibration(), PlaceVerifierOptions());
  const Eigen::Isometry3d T_map_known = pose(1.0, -0.5, 0.2, 0.3, 0.05);
  const std::vector<PlaceView> views{{room.see(T_map_known, 2), T_map_known}};
  const Eigen::Isometry3d T_map_odom = pose(-40.0, 25.0, 1.5, 2.4);  // any frame of odometry
  for (const double turn : {0.0, 0.3, -0.6})
  {
    const Eigen::Isometry3d T_map_body = pose(1.4, -0.1, 0.1, 0.3 + turn, -0.1, 0.08);
    const auto place = verifier.verify(*room.see(T_map_body, 3), T_map_odom.inverse() * T_map_body, views);
    ASSERT_TRUE(place.has_value()) << turn;
    EXPECT_GE(place->inliers, 40) << turn;
    // Half a pixel over some 60 points at 10 m.
    EXPECT_LT((place->T_map_body.translation() - T_map_body.translation()).norm(), 0.06) << turn;
    EXPECT_LT(angleOf(place->T_map_body, T_map_body), 0.004) << turn;
    EXPECT_LT((place->T_map_odom.matrix() - T_map_odom.matrix()).norm(), 0.25) << turn;
    EXPECT_NEAR(1.0, place->T_map_odom.linear()(2, 2), 1e-12);  // a turn about z, whatever the noise
  }
}

TEST(PlaceVerifier, KnowsHowUncertainItIs)
{
  const Room room(4);
  PlaceVerifier verifier(room.calibration(), PlaceVerifierOptions());
  const Eigen::Isometry3d T_map_known = pose(0.0, 0.0, 0.0, 0.0);
  const Eigen::Isometry3d T_map_body = pose(0.3, 0.3, 0.0, 0.2);
  double sum = 0.0;
  constexpr int RUNS = 40;
  for (int run = 0; run < RUNS; ++run)
  {
    const auto seed = static_cast<uint64_t>(10 + 2 * run);
    const std::vector<PlaceView> views{{room.see(T_map_known, seed, 1.2), T_map_known}};
    const auto place = verifier.verify(*room.see(T_map_body, seed + 1, 1.2), T_map_body, views);
    ASSERT_TRUE(place.has_value());
    Eigen::Vector4d error;
    error << place->T_map_body.translation() - T_map_body.translation(),
        std::atan2(place->T_map_odom.linear()(1, 0), place->T_map_odom.linear()(0, 0));
    sum += error.dot(place->covariance.ldlt().solve(error));
  }
  // Mean of chi-square with 4 degrees of freedom, were the model exact. Points of the map have noise of their own,
  // some share the map's and floors are added: within a factor of three either way it is of use.
  EXPECT_GT(sum / RUNS, 4.0 / 3.0 / 3.0);
  EXPECT_LT(sum / RUNS, 12.0);
}

TEST(PlaceVerifier, RefusesAnotherRoom)
{
  const Room room(1);
  const Room other(2);
  PlaceVerifier verifier(room.calibration(), PlaceVerifierOptions());
  const std::vector<PlaceView> views{{room.see(Eigen::Isometry3d::Identity(), 2), Eigen::Isometry3d::Identity()}};
  const Eigen::Isometry3d T = pose(0.2, 0.1, 0.0, 0.1);
  EXPECT_FALSE(verifier.verify(*other.see(T, 3), T, views).has_value());
}

TEST(PlaceVerifier, RefusesAMatchOnASmallPartOfThePicture)
{
  // What both pictures share lies in a narrow column (a poster that hangs in two rooms).
  const Room room(1);
  PlaceVerifierOptions options;
  options.min_support = 0.0;
  PlaceVerifier verifier(room.calibration(), options);
  const FeatureSetPtr all = room.see(Eigen::Isometry3d::Identity(), 2);
  auto narrow = std::make_shared<FeatureSet>();
  narrow->p_body_camera = all->p_body_camera;
  for (size_t i = 0; i < all->size(); ++i)
  {
    for (int copy = 0; copy < 6; ++copy)  // enough of them: it is the spread that is missing
    {
      if (std::abs(all->features[i].bearing.y()) < 0.03F)
      {
        narrow->features.push_back(all->features[i]);
        narrow->descriptors.insert(narrow->descriptors.end(), all->descriptor(i), all->descriptor(i) + 32);
      }
    }
  }
  ASSERT_GT(narrow->size(), 25u);
  const std::vector<PlaceView> views{{narrow, Eigen::Isometry3d::Identity()}};
  EXPECT_FALSE(verifier.verify(*all, Eigen::Isometry3d::Identity(), views).has_value());
}

TEST(PlaceVerifier, RefusesAPoseAgainstGravity)
{
  const Room room(1);
  PlaceVerifier verifier(room.calibration(), PlaceVerifierOptions());
  const std::vector<PlaceView> views{{room.see(Eigen::Isometry3d::Identity(), 2), Eigen::Isometry3d::Identity()}};
  const Eigen::Isometry3d truth = pose(0.2, 0.1, 0.0, 0.1, 0.0, 0.15);
  const Eigen::Isometry3d claimed = pose(0.2, 0.1, 0.0, 0.1);  // odometry says that it stands upright
  EXPECT_FALSE(verifier.verify(*room.see(truth, 3), claimed, views).has_value());
}

TEST(PlaceVerifier, AnswersTooLittleWithNothing)
{
  const Room room(1);
  PlaceVerifier verifier(room.calibration(), PlaceVerifierOptions());
  const FeatureSetPtr seen = room.see(Eigen::Isometry3d::Identity(), 2);
  EXPECT_FALSE(verifier.verify(*seen, Eigen::Isometry3d::Identity(), {}).has_value());
  const auto empty = std::make_shared<FeatureSet>();
  EXPECT_FALSE(
      verifier.verify(*empty, Eigen::Isometry3d::Identity(), {{seen, Eigen::Isometry3d::Identity()}}).has_value());
  EXPECT_FALSE(
      verifier.verify(*seen, Eigen::Isometry3d::Identity(), {{empty, Eigen::Isometry3d::Identity()}}).has_value());
}

TEST(PlaceVerifier, GivesTheSameTwice)
{
  const Room room(1);
  const Eigen::Isometry3d T = pose(0.4, 0.0, 0.0, 0.2);
  const std::vector<PlaceView> views{{room.see(Eigen::Isometry3d::Identity(), 2), Eigen::Isometry3d::Identity()}};
  PlaceVerifier a(room.calibration(), PlaceVerifierOptions());
  PlaceVerifier b(room.calibration(), PlaceVerifierOptions());
  a.verify(*room.see(pose(0.1, 0.2, 0.0, 0.0), 8), pose(0.1, 0.2, 0.0, 0.0), views);  // leaves no trace
  const auto first = a.verify(*room.see(T, 3), T, views);
  const auto second = b.verify(*room.see(T, 3), T, views);
  ASSERT_TRUE(first && second);
  EXPECT_EQ(first->T_map_body.matrix(), second->T_map_body.matrix());
  EXPECT_EQ(first->covariance, second->covariance);
}

TEST(DriftFilter, GrowsUnsureOnTheWayAndFollowsPlaces)
{
  DriftFilter filter;
  filter.start(Eigen::Isometry3d::Identity(), Eigen::Isometry3d::Identity(), Eigen::Matrix4d::Identity() * 1e-6);
  for (int i = 1; i <= 100; ++i)
  {
    filter.predict(pose(i, 0.0, 0.0, 0.0));
  }
  // 100 m: 8 mm per root of a metre, and across the way the heading's random walk, L sqrt(L / 3) * 0.8 mrad.
  EXPECT_NEAR(0.08, std::sqrt(filter.covariance()(0, 0)), 0.005);
  EXPECT_NEAR(std::hypot(0.08, 0.46), std::sqrt(filter.covariance()(1, 1)), 0.1);
  PlaceMatch place;
  place.T_map_odom = pose(0.0, 0.3, 0.0, 0.0);
  place.T_map_body = place.T_map_odom * pose(100.0, 0.0, 0.0, 0.0);
  place.covariance = Eigen::Matrix4d::Identity() * 1e-4;
  EXPECT_NEAR(0.3, filter.innovation(place).distance_m, 1e-9);
  EXPECT_LT(filter.innovation(place).chi2, 2.0);
  for (int i = 0; i < 3; ++i)
  {
    filter.update(place);
  }
  EXPECT_LT((filter.T_map_body().translation() - place.T_map_body.translation()).norm(), 0.01);
  EXPECT_NEAR(1.0, filter.T_map_odom().linear()(2, 2), 1e-12);
  place.T_map_odom = pose(0.0, 1.3, 0.0, 0.0);
  place.T_map_body = place.T_map_odom * pose(100.0, 0.0, 0.0, 0.0);
  EXPECT_GT(filter.innovation(place).chi2, 1000.0);
}

}  // namespace
