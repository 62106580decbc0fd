#include "ros/recognizer_worker.h"

#include <pi_node/vehicle_clock.h>
#include <pthread.h>
#include <ros/console.h>

#include <utility>

namespace pi_speech
{

RecognizerWorker::RecognizerWorker(const ros::NodeHandle& node, const RecognizerRosOptions& options,
                                   const std::string& topic, pi_node::WarningBoard* warnings,
                                   RecognizerDiagnostics* diagnostics, StreamRecognizer::Outputs outputs)
  : options_(options)
  , warnings_(warnings)
  , diagnostics_(diagnostics)
  , outputs_(std::move(outputs))
  , watch_(options.check, topic + ": ", warnings)
  , queue_(topic, options.format, options.queue_s)
  , stream_(node, options, topic, warnings, &watch_,
            {[this](const VoiceCommand& message, const Recognition& recognition, double latency_s)
             { tell(message, recognition, latency_s); },
             outputs_.utterance})
  , answers_("sound", "recognizer")
{
  figures_.stream = stream_.figures();
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
    warning = queue_.add(audio, header, figures_.stream.commands > 0 || figures_.loading.empty());
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
  std::string problem;
  {
    std::lock_guard<std::mutex> lock(mutex_);
    problem = queue_.setInfo(info, topic);
  }
  if (!problem.empty())
  {
    ROS_ERROR_STREAM_NAMED("recognizer", problem << "; the sound is ignored until another audio_info comes");
  }
}

void RecognizerWorker::take(bool wanted)
{
  answers_.take(wanted);
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

void RecognizerWorker::use(std::unique_ptr<CommandRecognizer> recognizer, const std::string& understood,
                           const std::string& no_network)
{
  Loaded loaded{std::move(recognizer), understood};
  {
    std::lock_guard<std::mutex> lock(mutex_);
    std::swap(next_, loaded);  // one that was never used ends after the lock
    figures_.loading.clear();
    figures_.problem.clear();
    figures_.no_network = no_network;
  }
  changed_.notify_one();
}

std::string RecognizerWorker::failLoading(const std::string& problem)
{
  std::lock_guard<std::mutex> lock(mutex_);
  figures_.loading.clear();
  figures_.problem = problem;
  changed_.notify_one();
  return next_.recognizer ? next_.understood : figures_.stream.understood;
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
  std::unique_lock<std::mutex> lock(mutex_);
  while (true)
  {
    const bool in_speech = stream_.inSpeech();
    const auto due = [this, in_speech]
    {
      // Sound that comes while the first models are loaded waits for them.
      const bool sound = !queue_.empty() && (stream_.ready() || figures_.loading.empty());
      return stopping_ || forget_ || sound || (next_.recognizer && !in_speech);
    };
    bool sound_stays_away = false;
    if (in_speech)
    {
      sound_stays_away = !pi_node::waitFor(&changed_, &lock, options_.check.missing_s, due);
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
      stream_.end(tell);
    }
    else if (next_.recognizer && !in_speech)
    {
      Loaded loaded = std::exchange(next_, Loaded());
      lock.unlock();
      stream_.use(std::move(loaded.recognizer), loaded.understood);
    }
    else
    {
      const SoundChunk chunk = queue_.take();
      lock.unlock();
      const double cpu_s = stream_.cpuSeconds();
      stream_.add(chunk);
      answers_.workedOff(chunk.stamp_ns);
      diagnostics_->addWork(stream_.cpuSeconds() - cpu_s, chunk.duration_s);
    }
    lock.lock();
    figures_.stream = stream_.figures();
  }
}

void RecognizerWorker::tell(const VoiceCommand& message, const Recognition& recognition, double latency_s)
{
  {
    std::lock_guard<std::mutex> lock(mutex_);
    if (forget_)  // stopped meanwhile
    {
      return;
    }
  }
  outputs_.recognition(message, recognition, latency_s);
}

}  // namespace pi_speech
