// config/microphone.yaml and the defaults in the code must be the same, and impossible values must be named.

#include <gtest/gtest.h>
#include <pi_node/test_support/options_reader.h>
#include "ros/microphone_ros_options.h"

#include <string>

namespace pi_speech
{

using namespace pi_node::test_support;
namespace
{

const OptionsReader<MicrophoneRosOptions> microphone_reader("/microphone/");

TEST(MicrophoneRosOptions, DefaultsAreThoseOfTheYamlFile)
{
  microphone_reader.expectDefaultsOf(MICROPHONE_YAML);
}

TEST(MicrophoneRosOptions, ParametersComeBackAsTheyWere)
{
  MicrophoneRosOptions options;
  options.microphone.device = "USB PnP";
  options.microphone.format = AudioFormat{48000, 2};
  options.microphone.period_s = 0.05;
  options.check.silent_s = 3.0;
  options.frame_id = "mast";
  Names unknown;
  const MicrophoneRosOptions again = MicrophoneRosOptions::fromParameters(options.toParameters(), "", &unknown);
  EXPECT_EQ(options.toText(), again.toText());
  EXPECT_EQ(options.microphone.format, again.microphone.format);
  EXPECT_NE(MicrophoneRosOptions().toText(), again.toText());
}

TEST(MicrophoneRosOptions, NamesUnknownParameters)
{
  Names unknown;
  microphone_reader.load("{device: hw, rate: 16000, check: {missing_s: 2}}", &unknown);
  EXPECT_EQ((Names{"/microphone/check/missing_s", "/microphone/rate"}), unknown);
}

TEST(MicrophoneRosOptions, NamesParameterValueAndBound)
{
  EXPECT_EQ("parameter /microphone/sample_rate = 100, must be in [4000, 192000]",
            microphone_reader.refusal("sample_rate: 100"));
  EXPECT_EQ("parameter /microphone/sample_rate = 16k, must be a whole number",
            microphone_reader.refusal("sample_rate: 16k"));
  EXPECT_EQ("parameter /microphone/period_s = 0, must be in [0.002, 1]", microphone_reader.refusal("period_s: 0"));
  EXPECT_EQ(
      0u,
      microphone_reader.refusal("device: \"\"").find("parameter /microphone/device = \"\", must be a name of ALSA"));
  EXPECT_EQ("parameter /microphone/check/silent_s = 0, must be in [1, 3600]",
            microphone_reader.refusal("check: {silent_s: 0}"));
  EXPECT_EQ("parameter /microphone/diagnostic_period = 0, must be in (0, 3600]",
            microphone_reader.refusal("diagnostic_period: 0"));
}

}  // namespace
}  // namespace pi_speech
