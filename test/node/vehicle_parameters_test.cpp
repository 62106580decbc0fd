#include <gtest/gtest.h>
#include <pi_node/ros/vehicle_parameters.h>
#include <pi_node/test_support/message_of.h>
#include <ros/ros.h>

#include <stdexcept>
#include <string>

namespace
{

using namespace pi_node;

void put(const std::string& parameter, const std::string& name)
{
  VehicleDescription vehicle;
  vehicle.name = name;
  ros::param::set(parameter, toParameters(vehicle));
}

std::string nameFor(const std::string& node)
{
  return loadVehicle(ros::NodeHandle(node)).name;
}

std::string refusalFor(const std::string& node)
{
  return test_support::messageOf<std::invalid_argument>([&node] { nameFor(node); });
}

TEST(VehicleParameters, TheNearestDescriptionUpwardsCounts)
{
  EXPECT_EQ(0u,
            refusalFor("/a/navigation").find("parameter vehicle is neither in /a/navigation nor above: rosparam load"));
  put("/vehicle", "one");
  put("/b/vehicle", "two");
  put("/b/navigation/vehicle", "three");
  EXPECT_EQ("one", nameFor("/navigation"));
  EXPECT_EQ("one", nameFor("/a/navigation"));
  EXPECT_EQ("two", nameFor("/b/arbiter"));
  EXPECT_EQ("three", nameFor("/b/navigation"));
}

TEST(VehicleParameters, AWrongOneIsNamedWhereItIs)
{
  put("/c/vehicle", "four");
  ros::param::set("/c/vehicle/limits/speed", 50.0);
  EXPECT_EQ("parameter /c/vehicle/limits/speed = 50, must be in [0.1, 10]", refusalFor("/c/navigation"));
  ros::param::set("/d/vehicle", "my car");
  EXPECT_EQ("parameter /d/vehicle = my car, must be a map as in config/vehicle.yaml of pi_node",
            refusalFor("/d/navigation"));
}

}  // namespace

int main(int argc, char** argv)
{
  testing::InitGoogleTest(&argc, argv);
  ros::init(argc, argv, "vehicle_parameters_test");
  const ros::NodeHandle node;
  return RUN_ALL_TESTS();
}
