// config/tracker.yaml and the defaults in the code must be the same, and impossible values must be named.

#include <gtest/gtest.h>
#include <pi_node/test_support/options_reader.h>
#include "ros/tracker_ros_options.h"

namespace pi_detect
{

using namespace pi_node::test_support;
namespace
{

const OptionsReader<TrackerRosOptions> tracker_reader("/tracker/");

TEST(TrackerRosOptions, DefaultsAreThoseOfTheYamlFile)
{
  tracker_reader.expectDefaultsOf(TRACKER_YAML);
}

TEST(TrackerRosOptions, NamesWhatIsWrong)
{
  Names unknown;
  tracker_reader.load("{tracker: {high: 0.5}, always: true}", &unknown);
  EXPECT_EQ((Names{"/tracker/always", "/tracker/tracker/high"}), unknown);
  EXPECT_EQ("parameter /tracker/warning_period_s = 0, must be in (0, 3600]",
            tracker_reader.refusal("warning_period_s: 0"));
  EXPECT_EQ("parameter /tracker/tracker/low_score = 0.6, must be in [0, 0.5]",
            tracker_reader.refusal("tracker: {high_score: 0.5, low_score: 0.6}"));
  EXPECT_EQ("", tracker_reader.refusal("tracker: {low_score: 0.6}")) << "the network's high score may be above";
  EXPECT_TRUE(
      begins(tracker_reader.refusal("tracker: {confirm_hits: 0}"), "parameter /tracker/tracker/confirm_hits = 0"))
      << tracker_reader.refusal("tracker: {confirm_hits: 0}");
}

}  // namespace
}  // namespace pi_detect
