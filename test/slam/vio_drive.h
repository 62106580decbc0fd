#pragma once

#include <gtest/gtest.h>
#include <pi_slam/imu_simulator.h>
#include "drives/vehicle_path.h"
#include "inertial/wheel_simulator.h"
#include "odometry/vio.h"
#include "renderer/stereo_renderer.h"
#include "world/synthetic_world.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <map>
#include <string>
#include <vector>

namespace pi_slam
{
using namespace pi_simulation;

/// A drive around the aisles of a hall at 1.5 m/s, 1 s at rest before and 4 s after, rendered once for all tests:
/// 320x240 px at 15 Hz, IMU at 200 Hz.
struct Drive
{
  StereoCalibration calibration;
  SplineTrajectory trajectory;
  std::vector<ImuSample> imu;
  std::vector<StereoFrame> frames;

  /// @param dark_from_s,dark_to_s  black pictures in between, which cost nothing to render.
  Drive(const std::vector<StampedPose>& poses, uint64_t seed, WorldKind kind = WorldKind::HALL,
        double dark_from_s = 0.0, double dark_to_s = 0.0, int width_px = 320)
    : calibration(StereoCalibration::makeForwardPair(width_px, 3 * width_px / 4, 0.12))
    , trajectory(SplineTrajectory::fit(poses))
  {
    imu = ImuSimulator(ImuSimulatorOptions()).simulate(trajectory, trajectory.startNs(), trajectory.endNs());
    SyntheticWorldOptions world;
    world.kind = kind;
    world.seed = seed;
    StereoRendererOptions options;
    options.threads = 2;
    options.supersampling = Supersampling::NONE;
    StereoRenderer renderer(SyntheticWorld::build(world, poses), calibration, options);
    for (int64_t stamp_ns = imu.front().stamp_ns; stamp_ns <= imu.back().stamp_ns; stamp_ns += 66666667)
    {
      if (seconds(stamp_ns) >= dark_from_s && seconds(stamp_ns) < dark_to_s)
      {
        StereoFrame dark;
        dark.stamp_ns = stamp_ns;
        dark.left = dark.right = cv::Mat(3 * width_px / 4, width_px, CV_8UC1, cv::Scalar(0));
        frames.push_back(dark);
        continue;
      }
      frames.push_back(renderer.render(trajectory, stamp_ns));
    }
  }

  /// The same way in the hall of a seed.
  static const Drive& instance(uint64_t seed = 1)
  {
    static std::map<uint64_t, Drive> drives;
    const auto found = drives.find(seed);
    if (found != drives.end())
    {
      return found->second;
    }
    VehiclePathOptions path;
    path.shape = PathShape::HALL_LOOP;
    path.duration_s = 16.0;
    path.speed = 1.5;
    path.start_standstill_s = 1.0;
    path.end_standstill_s = 4.0;
    return drives.emplace(seed, Drive(makeVehiclePath(path), seed)).first->second;
  }

  double seconds(int64_t stamp_ns) const { return 1e-9 * static_cast<double>(stamp_ns - imu.front().stamp_ns); }
};

/// A picture of the same size in which nothing is to be seen. (Assigning cv::Mat::zeros() to a matrix of the same size
/// would write into the memory it shares with the drive.)
inline cv::Mat black(const cv::Mat& picture)
{
  return cv::Mat(picture.size(), picture.type(), cv::Scalar(0));
}

/// What is done to the drive's data before the estimator sees it.
struct Faults
{
  std::function<bool(double time_s, cv::Mat* left, cv::Mat* right, int64_t* stamp_ns)> pair;  ///< false: it is missing
  std::function<bool(double time_s, ImuSample* sample)> imu;                                  ///< likewise
};

struct Outcome
{
  double time_s;
  FrameReport report;
  bool known = false;  ///< there is a pose
  NavState state;
  Matrix15d covariance = Matrix15d::Zero();
  double error_m = 0.0;  ///< of its position, from where the truth was when the first pose came
};

inline VioOptions makeOptions()
{
  VioOptions options;
  options.frame_budget_s = 0.0;
  return options;
}

class VioTest : public ::testing::Test
{
protected:
  /// Runs the drive through an estimator.
  std::vector<Outcome> run(Vio* vio, const Faults& faults = Faults(), const Drive& drive = Drive::instance())
  {
    std::vector<Outcome> outcomes;
    size_t next = 0;
    size_t next_wheels = 0;
    for (const StereoFrame& frame : drive.frames)
    {
      Outcome outcome;
      outcome.time_s = drive.seconds(frame.stamp_ns);
      cv::Mat left = frame.left;
      cv::Mat right = frame.right;
      int64_t stamp_ns = frame.stamp_ns;
      for (; next_wheels < wheels_.size() && wheels_[next_wheels].stamp_ns <= stamp_ns; ++next_wheels)
      {
        vio->addWheels(wheels_[next_wheels]);
      }
      const bool present = !faults.pair || faults.pair(outcome.time_s, &left, &right, &stamp_ns);
      // A pair waits for the IMU, but not for long.
      while (next < drive.imu.size() && !vio->imuCovers(stamp_ns) && drive.imu[next].stamp_ns < stamp_ns + 200000000)
      {
        ImuSample sample = drive.imu[next++];
        if (!faults.imu || faults.imu(drive.seconds(sample.stamp_ns), &sample))
        {
          const std::optional<PropagatedState> propagated = vio->addImu(sample);
          propagated_ += propagated ? 1 : 0;
          if (propagated)
          {
            EXPECT_TRUE(propagated->state.isFinite()) << "at " << outcome.time_s << " s";
            EXPECT_TRUE(propagated->covariance.allFinite());
          }
        }
        const std::string message = vio->imuMessage();
        if (!message.empty())
        {
          imu_messages_.push_back(message);
        }
      }
      if (!present)
      {
        continue;
      }
      outcome.report = vio->addPair(stamp_ns, left, right);
      if (!outcome.report.message.empty())
      {
        messages_.push_back(outcome.report.message);
      }
      const std::optional<PropagatedState> corrected = vio->newestCorrected();
      outcome.known =
          corrected && outcome.report.status != VioStatus::LOST && outcome.report.status != VioStatus::INITIALIZING;
      if (outcome.known)
      {
        outcome.state = corrected->state;
        outcome.covariance = corrected->covariance;
        EXPECT_TRUE(corrected->state.isFinite());
        outcome.error_m = positionInWorld(outcome.state, frame.stamp_ns, drive).norm();
      }
      outcomes.push_back(outcome);
    }
    return outcomes;
  }

  /// Error of a position; odom is laid over the world where the first pose came.
  Eigen::Vector3d positionInWorld(const NavState& state, int64_t stamp_ns, const Drive& drive)
  {
    const Eigen::Isometry3d truth = drive.trajectory.at(stamp_ns).T_world_body;
    if (!aligned_)
    {
      const Eigen::Matrix3d turn = truth.linear() * state.q.toRotationMatrix().transpose();
      T_world_odom_.linear() =
          Eigen::AngleAxisd(std::atan2(turn(1, 0) - turn(0, 1), turn(0, 0) + turn(1, 1)), Eigen::Vector3d::UnitZ())
              .toRotationMatrix();
      T_world_odom_.translation() = truth.translation() - T_world_odom_.linear() * state.p;
      aligned_ = true;
    }
    return T_world_odom_ * state.p - truth.translation();
  }

  bool said(const std::string& part) const
  {
    return std::any_of(messages_.begin(), messages_.end(),
                       [&](const std::string& message) { return message.find(part) != std::string::npos; });
  }
  std::string allMessages() const
  {
    std::string all;
    for (const std::string& message : messages_)
    {
      all += message + "\n";
    }
    return all;
  }

  static double deviation(const Outcome& outcome)
  {
    return std::sqrt(outcome.covariance.topLeftCorner<3, 3>().trace());
  }

  std::vector<WheelSample> wheels_;  ///< of the drive; empty: it has none
  size_t propagated_ = 0;
  std::vector<std::string> messages_;
  std::vector<std::string> imu_messages_;
  bool aligned_ = false;
  Eigen::Isometry3d T_world_odom_ = Eigen::Isometry3d::Identity();
};

inline const Outcome& at(const std::vector<Outcome>& outcomes, double time_s)
{
  return *std::min_element(outcomes.begin(), outcomes.end(),
                           [&](const Outcome& a, const Outcome& b)
                           { return std::abs(a.time_s - time_s) < std::abs(b.time_s - time_s); });
}

/// First time after from_s at which pictures correct the state again; infinite if they never do.
inline double correctedAfter(const std::vector<Outcome>& outcomes, double from_s)
{
  for (const Outcome& outcome : outcomes)
  {
    if (outcome.time_s >= from_s && outcome.known && outcome.report.status != VioStatus::BLIND)
    {
      return outcome.time_s;
    }
  }
  return std::numeric_limits<double>::infinity();
}

/// 4 s at rest, then at 2 cm/s, then at 4 cm/s.
inline std::vector<StampedPose> creepingPath()
{
  std::vector<StampedPose> path;
  double way_m = 0.0;
  for (int i = 0; i <= 28 * 50; ++i)
  {
    const double t = 0.02 * i;
    way_m += 0.02 * (std::clamp(0.02 * (t - 4.0), 0.0, 0.02) + std::clamp(0.02 * (t - 14.0), 0.0, 0.02) -
                     std::clamp(0.04 * (t - 24.0), 0.0, 0.04));
    StampedPose pose;
    pose.stamp_ns = 1700000000000000000LL + 20000000LL * i;
    pose.T_world_body.translation() = Eigen::Vector3d(way_m, 0.0, 1.0);
    path.push_back(pose);
  }
  return path;
}

}  // namespace pi_slam
