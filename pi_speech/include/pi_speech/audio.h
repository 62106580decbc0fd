#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

struct SRC_STATE_tag;

namespace pi_speech
{

/// Rate at which all sound is processed, in one channel [Hz].
constexpr int SAMPLE_RATE_HZ = 16000;

constexpr int FULL_SCALE = 32768;  ///< one more than the largest sample

/// Sound at SAMPLE_RATE_HZ, one channel, full scale = 32767.
using Samples = std::vector<int16_t>;

/// How a stream of sound is laid out: interleaved signed 16 bit, little endian.
struct AudioFormat
{
  int sample_rate_hz = SAMPLE_RATE_HZ;  ///< in [4000, 192000]
  int channels = 1;                     ///< in [1, 16]

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
};

bool operator==(const AudioFormat& a, const AudioFormat& b);
/// "16000 Hz, 1 channel"
std::string toString(const AudioFormat& format);

/// Converts a stream of any rate and number of channels to SAMPLE_RATE_HZ and one channel (the mean of all) with
/// libsamplerate. Not thread safe.
class Resampler
{
public:
  /// @throws std::invalid_argument if the format is not valid.
  explicit Resampler(const AudioFormat& format);

  const AudioFormat& format() const { return format_; }
  /// @param samples  interleaved; count is a multiple of the number of channels.
  /// @param out      converted samples are appended. Sound at SAMPLE_RATE_HZ in one channel passes unchanged at once.
  void process(const int16_t* samples, size_t count, Samples* out);
  /// Ends the stream and appends the samples that the filter still holds.
  void flush(Samples* out);

private:
  struct Free
  {
    void operator()(SRC_STATE_tag* state) const;
  };
  /// @param last  the stream ends with these.
  void resample(const float* values, size_t count, bool last, Samples* out);

  AudioFormat format_;
  std::unique_ptr<SRC_STATE_tag, Free> state_;  ///< null: the rate is right
  std::vector<float> mixed_;
  std::vector<float> resampled_;
};

/// Number of samples up to the end of speech, for evaluations that know the whole clip. Speech ends with the last piece
/// of 10 ms that is at most 25 dB below the loudest and 6 dB above the quietest tenth. All samples if there is none.
size_t endOfSpeech(const Samples& samples);

/// Reads a whole sound file: WAV, FLAC, Ogg and other formats of libsndfile, of any rate and number of channels. A file
/// whose name ends in .raw holds signed 16 bit, little endian, at SAMPLE_RATE_HZ in one channel.
/// @throws std::runtime_error naming the file, what is wrong and the way out: missing, no sound file, damaged, empty.
Samples readAudioFile(const std::string& path);

/// @throws std::runtime_error naming the file and the reason.
void writeWav(const std::string& path, const Samples& samples);

}  // namespace pi_speech
