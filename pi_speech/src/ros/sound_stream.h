#pragma once

#include <pi_speech/audio.h>

#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>

namespace pi_speech
{

/// Joins chunks of sound with stamps to one stream at SAMPLE_RATE_HZ whose samples have times. The stream consists of
/// pieces: a chunk that does not continue the one before begins a new piece. Not thread safe.
class SoundStream
{
public:
  enum class Break
  {
    NONE,    ///< the chunk continues the piece, or is the first
    GAP,     ///< sound is missing before it
    BACK,    ///< its stamp is earlier than the end of the chunk before it
    FORMAT,  ///< its rate or number of channels is another one
  };

  /// @param max_gap_s  largest difference of a stamp and the end of the chunk before that is no break [s].
  explicit SoundStream(double max_gap_s);

  /// The break before a chunk. @param stamp_ns  when its first sample was recorded.
  Break look(const AudioFormat& format, int64_t stamp_ns) const;
  /// From the end of the last chunk to a stamp [s]; 0 where no piece has begun.
  double gapBefore(int64_t stamp_ns) const;

  /// Adds a chunk. The caller calls end() before if look() reports a break.
  /// @param samples  interleaved; count is a multiple of the number of channels.
  /// @param out      gets the next samples of the stream, at its end.
  void add(const AudioFormat& format, int64_t stamp_ns, const int16_t* samples, size_t count, Samples* out);
  /// Ends the piece: the next chunk begins another. @param out  gets what the resampler still has.
  void end(Samples* out);

  /// Number of samples of the stream so far.
  int64_t samples() const { return samples_; }
  /// When a sample was recorded [ns], by the stamp of its chunk; extrapolated for samples older than KEPT_S. 0 before
  /// the first sample.
  int64_t timeOf(int64_t sample) const;

  static constexpr double KEPT_S = 120.0;  ///< twice the longest utterance

private:
  struct Mark
  {
    int64_t sample;
    int64_t stamp_ns;
  };

  const int64_t max_gap_ns_;
  std::optional<Resampler> resampler_;
  int64_t samples_ = 0;
  bool begun_ = false;         ///< a piece has
  int64_t piece_begin_ = 0;    ///< its first sample
  int64_t piece_frames_ = 0;   ///< that came in it, at the rate of the input
  int64_t next_stamp_ns_ = 0;  ///< where the next chunk should begin
  std::deque<Mark> marks_;     ///< first samples of chunks
};

}  // namespace pi_speech
