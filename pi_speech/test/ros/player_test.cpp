// Judge of player.test.

#include "audio/sound_bytes.h"
#include "ros/sound_on_graph.h"

#include <gtest/gtest.h>
#include <pi_node/test_support/temporary_folder.h>
#include <std_msgs/Empty.h>
#include <std_msgs/String.h>

#include <string>
#include <vector>

namespace pi_speech
{

using namespace pi_node::test_support;
namespace
{

/// Of a player that is loaded into a namespace of its name.
class Player
{
public:
  explicit Player(const std::string& name)
    : name_("/" + name + "/player"), sound(name), playing("/" + name + "/playing"), finished("/" + name + "/finished")
  {
  }
  ~Player()
  {
    if (loaded_)
    {
      unloadNodelet(name_);
    }
  }
  template <typename Value>
  void set(const std::string& parameter, const Value& value)
  {
    ros::param::set(name_ + "/" + parameter, value);
  }
  bool load()
  {
    loaded_ = loadNodelet(name_, "pi_speech/player");
    return loaded_;
  }
  bool waitUntilFinished() const
  {
    return finished.waitFor([](const std_msgs::Empty&) { return true; });
  }
  std::vector<std::string> played() const
  {
    std::vector<std::string> names;
    for (const auto& name : playing.messages())
    {
      names.push_back(name->data);
    }
    return names;
  }

private:
  const std::string name_;
  bool loaded_ = false;

public:
  SoundCollector sound;
  Collector<std_msgs::String> playing;
  Collector<std_msgs::Empty> finished;
};

TEST(Player, GivesTheSamplesOfItsFilesInOrderWithStampsThatFollowThem)
{
  const TemporaryFolder folder;
  const std::vector<int16_t> first = counting(5000, 1000);
  const std::vector<int16_t> second = counting(3333, 10000);
  const std::string first_file = folder.file("first.wav", wavBytes(SAMPLE_RATE_HZ, 1, first));
  const std::string broken_file = folder.file("broken.wav", "this is no sound");
  const std::string second_file = folder.file("second.raw", sampleBytes(second));
  LogCollector log;
  Player player("in_order");
  player.set("files", std::vector<std::string>{first_file, broken_file, second_file});
  player.set("gap_s", 0.1);
  player.set("gap_level_dbfs", -80.0);
  player.set("rate", 2.0);
  const ros::Time before = ros::Time::now();
  ASSERT_TRUE(log.waitForNode());
  ASSERT_TRUE(player.load());
  ASSERT_TRUE(player.waitUntilFinished()) << log.text();
  const size_t total = 5000 + 1600 + 3333 + 1600;
  ASSERT_TRUE(player.sound.waitFor(total));
  EXPECT_EQ((std::vector<std::string>{first_file, second_file}), player.played());
  EXPECT_TRUE(log.waitForText("sound file " + broken_file + ": is no sound that can be read")) << log.text();

  ASSERT_EQ(1u, player.sound.info().messages().size());
  EXPECT_EQ(AudioFormat(), fromMsg(*player.sound.info().last()));

  const std::vector<int16_t> samples = player.sound.samples();
  ASSERT_EQ(total, samples.size());
  auto at = samples.begin();
  EXPECT_EQ(first, std::vector<int16_t>(at, at + 5000));
  const std::vector<int16_t> gap(at + 5000, at + 6600);
  EXPECT_EQ(second, std::vector<int16_t>(at + 6600, at + 6600 + 3333));
  EXPECT_EQ(gap, std::vector<int16_t>(at + 6600 + 3333, samples.end()));
  double squares = 0.0;
  for (const int16_t sample : gap)
  {
    squares += static_cast<double>(sample) * sample;
  }
  // -80 dB is 3.3 steps; rounding adds a little, 1600 samples shake by 2 %.
  EXPECT_NEAR(3.28, std::sqrt(squares / 1600.0), 0.3);

  const auto messages = player.sound.messages();
  size_t count = 0;
  for (size_t i = 0; i < messages.size(); ++i)
  {
    EXPECT_EQ("microphone", messages[i]->header.frame_id);
    EXPECT_EQ(i + 1 < messages.size() ? 640u : 2 * (total % 320), messages[i]->audio.data.size());
    const ros::Duration since_first = messages[i]->header.stamp - messages[0]->header.stamp;
    EXPECT_EQ(static_cast<int64_t>(count * 62500), since_first.toNSec()) << i;  // also at twice the speed
    count += messages[i]->audio.data.size() / 2;
  }
  EXPECT_GE(messages[0]->header.stamp, before);
  EXPECT_LE(messages[0]->header.stamp, ros::Time::now());
}

TEST(Player, WaitsForASubscriberAndBeginsAnewWhenItLoops)
{
  const TemporaryFolder folder;
  const std::vector<int16_t> recorded = counting(500, 1);
  folder.file("only.wav", wavBytes(SAMPLE_RATE_HZ, 1, recorded));
  const std::string list = folder.file("list.tsv", "file\tword\nonly.wav\tgo\n");
  ros::param::set("/looping/player/files", list);
  ros::param::set("/looping/player/gap_s", 0.0);
  ros::param::set("/looping/player/loop", true);
  ros::param::set("/looping/player/rate", 5.0);
  ASSERT_TRUE(loadNodelet("/looping/player", "pi_speech/player"));
  {
    const Collector<AudioInfo> info("/looping/audio_info");
    ASSERT_TRUE(info.waitFor([](const AudioInfo&) { return true; }));  // it runs, and nobody listens to its sound
  }
  const ros::Time before = ros::Time::now();
  const Player player("looping");
  ASSERT_TRUE(player.sound.waitFor(1500));
  const std::vector<int16_t> samples = player.sound.samples();
  EXPECT_EQ(recorded, std::vector<int16_t>(samples.begin(), samples.begin() + 500));
  EXPECT_EQ(recorded, std::vector<int16_t>(samples.begin() + 500, samples.begin() + 1000));
  EXPECT_EQ(recorded, std::vector<int16_t>(samples.begin() + 1000, samples.begin() + 1500));
  EXPECT_GE(player.sound.messages().front()->header.stamp, before);
  EXPECT_TRUE(player.finished.messages().empty());
  EXPECT_TRUE(unloadNodelet("/looping/player"));  // in the middle of it
}

TEST(Player, FilesThatCannotBeReadAreNamedOnceAndThePlayerEnds)
{
  const Player player("nothing_to_play");
  LogCollector log;
  EXPECT_TRUE(player.waitUntilFinished());
  EXPECT_TRUE(player.played().empty());
  EXPECT_TRUE(player.sound.messages().empty());
  EXPECT_TRUE(ros::master::check());
}

TEST(Player, WithoutFilesIsRefusedWithTheNameOfTheParameter)
{
  LogCollector log;
  ASSERT_TRUE(log.waitForNode());
  EXPECT_FALSE(loadNodelet("/empty/player", "pi_speech/player"));
  EXPECT_TRUE(log.waitForText("parameter /empty/player/files is empty, must name what to play")) << log.text();
  ros::param::set("/empty/player/files", "/no/such/list.txt");
  EXPECT_FALSE(loadNodelet("/empty/player", "pi_speech/player"));
  EXPECT_TRUE(log.waitForText("list /no/such/list.txt cannot be read: No such file")) << log.text();
}

}  // namespace
}  // namespace pi_speech

int main(int argc, char** argv)
{
  return pi_speech::runOnGraph(argc, argv, "player_test");
}
