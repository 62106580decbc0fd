#include <nodelet/nodelet.h>
#include <pi_speech/ros/player_ros.h>
#include <pluginlib/class_list_macros.hpp>

#include <exception>
#include <memory>

namespace pi_speech
{

class PlayerNodelet : public nodelet::Nodelet
{
private:
  void onInit() override
  {
    try
    {
      player_ = std::make_unique<PlayerRos>(getNodeHandle(), getPrivateNodeHandle());
    }
    catch (const std::exception& error)
    {
      NODELET_FATAL_STREAM_NAMED("player", error.what());
      throw;
    }
  }

  std::unique_ptr<PlayerRos> player_;
};

}  // namespace pi_speech

PLUGINLIB_EXPORT_CLASS(pi_speech::PlayerNodelet, nodelet::Nodelet)
