// Messages of sound and back; what cannot be understood says why and what to set.

#include "audio/sound_bytes.h"

#include <gtest/gtest.h>
#include <pi_speech/ros/audio_conversions.h>
#include <ros/message_traits.h>

#include <functional>
#include <stdexcept>
#include <string>
#include <vector>

namespace pi_speech
{
namespace
{

std::string refusal(const std::function<void()>& call)
{
  try
  {
    call();
  }
  catch (const std::invalid_argument& error)
  {
    return error.what();
  }
  return "";
}

std::string refusalOfInfo(const std::function<void(AudioInfo*)>& change)
{
  AudioInfo info = toMsg(AudioFormat());
  change(&info);
  return refusal([&info] { fromMsg(info); });
}

TEST(AudioConversions, FormatGoesThereAndBack)
{
  const AudioFormat format{48000, 2};
  const AudioInfo info = toMsg(format);
  EXPECT_EQ(2, info.channels);
  EXPECT_EQ(48000u, info.sample_rate);
  EXPECT_EQ("S16LE", info.sample_format);
  EXPECT_EQ("wave", info.coding_format);
  EXPECT_EQ(48000u * 2 * 16, info.bitrate);
  EXPECT_EQ(format, fromMsg(info));
  EXPECT_EQ((AudioFormat{192000, 16}), fromMsg(toMsg(AudioFormat{192000, 16})));
}

TEST(AudioConversions, SamplesGoThereAndBackAsLittleEndian)
{
  const std::vector<int16_t> samples = {0, 1, -1, 0x1234, -32768, 32767};
  std_msgs::Header header;
  header.stamp = ros::Time(12, 34);
  header.frame_id = "microphone";
  const AudioDataStamped message = toMsg(samples.data(), samples.size(), header);
  EXPECT_EQ(header.stamp, message.header.stamp);
  EXPECT_EQ("microphone", message.header.frame_id);
  EXPECT_EQ(sampleBytes(samples), std::string(message.audio.data.begin(), message.audio.data.end()));
  std::vector<int16_t> again = {7};
  fromMsg(message.audio, AudioFormat{16000, 2}, &again);
  EXPECT_EQ(samples, again);
  fromMsg(AudioData(), AudioFormat(), &again);
  EXPECT_TRUE(again.empty());
}

TEST(AudioConversions, FormatThatIsNotUnderstoodSaysTheWayOut)
{
  EXPECT_EQ(
      "coding_format = \"mp3\", must be wave: compressed sound is not understood; set ~format of audio_capture to "
      "wave",
      refusalOfInfo([](AudioInfo* info) { info->coding_format = "mp3"; }));
  EXPECT_EQ("sample_format = \"F32LE\", must be S16LE; set ~sample_format and ~depth of audio_capture to S16LE and 16",
            refusalOfInfo([](AudioInfo* info) { info->sample_format = "F32LE"; }));
  EXPECT_EQ("sample_rate = 0, must be in [4000, 192000]",
            refusalOfInfo([](AudioInfo* info) { info->sample_rate = 0; }));
  EXPECT_EQ("sample_rate = 2147483647, must be in [4000, 192000]",
            refusalOfInfo([](AudioInfo* info) { info->sample_rate = 0xFFFFFFFF; }));
  EXPECT_EQ("channels = 0, must be in [1, 16]", refusalOfInfo([](AudioInfo* info) { info->channels = 0; }));
  EXPECT_EQ("channels = 17, must be in [1, 16]", refusalOfInfo([](AudioInfo* info) { info->channels = 17; }));
}

TEST(AudioConversions, CodingFormatMayStandInCapitalsAsInTheCommentOfAudioCommon)
{
  EXPECT_EQ("", refusalOfInfo([](AudioInfo* info) { info->coding_format = "WAVE"; }));
}

TEST(AudioConversions, BytesThatAreNoWholeFramesAreRefused)
{
  AudioData data;
  data.data.resize(6);
  std::vector<int16_t> samples = {1};
  EXPECT_EQ("", refusal([&] { fromMsg(data, AudioFormat{16000, 1}, &samples); }));
  EXPECT_EQ(
      "audio.data has 6 bytes, must be a multiple of 4: signed 16 bit, channels = 2; does audio_info belong to "
      "this sound?",
      refusal(
          [&] {
            fromMsg(data, AudioFormat{16000, 2}, &samples);
          }));
  EXPECT_TRUE(samples.empty());
  data.data.resize(7);
  EXPECT_EQ(0u, refusal([&] { fromMsg(data, AudioFormat{16000, 1}, &samples); }).find("audio.data has 7 bytes"));
}

/// The sums of audio_common_msgs 0.3, by which roscpp connects.
TEST(AudioConversions, MessagesConnectWithThoseOfAudioCommon)
{
  EXPECT_STREQ("f43a8e1b362b75baa741461b46adc7e0", ros::message_traits::md5sum<AudioData>());
  EXPECT_STREQ("3cdd84a06846af0dca4d0434908f9d96", ros::message_traits::md5sum<AudioDataStamped>());
  EXPECT_STREQ("9413d9b7029680d3b1db6ed0ae535f88", ros::message_traits::md5sum<AudioInfo>());
}

}  // namespace
}  // namespace pi_speech
