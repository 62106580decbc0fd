#pragma once

#include <ros/ros.h>

#include <iostream>
#include <sstream>
#include <string>

namespace pi_os_transport_bench
{
/// Runs a node of the benchmark: callbacks in one thread, commands from standard input in the calling one. Answers
/// "up", then hands each line to `node`.obey(command, rest of the line) until that returns false, the input ends or ROS
/// shuts down.
template <typename Node>
void serveCommands(Node* node)
{
  ros::AsyncSpinner spinner(1);
  spinner.start();
  std::cout << "@ {\"event\": \"up\"}" << std::endl;
  std::string line;
  while (ros::ok() && std::getline(std::cin, line))
  {
    std::istringstream words(line);
    std::string command;
    words >> command;
    if (!node->obey(command, words))
    {
      break;
    }
  }
  spinner.stop();
}
}  // namespace pi_os_transport_bench
