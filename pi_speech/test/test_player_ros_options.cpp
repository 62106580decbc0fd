// config/player.yaml and the defaults in the code must be the same, and impossible values must be named.

#include <gtest/gtest.h>
#include <pi_runtime/test_support/yaml_parameters.h>
#include <pi_speech/ros/player_ros_options.h>

#include <set>
#include <stdexcept>
#include <string>
#include <vector>

namespace pi_speech
{

using namespace pi_runtime::test_support;
namespace
{

using Names = std::vector<std::string>;

PlayerRosOptions load(const std::string& yaml, Names* unknown)
{
  return PlayerRosOptions::fromParameters(fromYaml(YAML::Load(yaml)), "/player/", unknown);
}

PlayerRosOptions load(const std::string& yaml)
{
  Names unknown;
  return load(yaml, &unknown);
}

std::string refusal(const std::string& yaml)
{
  try
  {
    load(yaml);
  }
  catch (const std::invalid_argument& error)
  {
    return error.what();
  }
  return "";
}

TEST(PlayerRosOptions, DefaultsAreThoseOfTheYamlFile)
{
  const XmlRpc::XmlRpcValue yaml = fromYaml(YAML::LoadFile(PLAYER_YAML));
  Names unknown;
  const PlayerRosOptions options = PlayerRosOptions::fromParameters(yaml, "", &unknown);
  EXPECT_EQ(Names(), unknown);
  EXPECT_EQ(PlayerRosOptions().toText(), options.toText());
  std::set<std::string> in_file;
  std::set<std::string> in_code;
  collectNames(yaml, "", &in_file);
  collectNames(PlayerRosOptions().toParameters(), "", &in_code);
  EXPECT_EQ(in_code, in_file);
}

TEST(PlayerRosOptions, FilesAreATextOrAList)
{
  EXPECT_EQ(Names({"/a.wav"}), load("files: /a.wav").files.entries);
  EXPECT_EQ(Names({"/a.wav", "/folder"}), load("files: [/a.wav, /folder]").files.entries);
  EXPECT_EQ(Names(), load("files: \"\"").files.entries);
  EXPECT_EQ("parameter /player/files = 5, must be a text or a list of texts", refusal("files: 5"));
  EXPECT_EQ(0u, refusal("files: [/a.wav, b.wav]").find("parameter /player/files = \"b.wav\", must be absolute paths"));
}

TEST(PlayerRosOptions, ParametersComeBackAsTheyWere)
{
  PlayerRosOptions options;
  options.files.entries = {"/a.wav", "/b"};
  options.rate = 4.0;
  options.loop = true;
  options.start_when_subscribed = false;
  Names unknown;
  const PlayerRosOptions again = PlayerRosOptions::fromParameters(options.toParameters(), "", &unknown);
  EXPECT_EQ(options.toText(), again.toText());
  EXPECT_EQ(options.files.entries, again.files.entries);
}

TEST(PlayerRosOptions, NamesParameterValueAndBound)
{
  Names unknown;
  load("{file: /a.wav}", &unknown);
  EXPECT_EQ(Names({"/player/file"}), unknown);
  EXPECT_EQ("parameter /player/rate = 0, must be in [0.01, 1000]", refusal("rate: 0"));
  EXPECT_EQ("parameter /player/gap_s = -1, must be in [0, 60]", refusal("gap_s: -1"));
  EXPECT_EQ("parameter /player/period_s = 2, must be in [0.002, 1]", refusal("period_s: 2"));
  EXPECT_EQ("parameter /player/loop = 1, must be true or false", refusal("loop: 1"));
}

}  // namespace
}  // namespace pi_speech
