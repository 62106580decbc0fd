#include <nodelet/nodelet.h>
#include <pi_runtime/ros/runtime_ros.h>
#include <pluginlib/class_list_macros.hpp>

#include <exception>
#include <memory>

namespace pi_runtime
{

class RuntimeNodelet : public nodelet::Nodelet
{
private:
  void onInit() override
  {
    try
    {
      runtime_ = std::make_unique<RuntimeRos>(getNodeHandle(), getPrivateNodeHandle());
    }
    catch (const std::exception& error)
    {
      NODELET_FATAL_STREAM_NAMED("runtime", error.what());
      throw;
    }
  }

  std::unique_ptr<RuntimeRos> runtime_;
};

}  // namespace pi_runtime

PLUGINLIB_EXPORT_CLASS(pi_runtime::RuntimeNodelet, nodelet::Nodelet)
