#pragma once

#include <pi_node/test_support/on_graph.h>
#include <pi_speech/AudioDataStamped.h>
#include <pi_speech/AudioInfo.h>
#include <pi_speech/ros/audio_conversions.h>

#include <string>
#include <vector>

namespace pi_speech
{

using namespace pi_node::test_support;

/// Keeps the sound of a node.
class SoundCollector
{
public:
  /// @param node  namespace of its topics.
  explicit SoundCollector(const std::string& node)
    : info_("/" + node + "/audio_info"), audio_("/" + node + "/audio_stamped", 0)
  {
  }

  const Collector<AudioInfo>& info() const { return info_; }
  std::vector<boost::shared_ptr<const AudioDataStamped>> messages() const { return audio_.messages(); }

  /// Waits for so many samples.
  bool waitFor(size_t count) const
  {
    size_t found = 0;
    return audio_.waitFor(
        [&found, count](const AudioDataStamped& message)
        {
          found += message.audio.data.size() / 2;
          return found >= count;
        });
  }
  std::vector<int16_t> samples() const
  {
    std::vector<int16_t> samples;
    std::vector<int16_t> part;
    for (const auto& message : audio_.messages())
    {
      fromMsg(message->audio, AudioFormat(), &part);
      samples.insert(samples.end(), part.begin(), part.end());
    }
    return samples;
  }

private:
  Collector<AudioInfo> info_;
  Collector<AudioDataStamped> audio_;
};

}  // namespace pi_speech
