#include <nodelet/nodelet.h>
#include <pi_bringup/ros/reaction_ros.h>
#include <pluginlib/class_list_macros.hpp>

#include <exception>
#include <memory>

namespace pi_bringup
{

class ReactionNodelet : public nodelet::Nodelet
{
private:
  void onInit() override
  {
    try
    {
      reaction_ = std::make_unique<ReactionRos>(getNodeHandle(), getPrivateNodeHandle());
    }
    catch (const std::exception& error)
    {
      NODELET_FATAL_STREAM_NAMED("reaction", error.what());
      throw;
    }
  }

  std::unique_ptr<ReactionRos> reaction_;
};

}  // namespace pi_bringup

PLUGINLIB_EXPORT_CLASS(pi_bringup::ReactionNodelet, nodelet::Nodelet)
