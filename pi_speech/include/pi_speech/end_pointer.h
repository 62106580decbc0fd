#pragma once

#include <pi_speech/audio.h>
#include <pi_speech/filter_bank.h>

#include <array>
#include <cstdint>
#include <deque>
#include <functional>

namespace pi_speech
{

struct EndPointerOptions
{
  double begin_threshold = 0.7;   ///< least mean excess over the noise at which speech begins [ln of energy]
  double end_threshold = 0.5;     ///< least mean excess below which speech pauses
  double min_level_dbfs = -65.0;  ///< least level of speech, however quiet the noise [dB of full scale]
  double min_speech_s = 0.08;     ///< least speech in an utterance; shorter sounds are clicks
  double end_silence_s = 0.22;    ///< pause that ends an utterance; most of the latency of a command
  double early_silence_s = 0.07;  ///< pause after which fast commands are reported; 0: never
  double tail_s = 0.10;           ///< most sound after the speech that belongs to the utterance
  double lead_s = 0.20;           ///< sound before the speech that belongs to the utterance
  double max_utterance_s = 5.0;   ///< longer utterances are cut, and the noise is learned again

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
};

/// A piece of sound with speech in it. Times count samples since the stream's beginning.
struct Utterance
{
  int64_t begin = 0;         ///< of `samples`
  int64_t speech_begin = 0;  ///< first frame of speech
  int64_t speech_end = 0;    ///< end of the last frame of speech
  double snr_db = 0.0;       ///< of the speech over the noise before it
  bool cut = false;          ///< at max_utterance_s
  Samples samples;           ///< from lead_s before the speech to tail_s behind it, as far as there is sound
};

/// Finds speech in a stream of sound by the energy above a running estimate of the noise in each band.
///
/// The estimate follows pauses with a time constant of 0.3 s and rises slowly during speech. What a band does not fall
/// below for 1.5 s is noise, speech or not. In noise that fluctuates, as rain and motors do, both thresholds rise with
/// the mean and the spread of its excess. Not thread safe.
class EndPointer
{
public:
  enum class Event
  {
    BEGIN,  ///< speech has begun; the utterance has no end yet
    PAUSE,  ///< early_silence_s have passed since the speech: it may be the end
    END,    ///< end_silence_s have passed, or max_utterance_s are exceeded
  };
  using Sink = std::function<void(Event event, const Utterance& utterance)>;

  explicit EndPointer(const EndPointerOptions& options, Sink sink);

  /// Calls the sink, on this thread, for each event in these samples.
  void process(const int16_t* samples, size_t count);
  /// Ends an utterance in progress, because the stream ends or has a gap. Later utterances hold no sound from before
  /// it. The estimate of the noise stays.
  void flush();
  /// Forgets the noise and an utterance in progress, because another stream begins.
  void reset();

  bool inSpeech() const { return state_ != State::NOISE; }
  int64_t samplesSeen() const { return seen_; }
  /// Level of the noise [dB of full scale].
  double noiseLevelDbfs() const;

private:
  enum class State
  {
    NOISE,
    SPEECH,
  };
  void takeFrame(const int16_t* frame);
  void followFloor(const BandEnergies& energies);
  void learnNoise(const BandEnergies& energies, double power, bool speech);
  void tell(Event event, bool cut = false);
  void endUtterance(bool cut);

  const EndPointerOptions options_;
  const Sink sink_;
  FilterBank bank_;
  Samples buffer_;  ///< from buffer_begin_ on
  int64_t buffer_begin_ = 0;
  int64_t next_frame_ = 0;  ///< first sample of the next frame
  int64_t seen_ = 0;

  State state_ = State::NOISE;
  BandEnergies noise_;     ///< ln energies
  BandEnergies smoothed_;  ///< ln energies of the last frames
  /// Least of them in the block in progress and in the blocks before it: what does not fall below for 1.5 s is
  /// noise.
  std::array<BandEnergies, 5> least_;
  int block_frames_ = 0;
  double excess_ = 0.0;         ///< mean over bands and the last frames
  double excess_mean_ = 0.0;    ///< of noise
  double excess_spread_ = 0.0;  ///< of noise, mean deviation
  double noise_power_ = 0.0;    ///< mean square of the samples
  int noise_frames_ = 0;        ///< that the estimate has seen
  double speech_power_ = 0.0;   ///< sum of mean squares over the utterance's frames of speech
  int speech_frames_ = 0;       ///< of the utterance
  int pause_frames_ = 0;        ///< since the last one of speech
  bool begun_ = false;          ///< BEGIN was told
  bool paused_ = false;         ///< PAUSE was told since the last frame of speech
  int64_t speech_begin_ = 0;
  int64_t speech_end_ = 0;
};

}  // namespace pi_speech
