// config/microphone.yaml and the defaults in the code must be the same, and impossible values must be named.

#include <gtest/gtest.h>
#include <pi_runtime/test_support/yaml_parameters.h>
#include <pi_speech/ros/microphone_ros_options.h>

#include <set>
#include <stdexcept>
#include <string>
#include <vector>

namespace pi_speech
{

using namespace pi_runtime::test_support;
namespace
{

MicrophoneRosOptions load(const std::string& yaml, std::vector<std::string>* unknown)
{
  return MicrophoneRosOptions::fromParameters(fromYaml(YAML::Load(yaml)), "/microphone/", unknown);
}

std::string refusal(const std::string& yaml)
{
  try
  {
    std::vector<std::string> unknown;
    load(yaml, &unknown);
  }
  catch (const std::invalid_argument& error)
  {
    return error.what();
  }
  return "";
}

TEST(MicrophoneRosOptions, DefaultsAreThoseOfTheYamlFile)
{
  const XmlRpc::XmlRpcValue yaml = fromYaml(YAML::LoadFile(MICROPHONE_YAML));
  std::vector<std::string> unknown;
  const MicrophoneRosOptions options = MicrophoneRosOptions::fromParameters(yaml, "", &unknown);
  EXPECT_EQ(std::vector<std::string>(), unknown);
  EXPECT_EQ(MicrophoneRosOptions().toText(), options.toText());
  std::set<std::string> in_file;
  std::set<std::string> in_code;
  collectNames(yaml, "", &in_file);
  collectNames(MicrophoneRosOptions().toParameters(), "", &in_code);
  EXPECT_EQ(in_code, in_file);
}

TEST(MicrophoneRosOptions, ParametersComeBackAsTheyWere)
{
  MicrophoneRosOptions options;
  options.microphone.device = "USB PnP";
  options.microphone.format = AudioFormat{48000, 2};
  options.microphone.period_s = 0.05;
  options.check.silent_s = 3.0;
  options.frame_id = "mast";
  std::vector<std::string> unknown;
  const MicrophoneRosOptions again = MicrophoneRosOptions::fromParameters(options.toParameters(), "", &unknown);
  EXPECT_EQ(options.toText(), again.toText());
  EXPECT_EQ(options.microphone.format, again.microphone.format);
  EXPECT_NE(MicrophoneRosOptions().toText(), again.toText());
}

TEST(MicrophoneRosOptions, NamesUnknownParameters)
{
  std::vector<std::string> unknown;
  load("{device: hw, rate: 16000, check: {missing_s: 2}}", &unknown);
  EXPECT_EQ((std::vector<std::string>{"/microphone/check/missing_s", "/microphone/rate"}), unknown);
}

TEST(MicrophoneRosOptions, NamesParameterValueAndBound)
{
  EXPECT_EQ("parameter /microphone/sample_rate = 100, must be in [4000, 192000]", refusal("sample_rate: 100"));
  EXPECT_EQ("parameter /microphone/sample_rate = 16k, must be a whole number", refusal("sample_rate: 16k"));
  EXPECT_EQ("parameter /microphone/period_s = 0, must be in [0.002, 1]", refusal("period_s: 0"));
  EXPECT_EQ(0u, refusal("device: \"\"").find("parameter /microphone/device = \"\", must be a name of ALSA"));
  EXPECT_EQ("parameter /microphone/check/silent_s = 0, must be in [1, 3600]", refusal("check: {silent_s: 0}"));
  EXPECT_EQ("parameter /microphone/diagnostic_period = 0, must be in (0, 3600]", refusal("diagnostic_period: 0"));
}

}  // namespace
}  // namespace pi_speech
