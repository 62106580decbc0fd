#include "ros/stream_recognizer.h"

#include <pi_node/durations.h>
#include <pi_node/formatting.h>
#include <pi_speech/ros/audio_conversions.h>

#include <algorithm>
#include <exception>
#include <stdexcept>
#include <utility>

namespace pi_speech
{

using pi_node::format;

/// A decision ends an utterance or is made during it: later, the speaker notices.
static constexpr std::chrono::milliseconds DECISION_DEADLINE{100};

static ros::Time toRos(int64_t ns)
{
  return ros::Time().fromNSec(static_cast<uint64_t>(std::max<int64_t>(0, ns)));
}

StreamRecognizer::StreamRecognizer(const ros::NodeHandle& node, const RecognizerRosOptions& options,
                                   const std::string& topic, pi_node::WarningBoard* warnings, SoundWatch* watch,
                                   Outputs outputs)
  : options_(options)
  , topic_(topic)
  , warnings_(warnings)
  , watch_(watch)
  , outputs_(std::move(outputs))
  , stage_(options.use_runtime ? pi_runtime::Runtime::shared(pi_runtime::RuntimeOptions::forService()) : nullptr,
           {"speech_decode", std::chrono::nanoseconds(0), DECISION_DEADLINE})
  , elsewhere_(options.utterance_service.empty()
                   ? nullptr
                   : std::make_unique<UtteranceService>(node, options.utterance_service, options.utterance_deadline_s))
  // Times of arrival vary more than stamps.
  , stream_(options.stamped ? options.max_gap_s : std::max(options.max_gap_s, options.check.missing_s))
{
}

void StreamRecognizer::use(std::unique_ptr<CommandRecognizer> recognizer, const std::string& understood)
{
  recognizer_ = std::move(recognizer);
  recognizer_begin_ = stream_.samples();
  const std::vector<std::string> commands = recognizer_->table().texts();
  recognizer_->setUtteranceSink([this](const Utterance& utterance, const Recognition& recognition)
                                { onUtterance(utterance, recognition); });
  recognizer_->setRunner([this](double, const std::function<void()>& work) { stage_.run(work); });
  if (elsewhere_)
  {
    recognizer_->setElsewhere([this, commands](const Utterance& utterance)
                              { return elsewhere_->ask(utterance, commands); });
  }
  figures_.understood = understood;
  figures_.commands = commands.size();
  figures_.spotted = recognizer_->spottedCommands().size();
  figures_.guessed = recognizer_->guessedWords().size();
}

void StreamRecognizer::add(const SoundChunk& chunk)
{
  try
  {
    fromMsg(*chunk.audio, chunk.format, &raw_);
  }
  catch (const std::invalid_argument& error)
  {
    warnings_->error(topic_ + ": " + error.what() + "; message ignored");
    ++figures_.damaged;
    return;
  }
  watch_->add(chunk.format, raw_.data(), raw_.size());
  const SoundStream::Break found = stream_.look(chunk.format, chunk.stamp_ns);
  if (chunk.after_loss || found != SoundStream::Break::NONE)
  {
    const double gap_s = stream_.gapBefore(chunk.stamp_ns);
    end(true);
    noteBreak(chunk, found, gap_s);
  }
  came_at_ = chunk.came_at;
  frame_id_ = chunk.frame_id;
  samples_.clear();
  stream_.add(chunk.format, chunk.stamp_ns, raw_.data(), raw_.size(), &samples_);
  clipping_.add(raw_.data(), raw_.size(), stream_.samples());
  recognize([this](const auto& sink) { recognizer_->process(samples_.data(), samples_.size(), sink); });
}

void StreamRecognizer::noteBreak(const SoundChunk& chunk, SoundStream::Break found, double gap_s)
{
  const bool gap = found == SoundStream::Break::GAP && !chunk.after_loss;
  const bool back = found == SoundStream::Break::BACK && !chunk.after_loss;
  if (gap)
  {
    warnings_->warn(topic_ + format(": %.2f s of sound are missing before a message", gap_s) +
                    "; is the computer of the microphone, or the network, too busy?");
  }
  else if (back)
  {
    warnings_->warn(topic_ + format(": stamps went back by %.2f s", -gap_s) +
                    "; a recording that begins again, or two sources of sound?");
  }
  figures_.gaps += gap ? 1 : 0;
  figures_.backs += back ? 1 : 0;
  figures_.formats += found == SoundStream::Break::FORMAT ? 1 : 0;
}

void StreamRecognizer::recognize(const std::function<void(const CommandRecognizer::Sink&)>& step)
{
  if (!recognizer_)
  {
    return;
  }
  try
  {
    step([this](const Recognition& recognition) { onRecognition(recognition); });
  }
  catch (const std::exception& error)
  {
    warnings_->error(std::string("recognition failed: ") + error.what());
  }
}

void StreamRecognizer::end(bool tell)
{
  forgetting_ = !tell;
  samples_.clear();
  stream_.end(&samples_);
  recognize([this](const auto& sink) { recognizer_->process(samples_.data(), samples_.size(), sink); });
  recognize([this](const auto& sink) { recognizer_->flush(sink); });
  forgetting_ = false;
}

StreamRecognizer::Figures StreamRecognizer::figures() const
{
  Figures figures = figures_;
  figures.decisions = stage_.status();
  if (recognizer_)
  {
    figures.in_speech = recognizer_->inSpeech();
    figures.noise_dbfs = recognizer_->noiseLevelDbfs();
  }
  return figures;
}

double StreamRecognizer::cpuSeconds() const
{
  return pi_node::cpuSeconds() + stage_.cpuSeconds();
}

void StreamRecognizer::onRecognition(Recognition recognition)
{
  if (forgetting_)
  {
    return;
  }
  const int64_t speech_end = recognizer_begin_ + recognition.speech_end;
  // Clipped words are often taken for others. A false "stop" is cheap, so fast commands are taken all the same.
  const double clipped = clipping_.shareSince(recognizer_begin_ + recognition.speech_begin);
  if (recognition.accepted && clipped >= options_.check.clipped_share && !isFast(recognition.text))
  {
    recognition.accepted = false;
    recognition.reason = format("%.1f %% of its samples are clipped: only fast commands are taken", 100.0 * clipped);
  }
  VoiceCommand message;
  message.text = recognition.text;
  message.confidence = static_cast<float>(recognition.confidence);
  message.speech_start = toRos(stream_.timeOf(recognizer_begin_ + recognition.speech_begin));
  // The sample before the end may be the last one before a break.
  message.speech_end = toRos(stream_.timeOf(speech_end - 1) + 1000000000 / SAMPLE_RATE_HZ);
  message.header.stamp = message.speech_end;
  message.header.frame_id = frame_id_;
  message.fast = recognition.fast;
  const double latency_s =
      static_cast<double>(stream_.samples() - speech_end) / SAMPLE_RATE_HZ + pi_node::secondsSince(came_at_);
  message.latency = ros::Duration(latency_s);
  outputs_.recognition(message, recognition, latency_s);
}

bool StreamRecognizer::isFast(const std::string& command) const
{
  const std::vector<Command>& commands = recognizer_->table().commands;
  return std::any_of(commands.begin(), commands.end(),
                     [&command](const Command& each) { return each.fast && each.text == command; });
}

void StreamRecognizer::onUtterance(const Utterance& utterance, const Recognition& recognition)
{
  if (forgetting_)
  {
    return;
  }
  if (utterance.cut)
  {
    warnings_->warn(
        topic_ + format(": speech without a pause for %.1f s is cut", options_.recognizer.end_pointer.max_utterance_s) +
        "; a radio, wind, or a microphone that is too far away?");
  }
  outputs_.utterance(utterance, recognition);
}

}  // namespace pi_speech
