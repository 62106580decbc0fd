#include <nodelet/nodelet.h>
#include <pi_speech/ros/microphone_ros.h>
#include <pluginlib/class_list_macros.hpp>

#include <exception>
#include <memory>

namespace pi_speech
{

class MicrophoneNodelet : public nodelet::Nodelet
{
private:
  void onInit() override
  {
    try
    {
      microphone_ = std::make_unique<MicrophoneRos>(getNodeHandle(), getPrivateNodeHandle());
    }
    catch (const std::exception& error)
    {
      NODELET_FATAL_STREAM_NAMED("microphone", error.what());
      throw;
    }
  }

  std::unique_ptr<MicrophoneRos> microphone_;
};

}  // namespace pi_speech

PLUGINLIB_EXPORT_CLASS(pi_speech::MicrophoneNodelet, nodelet::Nodelet)
