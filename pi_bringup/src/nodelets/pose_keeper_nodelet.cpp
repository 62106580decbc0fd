#include <nodelet/nodelet.h>
#include <pi_bringup/ros/pose_keeper_ros.h>
#include <pluginlib/class_list_macros.hpp>

#include <exception>
#include <memory>

namespace pi_bringup
{

class PoseKeeperNodelet : public nodelet::Nodelet
{
private:
  void onInit() override
  {
    try
    {
      keeper_ = std::make_unique<PoseKeeperRos>(getNodeHandle(), getPrivateNodeHandle());
    }
    catch (const std::exception& error)
    {
      NODELET_FATAL_STREAM_NAMED("pose_keeper", error.what());
      throw;
    }
  }

  std::unique_ptr<PoseKeeperRos> keeper_;
};

}  // namespace pi_bringup

PLUGINLIB_EXPORT_CLASS(pi_bringup::PoseKeeperNodelet, nodelet::Nodelet)
