#include <nodelet/nodelet.h>
#include <pi_detect/ros/obstacles_ros.h>
#include <pluginlib/class_list_macros.hpp>

#include <exception>
#include <memory>

namespace pi_detect
{

class ObstaclesNodelet : public nodelet::Nodelet
{
private:
  void onInit() override
  {
    try
    {
      obstacles_ = std::make_unique<ObstaclesRos>(getNodeHandle(), getPrivateNodeHandle());
    }
    catch (const std::exception& error)
    {
      NODELET_FATAL_STREAM_NAMED("obstacles", error.what());
      throw;
    }
  }

  std::unique_ptr<ObstaclesRos> obstacles_;
};

}  // namespace pi_detect

PLUGINLIB_EXPORT_CLASS(pi_detect::ObstaclesNodelet, nodelet::Nodelet)
