#include <nodelet/nodelet.h>
#include <pi_offload/ros/coordinator_ros.h>
#include <pluginlib/class_list_macros.hpp>

#include <exception>
#include <memory>

namespace pi_offload
{

class CoordinatorNodelet : public nodelet::Nodelet
{
private:
  void onInit() override
  {
    try
    {
      coordinator_ = std::make_unique<CoordinatorRos>(getNodeHandle(), getPrivateNodeHandle());
    }
    catch (const std::exception& error)
    {
      NODELET_FATAL_STREAM_NAMED("coordinator", error.what());
      throw;
    }
  }

  std::unique_ptr<CoordinatorRos> coordinator_;
};

}  // namespace pi_offload

PLUGINLIB_EXPORT_CLASS(pi_offload::CoordinatorNodelet, nodelet::Nodelet)
