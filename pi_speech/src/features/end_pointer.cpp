#include <pi_node/option_check.h>
#include <pi_speech/end_pointer.h>

#include <algorithm>
#include <cmath>

namespace pi_speech
{

namespace
{

constexpr int FIRST_FRAMES = 10;         ///< of a stream, from which the noise is learned with a running mean
constexpr float NOISE_RATE = 0.03F;      ///< of the estimate in pauses, per frame
constexpr float SPEECH_RATE = 0.002F;    ///< in speech: what lasts for seconds is noise
constexpr float SINK_RATE = 0.03F;       ///< where the sound is quieter than the estimate
constexpr float MOST_EXCESS = 3.0F;      ///< of one band that counts [ln]: no band decides alone
constexpr float FLOOR_RATE = 0.06F;      ///< of the energies whose least is the floor, per frame
constexpr int FLOOR_BLOCK_FRAMES = 30;   ///< of the least energies; 4 to 5 blocks are longer than a word
constexpr double EXCESS_RATE = 0.2;      ///< per frame
constexpr double MOST_THRESHOLD = 1.6;   ///< half of MOST_EXCESS: loud speech is heard in any noise
constexpr double MOST_THRESHOLDS = 2.0;  ///< of the excess of one frame that counts
constexpr int EXCESS_DELAY = 3;          ///< frames from speech until the mean excess shows it, and after its end
constexpr double SPREAD_RATE = 0.01;     ///< of mean and deviation of the excess of noise, per frame
constexpr double FIRST_EXCESS = 0.3;     ///< of white noise, before any is known
constexpr double FIRST_SPREAD = 0.05;
constexpr double BEGIN_SPREADS = 3.0;  ///< mean deviations above the excess of the noise where speech begins
constexpr double END_SPREADS = 2.5;    ///< the same where it pauses
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
  followFloor(energies);
  const double excess = (energies - noise_).cwiseMax(0.0F).cwiseMin(MOST_EXCESS).mean();
  const double least = state_ == State::SPEECH ? options_.end_threshold : options_.begin_threshold;
  const double spreads = state_ == State::SPEECH ? END_SPREADS : BEGIN_SPREADS;
  const double threshold = std::min(MOST_THRESHOLD, std::max(least, excess_mean_ + spreads * excess_spread_));
  excess_ += EXCESS_RATE * (std::min(excess, MOST_THRESHOLDS * threshold) - excess_);  // no click lasts
  const bool speech = excess_ > threshold && dbfs(power) > options_.min_level_dbfs;
  learnNoise(energies, power, speech || excess > MOST_THRESHOLDS * threshold);

  if (state_ == State::NOISE)
  {
    if (!speech)
    {
      return;
    }
    state_ = State::SPEECH;
    speech_begin_ = std::max(buffer_begin_, next_frame_ - EXCESS_DELAY * HOP_SAMPLES);
    speech_frames_ = 0;
    speech_power_ = 0.0;
    begun_ = false;
  }
  if (speech)
  {
    ++speech_frames_;
    speech_power_ += power;
    speech_end_ = std::max(speech_begin_, next_frame_ - EXCESS_DELAY * HOP_SAMPLES) + FRAME_SAMPLES;
    pause_frames_ = EXCESS_DELAY;
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
      if (pause_frames_ > MOST_GAP_FRAMES + EXCESS_DELAY)
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
    noise_ = smoothed_;  // what lasts so long is the noise of now
    noise_power_ = power;
  }
}

/// Raises the noise to what the bands have not fallen below for 1.5 s, speech or not.
void EndPointer::followFloor(const BandEnergies& energies)
{
  if (noise_frames_ == 0)
  {
    smoothed_ = energies;
    least_.fill(BandEnergies::Constant(-1e3F));
    least_[0] = smoothed_;
    block_frames_ = 0;
    excess_ = 0.0;
    excess_mean_ = FIRST_EXCESS;
    excess_spread_ = FIRST_SPREAD;
  }
  smoothed_ += FLOOR_RATE * (energies - smoothed_);
  if (++block_frames_ == FLOOR_BLOCK_FRAMES)
  {
    block_frames_ = 0;
    std::rotate(least_.begin(), least_.end() - 1, least_.end());
    least_[0] = smoothed_;
  }
  least_[0] = least_[0].cwiseMin(smoothed_);
  BandEnergies floor = least_[0];
  for (const BandEnergies& block : least_)
  {
    floor = floor.cwiseMin(block);
  }
  noise_ = noise_.cwiseMax(floor);
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
    const double deviation = std::abs(excess_ - excess_mean_);
    excess_mean_ += SPREAD_RATE * (excess_ - excess_mean_);
    excess_spread_ += SPREAD_RATE * (deviation - excess_spread_);
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
