#include <nodelet/nodelet.h>
#include <pi_detect/ros/tracker_ros.h>
#include <pluginlib/class_list_macros.hpp>

#include <exception>
#include <memory>

namespace pi_detect
{

class TrackerNodelet : public nodelet::Nodelet
{
private:
  void onInit() override
  {
    try
    {
      tracker_ = std::make_unique<TrackerRos>(getNodeHandle(), getPrivateNodeHandle());
    }
    catch (const std::exception& error)
    {
      NODELET_FATAL_STREAM_NAMED("tracker", error.what());
      throw;
    }
  }

  std::unique_ptr<TrackerRos> tracker_;
};

}  // namespace pi_detect

PLUGINLIB_EXPORT_CLASS(pi_detect::TrackerNodelet, nodelet::Nodelet)
