#include <nodelet/nodelet.h>
#include <pi_bringup/ros/command_ros.h>
#include <pluginlib/class_list_macros.hpp>

#include <exception>
#include <memory>

namespace pi_bringup
{

class CommandNodelet : public nodelet::Nodelet
{
private:
  void onInit() override
  {
    try
    {
      command_ = std::make_unique<CommandRos>(getNodeHandle(), getPrivateNodeHandle());
    }
    catch (const std::exception& error)
    {
      NODELET_FATAL_STREAM_NAMED("command", error.what());
      throw;
    }
  }

  std::unique_ptr<CommandRos> command_;
};

}  // namespace pi_bringup

PLUGINLIB_EXPORT_CLASS(pi_bringup::CommandNodelet, nodelet::Nodelet)
