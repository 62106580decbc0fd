// config/joystick.yaml and the defaults in the code must be the same, and impossible values must be named.

#include "ros/joystick_ros.h"

#include <gtest/gtest.h>
#include <pi_node/test_support/options_reader.h>

namespace pi_vehicle
{

using namespace pi_node::test_support;
namespace
{

const OptionsReader<JoystickRosOptions> joystick_reader("/joystick/");

TEST(JoystickRosOptions, DefaultsAreThoseOfTheYamlFile)
{
  joystick_reader.expectDefaultsOf(JOYSTICK_YAML);
}

TEST(JoystickRosOptions, NamesParameterValueAndBound)
{
  EXPECT_EQ("parameter /joystick/rate = 5, must be in [10, 200]", joystick_reader.refusal("rate: 5"));
  EXPECT_EQ("parameter /joystick/speed_axis = -1, must be in [0, 255]", joystick_reader.refusal("speed_axis: -1"));
  EXPECT_EQ("parameter /joystick/emergency_button = 4, must be another button than dead_man_button",
            joystick_reader.refusal("emergency_button: 4"));
}

}  // namespace
}  // namespace pi_vehicle
