#include <nodelet/nodelet.h>
#include <pi_bringup/ros/vehicle_simulator_ros.h>
#include <pluginlib/class_list_macros.hpp>

#include <exception>
#include <memory>

namespace pi_bringup
{

class VehicleSimulatorNodelet : public nodelet::Nodelet
{
private:
  void onInit() override
  {
    try
    {
      simulator_ = std::make_unique<VehicleSimulatorRos>(getNodeHandle(), getPrivateNodeHandle());
    }
    catch (const std::exception& error)
    {
      NODELET_FATAL_STREAM_NAMED("simulator", error.what());
      throw;
    }
  }

  std::unique_ptr<VehicleSimulatorRos> simulator_;
};

}  // namespace pi_bringup

PLUGINLIB_EXPORT_CLASS(pi_bringup::VehicleSimulatorNodelet, nodelet::Nodelet)
