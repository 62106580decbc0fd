#include "ros/sound_stream.h"

#include <algorithm>
#include <cmath>

namespace pi_speech
{
namespace
{

constexpr double NS = 1e9;

int64_t durationNs(int64_t samples, int rate_hz)
{
  return static_cast<int64_t>(std::llround(static_cast<double>(samples) * NS / rate_hz));
}

}  // namespace

SoundStream::SoundStream(double max_gap_s) : max_gap_ns_(static_cast<int64_t>(std::llround(max_gap_s * NS))) {}

double SoundStream::gapBefore(int64_t stamp_ns) const
{
  return begun_ ? static_cast<double>(stamp_ns - next_stamp_ns_) / NS : 0.0;
}

SoundStream::Break SoundStream::look(const AudioFormat& format, int64_t stamp_ns) const
{
  if (!begun_)
  {
    return Break::NONE;
  }
  if (!(format == resampler_->format()))
  {
    return Break::FORMAT;
  }
  const int64_t gap_ns = stamp_ns - next_stamp_ns_;
  return gap_ns > max_gap_ns_ ? Break::GAP : gap_ns < -max_gap_ns_ ? Break::BACK : Break::NONE;
}

void SoundStream::add(const AudioFormat& format, int64_t stamp_ns, const int16_t* samples, size_t count, Samples* out)
{
  if (!resampler_ || !(format == resampler_->format()))
  {
    resampler_.emplace(format);
  }
  if (!begun_)
  {
    begun_ = true;
    piece_begin_ = samples_;
    piece_frames_ = 0;
  }
  // The resampler gives its samples late; the first of a chunk is counted where it belongs.
  marks_.push_back(
      {piece_begin_ + std::llround(static_cast<double>(piece_frames_) * SAMPLE_RATE_HZ / format.sample_rate_hz),
       stamp_ns});
  while (marks_.front().sample < samples_ - static_cast<int64_t>(KEPT_S * SAMPLE_RATE_HZ))
  {
    marks_.pop_front();
  }
  const auto frames = static_cast<int64_t>(count) / format.channels;
  piece_frames_ += frames;
  next_stamp_ns_ = stamp_ns + durationNs(frames, format.sample_rate_hz);
  const size_t before = out->size();
  resampler_->process(samples, count, out);
  samples_ += static_cast<int64_t>(out->size() - before);
}

void SoundStream::end(Samples* out)
{
  if (begun_)
  {
    const size_t before = out->size();
    resampler_->flush(out);
    samples_ += static_cast<int64_t>(out->size() - before);
    begun_ = false;
  }
}

int64_t SoundStream::timeOf(int64_t sample) const
{
  if (marks_.empty())
  {
    return 0;
  }
  auto mark = std::upper_bound(marks_.begin(), marks_.end(), sample,
                               [](int64_t value, const Mark& candidate) { return value < candidate.sample; });
  mark -= mark == marks_.begin() ? 0 : 1;
  return mark->stamp_ns + durationNs(sample - mark->sample, SAMPLE_RATE_HZ);
}

}  // namespace pi_speech
