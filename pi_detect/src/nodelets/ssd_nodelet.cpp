#include <nodelet/nodelet.h>
#include <pi_detect/ros/ssd_ros.h>
#include <pluginlib/class_list_macros.hpp>

#include <exception>
#include <memory>

namespace pi_detect
{

class SsdNodelet : public nodelet::Nodelet
{
private:
  void onInit() override
  {
    try
    {
      ssd_ = std::make_unique<SsdRos>(getNodeHandle(), getPrivateNodeHandle());
    }
    catch (const std::exception& error)
    {
      NODELET_FATAL_STREAM_NAMED("ssd", error.what());
      throw;
    }
  }

  std::unique_ptr<SsdRos> ssd_;
};

}  // namespace pi_detect

PLUGINLIB_EXPORT_CLASS(pi_detect::SsdNodelet, nodelet::Nodelet)
