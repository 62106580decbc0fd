#include <gtest/gtest.h>
#include <pi_bringup/euroc_dataset.h>
#include <pi_bringup/stereo_rectification.h>

#include <cstdlib>
#include <filesystem>
#include <string>

#include "tiny_recording.h"

using pi_bringup::EurocDataset;
using pi_bringup::EurocError;

namespace fs = std::filesystem;

namespace
{

class EurocFolder : public testing::Test
{
protected:
  EurocFolder() { TinyRecording::write(folder_.path()); }

  EurocDataset load() const { return EurocDataset::load(folder_.path().string()); }

  /// The text of the error that loading gives; fails the test if there is none.
  std::string error() const
  {
    try
    {
      load();
    }
    catch (const EurocError& error)
    {
      return error.what();
    }
    ADD_FAILURE() << "no error";
    return std::string();
  }

  fs::path mav(const std::string& file) const { return folder_.path() / "mav0" / file; }

  TemporaryFolder folder_;
};

#define EXPECT_CONTAINS(part, text) EXPECT_NE(std::string::npos, std::string(text).find(part)) << (text)

}  // namespace

TEST_F(EurocFolder, IsReadCompletely)
{
  const EurocDataset dataset = load();
  ASSERT_EQ(static_cast<size_t>(TinyRecording::PICTURES), dataset.left.images.size());
  ASSERT_TRUE(dataset.right);
  ASSERT_EQ(static_cast<size_t>(TinyRecording::PICTURES), dataset.right->images.size());
  EXPECT_EQ(TinyRecording::pictureStamp(4), dataset.left.images[4].stamp_ns);
  EXPECT_EQ(mav("cam1/data/" + TinyRecording::pictureName(4)).string(), dataset.right->images[4].path);
  EXPECT_EQ(64, dataset.left.calibration.width);
  EXPECT_EQ(48, dataset.left.calibration.height);
  EXPECT_DOUBLE_EQ(41.0, dataset.left.calibration.intrinsics[1]);
  EXPECT_DOUBLE_EQ(-0.0002, dataset.left.calibration.distortion[3]);
  EXPECT_NEAR(TinyRecording::BASELINE_M, dataset.right->calibration.T_body_camera.translation().y(), 1e-12);

  ASSERT_TRUE(dataset.imu);
  ASSERT_EQ(static_cast<size_t>(TinyRecording::SAMPLES), dataset.imu->samples.size());
  EXPECT_EQ(TinyRecording::sampleStamp(7), dataset.imu->samples[7].stamp_ns);
  EXPECT_DOUBLE_EQ(0.007, dataset.imu->samples[7].angular_velocity.x());
  EXPECT_DOUBLE_EQ(9.807, dataset.imu->samples[7].linear_acceleration.x());
  EXPECT_DOUBLE_EQ(0.01, dataset.imu->calibration.gyroscope_noise_density);

  ASSERT_EQ(static_cast<size_t>(TinyRecording::SAMPLES), dataset.ground_truth.size());
  EXPECT_EQ(TinyRecording::sampleStamp(7), dataset.ground_truth[7].stamp_ns);
  EXPECT_DOUBLE_EQ(0.07, dataset.ground_truth[7].T_world_body.translation().x());
  EXPECT_FALSE(dataset.ground_truth[7].v_world);
}

TEST_F(EurocFolder, MayLackRightCameraImuAndGroundTruth)
{
  fs::remove_all(mav("cam1"));
  fs::remove_all(mav("imu0"));
  fs::remove(folder_.path() / "groundtruth_tum.txt");
  const EurocDataset dataset = load();
  EXPECT_FALSE(dataset.right);
  EXPECT_FALSE(dataset.imu);
  EXPECT_TRUE(dataset.ground_truth.empty());
}

TEST_F(EurocFolder, PrefersTheGroundTruthOfTheOriginalFormat)
{
  fs::create_directories(mav("state_groundtruth_estimate0"));
  writeText(mav("state_groundtruth_estimate0/data.csv"),
            "#timestamp,p,p,p,qw,qx,qy,qz,v,v,v,bw,bw,bw,ba,ba,ba\n"
            "1500000000000000000,1,2,3,0,1,0,0,0.1,0.2,0.3,0,0,0,0,0,0\n");
  const EurocDataset dataset = load();
  ASSERT_EQ(1U, dataset.ground_truth.size());
  EXPECT_TRUE(dataset.ground_truth[0].T_world_body.linear().isApprox(
      Eigen::Vector3d(1.0, -1.0, -1.0).asDiagonal().toDenseMatrix(), 1e-12));  // half a turn about x
  ASSERT_TRUE(dataset.ground_truth[0].v_world);
  EXPECT_DOUBLE_EQ(0.3, dataset.ground_truth[0].v_world->z());
}

TEST_F(EurocFolder, ReadsSensorYamlWithTheDirectiveOfOpenCv)
{
  writeText(mav("imu0/sensor.yaml"),
            "%YAML:1.0\n---\nT_BS:\n  data: [1.0, 0.0, 0.0, 0.5, 0.0, 1.0, 0.0, 0.0, 0.0, "
            "0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0]\nrate_hz: 100\n");
  EXPECT_DOUBLE_EQ(0.5, load().imu->calibration.T_body_imu.translation().x());
}

TEST_F(EurocFolder, IsNamedIfItHoldsNoRecording)
{
  fs::remove_all(mav("cam0"));
  EXPECT_CONTAINS("mav0/cam0: no such folder", error());
  EXPECT_CONTAINS("contains mav0", error());
}

TEST_F(EurocFolder, NamesAMissingSensorYaml)
{
  fs::remove(mav("cam1/sensor.yaml"));
  EXPECT_CONTAINS("cam1/sensor.yaml: missing", error());
}

TEST_F(EurocFolder, NamesAMissingCsv)
{
  fs::remove(mav("imu0/data.csv"));
  EXPECT_CONTAINS("imu0/data.csv: missing", error());
}

TEST_F(EurocFolder, NamesTheLineOfAMissingPicture)
{
  fs::remove(mav("cam0/data/" + TinyRecording::pictureName(2)));
  EXPECT_CONTAINS("cam0/data.csv:4: ", error());
  EXPECT_CONTAINS(TinyRecording::pictureName(2), error());
}

TEST_F(EurocFolder, NamesTheLineWithTooFewColumns)
{
  writeText(mav("imu0/data.csv"), "#t\n1500000000000000000,1,2,3,4,5,6\n1500000000005000000,1,2,3\n");
  EXPECT_CONTAINS("imu0/data.csv:3: has 4 of 7 columns", error());
}

TEST_F(EurocFolder, NamesTheCellThatIsNoNumber)
{
  writeText(mav("imu0/data.csv"), "1500000000000000000,1,2,x3,4,5,6\n");
  EXPECT_CONTAINS("imu0/data.csv:1: column 4 is \"x3\"", error());
  writeText(mav("imu0/data.csv"), "1500000000000000000,1,2,nan,4,5,6\n");
  EXPECT_CONTAINS("finite", error());
  writeText(mav("imu0/data.csv"), "15000000000000000001,1,2,3,4,5,6\n");
  EXPECT_CONTAINS("time stamp", error());
}

TEST_F(EurocFolder, RefusesStampsThatDoNotIncrease)
{
  writeText(mav("imu0/data.csv"), "1500000000000000000,1,2,3,4,5,6\n1500000000000000000,1,2,3,4,5,6\n");
  EXPECT_CONTAINS("imu0/data.csv:2: ", error());
  EXPECT_CONTAINS("does not come after", error());
}

TEST_F(EurocFolder, NamesABrokenLineOfTheGroundTruth)
{
  writeText(folder_.path() / "groundtruth_tum.txt", "1500000000.0 1 2 3 0 0 0 1\n1500000000.1 1 2 3 0 0 0 7\n");
  EXPECT_CONTAINS("groundtruth_tum.txt:2: quaternion", error());
}

TEST_F(EurocFolder, RefusesCalibrationsItCannotUse)
{
  writeText(mav("imu0/sensor.yaml"), "rate_hz: 100\n");
  EXPECT_CONTAINS("imu0/sensor.yaml: T_BS/data must be a list of 16 numbers", error());
  writeText(mav("imu0/sensor.yaml"),
            "T_BS:\n  data: [2.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, "
            "0.0, 0.0, 0.0, 1.0]\nrate_hz: 100\n");
  EXPECT_CONTAINS("not a rigid transform", error());
  writeText(mav("imu0/sensor.yaml"), "rate_hz: [1, \n: :\n  - {\n");
  EXPECT_CONTAINS("imu0/sensor.yaml", error());
  writeText(mav("cam0/sensor.yaml"), "camera_model: omni\n");
  EXPECT_CONTAINS("camera_model is \"omni\"", error());
}

TEST_F(EurocFolder, RefusesEmptyTables)
{
  writeText(mav("cam0/data.csv"), "#timestamp [ns],filename\n");
  EXPECT_CONTAINS("cam0/data.csv: names no picture", error());
}

TEST(RealRecording, IsReadCompletely)
{
  const char* data = std::getenv("PI_EDGE_DATA");
  const fs::path folder = fs::path(data == nullptr ? "" : data) / "slam" / "mh01_first10s";
  if (data == nullptr || !fs::is_directory(folder))
  {
    GTEST_SKIP() << "PI_EDGE_DATA names no folder with slam/mh01_first10s";
  }
  const EurocDataset dataset = EurocDataset::load(folder.string());
  EXPECT_EQ(200U, dataset.left.images.size());
  ASSERT_TRUE(dataset.right);
  EXPECT_EQ(200U, dataset.right->images.size());
  ASSERT_TRUE(dataset.imu);
  EXPECT_EQ(3020U, dataset.imu->samples.size());
  EXPECT_EQ(2805U, dataset.ground_truth.size());
  // The published baseline of the sensor is 11 cm.
  const auto rectification = pi_bringup::rectifyStereo(dataset.left.calibration, dataset.right->calibration);
  EXPECT_NEAR(0.11, -rectification.right.P(0, 3) / rectification.right.P(0, 0), 1e-3);
}
