// config/navigation.yaml and the defaults in the code must be the same, and impossible values must be named.

#include "ros/navigation/navigation_ros_options.h"

#include <gtest/gtest.h>
#include <pi_node/test_support/options_reader.h>

#include <string>

namespace pi_vehicle
{

using namespace pi_node::test_support;
namespace
{

const OptionsReader<NavigationRosOptions> navigation_reader("/navigation/");

TEST(NavigationRosOptions, DefaultsAreThoseOfTheYamlFile)
{
  navigation_reader.expectDefaultsOf(NAVIGATION_YAML);
}

TEST(NavigationRosOptions, ParametersComeBackAsTheyWere)
{
  NavigationRosOptions options;
  options.rate_hz = 50.0;
  options.navigator.need_obstacles = false;
  options.navigator.blocked_after_s = 60.0;
  options.navigator.route.corridor = 0.5;
  options.navigator.follower.goal_tolerance = 0.4;
  options.navigator.governor.stop_gap = 2.0;
  options.places["gate"] = {{12.0, -3.5}, 1.5};
  options.places["yard"] = {{1.0, 2.0}, std::nullopt};
  Names unknown;
  const NavigationRosOptions again = NavigationRosOptions::fromParameters(options.toParameters(), "", &unknown);
  EXPECT_EQ(Names(), unknown);
  EXPECT_EQ(options.toText(), again.toText());
  EXPECT_NE(NavigationRosOptions().toText(), again.toText());
}

TEST(NavigationRosOptions, PlacesHaveAHeadingOrNone)
{
  const Places places = navigation_reader.load("places: {gate: [12, -3.5, 1.5], yard: [1.0, 2.0]}").places;
  ASSERT_EQ(2u, places.size());
  EXPECT_EQ(Eigen::Vector2d(12.0, -3.5), places.at("gate").position);
  EXPECT_EQ(1.5, places.at("gate").heading.value());
  EXPECT_FALSE(places.at("yard").heading);
  EXPECT_TRUE(navigation_reader.load("places: {}").places.empty());
}

TEST(NavigationRosOptions, TakeTheVehicleBeforeTheyAreJudged)
{
  pi_node::VehicleDescription vehicle;
  vehicle.footprint.front = 2.0;
  vehicle.limits.deceleration = 2.0;
  vehicle.limits.curvature = 0.5;
  Names unknown;
  const XmlRpc::XmlRpcValue tree = fromYaml(YAML::Load("follower: {deceleration: 1.5}"));
  const auto& navigator = NavigationRosOptions::fromParameters(tree, "", vehicle, &unknown).navigator;
  EXPECT_EQ(1.5, navigator.follower.deceleration);
  EXPECT_EQ(2.0, navigator.governor.footprint.front);
  EXPECT_EQ(2.0, navigator.governor.limits.deceleration);
  EXPECT_EQ(2.0, navigator.route.min_radius);
}

TEST(NavigationRosOptions, NamesUnknownParameters)
{
  Names unknown;
  NavigationRosOptions::fromParameters(fromYaml(YAML::Load("{rate: 1, follower: {jerk: 2}}")), "/navigation/",
                                       &unknown);
  EXPECT_EQ((Names{"/navigation/follower/jerk", "/navigation/rate"}), unknown);
}

TEST(NavigationRosOptions, NamesParameterValueAndBound)
{
  EXPECT_EQ("parameter /navigation/rate_hz = 1, must be in [10, 100]", navigation_reader.refusal("rate_hz: 1"));
  EXPECT_EQ("parameter /navigation/follower/deceleration = 2, must be in [0.05, 1] (vehicle/limits/deceleration)",
            navigation_reader.refusal("follower: {deceleration: 2}"));
  EXPECT_EQ("parameter /navigation/governor/rise = fast, must be a number",
            navigation_reader.refusal("governor: {rise: fast}"));
  EXPECT_EQ("parameter /navigation/max_position_deviation = 0, must be in [0.01, 100]",
            navigation_reader.refusal("max_position_deviation: 0"));
  EXPECT_EQ("parameter /navigation/need_obstacles = perhaps, must be true or false",
            navigation_reader.refusal("need_obstacles: perhaps"));
  EXPECT_EQ("parameter /navigation/base_link_frame = \"map\", must be a name other than map_frame",
            navigation_reader.refusal("base_link_frame: map"));
  EXPECT_EQ(
      0u,
      navigation_reader.refusal("places: {gate: [1]}").find("parameter /navigation/places/gate = {1}, must be [x, y]"))
      << navigation_reader.refusal("places: {gate: [1]}");
  EXPECT_NE("", navigation_reader.refusal("places: {gate: [1, two]}"));
  EXPECT_NE("", navigation_reader.refusal("places: {gate: [.nan, 1]}"));
  EXPECT_EQ("parameter /navigation/places = 5, must be a map of names to [x, y] or [x, y, heading]",
            navigation_reader.refusal("places: 5"));
}

}  // namespace
}  // namespace pi_vehicle
