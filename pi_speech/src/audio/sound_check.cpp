#include "audio/sound_check.h"
#include <pi_node/formatting.h>
#include <pi_node/option_check.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

namespace pi_speech
{
namespace
{

using pi_node::format;

constexpr double LEAST_DBFS = -120.0;
constexpr double MOST_OFFSET = 0.1;  ///< of full scale; good devices have less than 0.01
/// Power of the channels' mean over that of the channels: 1 for the same sound, 0.5 for two rooms, 0 in antiphase.
constexpr double LEAST_MEAN_POWER = 0.1;
constexpr double DEAD_POWER = 1e-4;  ///< of the strongest channel: 40 dB below it nobody hears the same room

}  // namespace

const char* toString(SoundState state)
{
  switch (state)
  {
    case SoundState::GOOD:
      return "good";
    case SoundState::CLIPPED:
      return "clipped";
    case SoundState::OFFSET:
      return "offset";
    case SoundState::CANCELLING:
      return "cancelling";
    case SoundState::DEAD:
      return "dead channel";
    case SoundState::NARROW:
      return "narrow";
    case SoundState::SILENT:
      return "silent";
    case SoundState::MISSING:
      return "missing";
  }
  return "";
}

void SoundCheckOptions::validate() const
{
  const pi_node::OptionCheck check("");
  check.range("clipped_share", clipped_share, 1e-6, 1.0);
  check.range("silent_level_dbfs", silent_level_dbfs, LEAST_DBFS, 0.0);
  check.range("silent_s", silent_s, 1.0, 3600.0);
  check.range("missing_s", missing_s, 0.1, 3600.0);
  check.range("window_s", window_s, 0.05, 10.0);
}

SoundCheck::SoundCheck(const SoundCheckOptions& options, int64_t now_ns) : options_(options), heard_ns_(now_ns)
{
  options_.validate();
  beginWindow();
}

std::optional<SoundChange> SoundCheck::add(const AudioFormat& format, const int16_t* samples, size_t count,
                                           int64_t now_ns)
{
  if (count == 0)
  {
    return look(now_ns);
  }
  heard_ns_ = now_ns;
  if (!(format == format_))
  {
    format_ = format;
    told_.clear();
    beginWindow();
  }
  const auto full = std::max<size_t>(
      1, static_cast<size_t>(std::llround(options_.window_s * format.sample_rate_hz * format.channels)));
  std::optional<SoundChange> said;
  for (size_t i = 0; i < count; ++i)
  {
    const int value = samples[i];
    Sums& channel = channels_[count_ % channels_.size()];
    channel.sum += value;
    channel.squares += static_cast<double>(value) * value;
    frame_ += value;
    clipped_ += std::abs(value) >= CLIPPED_FROM ? 1 : 0;
    if (++count_ % channels_.size() == 0)
    {
      const double mean = std::exchange(frame_, 0.0) / static_cast<double>(channels_.size());
      mean_.sum += mean;
      mean_.squares += mean * mean;
    }
    if (count_ >= full && count_ % channels_.size() == 0)
    {
      if (const std::optional<SoundChange> now = endWindow())
      {
        said = now;  // the last one of several in a call holds
      }
    }
  }
  return said;
}

std::optional<SoundChange> SoundCheck::look(int64_t now_ns)
{
  const double missing_s = 1e-9 * static_cast<double>(now_ns - heard_ns_);
  if (missing_s < options_.missing_s)
  {
    return std::nullopt;
  }
  silent_for_s_ = 0.0;
  return change(SoundState::MISSING,
                format("no sound for %.1f s; is the microphone plugged in and its node alive?", missing_s));
}

double SoundCheck::Sums::variance(double count) const
{
  const double mean = sum / count;  // of a muted microphone too, and nothing that can be heard
  return std::max(0.0, squares / count - mean * mean);
}

void SoundCheck::beginWindow()
{
  count_ = 0;
  clipped_ = 0;
  channels_.assign(static_cast<size_t>(format_.channels), {});
  mean_ = {};
  frame_ = 0.0;
}

std::optional<SoundChange> SoundCheck::endWindow()
{
  const auto count = static_cast<double>(count_);
  const double frames = count / static_cast<double>(channels_.size());
  std::vector<double> variances;
  double variance = 0.0;
  for (const Sums& channel : channels_)
  {
    variances.push_back(channel.variance(frames));
    variance += variances.back() / static_cast<double>(channels_.size());
  }
  level_dbfs_ = std::max(LEAST_DBFS, 10.0 * std::log10(std::max(variance, 1e-12) / (FULL_SCALE * FULL_SCALE)));
  clipped_share_ = static_cast<double>(clipped_) / count;
  ++windows_;
  const std::optional<SoundChange> fault = look(variances, frames);
  beginWindow();

  if (clipped_share_ >= options_.clipped_share)
  {
    silent_for_s_ = 0.0;
    return change(SoundState::CLIPPED, format("%.1f %% of the samples are at full scale, at most %.1f may be; turn the "
                                              "microphone's gain down",
                                              100.0 * clipped_share_, 100.0 * options_.clipped_share));
  }
  // Hysteresis: at the bound the state would flicker.
  if (state_ == SoundState::CLIPPED && clipped_share_ > 0.5 * options_.clipped_share)
  {
    return std::nullopt;
  }
  if (level_dbfs_ >= options_.silent_level_dbfs)
  {
    silent_for_s_ = 0.0;
    if (fault)
    {
      // Said once: a fault of the device stays, and pauses in the speech hide it.
      const std::optional<SoundChange> said = change(fault->state, fault->text);
      return told_.insert(fault->state).second ? said : std::nullopt;
    }
    return change(SoundState::GOOD, format("sound is good, level %.0f dB of full scale", level_dbfs_));
  }
  silent_for_s_ += options_.window_s;
  if (silent_for_s_ < options_.silent_s - 1e-9)
  {
    // Not silent for long enough to report it, but no longer missing or too loud.
    return state_ == SoundState::SILENT ? std::nullopt : change(SoundState::GOOD, "sound comes");
  }
  return change(
      SoundState::SILENT,
      variance < 1e-9
          ? format("all samples are the same for %.0f s; is the microphone muted or unplugged?", silent_for_s_)
          : format("level %.0f dB of full scale for %.0f s; is the microphone muted or unplugged, or its gain "
                   "too low?",
                   level_dbfs_, silent_for_s_));
}

std::optional<SoundChange> SoundCheck::look(const std::vector<double>& variances, double frames)
{
  for (size_t i = 0; i < channels_.size(); ++i)
  {
    const double offset = channels_[i].sum / frames / FULL_SCALE;
    if (std::abs(offset) > MOST_OFFSET)
    {
      return SoundChange{SoundState::OFFSET,
                         "channel " + std::to_string(i) +
                             format(" is %.2f of full scale away from 0 in the mean, at most %.2f may be; is the "
                                    "microphone or its cable faulty?",
                                    offset, MOST_OFFSET)};
    }
  }
  const auto [weakest, strongest] = std::minmax_element(variances.begin(), variances.end());
  const double power = std::accumulate(variances.begin(), variances.end(), 0.0) / static_cast<double>(variances.size());
  if (*weakest < DEAD_POWER * *strongest)
  {
    return SoundChange{SoundState::DEAD, "channel " + std::to_string(weakest - variances.begin()) +
                                             " has no sound, but another one has; the mean, which is recognised, is "
                                             "quieter than the speech: record one channel, or repair the other"};
  }
  if (mean_.variance(frames) < LEAST_MEAN_POWER * power)
  {
    return SoundChange{
        SoundState::CANCELLING,
        format("the channels cancel each other: their mean has %.0f %% of their power; swap the wires of "
               "one microphone, or record one channel",
               100.0 * mean_.variance(frames) / power)};
  }
  if (format_.sample_rate_hz < SAMPLE_RATE_HZ)
  {
    return SoundChange{SoundState::NARROW, "sound at " + std::to_string(format_.sample_rate_hz) +
                                               " Hz lacks what tells s, f and p apart; " +
                                               std::to_string(SAMPLE_RATE_HZ) + " Hz or more make fewer errors"};
  }
  return std::nullopt;
}

std::optional<SoundChange> SoundCheck::change(SoundState state, const std::string& text)
{
  if (state == state_)
  {
    return std::nullopt;
  }
  state_ = state;
  return SoundChange{state, text};
}

void ClippingRecord::add(const int16_t* samples, size_t count, int64_t end)
{
  const auto clipped = [](int16_t value) { return std::abs(int{value}) >= SoundCheck::CLIPPED_FROM; };
  chunks_.push_back({end, static_cast<size_t>(std::count_if(samples, samples + count, clipped)), count});
  while (chunks_.front().end < end - static_cast<int64_t>(KEPT_S * SAMPLE_RATE_HZ))
  {
    chunks_.pop_front();
  }
}

double ClippingRecord::shareSince(int64_t begin) const
{
  size_t clipped = 0;
  size_t count = 0;
  for (auto chunk = chunks_.rbegin(); chunk != chunks_.rend() && chunk->end > begin; ++chunk)
  {
    clipped += chunk->clipped;
    count += chunk->count;
  }
  return count == 0 ? 0.0 : static_cast<double>(clipped) / static_cast<double>(count);
}

}  // namespace pi_speech
