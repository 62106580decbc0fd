#pragma once

#include "renderer/stereo_renderer.h"
#include "ros/simulated_time.h"
#include "vehicle/vehicle_simulation.h"

#include <pi_node/ros/node_parameters.h>
#include <pi_slam/stereo_calibration.h>
#include <ros/node_handle.h>
#include <xmlrpcpp/XmlRpcValue.h>

#include <string>
#include <vector>

namespace pi_simulation
{

/// The parameters of the vehicle simulator; config/vehicle_simulator.yaml shows each with its unit.
struct VehicleSimulatorRosOptions : pi_node::NodeParameters<VehicleSimulatorRosOptions>
{
  std::string scenario;   ///< file; must be set
  int scenario_seed = 1;  ///< of the scenario's random ranges and of all noise
  Base base = Base::SERIAL;
  std::string link;  ///< symbolic link to the chassis's pseudo-terminal; empty: none
  std::string log;   ///< file of states and events; empty: none

  struct Cameras
  {
    double frame_rate = 20.0;   ///< [Hz]
    int threads = 1;            ///< of the renderer
    int nice = 10;              ///< priority of these threads, 0 (normal) to 19 (lowest)
    bool color = true;          ///< bgr8; false: mono8
    bool smooth_edges = false;  ///< more rays at outlines: a third more processor time
    double noise = 1.0;         ///< scale of the pictures' noise
    double brightness = 1.15;   ///< grey value of white in full light is 255 times this
  } cameras;
  double realtime_factor = 1.0;  ///< in simulated time: most seconds of it per second; 0: as fast as the computer can
  PaceOptions pace;              ///< in simulated time
  double patience_s = 20.0;      ///< in simulated time: by the clock on the wall, for an answer of the vehicle
  double imu_noise = 1.0;        ///< scale of the IMU's noise and biases; 0: ideal

  pi_node::VehicleDescription vehicle;  ///< IMU and cameras must not be turned

  std::string map_frame = "map";
  std::string base_link_frame = "base_link";
  std::string odom_frame = "odom";  ///< of a stock base
  std::string imu_frame = "imu_link";
  std::string left_frame = "left_optical";
  std::string right_frame = "right_optical";
  double diagnostic_period = 1.0;  ///< [s]; the name is that of diagnostic_updater
  double warning_period_s = 5.0;   ///< between two log lines of one warning [s]

  void setVehicle(const pi_node::VehicleDescription& description) { vehicle = description; }
  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
  /// Reads the private parameters of a node, and validates.
  /// @param[out] unknown  names of parameters that mean nothing here.
  /// @throws std::invalid_argument naming the parameter that is wrong, its value and its bound.
  static VehicleSimulatorRosOptions load(const ros::NodeHandle& private_node, std::vector<std::string>* unknown);

  SimulatedTimeOptions timeOptions() const;
  VehicleSimulationOptions simulationOptions() const;
  StereoRendererOptions rendererOptions() const;
  pi_slam::StereoCalibration calibration() const;
};

}  // namespace pi_simulation

extern template struct pi_node::NodeParameters<pi_simulation::VehicleSimulatorRosOptions>;
