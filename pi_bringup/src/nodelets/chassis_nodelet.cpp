#include <nodelet/nodelet.h>
#include <pi_bringup/ros/chassis_ros.h>
#include <pluginlib/class_list_macros.hpp>

#include <exception>
#include <memory>

namespace pi_bringup
{

class ChassisNodelet : public nodelet::Nodelet
{
private:
  void onInit() override
  {
    try
    {
      chassis_ = std::make_unique<ChassisRos>(getNodeHandle(), getPrivateNodeHandle());
    }
    catch (const std::exception& error)
    {
      NODELET_FATAL_STREAM_NAMED("chassis", error.what());
      throw;
    }
  }

  std::unique_ptr<ChassisRos> chassis_;
};

}  // namespace pi_bringup

PLUGINLIB_EXPORT_CLASS(pi_bringup::ChassisNodelet, nodelet::Nodelet)
