#include <nodelet/nodelet.h>
#include <pi_bringup/ros/simulated_microphone_ros.h>
#include <pluginlib/class_list_macros.hpp>

#include <exception>
#include <memory>

namespace pi_bringup
{

class SimulatedMicrophoneNodelet : public nodelet::Nodelet
{
private:
  void onInit() override
  {
    try
    {
      microphone_ = std::make_unique<SimulatedMicrophoneRos>(getNodeHandle(), getPrivateNodeHandle());
    }
    catch (const std::exception& error)
    {
      NODELET_FATAL_STREAM_NAMED("simulated_microphone", error.what());
      throw;
    }
  }

  std::unique_ptr<SimulatedMicrophoneRos> microphone_;
};

}  // namespace pi_bringup

PLUGINLIB_EXPORT_CLASS(pi_bringup::SimulatedMicrophoneNodelet, nodelet::Nodelet)
