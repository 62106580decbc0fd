#include <pi_node/ros/adapter_nodelet.h>
#include <pluginlib/class_list_macros.hpp>

#include "ros/microphone_ros.h"
#include "ros/player_ros.h"
#include "ros/recognizer_ros.h"

namespace pi_speech
{

using MicrophoneNodelet = pi_node::AdapterNodelet<MicrophoneRos>;
using PlayerNodelet = pi_node::AdapterNodelet<PlayerRos>;
using RecognizerNodelet = pi_node::AdapterNodelet<RecognizerRos>;

}  // namespace pi_speech

PLUGINLIB_EXPORT_CLASS(pi_speech::MicrophoneNodelet, nodelet::Nodelet)
PLUGINLIB_EXPORT_CLASS(pi_speech::PlayerNodelet, nodelet::Nodelet)
PLUGINLIB_EXPORT_CLASS(pi_speech::RecognizerNodelet, nodelet::Nodelet)
