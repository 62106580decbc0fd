#pragma once

#include <pi_speech/AudioData.h>
#include <pi_speech/AudioInfo.h>
#include <pi_speech/audio.h>
#include <ros/time.h>
#include <std_msgs/Header.h>

#include <chrono>
#include <cstdint>
#include <deque>
#include <string>

namespace pi_speech
{

/// A message of sound that waits for the recogniser.
struct SoundChunk
{
  AudioDataConstPtr audio;
  AudioFormat format;
  int64_t stamp_ns = 0;  ///< of the first sample
  std::string frame_id;
  std::chrono::steady_clock::time_point came_at;
  double duration_s = 0.0;
  bool after_loss = false;  ///< messages before it were dropped
};

/// Sound between its topic and the recogniser: gives each message format and stamp, and drops the oldest of too many.
/// Not thread safe.
class SoundQueue
{
public:
  struct Figures
  {
    AudioFormat format;         ///< of the sound that comes
    bool format_known = false;  ///< from audio_info
    std::string problem;        ///< why the sound cannot be used; empty: it can
    uint64_t chunks = 0;        ///< that came
    uint64_t dropped = 0;       ///< because the recogniser was busy
    uint64_t unusable = 0;      ///< that came while there was a problem
    double waiting_s = 0.0;     ///< sound in the queue
  };

  /// @param topic   of the sound, for warnings.
  /// @param format  of sound that comes before audio_info.
  /// @param most_s  of sound that may wait [s].
  SoundQueue(std::string topic, const AudioFormat& format, double most_s);

  /// @param header  a stamp of 0 means that the sound ends now.
  /// @param ready   false: messages that are dropped are not counted, because the recogniser is still being loaded.
  /// @return a warning; empty: none.
  std::string add(const AudioDataConstPtr& audio, const std_msgs::Header& header, bool ready);
  /// The oldest message. The queue must not be empty.
  SoundChunk take();
  bool empty() const { return chunks_.empty(); }
  void clear();

  /// Takes the format of the sound that comes. If the suite cannot use it, the sound is ignored until the next one.
  /// @param topic  of the message. @return a new problem; empty: none.
  std::string setInfo(const AudioInfo& info, const std::string& topic);

  const Figures& figures() const { return figures_; }

private:
  std::string noteMissingInfo(double duration_s);
  std::string dropOldest(bool ready);

  const std::string topic_;
  const double most_s_;
  std::deque<SoundChunk> chunks_;
  Figures figures_;
  double without_info_s_ = 0.0;  ///< sound that came before audio_info
};

}  // namespace pi_speech
