#pragma once

#include <pi_node/input_topic.h>

namespace pi_slam
{

struct VioTopics
{
  pi_node::InputTopic imu;
  pi_node::InputTopic wheels;       ///< without a name: there are none
  pi_node::InputTopic gnss;         ///< likewise
  pi_node::InputTopic pictures[2];  ///< LEFT, RIGHT
  pi_node::InputTopic infos[2];
};

}  // namespace pi_slam
