// Odometry with a calibration that is wrong: it finds the time offset and the rotation between cameras and IMU.
#include <pi_slam/so3.h>

#include "vio_drive.h"

namespace pi_slam
{
namespace
{

constexpr double DEGREE = M_PI / 180.0;

struct CalibrationTest : VioTest
{
  /// Half a round of the campus at 3 m/s.
  static const Drive& drive()
  {
    static const Drive drive = []
    {
      VehiclePathOptions path;
      path.shape = PathShape::CAMPUS_LOOP;
      path.duration_s = 30.0;
      return Drive(makeVehiclePath(path), 3, WorldKind::CAMPUS);
    }();
    return drive;
  }

  static double rms(const std::vector<Outcome>& outcomes, double from_s)
  {
    double sum = 0.0;
    int count = 0;
    for (const Outcome& outcome : outcomes)
    {
      sum += outcome.time_s >= from_s ? outcome.error_m * outcome.error_m : 0.0;
      count += outcome.time_s >= from_s ? 1 : 0;
    }
    return std::sqrt(sum / std::max(1, count));
  }
};

TEST_F(CalibrationTest, FindsByHowMuchTheCamerasAreLate)
{
  for (const double late_ms : {10.0, -10.0, 25.0})
  {
    SCOPED_TRACE(late_ms);
    aligned_ = false;
    messages_.clear();
    Faults faults;
    faults.pair = [=](double, cv::Mat*, cv::Mat*, int64_t* stamp_ns)
    {
      *stamp_ns += std::llround(1e6 * late_ms);
      return true;
    };
    Vio vio(drive().calibration, makeOptions());
    const std::vector<Outcome> outcomes = run(&vio, faults, drive());
    const RigReport found = vio.rig();
    EXPECT_NEAR(1e3 * found.late_s, late_ms, 1.0);
    EXPECT_NEAR(1e3 * found.used.late_s, late_ms, 3.0);  // small pictures: 1.3 ms of deviation
    EXPECT_LT(found.lateDeviation(), 2e-3);
    EXPECT_TRUE(said("ms late")) << allMessages();
    std::cout << late_ms << " ms late: " << 1e3 * found.late_s << " +- " << 1e3 * found.lateDeviation() << " found, "
              << 1e3 * found.used.late_s << " taken over, " << rms(outcomes, 0.0) << " m off\n";
  }
}

TEST_F(CalibrationTest, BeginsAgainWithWhatWasFound)
{
  Faults faults;
  faults.pair = [](double, cv::Mat*, cv::Mat*, int64_t* stamp_ns)
  {
    *stamp_ns += 20000000;
    return true;
  };
  RigReport found;
  found.late_s = found.used.late_s = 0.02;
  found.covariance(3, 3) = 1e-6;
  Vio vio(drive().calibration, makeOptions(), nullptr, found);
  const std::vector<Outcome> outcomes = run(&vio, faults, drive());
  EXPECT_FALSE(said("calibration:")) << allMessages();
  EXPECT_NEAR(vio.rig().late_s, 0.02, 1e-3);
  EXPECT_LT(outcomes.back().error_m, 1.0);
}

TEST_F(CalibrationTest, FindsHowTheCamerasAreTurned)
{
  for (const double turn_deg : {1.0, 3.0})
  {
    SCOPED_TRACE(turn_deg);
    aligned_ = false;
    messages_.clear();
    const Eigen::Vector3d turn = turn_deg * DEGREE * Eigen::Vector3d(0.6, -0.8, 0.0);
    StereoCalibration wrong = drive().calibration;
    for (MountedCamera* const camera : {&wrong.left, &wrong.right})
    {
      camera->T_body_camera = expSo3(-turn) * camera->T_body_camera;
    }
    Vio vio(wrong, makeOptions());
    const std::vector<Outcome> outcomes = run(&vio, Faults(), drive());
    const RigReport found = vio.rig();
    // About the axis of the vehicle's turns nothing is known, and it says so.
    EXPECT_NEAR(found.turn.x() / DEGREE, turn.x() / DEGREE, 0.5);
    EXPECT_NEAR(found.turn.y() / DEGREE, turn.y() / DEGREE, 0.5);
    EXPECT_GT(found.turnDeviation().z(), 3.0 * found.turnDeviation().x());
    // In small pictures 1 degree in half a minute is not sure enough to be taken over.
    EXPECT_TRUE(turn_deg < 2.0 || said("turned by")) << allMessages();
    std::cout << turn_deg << " degrees: " << (found.turn / DEGREE).transpose() << " +- "
              << (found.turnDeviation() / DEGREE).transpose() << " found, " << rms(outcomes, 0.0) << " m off\n";
  }
}

TEST_F(CalibrationTest, LeavesARightCalibrationAlone)
{
  Vio vio(drive().calibration, makeOptions());
  const std::vector<Outcome> outcomes = run(&vio, Faults(), drive());
  EXPECT_FALSE(said("calibration:")) << allMessages();
  EXPECT_LT(std::abs(vio.rig().late_s), 1e-3);
  std::cout << "right: " << 1e3 * vio.rig().late_s << " ms, " << (vio.rig().turn / DEGREE).transpose() << " degrees, "
            << rms(outcomes, 0.0) << " m off\n";
}

}  // namespace
}  // namespace pi_slam
