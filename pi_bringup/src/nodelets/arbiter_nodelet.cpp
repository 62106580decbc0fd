#include <nodelet/nodelet.h>
#include <pi_bringup/ros/arbiter_ros.h>
#include <pluginlib/class_list_macros.hpp>

#include <exception>
#include <memory>

namespace pi_bringup
{

class ArbiterNodelet : public nodelet::Nodelet
{
private:
  void onInit() override
  {
    try
    {
      arbiter_ = std::make_unique<ArbiterRos>(getNodeHandle(), getPrivateNodeHandle());
    }
    catch (const std::exception& error)
    {
      NODELET_FATAL_STREAM_NAMED("arbiter", error.what());
      throw;
    }
  }

  std::unique_ptr<ArbiterRos> arbiter_;
};

}  // namespace pi_bringup

PLUGINLIB_EXPORT_CLASS(pi_bringup::ArbiterNodelet, nodelet::Nodelet)
