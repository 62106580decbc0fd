#include "ros/recognizer_worker.h"

#include <pi_node/formatting.h>
#include <pi_speech/ros/audio_conversions.h>
#include <pthread.h>
#include <ros/console.h>

#include <algorithm>
#include <exception>
#include <stdexcept>
#include <utility>

namespace pi_speech
{

using pi_node::format;

static ros::Time toRos(int64_t ns)
{
  return ros::Time().fromNSec(static_cast<uint64_t>(std::max<int64_t>(0, ns)));
}

RecognizerWorker::RecognizerWorker(const ros::NodeHandle& node, const RecognizerRosOptions& options,
                                   const std::string& topic, pi_node::WarningBoard* warnings,
                                   RecognizerDiagnostics* diagnostics, Outputs outputs)
  : options_(options)
  , topic_(topic)
  , warnings_(warnings)
  , diagnostics_(diagnostics)
  , outputs_(std::move(outputs))
  , tasks_(options.use_runtime
               ? std::make_unique<RecognizerTasks>(pi_runtime::Runtime::shared(),
                                                   [warnings](const std::string& text) { warnings->error(text); })
               : nullptr)
  , elsewhere_(options.utterance_service.empty()
                   ? nullptr
                   : std::make_unique<UtteranceService>(node, options.utterance_service, options.utterance_deadline_s))
  , watch_(options.check, topic + ": ", warnings)
  , queue_(topic, options.format, options.queue_s)
  // Times of arrival vary more than stamps.
  , stream_(options.stamped ? options.max_gap_s : std::max(options.max_gap_s, options.check.missing_s))
{
  figures_.use_runtime = tasks_ != nullptr;
}

void RecognizerWorker::start()
{
  thread_ = std::thread([this] { work(); });
}

void RecognizerWorker::stop()
{
  {
    std::lock_guard<std::mutex> lock(mutex_);
    stopping_ = true;
  }
  changed_.notify_all();
  thread_.join();
}

// ---------------------------------------------------------------------------------------------------------- any thread

bool RecognizerWorker::add(const AudioDataConstPtr& audio, const std_msgs::Header& header)
{
  std::string warning;
  {
    std::lock_guard<std::mutex> lock(mutex_);
    if (!taking_)
    {
      return false;
    }
    warning = queue_.add(audio, header, figures_.commands > 0 || figures_.loading.empty());
    if (!queue_.figures().problem.empty())
    {
      return false;
    }
  }
  changed_.notify_one();
  if (!warning.empty())
  {
    warnings_->warn(warning);
  }
  return true;
}

void RecognizerWorker::addInfo(const AudioInfo& info, const std::string& topic)
{
  try
  {
    const AudioFormat found = fromMsg(info);
    std::lock_guard<std::mutex> lock(mutex_);
    queue_.setFormat(found);
  }
  catch (const std::invalid_argument& error)
  {
    const std::string problem = topic + ": " + error.what();
    std::unique_lock<std::mutex> lock(mutex_);
    if (queue_.refuse(problem))
    {
      lock.unlock();
      ROS_ERROR_STREAM_NAMED("recognizer", problem << "; the sound is ignored until another audio_info comes");
    }
  }
}

void RecognizerWorker::take(bool wanted)
{
  {
    std::lock_guard<std::mutex> lock(mutex_);
    taking_ = wanted;
    if (!wanted)
    {
      queue_.clear();
      forget_ = true;
    }
  }
  if (!wanted)
  {
    changed_.notify_one();
    return;
  }
  watch_.restart();
}

void RecognizerWorker::beginLoading(const std::string& name)
{
  std::lock_guard<std::mutex> lock(mutex_);
  figures_.loading = name;
}

void RecognizerWorker::use(std::unique_ptr<CommandRecognizer> recognizer, const std::string& understood)
{
  Loaded loaded{std::move(recognizer), understood};
  {
    std::lock_guard<std::mutex> lock(mutex_);
    std::swap(next_, loaded);  // one that was never used ends after the lock
    figures_.loading.clear();
    figures_.problem.clear();
  }
  changed_.notify_one();
}

std::string RecognizerWorker::failLoading(const std::string& problem)
{
  std::lock_guard<std::mutex> lock(mutex_);
  figures_.loading.clear();
  figures_.problem = problem;
  changed_.notify_one();
  return next_.recognizer ? next_.understood : figures_.understood;
}

void RecognizerWorker::report(bool subscribed, RecognizerFigures* figures)
{
  if (subscribed)
  {
    watch_.look();
  }
  std::lock_guard<std::mutex> lock(mutex_);
  *figures = figures_;
  figures->queue = queue_.figures();
  figures->sound = watch_.figures();
}

// ------------------------------------------------------------------------------------------------------ speech_worker

void RecognizerWorker::work()
{
  pthread_setname_np(pthread_self(), "speech_worker");
  const std::chrono::duration<double> missing(options_.check.missing_s);
  std::unique_lock<std::mutex> lock(mutex_);
  while (true)
  {
    const bool in_speech = recognizer_ && recognizer_->inSpeech();
    const auto due = [this, in_speech]
    {
      // Sound that comes while the first models are loaded waits for them.
      const bool sound = !queue_.empty() && (recognizer_ || figures_.loading.empty());
      return stopping_ || forget_ || sound || (next_.recognizer && !in_speech);
    };
    bool sound_stays_away = false;
    if (in_speech)
    {
      sound_stays_away = !changed_.wait_for(lock, missing, due);
    }
    else
    {
      changed_.wait(lock, due);
    }
    if (stopping_)
    {
      return;
    }
    if (forget_ || sound_stays_away)
    {
      const bool tell = !std::exchange(forget_, false);
      lock.unlock();
      endPiece(tell);
    }
    else if (next_.recognizer && !in_speech)
    {
      Loaded loaded = std::exchange(next_, Loaded());
      lock.unlock();
      takeOver(std::move(loaded));
    }
    else
    {
      const SoundChunk chunk = queue_.take();
      lock.unlock();
      const double cpu_s = cpuSeconds();
      workOn(chunk);
      diagnostics_->addWork(cpuSeconds() - cpu_s, chunk.duration_s);
    }
    lock.lock();
    if (tasks_)
    {
      figures_.tasks = tasks_->figures();
    }
    figures_.in_speech = recognizer_ && recognizer_->inSpeech();
    figures_.noise_dbfs = recognizer_ ? recognizer_->noiseLevelDbfs() : 0.0;
  }
}

double RecognizerWorker::cpuSeconds() const
{
  return RecognizerTasks::threadCpuSeconds() + (tasks_ ? tasks_->figures().cpu_s : 0.0);
}

void RecognizerWorker::takeOver(Loaded loaded)
{
  recognizer_ = std::move(loaded.recognizer);
  recognizer_begin_ = stream_.samples();
  std::vector<std::string> commands;
  for (const Command& command : recognizer_->table().commands)
  {
    commands.push_back(command.text);
  }
  recognizer_->setUtteranceSink([this](const Utterance& utterance, const Recognition& recognition)
                                { onUtterance(utterance, recognition); });
  if (tasks_)
  {
    recognizer_->setRunner([this](double speech_s, const std::function<void()>& work) { tasks_->run(speech_s, work); });
  }
  if (elsewhere_)
  {
    recognizer_->setElsewhere([this, commands](const Utterance& utterance)
                              { return elsewhere_->ask(utterance, commands); });
  }
  std::lock_guard<std::mutex> lock(mutex_);
  figures_.understood = loaded.understood;
  figures_.commands = commands.size();
  figures_.word_models = recognizer_->usesWordModels();
}

void RecognizerWorker::workOn(const SoundChunk& chunk)
{
  try
  {
    fromMsg(*chunk.audio, chunk.format, &raw_);
  }
  catch (const std::invalid_argument& error)
  {
    warnings_->error(topic_ + ": " + error.what() + "; message ignored");
    std::lock_guard<std::mutex> lock(mutex_);
    ++figures_.damaged;
    return;
  }
  watch_.add(chunk.format, raw_.data(), raw_.size());
  const SoundStream::Break found = stream_.look(chunk.format, chunk.stamp_ns);
  if (chunk.after_loss || found != SoundStream::Break::NONE)
  {
    const double gap_s = stream_.gapBefore(chunk.stamp_ns);
    endPiece(true);
    noteBreak(chunk, found, gap_s);
  }
  came_at_ = chunk.came_at;
  frame_id_ = chunk.frame_id;
  samples_.clear();
  stream_.add(chunk.format, chunk.stamp_ns, raw_.data(), raw_.size(), &samples_);
  recognize([this](const auto& sink) { recognizer_->process(samples_.data(), samples_.size(), sink); });
}

void RecognizerWorker::noteBreak(const SoundChunk& chunk, SoundStream::Break found, double gap_s)
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
  std::lock_guard<std::mutex> lock(mutex_);
  figures_.gaps += gap ? 1 : 0;
  figures_.backs += back ? 1 : 0;
  figures_.formats += found == SoundStream::Break::FORMAT ? 1 : 0;
}

void RecognizerWorker::recognize(const std::function<void(const CommandRecognizer::Sink&)>& step)
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

void RecognizerWorker::endPiece(bool tell)
{
  forgetting_ = !tell;
  samples_.clear();
  stream_.end(&samples_);
  recognize([this](const auto& sink) { recognizer_->process(samples_.data(), samples_.size(), sink); });
  recognize([this](const auto& sink) { recognizer_->flush(sink); });
  forgetting_ = false;
}

void RecognizerWorker::onRecognition(const Recognition& recognition)
{
  {
    std::lock_guard<std::mutex> lock(mutex_);
    if (forgetting_ || forget_)  // stopped meanwhile
    {
      return;
    }
  }
  const int64_t speech_end = recognizer_begin_ + recognition.speech_end;
  VoiceCommand message;
  message.text = recognition.text;
  message.confidence = static_cast<float>(recognition.confidence);
  message.speech_start = toRos(stream_.timeOf(recognizer_begin_ + recognition.speech_begin));
  // The sample before the end may be the last one before a break.
  message.speech_end = toRos(stream_.timeOf(speech_end - 1) + 1000000000 / SAMPLE_RATE_HZ);
  message.header.stamp = message.speech_end;
  message.header.frame_id = frame_id_;
  message.fast = recognition.fast;
  const double latency_s = static_cast<double>(stream_.samples() - speech_end) / SAMPLE_RATE_HZ +
                           std::chrono::duration<double>(Clock::now() - came_at_).count();
  message.latency = ros::Duration(latency_s);
  outputs_.recognition(message, recognition, latency_s);
}

void RecognizerWorker::onUtterance(const Utterance& utterance, const Recognition& recognition)
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
