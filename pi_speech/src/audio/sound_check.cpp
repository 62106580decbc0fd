#include "audio/sound_check.h"
#include <pi_node/formatting.h>
#include <pi_node/option_check.h>

#include <algorithm>
#include <cmath>

namespace pi_speech
{
namespace
{

using pi_node::format;

constexpr int CLIPPED_FROM = 32700;  ///< some converters stop a little below full scale
constexpr double LEAST_DBFS = -120.0;

}  // namespace

const char* toString(SoundState state)
{
  switch (state)
  {
    case SoundState::GOOD:
      return "good";
    case SoundState::CLIPPED:
      return "clipped";
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
    count_ = 0;
    clipped_ = 0;
    sum_ = squares_ = 0.0;
  }
  const auto full = std::max<size_t>(
      1, static_cast<size_t>(std::llround(options_.window_s * format.sample_rate_hz * format.channels)));
  std::optional<SoundChange> said;
  for (size_t i = 0; i < count; ++i)
  {
    const int value = samples[i];
    sum_ += value;
    squares_ += static_cast<double>(value) * value;
    clipped_ += std::abs(value) >= CLIPPED_FROM ? 1 : 0;
    if (++count_ >= full)
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

std::optional<SoundChange> SoundCheck::endWindow()
{
  const auto count = static_cast<double>(count_);
  const double mean = sum_ / count;  // of a muted microphone too, and nothing that can be heard
  const double variance = std::max(0.0, squares_ / count - mean * mean);
  level_dbfs_ = std::max(LEAST_DBFS, 10.0 * std::log10(std::max(variance, 1e-12) / (FULL_SCALE * FULL_SCALE)));
  clipped_share_ = static_cast<double>(clipped_) / count;
  ++windows_;
  count_ = 0;
  clipped_ = 0;
  sum_ = squares_ = 0.0;

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

std::optional<SoundChange> SoundCheck::change(SoundState state, const std::string& text)
{
  if (state == state_)
  {
    return std::nullopt;
  }
  state_ = state;
  return SoundChange{state, text};
}

}  // namespace pi_speech
