// config/simulated_microphone.yaml and the defaults in the code must be the same, and impossible values must be named.

#include "ros/simulated_microphone_ros_options.h"

#include <gtest/gtest.h>
#include <pi_node/test_support/options_reader.h>

#include <string>

namespace pi_simulation
{

using namespace pi_node::test_support;
namespace
{

using Reader = OptionsReader<SimulatedMicrophoneRosOptions>;

TEST(SimulatedMicrophoneRosOptions, DefaultsAreThoseOfTheYamlFile)
{
  Reader::expectDefaultsOf(MICROPHONE_YAML);
}

TEST(SimulatedMicrophoneRosOptions, ParametersComeBackAsTheyWere)
{
  const Reader reader("/microphone/");
  const SimulatedMicrophoneRosOptions options =
      reader.load("{seed: 4, background: /a/b.wav, play_gain_db: -3.5, frame_id: head}");
  EXPECT_EQ(4, options.mixer.seed);
  EXPECT_EQ("/a/b.wav", options.mixer.background);
  EXPECT_EQ(-3.5, options.mixer.play_gain_db);
  EXPECT_EQ("head", options.frame_id);
  Names unknown;
  EXPECT_EQ(options.toText(),
            SimulatedMicrophoneRosOptions::fromParameters(options.toParameters(), "", &unknown).toText());
}

TEST(SimulatedMicrophoneRosOptions, NamesParameterValueAndBound)
{
  const Reader reader("/microphone/");
  EXPECT_EQ("parameter /microphone/noise_level_dbfs = 1, must be in [-120, 0]", reader.refusal("noise_level_dbfs: 1"));
  EXPECT_EQ("parameter /microphone/seed = much, must be a whole number", reader.refusal("seed: much"));
  EXPECT_TRUE(begins(reader.refusal("background: hum.wav"),
                     "parameter /microphone/background = \"hum.wav\", must be white, pink, wind, or an"))
      << reader.refusal("background: hum.wav");
  Names unknown;
  reader.load("{level: 1}", &unknown);
  EXPECT_EQ(Names{"/microphone/level"}, unknown);
}

}  // namespace
}  // namespace pi_simulation
