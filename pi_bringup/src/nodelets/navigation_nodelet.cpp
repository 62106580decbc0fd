#include <nodelet/nodelet.h>
#include <pi_bringup/ros/navigation_ros.h>
#include <pluginlib/class_list_macros.hpp>

#include <exception>
#include <memory>

namespace pi_bringup
{

class NavigationNodelet : public nodelet::Nodelet
{
private:
  void onInit() override
  {
    try
    {
      navigation_ = std::make_unique<NavigationRos>(getNodeHandle(), getPrivateNodeHandle());
    }
    catch (const std::exception& error)
    {
      NODELET_FATAL_STREAM_NAMED("navigation", error.what());
      throw;
    }
  }

  std::unique_ptr<NavigationRos> navigation_;
};

}  // namespace pi_bringup

PLUGINLIB_EXPORT_CLASS(pi_bringup::NavigationNodelet, nodelet::Nodelet)
