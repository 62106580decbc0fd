#include <gtest/gtest.h>
#include <pi_node/test_support/message_of.h>
#include <pi_node/test_support/temporary_folder.h>
#include <pi_slam/imu_sample.h>
#include <pi_slam/stereo_calibration.h>

#include <limits>

using namespace pi_slam;
using pi_node::test_support::messageOf;
using pi_node::test_support::TemporaryFolder;

namespace
{

const char* const KALIBR =
    "rostopic: /imu0\n"
    "update_rate: 400.0  # Hz\n"
    "accelerometer_noise_density: 0.01\n"
    "accelerometer_random_walk: 0.0002\n"
    "gyroscope_noise_density: 0.005\n"
    "gyroscope_random_walk: 4.0e-06\n";

const char* const EUROC =
    "%YAML:1.0\n"
    "#Default imu sensor yaml file\n"
    "sensor_type: imu\n"
    "T_BS:\n  cols: 4\n  rows: 4\n  data: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]\n"
    "rate_hz: 200\n"
    "gyroscope_noise_density: 1.6968e-04     # [ rad / s / sqrt(Hz) ]\n"
    "gyroscope_random_walk: 1.9393e-05\n"
    "accelerometer_noise_density: 2.0000e-3\n"
    "accelerometer_random_walk: 3.0000e-3\n";

std::string without(std::string text, const std::string& key)
{
  const size_t begin = text.find(key);
  return text.erase(begin, text.find('\n', begin) + 1 - begin);
}

}  // namespace

TEST(ImuModel, ReadsKalibrsFile)
{
  const TemporaryFolder folder;
  const ImuModel model = ImuModel::loadYaml(folder.file("imu.yaml", KALIBR));
  EXPECT_EQ(model.rate_hz, 400.0);
  EXPECT_EQ(model.accel_noise_density, 0.01);
  EXPECT_EQ(model.accel_random_walk, 0.0002);
  EXPECT_EQ(model.gyro_noise_density, 0.005);
  EXPECT_EQ(model.gyro_random_walk, 4e-6);
  EXPECT_EQ(model.gravity, ImuModel().gravity);
}

TEST(ImuModel, ReadsKalibrsOutputBelowImu0)
{
  const TemporaryFolder folder;
  std::string text = std::string("  ") + KALIBR;
  for (size_t at = text.find('\n'); at + 1 < text.size(); at = text.find('\n', at + 1))
  {
    text.insert(at + 1, "  ");
  }
  const ImuModel model = ImuModel::loadYaml(folder.file("imu.yaml", "imu0:\n" + text));
  EXPECT_EQ(model.rate_hz, 400.0);
  EXPECT_EQ(model.gyro_noise_density, 0.005);
}

TEST(ImuModel, ReadsEurocsSensorFile)
{
  const TemporaryFolder folder;
  const ImuModel model = ImuModel::loadYaml(folder.file("sensor.yaml", EUROC));
  EXPECT_EQ(model.rate_hz, 200.0);
  EXPECT_EQ(model.gyro_noise_density, 1.6968e-4);
  EXPECT_EQ(model.gyro_random_walk, 1.9393e-5);
  EXPECT_EQ(model.accel_noise_density, 2e-3);
  EXPECT_EQ(model.accel_random_walk, 3e-3);
}

TEST(ImuModel, ReadsAndWritesTheScales)
{
  const TemporaryFolder folder;
  const std::string scales =
      "gyroscopes:\n  M:\n  - [1.02, 0.0, 0.0]\n  - [0.001, 0.99, 0.0]\n  - [0.0, 0.0, 1.01]\n"
      "accelerometers:\n  M: [[1.03, 0, 0], [0, 1.0, 0], [0, 0, 0.97]]\n";
  ImuModel model = ImuModel::loadYaml(folder.file("imu.yaml", KALIBR + scales));
  EXPECT_EQ(model.gyro_scale, (std::vector<double>{1.02, 0.99, 1.01}));
  EXPECT_EQ(model.accel_scale, (std::vector<double>{1.03, 1.0, 0.97}));
  model.gyro_scale[2] = 0.995;
  const std::string saved = folder.path() + "/saved.yaml";
  model.saveYaml(saved);
  const ImuModel again = ImuModel::loadYaml(saved);
  EXPECT_EQ(again.gyro_scale, model.gyro_scale);
  EXPECT_EQ(again.accel_scale, model.accel_scale);
  EXPECT_EQ(again.rate_hz, model.rate_hz);
  EXPECT_EQ(again.gyro_random_walk, model.gyro_random_walk);
  EXPECT_EQ(again.accel_noise_density, model.accel_noise_density);

  const auto complaint = [&](const std::string& text)
  { return messageOf<CalibrationError>([&] { ImuModel::loadYaml(folder.file("imu.yaml", KALIBR + text)); }); };
  EXPECT_NE(complaint("gyroscopes: {M: [[1, 0], [0, 1]]}\n").find("gyroscopes: M is no 3x3 matrix"), std::string::npos);
  EXPECT_NE(complaint("accelerometers: {A: 1}\n").find("accelerometers: has no M"), std::string::npos);
  EXPECT_NE(complaint("gyroscopes: {M: [[9, 0, 0], [0, 1, 0], [0, 0, 1]]}\n").find("gyro_scale = 9, must be in"),
            std::string::npos);
  EXPECT_NE(messageOf<CalibrationError>([&] { model.saveYaml("/nowhere/imu.yaml"); }).find("cannot be written"),
            std::string::npos);
}

TEST(ImuModel, NamesFileKeyAndDefect)
{
  const TemporaryFolder folder;
  const auto complaint = [&](const std::string& text)
  { return messageOf<CalibrationError>([&] { ImuModel::loadYaml(folder.file("imu.yaml", text)); }); };
  for (const char* key : {"accelerometer_noise_density", "accelerometer_random_walk", "gyroscope_noise_density",
                          "gyroscope_random_walk", "update_rate"})
  {
    const std::string message = complaint(without(KALIBR, key));
    EXPECT_NE(message.find(std::string("imu.yaml: has no ") + key), std::string::npos) << message;
  }
  EXPECT_NE(complaint(without(KALIBR, "update_rate") + "update_rate: fast\n").find("update_rate is not a number"),
            std::string::npos);
  EXPECT_NE(complaint(without(KALIBR, "update_rate") + "update_rate: 1e9\n").find("imu/rate_hz = 1e+09, must be in"),
            std::string::npos);
  EXPECT_NE(complaint(without(KALIBR, "update_rate") + "update_rate: .nan\n").find("imu/rate_hz"), std::string::npos);
  EXPECT_NE(complaint("").find("is no map"), std::string::npos);
  EXPECT_NE(complaint("[1, 2]").find("is no map"), std::string::npos);
  EXPECT_NE(complaint("a: [1").find("is not YAML"), std::string::npos);
  EXPECT_NE(messageOf<CalibrationError>([] { ImuModel::loadYaml("/nowhere/imu.yaml"); }).find("missing"),
            std::string::npos);
}

TEST(ImuModel, RefusesFieldsOutOfRangeByName)
{
  EXPECT_NO_THROW(ImuModel().validate());
  const auto complaint = [](double ImuModel::*field, double value)
  {
    ImuModel model;
    model.*field = value;
    return messageOf<std::invalid_argument>([&] { model.validate(); });
  };
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(complaint(&ImuModel::rate_hz, 10.0), "imu/rate_hz = 10, must be in [20, 4000]");
  EXPECT_EQ(complaint(&ImuModel::gravity, 1.62), "imu/gravity = 1.62, must be in [9.5, 10]");
  EXPECT_EQ(complaint(&ImuModel::time_offset_s, 0.6), "imu/time_offset_s = 0.6, must be in [-0.5, 0.5]");
  for (const double bad : {0.0, -1.0, nan})
  {
    EXPECT_NE(complaint(&ImuModel::gyro_noise_density, bad).find("imu/gyro_noise_density"), std::string::npos) << bad;
    EXPECT_NE(complaint(&ImuModel::gyro_random_walk, bad).find("imu/gyro_random_walk"), std::string::npos) << bad;
    EXPECT_NE(complaint(&ImuModel::accel_noise_density, bad).find("imu/accel_noise_density"), std::string::npos) << bad;
    EXPECT_NE(complaint(&ImuModel::accel_random_walk, bad).find("imu/accel_random_walk"), std::string::npos) << bad;
    EXPECT_NE(complaint(&ImuModel::gyro_limit, bad).find("imu/gyro_limit"), std::string::npos) << bad;
    EXPECT_NE(complaint(&ImuModel::accel_limit, bad).find("imu/accel_limit"), std::string::npos) << bad;
    EXPECT_NE(complaint(&ImuModel::rate_hz, bad), "") << bad;
    EXPECT_NE(complaint(&ImuModel::gravity, bad), "") << bad;
  }
  EXPECT_NE(complaint(&ImuModel::time_offset_s, nan), "");
}
