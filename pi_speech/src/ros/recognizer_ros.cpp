#include <pi_node/formatting.h>
#include <pi_node/ros/node_options.h>
#include <pi_speech/ros/audio_conversions.h>
#include "ros/recognizer_ros.h"
#include <pthread.h>
#include <ros/package.h>
#include <std_msgs/String.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <boost/make_shared.hpp>
#include <ctime>
#include <exception>
#include <utility>

#include "recognizer/words.h"

namespace pi_speech
{
namespace
{

using pi_node::format;

constexpr uint32_t OUTPUT_QUEUE = 20;
constexpr size_t DICTATION_QUEUE = 3;  ///< utterances
constexpr int DICTATION_NICE = 10;
constexpr double LEAST_SAID_S = 1.0;  ///< of sound without audio_info, before that is said: it may come second

ros::Time toRos(int64_t ns)
{
  return ros::Time().fromNSec(static_cast<uint64_t>(std::max<int64_t>(0, ns)));
}

double threadCpuSeconds()
{
  timespec time{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

int64_t steadyNs()
{
  return std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::steady_clock::now().time_since_epoch())
      .count();
}

double samplesToSeconds(int64_t samples)
{
  return static_cast<double>(samples) / SAMPLE_RATE_HZ;
}

std::string textsOf(const CommandTable& table)
{
  std::string texts;
  for (const Command& command : table.commands)
  {
    texts += (texts.empty() ? "" : ", ") + command.text;
  }
  return texts;
}

CommandTable tableOf(const std::vector<std::string>& texts)
{
  CommandTable table;
  for (const std::string& text : texts)
  {
    Command command;
    command.text = normalised(text);
    table.commands.push_back(command);
  }
  table.validate();
  return table;
}

std_msgs::String toMsg(const std::string& text)
{
  std_msgs::String message;
  message.data = text;
  return message;
}

}  // namespace

RecognizerRos::RecognizerRos(ros::NodeHandle node, ros::NodeHandle private_node)
  : input_thread_("speech_input")
  , loader_thread_("speech_loader")
  , service_thread_("speech_service")
  , input_node_(input_thread_.handle(node))
  , service_node_(service_thread_.handle(node))
  , service_private_node_(service_thread_.handle(private_node))
  , loader_private_node_(loader_thread_.handle(private_node))
  , options_(pi_node::loadNodeOptions<RecognizerRosOptions>(private_node, "recognizer"))
  , package_(ros::package::getPath("pi_speech"))
  , topic_(node.resolveName(options_.stamped ? "audio_stamped" : "audio"))
  , info_topic_(node.resolveName("audio_info"))
  , warnings_(options_.warning_period_s, pi_node::warningLog<RecognizerRosOptions>("recognizer"))
  , diagnostics_(service_node_, private_node, &warnings_)
  , tasks_(options_.use_runtime
               ? std::make_unique<RecognizerTasks>(pi_runtime::Runtime::shared(),
                                                   [this](const std::string& text) { warnings_.error(text); })
               : nullptr)
  , elsewhere_(options_.utterance_service.empty() ? nullptr
                                                  : std::make_unique<UtteranceService>(node, options_.utterance_service,
                                                                                       options_.utterance_deadline_s))
  , listening_(options_.start_listening)
  , format_(options_.format)
  , check_(std::make_unique<SoundCheck>(options_.check, steadyNs()))
  // Arrivals shake more than stamps.
  , stream_(options_.stamped ? options_.max_gap_s : std::max(options_.max_gap_s, options_.check.missing_s))
{
  asked_for_.file = options_.commandsFile(package_);
  figures_.topic = topic_;
  figures_.mode = toString(options_.recognizer.mode);
  figures_.loading = asked_for_.name();
  figures_.use_runtime = tasks_ != nullptr;
  figures_.dictation = options_.dictation;

  const auto look = [this](const ros::SingleSubscriberPublisher&) { updateSubscription(); };
  command_ = service_node_.advertise<VoiceCommand>("command", OUTPUT_QUEUE, look, look);
  output_ = service_node_.advertise<std_msgs::String>("recognizer/output", OUTPUT_QUEUE, look, look);
  rejected_ = service_private_node_.advertise<VoiceCommand>("rejected", OUTPUT_QUEUE, look, look);
  if (options_.dictation)
  {
    written_ = service_node_.advertise<std_msgs::String>("dictation", OUTPUT_QUEUE, look, look);
  }
  services_.push_back(service_private_node_.advertiseService("start", &RecognizerRos::start, this));
  services_.push_back(service_private_node_.advertiseService("stop", &RecognizerRos::stop, this));
  services_.push_back(loader_private_node_.advertiseService("set_commands", &RecognizerRos::setCommands, this));
  timer_ = service_node_.createWallTimer(ros::WallDuration(options_.diagnostic_period),
                                         [this](const ros::WallTimerEvent&) { publishDiagnostics(); });
  loader_thread_.post(
      [this]
      {
        std::string message;
        load(asked_for_, &message);
      });
  service_thread_.post([this] { updateSubscription(); });

  worker_ = std::thread([this] { work(); });
  if (options_.dictation)
  {
    dictation_thread_ = std::thread([this] { dictate(); });
  }
  input_thread_.start();
  loader_thread_.start();
  service_thread_.start();
}

RecognizerRos::~RecognizerRos()
{
  {
    std::lock_guard<std::mutex> lock(mutex_);
    stopping_ = true;
  }
  work_changed_.notify_all();
  dictation_changed_.notify_all();
  worker_.join();
  if (dictation_thread_.joinable())
  {
    dictation_thread_.join();
  }
  input_thread_.stop();
  service_thread_.stop();
  loader_thread_.stop();
  audio_.shutdown();
  info_.shutdown();
  services_.clear();
}

// ------------------------------------------------------------------------------------------------------- speech_input

void RecognizerRos::onStamped(const AudioDataStampedConstPtr& message)
{
  Chunk chunk;
  chunk.audio = AudioDataConstPtr(message, &message->audio);  // keeps the whole
  take(std::move(chunk), message->header);
}

void RecognizerRos::onAudio(const AudioDataConstPtr& message)
{
  Chunk chunk;
  chunk.audio = message;
  take(std::move(chunk), std_msgs::Header());
}

void RecognizerRos::take(Chunk chunk, const std_msgs::Header& header)
{
  chunk.came_at = Clock::now();
  chunk.frame_id = header.frame_id;
  std::string warning;
  {
    std::lock_guard<std::mutex> lock(mutex_);
    if (!taking_)
    {
      return;
    }
    ++figures_.chunks;
    if (!figures_.input_problem.empty())
    {
      ++figures_.unusable;
      return;
    }
    chunk.format = format_;
    chunk.duration_s =
        static_cast<double>(chunk.audio->data.size()) / (2.0 * format_.channels * format_.sample_rate_hz);
    if (!format_known_ && without_info_s_ < LEAST_SAID_S)
    {
      without_info_s_ += chunk.duration_s;
      if (without_info_s_ >= LEAST_SAID_S)
      {
        warning = topic_ + ": no audio_info yet, the sound is taken as " + std::to_string(format_.sample_rate_hz) +
                  " Hz, channels = " + std::to_string(format_.channels) +
                  "; set sample_rate and channels if it is something else";
      }
    }
    if (header.stamp.isZero())
    {
      const ros::Time now = ros::Time::now();
      const ros::Duration before(chunk.duration_s);
      chunk.stamp_ns = static_cast<int64_t>(now.toNSec()) - before.toNSec();
    }
    else
    {
      chunk.stamp_ns = static_cast<int64_t>(header.stamp.toNSec());
    }
    waiting_s_ += chunk.duration_s;
    chunks_.push_back(std::move(chunk));
    uint64_t dropped = 0;
    while (waiting_s_ > options_.queue_s && chunks_.size() > 1)
    {
      waiting_s_ -= chunks_.front().duration_s;
      chunks_.pop_front();
      chunks_.front().after_loss = true;
      ++dropped;
    }
    if (dropped > 0 && (figures_.commands > 0 || figures_.loading.empty()))
    {
      figures_.dropped += dropped;
      warning = topic_ + format(": more than %.1f s of sound wait, the oldest is dropped", options_.queue_s) +
                "; the computer is too busy for the recogniser";
    }
  }
  work_changed_.notify_one();
  if (!warning.empty())
  {
    warnings_.warn(warning);
  }
  if (options_.stamped && header.stamp.isZero())
  {
    warnings_.warn(topic_ + ": stamp is 0, so the arrival counts; the driver must stamp its messages");
  }
}

void RecognizerRos::onInfo(const AudioInfoConstPtr& message)
{
  AudioFormat found;
  std::string problem;
  try
  {
    found = fromMsg(*message);
  }
  catch (const std::invalid_argument& error)
  {
    problem = info_topic_ + ": " + error.what();
  }
  {
    std::lock_guard<std::mutex> lock(mutex_);
    if (problem.empty())
    {
      format_ = found;
      format_known_ = true;
    }
    std::swap(problem, figures_.input_problem);  // what is left is what was said before
    if (figures_.input_problem.empty() || figures_.input_problem == problem)
    {
      return;
    }
    problem = figures_.input_problem;
  }
  ROS_ERROR_STREAM_NAMED("recognizer", problem << "; the sound is ignored until another audio_info comes");
}

// ------------------------------------------------------------------------------------------------------ speech_worker

void RecognizerRos::work()
{
  pthread_setname_np(pthread_self(), "speech_worker");
  const std::chrono::duration<double> missing(options_.check.missing_s);
  std::unique_lock<std::mutex> lock(mutex_);
  while (true)
  {
    const bool in_speech = recognizer_ && recognizer_->inSpeech();
    const auto due = [this, in_speech]
    {
      // What is said while the first models are loaded waits for them.
      const bool sound = !chunks_.empty() && (recognizer_ || figures_.loading.empty());
      return stopping_ || forget_ || sound || (next_.recognizer && !in_speech);
    };
    bool sound_stays_away = false;
    if (in_speech)
    {
      sound_stays_away = !work_changed_.wait_for(lock, missing, due);
    }
    else
    {
      work_changed_.wait(lock, due);
    }
    if (stopping_)
    {
      return;
    }
    if (forget_ || sound_stays_away)
    {
      const bool tell = !forget_;
      forget_ = false;
      lock.unlock();
      endPiece(tell);
      lock.lock();
    }
    else if (next_.recognizer && !in_speech)
    {
      Loaded loaded = std::move(next_);
      next_ = Loaded();
      lock.unlock();
      takeOver(std::move(loaded));
      lock.lock();
    }
    else
    {
      const Chunk chunk = std::move(chunks_.front());
      chunks_.pop_front();
      waiting_s_ = chunks_.empty() ? 0.0 : waiting_s_ - chunk.duration_s;
      lock.unlock();
      const double cpu_s = cpuSeconds();
      workOn(chunk);
      diagnostics_.addWork(cpuSeconds() - cpu_s, chunk.duration_s);
      lock.lock();
    }
    if (tasks_)
    {
      figures_.tasks = tasks_->figures();
    }
    figures_.in_speech = recognizer_ && recognizer_->inSpeech();
    figures_.noise_dbfs = recognizer_ ? recognizer_->noiseLevelDbfs() : 0.0;
  }
}

double RecognizerRos::cpuSeconds() const
{
  return threadCpuSeconds() + (tasks_ ? tasks_->figures().cpu_s : 0.0);
}

void RecognizerRos::takeOver(Loaded loaded)
{
  recognizer_ = std::move(loaded.recognizer);
  recognizer_begin_ = stream_.samples();
  std::lock_guard<std::mutex> lock(mutex_);
  figures_.understood = loaded.understood;
  figures_.commands = recognizer_->table().commands.size();
  figures_.word_models = recognizer_->usesWordModels();
}

void RecognizerRos::workOn(const Chunk& chunk)
{
  try
  {
    fromMsg(*chunk.audio, chunk.format, &raw_);
  }
  catch (const std::invalid_argument& error)
  {
    warnings_.error(topic_ + ": " + error.what() + "; message ignored");
    std::lock_guard<std::mutex> lock(mutex_);
    ++figures_.unusable;
    return;
  }
  checkSound(chunk);
  const SoundStream::Break found = stream_.look(chunk.format, chunk.stamp_ns);
  if (chunk.after_loss || found != SoundStream::Break::NONE)
  {
    const double gap_s = stream_.gapBefore(chunk.stamp_ns);
    endPiece(true);
    if (!chunk.after_loss && found == SoundStream::Break::GAP)
    {
      warnings_.warn(topic_ + format(": %.2f s of sound are missing before a message", gap_s) +
                     "; is the computer of the microphone, or the network, too busy?");
    }
    else if (!chunk.after_loss && found == SoundStream::Break::BACK)
    {
      warnings_.warn(topic_ + format(": stamps went back by %.2f s", -gap_s) +
                     "; a recording that begins again, or two sources of sound?");
    }
    std::lock_guard<std::mutex> lock(mutex_);
    if (!chunk.after_loss)
    {
      figures_.gaps += found == SoundStream::Break::GAP ? 1 : 0;
      figures_.backs += found == SoundStream::Break::BACK ? 1 : 0;
    }
    figures_.formats += found == SoundStream::Break::FORMAT ? 1 : 0;
  }
  came_at_ = chunk.came_at;
  frame_id_ = chunk.frame_id;
  samples_.clear();
  stream_.add(chunk.format, chunk.stamp_ns, raw_.data(), raw_.size(), &samples_);
  recognize(samples_);
}

void RecognizerRos::checkSound(const Chunk& chunk)
{
  std::string warning;
  {
    std::lock_guard<std::mutex> lock(check_mutex_);
    if (const auto change = check_->add(chunk.format, raw_.data(), raw_.size(), steadyNs()))
    {
      sound_ = *change;
      warning = change->state == SoundState::GOOD ? "" : topic_ + ": " + change->text;
    }
  }
  if (!warning.empty())
  {
    warnings_.warn(warning);
  }
}

void RecognizerRos::recognize(const Samples& samples)
{
  if (!recognizer_ || samples.empty())
  {
    return;
  }
  try
  {
    recognizer_->process(samples.data(), samples.size(),
                         [this](const Recognition& recognition) { onRecognition(recognition); });
  }
  catch (const std::exception& error)
  {
    warnings_.error(std::string("recognition failed: ") + error.what());
  }
}

void RecognizerRos::endPiece(bool tell)
{
  forgetting_ = !tell;
  samples_.clear();
  stream_.end(&samples_);
  recognize(samples_);
  if (recognizer_)
  {
    try
    {
      recognizer_->flush([this](const Recognition& recognition) { onRecognition(recognition); });
    }
    catch (const std::exception& error)
    {
      warnings_.error(std::string("recognition failed: ") + error.what());
    }
  }
  forgetting_ = false;
}

void RecognizerRos::onRecognition(const Recognition& recognition)
{
  {
    std::lock_guard<std::mutex> lock(mutex_);
    if (forgetting_ || forget_)  // it was stopped meanwhile
    {
      return;
    }
  }
  const int64_t speech_end = recognizer_begin_ + recognition.speech_end;
  VoiceCommand message;
  message.text = recognition.text;
  message.confidence = static_cast<float>(recognition.confidence);
  message.speech_start = toRos(stream_.timeOf(recognizer_begin_ + recognition.speech_begin));
  // The end is that of the sample before it, which may be the last before a break.
  message.speech_end = toRos(stream_.timeOf(speech_end - 1) + 1000000000 / SAMPLE_RATE_HZ);
  message.header.stamp = message.speech_end;
  message.header.frame_id = frame_id_;
  message.fast = recognition.fast;
  const double latency_s =
      samplesToSeconds(stream_.samples() - speech_end) + std::chrono::duration<double>(Clock::now() - came_at_).count();
  message.latency = ros::Duration(latency_s);
  if (recognition.accepted)
  {
    command_.publish(message);
    output_.publish(toMsg(recognition.text));
    ROS_INFO_STREAM_NAMED("recognizer", "heard \"" << recognition.text << "\""
                                                   << format(", confidence %.2f", recognition.confidence)
                                                   << format(", %.0f ms after its end", 1e3 * latency_s)
                                                   << (recognition.fast ? ", fast" : "")
                                                   << (recognition.place.empty() ? "" : ", by " + recognition.place));
  }
  else
  {
    rejected_.publish(message);
    ROS_DEBUG_STREAM_NAMED("recognizer", "rejected \"" << recognition.text << "\": " << recognition.reason
                                                       << format(", confidence %.2f", recognition.confidence)
                                                       << format(", %.0f dB over the noise", recognition.snr_db));
  }
  diagnostics_.addRecognition(recognition, latency_s);
}

void RecognizerRos::onUtterance(const Utterance& utterance, const Recognition& recognition)
{
  if (forgetting_)
  {
    return;
  }
  if (utterance.cut)
  {
    warnings_.warn(
        topic_ + format(": speech without a pause for %.1f s is cut", options_.recognizer.end_pointer.max_utterance_s) +
        "; a radio, wind, or a microphone that is too far away?");
  }
  if (!options_.dictation || recognition.accepted || written_.getNumSubscribers() == 0)
  {
    return;
  }
  {
    std::lock_guard<std::mutex> lock(mutex_);
    if (!dictation_ready_)
    {
      return;
    }
    if (dictation_.size() >= DICTATION_QUEUE)
    {
      dictation_.pop_front();
      ++figures_.dictation_dropped;
    }
    dictation_.push_back(utterance.samples);
  }
  dictation_changed_.notify_one();
}

// ------------------------------------------------------------------------------------------------------ speech_loader

std::string RecognizerRos::Source::name() const
{
  return file.empty() ? "a list of " + std::to_string(texts.size()) + " commands" : file;
}

bool RecognizerRos::load(const Source& source, std::string* message)
{
  {
    std::lock_guard<std::mutex> lock(mutex_);
    figures_.loading = source.name();
  }
  Loaded loaded;
  std::string problem;
  try
  {
    const CommandTable table = source.file.empty() ? tableOf(source.texts) : CommandTable::load(source.file);
    loaded.recognizer = std::make_unique<CommandRecognizer>(options_.recognizerOptions(package_), table);
    loaded.understood = textsOf(loaded.recognizer->table());
    loaded.recognizer->setUtteranceSink([this](const Utterance& utterance, const Recognition& recognition)
                                        { onUtterance(utterance, recognition); });
    if (tasks_)
    {
      loaded.recognizer->setRunner([this](double speech_s, const std::function<void()>& work)
                                   { tasks_->run(speech_s, work); });
    }
    if (elsewhere_)
    {
      std::vector<std::string> commands;
      for (const Command& command : loaded.recognizer->table().commands)
      {
        commands.push_back(command.text);
      }
      loaded.recognizer->setElsewhere([this, commands](const Utterance& utterance)
                                      { return elsewhere_->ask(utterance, commands); });
    }
  }
  catch (const std::exception& error)
  {
    problem = error.what();
  }
  if (!loaded.recognizer)
  {
    std::lock_guard<std::mutex> lock(mutex_);
    const std::string& understood = next_.recognizer ? next_.understood : figures_.understood;
    *message = problem + (understood.empty() ? "; nothing is understood until set_commands is called and all is right"
                                             : "; these stay in use: " + understood);
    ROS_ERROR_STREAM_NAMED("recognizer", *message);
    figures_.loading.clear();
    figures_.problem = problem;
    work_changed_.notify_one();
    return false;
  }
  *message = "understands " + loaded.understood + " (" + (loaded.recognizer->usesWordModels() ? "with" : "without") +
             " models of whole words)";
  ROS_INFO_STREAM_NAMED("recognizer", *message);
  {
    std::lock_guard<std::mutex> lock(mutex_);
    std::swap(next_, loaded);  // one that was never used ends after the lock
    figures_.loading.clear();
    figures_.problem.clear();
  }
  work_changed_.notify_one();
  return true;
}

bool RecognizerRos::setCommands(SetCommands::Request& request, SetCommands::Response& response)
{
  if (!request.file.empty() && !request.commands.empty())
  {
    response.message = "file and commands are both given, must be one of them";
    return true;
  }
  if (!request.file.empty() && request.file.front() != '/')
  {
    response.message =
        "file = \"" + request.file + "\", must be an absolute path: the node's working folder is not the caller's";
    return true;
  }
  if (!request.file.empty() || !request.commands.empty())
  {
    asked_for_ = Source{request.file, request.commands};
  }
  response.success = load(asked_for_, &response.message);
  return true;
}

// ----------------------------------------------------------------------------------------------------- speech_dictate

void RecognizerRos::dictate()
{
  pthread_setname_np(pthread_self(), "speech_dictate");
  setpriority(PRIO_PROCESS, static_cast<id_t>(syscall(SYS_gettid)), DICTATION_NICE);
  std::unique_ptr<SphinxDecoder> decoder;
  std::string problem;
  try
  {
    decoder = std::make_unique<SphinxDecoder>(options_.recognizerOptions(package_).sphinx, std::vector<std::string>(),
                                              std::vector<std::string>());
  }
  catch (const std::exception& error)
  {
    problem = error.what();
  }
  std::unique_lock<std::mutex> lock(mutex_);
  if (!decoder)
  {
    figures_.dictation_problem = problem;
    lock.unlock();
    ROS_ERROR_STREAM_NAMED("recognizer", "no dictation: " << problem);
    return;
  }
  dictation_ready_ = true;
  while (true)
  {
    dictation_changed_.wait(lock, [this] { return stopping_ || !dictation_.empty(); });
    if (stopping_)
    {
      return;
    }
    const Samples samples = std::move(dictation_.front());
    dictation_.pop_front();
    lock.unlock();
    std::string text;
    try
    {
      text = decoder->decode(samples).text();
    }
    catch (const std::exception& error)
    {
      warnings_.error(std::string("dictation failed: ") + error.what());
    }
    if (!text.empty())
    {
      written_.publish(toMsg(text));
    }
    lock.lock();
    figures_.dictated += text.empty() ? 0 : 1;
  }
}

}  // namespace pi_speech
