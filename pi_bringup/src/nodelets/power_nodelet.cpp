#include <nodelet/nodelet.h>
#include <pi_bringup/ros/power_ros.h>
#include <pluginlib/class_list_macros.hpp>

#include <exception>
#include <memory>

namespace pi_bringup
{

class PowerNodelet : public nodelet::Nodelet
{
private:
  void onInit() override
  {
    try
    {
      power_ = std::make_unique<PowerRos>(getNodeHandle(), getPrivateNodeHandle());
    }
    catch (const std::exception& error)
    {
      NODELET_FATAL_STREAM_NAMED("power", error.what());
      throw;
    }
  }

  std::unique_ptr<PowerRos> power_;
};

}  // namespace pi_bringup

PLUGINLIB_EXPORT_CLASS(pi_bringup::PowerNodelet, nodelet::Nodelet)
