#include <nodelet/nodelet.h>
#include <pi_speech/ros/recognizer_ros.h>
#include <pluginlib/class_list_macros.hpp>

#include <exception>
#include <memory>

namespace pi_speech
{

class RecognizerNodelet : public nodelet::Nodelet
{
private:
  void onInit() override
  {
    try
    {
      recognizer_ = std::make_unique<RecognizerRos>(getNodeHandle(), getPrivateNodeHandle());
    }
    catch (const std::exception& error)
    {
      NODELET_FATAL_STREAM_NAMED("recognizer", error.what());
      throw;
    }
  }

  std::unique_ptr<RecognizerRos> recognizer_;
};

}  // namespace pi_speech

PLUGINLIB_EXPORT_CLASS(pi_speech::RecognizerNodelet, nodelet::Nodelet)
