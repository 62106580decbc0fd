#include <nodelet/nodelet.h>
#include <pi_slam/ros/vio_ros.h>
#include <pluginlib/class_list_macros.hpp>

#include <exception>
#include <memory>

namespace pi_slam
{

class VioNodelet : public nodelet::Nodelet
{
private:
  void onInit() override
  {
    try
    {
      vio_ = std::make_unique<VioRos>(getNodeHandle(), getPrivateNodeHandle());
    }
    catch (const std::exception& error)
    {
      NODELET_FATAL_STREAM_NAMED("vio", error.what());
      throw;
    }
  }

  std::unique_ptr<VioRos> vio_;
};

}  // namespace pi_slam

PLUGINLIB_EXPORT_CLASS(pi_slam::VioNodelet, nodelet::Nodelet)
