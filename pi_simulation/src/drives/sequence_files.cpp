#include "drives/sequence_files.h"

#include <fstream>
#include <iomanip>
#include <sstream>
#include <stdexcept>

namespace pi_simulation
{

namespace
{

std::string transformYaml(const Eigen::Isometry3d& transform)
{
  std::ostringstream yaml;
  yaml << std::setprecision(15) << "T_BS:\n  cols: 4\n  rows: 4\n  data: [";
  for (int i = 0; i < 16; ++i)
  {
    yaml << (i == 0 ? "" : i % 4 == 0 ? ",\n         " : ", ") << transform.matrix()(i / 4, i % 4);
  }
  yaml << "]\n";
  return yaml.str();
}

void write(std::ostream& stream, char separator, const Eigen::Vector3d& value)
{
  stream << separator << value.x() << separator << value.y() << separator << value.z();
}

/// One hemisphere, so that quaternions do not jump between q and -q.
Eigen::Quaterniond orientation(const pi_slam::SplineTrajectory::State& state, Eigen::Quaterniond* last)
{
  Eigen::Quaterniond q(state.T_world_body.linear());
  if (q.dot(*last) < 0.0)
  {
    q.coeffs() = -q.coeffs();
  }
  *last = q;
  return q;
}

}  // namespace

void writeText(const std::filesystem::path& file, const std::string& text)
{
  std::ofstream stream(file, std::ios::binary | std::ios::trunc);
  stream << text;
  if (!stream.flush())
  {
    throw std::runtime_error(file.string() + ": cannot be written; check the folder's permissions and free space");
  }
}

std::string cameraYaml(const pi_slam::MountedCamera& camera, double rate_hz)
{
  const pi_slam::CameraModel& model = camera.model;
  std::ostringstream yaml;
  yaml << std::setprecision(15) << "%YAML:1.0\nsensor_type: camera\ncomment: rendered\n\n"
       << transformYaml(camera.T_body_camera) << "rate_hz: " << rate_hz << "\nresolution: [" << model.width << ", "
       << model.height << "]\ncamera_model: pinhole\nintrinsics: [" << model.fx << ", " << model.fy << ", " << model.cx
       << ", " << model.cy << "]\ndistortion_model: "
       << (model.distortion == pi_slam::Distortion::EQUIDISTANT ? "equidistant" : "radial-tangential")
       << "\ndistortion_coefficients: [";
  for (size_t i = 0; i < model.usedCoefficients(); ++i)
  {
    yaml << (i == 0 ? "" : ", ") << (model.distortion == pi_slam::Distortion::NONE ? 0.0 : model.coefficients[i]);
  }
  yaml << "]\n";
  return yaml.str();
}

std::string imuYaml(const pi_slam::ImuSimulatorOptions& imu)
{
  std::ostringstream yaml;
  yaml << "%YAML:1.0\nsensor_type: imu\ncomment: the body frame is the IMU's\n\n"
       << transformYaml(Eigen::Isometry3d::Identity()) << std::setprecision(9) << "rate_hz: " << imu.rate_hz
       << "\n\ngyroscope_noise_density: " << imu.gyro_noise_density
       << "     # [ rad / s / sqrt(Hz) ]\ngyroscope_random_walk: " << imu.gyro_random_walk
       << "       # [ rad / s^2 / sqrt(Hz) ]\naccelerometer_noise_density: " << imu.accel_noise_density
       << "  # [ m / s^2 / sqrt(Hz) ]\naccelerometer_random_walk: " << imu.accel_random_walk
       << "    # [ m / s^3 / sqrt(Hz) ]\n";
  return yaml.str();
}

std::string imuCsv(const std::vector<pi_slam::ImuSample>& samples)
{
  std::ostringstream csv;
  csv << "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],a_RS_S_x [m s^-2],"
         "a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]\n"
      << std::fixed << std::setprecision(9);
  for (const pi_slam::ImuSample& sample : samples)
  {
    csv << sample.stamp_ns;
    write(csv, ',', sample.w);
    write(csv, ',', sample.f);
    csv << "\n";
  }
  return csv.str();
}

std::string picturesCsv(const std::vector<int64_t>& stamps_ns)
{
  std::string csv = "#timestamp [ns],filename\n";
  for (const int64_t stamp_ns : stamps_ns)
  {
    csv += std::to_string(stamp_ns) + "," + std::to_string(stamp_ns) + ".png\n";
  }
  return csv;
}

std::string groundTruthCsv(const pi_slam::SplineTrajectory& trajectory, const std::vector<int64_t>& stamps_ns,
                           const std::vector<pi_slam::ImuBias>& biases)
{
  std::ostringstream csv;
  csv << "#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z [], "
         "v_RS_R_x [m s^-1], v_RS_R_y [m s^-1], v_RS_R_z [m s^-1]"
      << (biases.empty() ? ""
                         : ", b_w_RS_S_x [rad s^-1], b_w_RS_S_y [rad s^-1], b_w_RS_S_z [rad s^-1], "
                           "b_a_RS_S_x [m s^-2], b_a_RS_S_y [m s^-2], b_a_RS_S_z [m s^-2]")
      << "\n"
      << std::fixed << std::setprecision(9);
  Eigen::Quaterniond last = Eigen::Quaterniond::Identity();
  for (size_t i = 0; i < stamps_ns.size(); ++i)
  {
    const pi_slam::SplineTrajectory::State state = trajectory.at(stamps_ns[i]);
    const Eigen::Quaterniond q = orientation(state, &last);
    csv << stamps_ns[i];
    write(csv, ',', state.T_world_body.translation());
    csv << "," << q.w() << "," << q.x() << "," << q.y() << "," << q.z();
    write(csv, ',', state.v_world);
    if (!biases.empty())
    {
      write(csv, ',', biases[i].gyro);
      write(csv, ',', biases[i].accel);
    }
    csv << "\n";
  }
  return csv.str();
}

std::string groundTruthTum(const pi_slam::SplineTrajectory& trajectory, const std::vector<int64_t>& stamps_ns)
{
  std::ostringstream text;
  text << "# timestamp(s) tx ty tz qx qy qz qw\n" << std::fixed << std::setprecision(9);
  Eigen::Quaterniond last = Eigen::Quaterniond::Identity();
  for (const int64_t stamp_ns : stamps_ns)
  {
    const pi_slam::SplineTrajectory::State state = trajectory.at(stamp_ns);
    const Eigen::Quaterniond q = orientation(state, &last);
    text << pi_slam::formatSeconds(stamp_ns);
    write(text, ' ', state.T_world_body.translation());
    text << " " << q.x() << " " << q.y() << " " << q.z() << " " << q.w() << "\n";
  }
  return text.str();
}

}  // namespace pi_simulation
