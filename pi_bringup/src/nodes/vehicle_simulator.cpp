#include <pi_bringup/ros/vehicle_simulator_ros.h>
#include <ros/ros.h>

#include <exception>

int main(int argc, char** argv)
{
  ros::init(argc, argv, "vehicle_simulator");
  const ros::NodeHandle node;  // outlives the simulator: roscpp ends with the last handle, and its log with it
  try
  {
    pi_bringup::VehicleSimulatorRos simulator(node, ros::NodeHandle("~"));
    ros::spin();
    return 0;
  }
  catch (const std::exception& error)
  {
    ROS_FATAL_STREAM_NAMED("simulator", error.what());
    return 1;
  }
}
