#include <pi_node/option_check.h>
#include <pi_speech/ros/audio_conversions.h>

#include <algorithm>
#include <limits>
#include <stdexcept>
#include <string>

namespace pi_speech
{
namespace
{

constexpr char SAMPLE_FORMAT[] = "S16LE";
constexpr char CODING_FORMAT[] = "wave";  ///< as audio_capture names samples without a file around them

}  // namespace

AudioFormat fromMsg(const AudioInfo& message)
{
  if (message.coding_format != CODING_FORMAT && message.coding_format != "WAVE")
  {
    throw std::invalid_argument("coding_format = \"" + message.coding_format +
                                "\", must be wave: compressed sound is not understood; set ~format of audio_capture to "
                                "wave");
  }
  if (message.sample_format != SAMPLE_FORMAT)
  {
    throw std::invalid_argument("sample_format = \"" + message.sample_format +
                                "\", must be S16LE; set ~sample_format and ~depth of audio_capture to S16LE and 16");
  }
  AudioFormat format;
  format.sample_rate_hz =
      static_cast<int>(std::min<uint32_t>(message.sample_rate, std::numeric_limits<int32_t>::max()));
  format.channels = message.channels;
  format.validate();
  return format;
}

AudioInfo toMsg(const AudioFormat& format)
{
  AudioInfo message;
  message.channels = static_cast<uint8_t>(format.channels);
  message.sample_rate = static_cast<uint32_t>(format.sample_rate_hz);
  message.sample_format = SAMPLE_FORMAT;
  message.bitrate = static_cast<uint32_t>(format.sample_rate_hz * format.channels * 16);
  message.coding_format = CODING_FORMAT;
  return message;
}

void fromMsg(const AudioData& message, const AudioFormat& format, std::vector<int16_t>* samples)
{
  samples->clear();
  const size_t frame = 2 * static_cast<size_t>(format.channels);
  const std::vector<uint8_t>& data = message.data;
  if (data.size() % frame != 0)
  {
    throw std::invalid_argument(
        "audio.data has " + std::to_string(data.size()) + " bytes, must be a multiple of " + std::to_string(frame) +
        ": signed 16 bit, channels = " + std::to_string(format.channels) + "; does audio_info belong to this sound?");
  }
  samples->resize(data.size() / 2);
  for (size_t i = 0; i < samples->size(); ++i)
  {
    (*samples)[i] = static_cast<int16_t>(static_cast<uint16_t>(data[2 * i] | data[2 * i + 1] << 8));
  }
}

AudioDataStamped toMsg(const int16_t* samples, size_t count, const std_msgs::Header& header)
{
  AudioDataStamped message;
  message.header = header;
  message.audio.data.resize(2 * count);
  for (size_t i = 0; i < count; ++i)
  {
    const auto bits = static_cast<uint16_t>(samples[i]);
    message.audio.data[2 * i] = static_cast<uint8_t>(bits & 0xFF);
    message.audio.data[2 * i + 1] = static_cast<uint8_t>(bits >> 8);
  }
  return message;
}

}  // namespace pi_speech
