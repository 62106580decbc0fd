#include "ros/sensors/serial_imu_ros.h"

#include <pi_node/ros/node_main.h>

int main(int argc, char** argv)
{
  return pi_node::runNode<pi_vehicle::SerialImuRos>(argc, argv, "imu");
}
