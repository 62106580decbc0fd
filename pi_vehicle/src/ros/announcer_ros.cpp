#include "ros/announcer_ros.h"

#include "announcer/sound_output.h"

#include <diagnostic_msgs/DiagnosticStatus.h>
#include <pi_node/option_check.h>
#include <pi_node/ros/node_options.h>
#include <pi_node/ros/parameter_tree.h>
#include <pthread.h>

#include <exception>

namespace pi_vehicle
{

namespace parameter_tree = pi_node::parameter_tree;
using XmlRpc::XmlRpcValue;

/// Every parameter by its name, with its field.
template <typename Visitor>
static void visitFields(AnnouncerRosOptions& options, Visitor&& visit)
{
  visit("device", options.device);
  visit("voice", options.voice);
  visit("words_per_minute", options.words_per_minute);
  visit("horn_s", options.horn_s);
  visit("queue_size", options.queue_size);
  visit("diagnostic_period", options.diagnostic_period);
  visit("warning_period_s", options.warning_period_s);
}

namespace
{

using diagnostic_msgs::DiagnosticStatus;

constexpr int HORN_RATE = 22050;  // [Hz]

}  // namespace

void AnnouncerRosOptions::validate() const
{
  const pi_node::OptionCheck check("");
  pi_node::parameters::require(!device.empty(), "device", "\"\"", "a name that aplay -L lists");
  pi_node::parameters::require(!voice.empty(), "voice", "\"\"", "a voice of espeak-ng, as en-us");
  check.range("words_per_minute", words_per_minute, 80, 450);
  check.range("horn_s", horn_s, 0.05, 5.0);
  check.range("queue_size", queue_size, 1, 100);
  parameter_tree::requireDuration("diagnostic_period", diagnostic_period);
  parameter_tree::requireDuration("warning_period_s", warning_period_s);
}

AnnouncerRos::AnnouncerRos(ros::NodeHandle node, ros::NodeHandle private_node)
  : thread_("announcer")
  , node_(thread_.handle(node))
  , options_(pi_node::loadNodeOptions<AnnouncerRosOptions>(private_node, "announcer"))
  , warnings_(options_.warning_period_s, pi_node::warningLog<AnnouncerRosOptions>("announcer"))
  , updater_(node_, private_node, private_node.getNamespace())
{
  updater_.setHardwareID(options_.device);
  updater_.add("announcer", [this](Status& status) { report(status); });
  sound_thread_ = std::thread(&AnnouncerRos::run, this);
  pthread_setname_np(sound_thread_.native_handle(), "announcer_sound");
  say_ = node_.subscribe("say", 10, &AnnouncerRos::onSay, this);
  horn_ = node_.subscribe("horn", 1, &AnnouncerRos::onHorn, this, ros::TransportHints().tcpNoDelay());
  diagnostic_timer_ = pi_node::VehicleTimer(node_, options_.diagnostic_period, [this] { updater_.force_update(); });
  thread_.start();
}

AnnouncerRos::~AnnouncerRos()
{
  thread_.stop();
  {
    std::lock_guard<std::mutex> lock(mutex_);
    stopping_ = true;
  }
  changed_.notify_one();
  sound_thread_.join();
}

void AnnouncerRos::onSay(const std_msgs::String& message)
{
  ROS_INFO_STREAM_NAMED("announcer", "says: " << message.data);
  {
    std::lock_guard<std::mutex> lock(mutex_);
    if (texts_.size() >= static_cast<size_t>(options_.queue_size))
    {
      warnings_.warn("texts come faster than they can be spoken; the oldest was dropped");
      texts_.pop_front();
    }
    texts_.push_back(message.data);
  }
  changed_.notify_one();
}

void AnnouncerRos::onHorn(const std_msgs::Empty&)
{
  ROS_INFO_STREAM_NAMED("announcer", "blows the horn");
  {
    std::lock_guard<std::mutex> lock(mutex_);
    horn_waits_ = true;
  }
  changed_.notify_one();
}

void AnnouncerRos::run()
{
  std::unique_lock<std::mutex> lock(mutex_);
  while (true)
  {
    changed_.wait(lock, [this] { return stopping_ || horn_waits_ || !texts_.empty(); });
    if (stopping_)
    {
      return;
    }
    const bool horn = horn_waits_;
    std::string text;
    if (!horn)
    {
      text = texts_.front();
      texts_.pop_front();
    }
    horn_waits_ = false;
    lock.unlock();
    std::string problem;
    try
    {
      sound(horn, text);
    }
    catch (const std::exception& error)
    {
      problem = error.what();
    }
    lock.lock();
    ++(problem.empty() ? heard_ : unheard_);
    if (problem != problem_)
    {
      problem_ = problem;
      if (problem.empty())
      {
        ROS_INFO_STREAM_NAMED("announcer", "is heard again");
      }
      else
      {
        ROS_ERROR_STREAM_NAMED("announcer", problem << "; what is said is in this log only");
      }
    }
  }
}

void AnnouncerRos::sound(bool horn, const std::string& text)
{
  if (horn)
  {
    playSound(options_.device, HORN_RATE, hornSound(HORN_RATE, options_.horn_s), stopping_);
    return;
  }
  if (!synthesizer_)
  {
    synthesizer_ = std::make_unique<SpeechSynthesizer>(options_.voice, options_.words_per_minute);
  }
  playSound(options_.device, synthesizer_->sampleRate(), synthesizer_->speak(text), stopping_);
}

void AnnouncerRos::report(Status& status)
{
  const std::vector<pi_node::WarningBoard::Entry> warnings = warnings_.recent();
  std::lock_guard<std::mutex> lock(mutex_);
  if (!problem_.empty())
  {
    status.summary(DiagnosticStatus::WARN, problem_ + "; what is said is in the log only");
  }
  else if (!warnings.empty())
  {
    status.summary(DiagnosticStatus::WARN, warnings.front().text);
  }
  else
  {
    status.summary(DiagnosticStatus::OK, heard_ > 0 ? "is heard" : "nothing said yet");
  }
  status.add("device", options_.device);
  status.add("sounds heard", heard_);
  status.add("sounds not heard", unheard_);
  status.add("texts waiting", texts_.size());
}

}  // namespace pi_vehicle

template struct pi_node::NodeParameters<pi_vehicle::AnnouncerRosOptions>;
