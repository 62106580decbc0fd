#include "tiny_recording.h"

#include <cstdlib>
#include <fstream>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <sstream>
#include <stdexcept>

namespace fs = std::filesystem;

namespace
{

/// The optical frame in the body frame: looks along the body's z, x to the right is the body's y, as on the real MAV.
std::string cameraYaml(double y_m)
{
  std::ostringstream yaml;
  yaml << "# made up\nsensor_type: camera\nT_BS:\n  cols: 4\n  rows: 4\n  data: [0.0, -1.0, 0.0, 0.0,\n"
       << "         1.0, 0.0, 0.0, " << y_m << ",\n         0.0, 0.0, 1.0, 0.0,\n         0.0, 0.0, 0.0, 1.0]\n"
       << "rate_hz: 20\nresolution: [" << TinyRecording::WIDTH << ", " << TinyRecording::HEIGHT << "]\n"
       << "camera_model: pinhole  # as all\nintrinsics: [40.0, 41.0, 31.5, 23.5] #fu, fv, cu, cv\n"
       << "distortion_model: radial-tangential\ndistortion_coefficients: [-0.1, 0.01, 0.0001, -0.0002]\n";
  return yaml.str();
}

}  // namespace

TemporaryFolder::TemporaryFolder()
{
  std::string name = (fs::temp_directory_path() / "pi_bringup_test_XXXXXX").string();
  if (mkdtemp(name.data()) == nullptr)
  {
    throw std::runtime_error("cannot create " + name);
  }
  path_ = name;
}

TemporaryFolder::~TemporaryFolder()
{
  std::error_code ignored;
  fs::remove_all(path_, ignored);
}

void writeText(const fs::path& file, const std::string& text)
{
  std::ofstream stream(file, std::ios::binary | std::ios::trunc);
  stream << text;
  if (!stream.flush())
  {
    throw std::runtime_error("cannot write " + file.string());
  }
}

void TinyRecording::write(const fs::path& folder)
{
  for (const bool left : {true, false})
  {
    const fs::path camera = folder / "mav0" / (left ? "cam0" : "cam1");
    fs::create_directories(camera / "data");
    writeText(camera / "sensor.yaml", cameraYaml(left ? 0.0 : BASELINE_M));
    std::string csv = "#timestamp [ns],filename\n";
    for (int i = 0; i < PICTURES; ++i)
    {
      csv += std::to_string(pictureStamp(i)) + "," + pictureName(i) + "\r\n";  // as in the originals
      const cv::Mat picture(HEIGHT, WIDTH, CV_8UC1, cv::Scalar(grey(left, i)));
      if (!cv::imwrite((camera / "data" / pictureName(i)).string(), picture))
      {
        throw std::runtime_error("cannot write a picture below " + camera.string());
      }
    }
    writeText(camera / "data.csv", csv);
  }

  const fs::path imu = folder / "mav0" / "imu0";
  fs::create_directories(imu);
  writeText(
      imu / "sensor.yaml",
      "sensor_type: imu\ncomment: VI-Sensor IMU (made up)\nT_BS:\n  cols: 4\n  rows: 4\n"
      "  data: [1.0, 0.0, 0.0, 0.0,\n         0.0, 1.0, 0.0, 0.0,\n         0.0, 0.0, 1.0, 0.0,\n"
      "         0.0, 0.0, 0.0, 1.0]\nrate_hz: 200\ngyroscope_noise_density: 1.0e-02     # [ rad / s / sqrt(Hz) ]\n"
      "accelerometer_noise_density: 2.0e-02\n");
  std::ostringstream samples;
  samples << "#timestamp [ns],w_x,w_y,w_z,a_x,a_y,a_z\n";
  std::ostringstream poses;
  poses << "# timestamp(s) tx ty tz qx qy qz qw\n";
  for (int i = 0; i < SAMPLES; ++i)
  {
    samples << sampleStamp(i) << "," << 0.001 * i << ",0.2,0.3," << 9.8 + 0.001 * i << ",0.5,0.6\n";
    std::ostringstream seconds;
    const std::string nanoseconds = std::to_string(sampleStamp(i) % 1000000000LL);
    seconds << sampleStamp(i) / 1000000000LL << "." << std::string(9 - nanoseconds.size(), '0') << nanoseconds;
    poses << seconds.str() << " " << 0.01 * i << " 2.0 3.0 0.0 0.0 0.0 1.0\n";
  }
  writeText(imu / "data.csv", samples.str());
  writeText(folder / "groundtruth_tum.txt", poses.str());
}
