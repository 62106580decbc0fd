#include "ros/simulated_microphone_ros.h"
#include "ros/vehicle_simulator_ros.h"

#include <pi_node/ros/adapter_nodelet.h>

#include <pluginlib/class_list_macros.hpp>

namespace pi_simulation
{

using SimulatedMicrophoneNodelet = pi_node::AdapterNodelet<SimulatedMicrophoneRos>;
using VehicleSimulatorNodelet = pi_node::AdapterNodelet<VehicleSimulatorRos>;

}  // namespace pi_simulation

PLUGINLIB_EXPORT_CLASS(pi_simulation::SimulatedMicrophoneNodelet, nodelet::Nodelet)
PLUGINLIB_EXPORT_CLASS(pi_simulation::VehicleSimulatorNodelet, nodelet::Nodelet)
