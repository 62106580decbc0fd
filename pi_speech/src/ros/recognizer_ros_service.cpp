// The thread speech_service of RecognizerRos.

#include "ros/recognizer_ros.h"

#include <string>

namespace pi_speech
{
namespace
{

constexpr uint32_t INPUT_QUEUE = 500;  ///< messages that wait for speech_input: 10 s of 20 ms

int64_t steadyNs()
{
  return std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::steady_clock::now().time_since_epoch())
      .count();
}

}  // namespace

bool RecognizerRos::start(std_srvs::Empty::Request&, std_srvs::Empty::Response&)
{
  {
    std::lock_guard<std::mutex> lock(mutex_);
    listening_ = true;
  }
  updateSubscription();
  ROS_INFO_NAMED("recognizer", "listens");
  return true;
}

bool RecognizerRos::stop(std_srvs::Empty::Request&, std_srvs::Empty::Response&)
{
  {
    std::lock_guard<std::mutex> lock(mutex_);
    listening_ = false;
  }
  updateSubscription();
  ROS_INFO_NAMED("recognizer", "stopped");
  return true;
}

void RecognizerRos::updateSubscription()
{
  bool wanted = false;
  {
    const bool heard = options_.always_on || command_.getNumSubscribers() > 0 || output_.getNumSubscribers() > 0 ||
                       rejected_.getNumSubscribers() > 0 || (options_.dictation && written_.getNumSubscribers() > 0);
    std::lock_guard<std::mutex> lock(mutex_);
    wanted = listening_ && heard;
    if (wanted == subscribed_)
    {
      return;
    }
    taking_ = wanted;
    if (!wanted)
    {
      chunks_.clear();
      waiting_s_ = 0.0;
      forget_ = true;
    }
  }
  subscribed_ = wanted;
  if (!wanted)
  {
    work_changed_.notify_one();
    audio_.shutdown();
    info_.shutdown();
    return;
  }
  {
    std::lock_guard<std::mutex> lock(check_mutex_);
    check_ = std::make_unique<SoundCheck>(options_.check, steadyNs());
    sound_ = SoundChange();
  }
  const ros::TransportHints hints = ros::TransportHints().tcpNoDelay();
  info_ = input_node_.subscribe("audio_info", 1, &RecognizerRos::onInfo, this, hints);
  audio_ = options_.stamped
               ? input_node_.subscribe("audio_stamped", INPUT_QUEUE, &RecognizerRos::onStamped, this, hints)
               : input_node_.subscribe("audio", INPUT_QUEUE, &RecognizerRos::onAudio, this, hints);
}

void RecognizerRos::publishDiagnostics()
{
  updateSubscription();  // also when somebody left without saying so
  RecognizerFigures figures;
  {
    std::lock_guard<std::mutex> lock(mutex_);
    figures = figures_;
    figures.listening = listening_;
    figures.format = format_;
    figures.format_known = format_known_;
    figures.waiting_s = waiting_s_;
  }
  figures.subscribed = subscribed_;
  std::string warning;
  {
    std::lock_guard<std::mutex> lock(check_mutex_);
    if (subscribed_)
    {
      if (const auto change = check_->look(steadyNs()))
      {
        sound_ = *change;
        warning = topic_ + ": " + change->text;
      }
    }
    figures.sound = sound_.state;
    figures.sound_text = sound_.text;
    figures.level_dbfs = check_->levelDbfs();
    figures.clipped_share = check_->clippedShare();
  }
  if (!warning.empty())
  {
    warnings_.warn(warning);
  }
  diagnostics_.update(figures);
}

}  // namespace pi_speech
