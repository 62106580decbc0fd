#pragma once

#include <pi_speech/audio.h>

#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>
#include <set>
#include <string>
#include <vector>

namespace pi_speech
{

struct SoundCheckOptions
{
  double clipped_share = 0.005;      ///< part of a window's samples at full scale from which it is clipped, in (0, 1]
  double silent_level_dbfs = -75.0;  ///< level below which a window is silent [dB of full scale], in [-120, 0]
  double silent_s = 10.0;            ///< of silence until it is reported [s], in [1, 3600]
  double missing_s = 2.0;            ///< without a sample until it is reported [s], in [0.1, 3600]
  double window_s = 1.0;             ///< over which level and share are measured [s], in [0.05, 10]

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
};

enum class SoundState
{
  GOOD,
  CLIPPED,     ///< too loud for the microphone's gain
  OFFSET,      ///< far from 0 in the mean: a faulty device or cable
  CANCELLING,  ///< channels in antiphase: their mean, which is recognised, is silence
  DEAD,        ///< a channel without sound
  NARROW,      ///< a lower rate than that of the models
  SILENT,      ///< samples come, but nothing is in them
  MISSING,     ///< no samples come
};
const char* toString(SoundState state);

/// A change of state, with a text for users.
struct SoundChange
{
  SoundState state = SoundState::GOOD;
  std::string text;  ///< figure, its bound and the way out
};

/// Watches the sound of a microphone for faults, before resampling, which hides clipped samples. Not thread safe.
class SoundCheck
{
public:
  /// @param now_ns  monotonic time from which sound is expected.
  /// @throws std::invalid_argument for wrong options.
  SoundCheck(const SoundCheckOptions& options, int64_t now_ns);

  /// @param samples  interleaved. A format other than before begins a new window.
  /// @return the change, once.
  std::optional<SoundChange> add(const AudioFormat& format, const int16_t* samples, size_t count, int64_t now_ns);
  /// To be called regularly while no sound comes.
  std::optional<SoundChange> look(int64_t now_ns);

  SoundState state() const { return state_; }
  double levelDbfs() const { return level_dbfs_; }        ///< of the last window; at least -120
  double clippedShare() const { return clipped_share_; }  ///< in the last window
  uint64_t windows() const { return windows_; }

  static constexpr int CLIPPED_FROM = 32700;  ///< some converters stop a little below full scale

private:
  struct Sums
  {
    double sum = 0.0;
    double squares = 0.0;
    double variance(double count) const;
  };
  void beginWindow();
  std::optional<SoundChange> endWindow();
  /// Of a window with sound in it: what is wrong with device or cable, or nothing.
  std::optional<SoundChange> look(const std::vector<double>& variances, double frames);
  std::optional<SoundChange> change(SoundState state, const std::string& text);

  const SoundCheckOptions options_;
  SoundState state_ = SoundState::GOOD;
  AudioFormat format_;
  int64_t heard_ns_;  ///< last sample
  uint64_t windows_ = 0;
  double level_dbfs_ = -120.0;
  double clipped_share_ = 0.0;
  double silent_for_s_ = 0.0;

  // Of the window that is not full yet.
  size_t count_ = 0;
  size_t clipped_ = 0;
  std::vector<Sums> channels_;
  Sums mean_;                  ///< of the channels' means
  double frame_ = 0.0;         ///< sum over the channels of the frame in progress
  std::set<SoundState> told_;  ///< faults of the device, each once per format
};

/// Which part of a stream's last seconds was clipped. Not thread safe.
class ClippingRecord
{
public:
  static constexpr double KEPT_S = 8.0;

  /// @param end  sample of the stream behind these ones, which may be at another rate.
  void add(const int16_t* samples, size_t count, int64_t end);
  /// Share at full scale of what came since a sample of the stream; 0 if nothing did.
  double shareSince(int64_t begin) const;

private:
  struct Chunk
  {
    int64_t end;
    size_t clipped;
    size_t count;
  };
  std::deque<Chunk> chunks_;
};

}  // namespace pi_speech
