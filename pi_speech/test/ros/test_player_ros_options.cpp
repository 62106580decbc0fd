// config/player.yaml and the defaults in the code must be the same, and impossible values must be named.

#include <gtest/gtest.h>
#include <pi_node/test_support/options_reader.h>
#include "ros/player_ros_options.h"

#include <string>

namespace pi_speech
{

using namespace pi_node::test_support;
namespace
{

const OptionsReader<PlayerRosOptions> player_reader("/player/");

TEST(PlayerRosOptions, DefaultsAreThoseOfTheYamlFile)
{
  player_reader.expectDefaultsOf(PLAYER_YAML);
}

TEST(PlayerRosOptions, FilesAreATextOrAList)
{
  EXPECT_EQ(Names({"/a.wav"}), player_reader.load("files: /a.wav").files.entries);
  EXPECT_EQ(Names({"/a.wav", "/folder"}), player_reader.load("files: [/a.wav, /folder]").files.entries);
  EXPECT_EQ(Names(), player_reader.load("files: \"\"").files.entries);
  EXPECT_EQ("parameter /player/files = 5, must be a text or a list of texts", player_reader.refusal("files: 5"));
  EXPECT_EQ(0u, player_reader.refusal("files: [/a.wav, b.wav]")
                    .find("parameter /player/files = \"b.wav\", must be absolute paths"));
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
  player_reader.load("{file: /a.wav}", &unknown);
  EXPECT_EQ(Names({"/player/file"}), unknown);
  EXPECT_EQ("parameter /player/rate = 0, must be in [0.01, 1000]", player_reader.refusal("rate: 0"));
  EXPECT_EQ("parameter /player/gap_s = -1, must be in [0, 60]", player_reader.refusal("gap_s: -1"));
  EXPECT_EQ("parameter /player/period_s = 2, must be in [0.002, 1]", player_reader.refusal("period_s: 2"));
  EXPECT_EQ("parameter /player/loop = 1, must be true or false", player_reader.refusal("loop: 1"));
}

}  // namespace
}  // namespace pi_speech
