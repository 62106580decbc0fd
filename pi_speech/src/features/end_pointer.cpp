#include <pi_node/option_check.h>
#include <pi_speech/end_pointer.h>

#include <algorithm>
#include <cmath>

namespace pi_speech
{

namespace
{

constexpr int FIRST_FRAMES = 10;       ///< of a stream, from which the noise is learned with a running mean
constexpr float NOISE_RATE = 0.05F;    ///< of the estimate in pauses, per frame
constexpr float SPEECH_RATE = 0.002F;  ///< in speech: what lasts for seconds is noise
constexpr float SINK_RATE = 0.1F;      ///< where the sound is quieter than the estimate
constexpr float MOST_EXCESS = 3.0F;    ///< of one band that counts [ln]: no band decides alone
constexpr int MOST_GAP_FRAMES = 6;     ///< between frames of speech before the beginning is certain

int framesIn(double seconds)
{
  return static_cast<int>(std::lround(seconds / FRAME_S));
}

double dbfs(double power)
{
  return 10.0 * std::log10(std::max(power, 1e-3) / (FULL_SCALE * FULL_SCALE));
}

}  // namespace

void EndPointerOptions::validate() const
{
  const pi_node::OptionCheck check("");
  check.range("begin_threshold", begin_threshold, 0.05, 3.0);
  check.range("end_threshold", end_threshold, 0.01, begin_threshold);
  check.range("min_level_dbfs", min_level_dbfs, -120.0, 0.0);
  check.range("max_utterance_s", max_utterance_s, 0.5, 60.0);
  check.range("min_speech_s", min_speech_s, FRAME_S, 0.5 * max_utterance_s);
  check.range("end_silence_s", end_silence_s, 0.05, 3.0);
  check.range("early_silence_s", early_silence_s, 0.0, end_silence_s);
  check.range("tail_s", tail_s, 0.0, 3.0);
  check.range("lead_s", lead_s, 0.0, 2.0);
}

EndPointer::EndPointer(const EndPointerOptions& options, Sink sink) : options_(options), sink_(std::move(sink))
{
  options.validate();
  noise_.setZero();
}

double EndPointer::noiseLevelDbfs() const
{
  return dbfs(noise_power_);
}

void EndPointer::process(const int16_t* samples, size_t count)
{
  buffer_.insert(buffer_.end(), samples, samples + count);
  seen_ += static_cast<int64_t>(count);
  while (seen_ - next_frame_ >= FRAME_SAMPLES)
  {
    takeFrame(buffer_.data() + (next_frame_ - buffer_begin_));
    next_frame_ += HOP_SAMPLES;
  }
  // Between utterances only the lead is needed.
  const auto lead = static_cast<int64_t>(options_.lead_s * SAMPLE_RATE_HZ);
  const int64_t needed = (state_ == State::NOISE ? next_frame_ : speech_begin_) - lead;
  if (needed > buffer_begin_ + SAMPLE_RATE_HZ)
  {
    buffer_.erase(buffer_.begin(), buffer_.begin() + (needed - buffer_begin_));
    buffer_begin_ = needed;
  }
}

void EndPointer::takeFrame(const int16_t* frame)
{
  const BandEnergies energies = bank_.energies(frame);
  double power = 0.0;
  for (int i = 0; i < FRAME_SAMPLES; ++i)
  {
    power += static_cast<double>(frame[i]) * frame[i];
  }
  power /= FRAME_SAMPLES;

  if (noise_frames_ == 0)
  {
    noise_ = energies;
    noise_power_ = power;
  }
  const double excess = (energies - noise_).cwiseMax(0.0F).cwiseMin(MOST_EXCESS).mean();
  const double threshold = state_ == State::SPEECH ? options_.end_threshold : options_.begin_threshold;
  const bool speech = excess > threshold && dbfs(power) > options_.min_level_dbfs;
  learnNoise(energies, power, speech);

  if (state_ == State::NOISE)
  {
    if (!speech)
    {
      return;
    }
    state_ = State::SPEECH;
    speech_begin_ = next_frame_;
    speech_frames_ = 0;
    speech_power_ = 0.0;
    begun_ = false;
  }
  if (speech)
  {
    ++speech_frames_;
    speech_power_ += power;
    speech_end_ = next_frame_ + FRAME_SAMPLES;
    pause_frames_ = 0;
    paused_ = false;
    if (!begun_ && speech_frames_ >= framesIn(options_.min_speech_s))
    {
      begun_ = true;
      tell(Event::BEGIN);
    }
  }
  else
  {
    ++pause_frames_;
    if (!begun_)
    {
      if (pause_frames_ > MOST_GAP_FRAMES)
      {
        state_ = State::NOISE;
      }
      return;
    }
    if (!paused_ && options_.early_silence_s > 0.0 && pause_frames_ >= framesIn(options_.early_silence_s))
    {
      paused_ = true;
      tell(Event::PAUSE);
    }
    if (pause_frames_ >= framesIn(options_.end_silence_s))
    {
      endUtterance(false);
      return;
    }
  }
  if (static_cast<double>(next_frame_ - speech_begin_) > options_.max_utterance_s * SAMPLE_RATE_HZ)
  {
    endUtterance(true);
    noise_ = energies;  // what lasts so long is the noise of now
    noise_power_ = power;
  }
}

void EndPointer::learnNoise(const BandEnergies& energies, double power, bool speech)
{
  ++noise_frames_;
  // A running mean over the first frames; later fast in pauses, slow in speech, and fastest for quieter sound.
  const float first = noise_frames_ <= FIRST_FRAMES && !speech ? 1.0F / static_cast<float>(noise_frames_) : 0.0F;
  const float rise = std::max(first, speech ? SPEECH_RATE : NOISE_RATE);
  const float fall = std::max(first, SINK_RATE);
  for (int b = 0; b < BANDS; ++b)
  {
    const float change = energies[b] - noise_[b];
    noise_[b] += (change < 0.0F ? fall : rise) * change;
  }
  if (!speech)
  {
    const float power_rate = power < noise_power_ ? fall : rise;
    noise_power_ += static_cast<double>(power_rate) * (power - noise_power_);
  }
}

void EndPointer::tell(Event event, bool cut)
{
  Utterance utterance;
  const auto lead = static_cast<int64_t>(options_.lead_s * SAMPLE_RATE_HZ);
  utterance.begin = std::max(buffer_begin_, speech_begin_ - lead);
  utterance.speech_begin = speech_begin_;
  utterance.speech_end = std::min(speech_end_, seen_);
  const double speech_power = speech_power_ / std::max(1, speech_frames_);
  utterance.snr_db = dbfs(std::max(speech_power - noise_power_, 1e-3)) - dbfs(noise_power_);
  utterance.cut = cut;
  if (event != Event::BEGIN)
  {
    // The same at a pause and at the end: what was decided at the pause holds at the end.
    const int64_t end = std::min(
        {seen_, next_frame_ + FRAME_SAMPLES, speech_end_ + static_cast<int64_t>(options_.tail_s * SAMPLE_RATE_HZ)});
    utterance.samples.assign(buffer_.begin() + (utterance.begin - buffer_begin_),
                             buffer_.begin() + (end - buffer_begin_));
  }
  sink_(event, utterance);
}

void EndPointer::endUtterance(bool cut)
{
  state_ = State::NOISE;
  tell(Event::END, cut);
}

void EndPointer::flush()
{
  if (state_ == State::SPEECH && begun_)
  {
    endUtterance(false);
  }
  state_ = State::NOISE;
  buffer_.clear();
  buffer_begin_ = seen_;
  next_frame_ = seen_;
}

void EndPointer::reset()
{
  buffer_.clear();
  buffer_begin_ = 0;
  next_frame_ = 0;
  seen_ = 0;
  state_ = State::NOISE;
  noise_frames_ = 0;
  noise_power_ = 0.0;
}

}  // namespace pi_speech
