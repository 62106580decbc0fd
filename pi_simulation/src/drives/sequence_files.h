#pragma once

#include <pi_slam/imu_simulator.h>
#include <pi_slam/spline_trajectory.h>
#include <pi_slam/stereo_calibration.h>

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace pi_simulation
{

/// Replaces the content of a file.
/// @throws std::runtime_error if it cannot be written.
void writeText(const std::filesystem::path& file, const std::string& text);

/// mav0/camN/sensor.yaml. A camera without distortion is written as radial-tangential with zeros, which every reader
/// of the format knows.
std::string cameraYaml(const pi_slam::MountedCamera& camera, double rate_hz);
/// mav0/imu0/sensor.yaml.
std::string imuYaml(const pi_slam::ImuSimulatorOptions& imu);
/// mav0/imu0/data.csv of simulated samples.
std::string imuCsv(const std::vector<pi_slam::ImuSample>& samples);
/// mav0/camN/data.csv.
std::string picturesCsv(const std::vector<int64_t>& stamps_ns);
/// state_groundtruth_estimate0/data.csv: pose, velocity and, if given, biases (one per stamp).
std::string groundTruthCsv(const pi_slam::SplineTrajectory& trajectory, const std::vector<int64_t>& stamps_ns,
                           const std::vector<pi_slam::ImuBias>& biases);
/// groundtruth_tum.txt.
std::string groundTruthTum(const pi_slam::SplineTrajectory& trajectory, const std::vector<int64_t>& stamps_ns);

}  // namespace pi_simulation
