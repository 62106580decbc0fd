#include "ros/recognizer_ros.h"

#include <pi_node/formatting.h>
#include <pi_node/ros/node_options.h>
#include <ros/package.h>
#include <std_msgs/String.h>

namespace pi_speech
{
namespace
{

using pi_node::format;

constexpr uint32_t OUTPUT_QUEUE = 20;
constexpr uint32_t INPUT_QUEUE = 500;  ///< messages that wait for speech_input: 10 s of 20 ms

std_msgs::String toMsg(const std::string& text)
{
  std_msgs::String message;
  message.data = text;
  return message;
}

}  // namespace

RecognizerRos::RecognizerRos(ros::NodeHandle node, ros::NodeHandle private_node)
  : input_thread_("speech_input")
  , service_thread_("speech_service")
  , input_node_(input_thread_.handle(node))
  , service_node_(service_thread_.handle(node))
  , private_node_(service_thread_.handle(private_node))
  , options_(pi_node::loadNodeOptions<RecognizerRosOptions>(private_node, "recognizer"))
  , topic_(node.resolveName(options_.stamped ? "audio_stamped" : "audio"))
  , warnings_(options_.warning_period_s, pi_node::warningLog<RecognizerRosOptions>("recognizer"))
  , diagnostics_(service_node_, private_node, &warnings_)
  , worker_(node, options_, topic_, &warnings_, &diagnostics_,
            {[this](const VoiceCommand& message, const Recognition& recognition, double latency_s)
             { publish(message, recognition, latency_s); },
             [this](const Utterance& utterance, const Recognition& recognition)
             {
               if (dictation_ && !recognition.accepted && written_.getNumSubscribers() > 0)
               {
                 dictation_->add(utterance.samples);
               }
             }})
  , loader_(private_node, options_, ros::package::getPath("pi_speech"), &worker_)
  , listening_(options_.start_listening)
{
  const auto look = [this](const ros::SingleSubscriberPublisher&) { updateSubscription(); };
  command_ = service_node_.advertise<VoiceCommand>("command", OUTPUT_QUEUE, look, look);
  output_ = service_node_.advertise<std_msgs::String>("recognizer/output", OUTPUT_QUEUE, look, look);
  doubtful_ = service_node_.advertise<VoiceCommand>("doubtful_command", OUTPUT_QUEUE, look, look);
  rejected_ = private_node_.advertise<VoiceCommand>("rejected", OUTPUT_QUEUE, look, look);
  if (options_.dictation)
  {
    written_ = service_node_.advertise<std_msgs::String>("dictation", OUTPUT_QUEUE, look, look);
    dictation_ =
        std::make_unique<Dictation>(options_.recognizerOptions(ros::package::getPath("pi_speech")).sphinx, &warnings_,
                                    [this](const std::string& text) { written_.publish(toMsg(text)); });
  }
  for (const bool wanted : {true, false})
  {
    services_.push_back(private_node_.advertiseService<std_srvs::Empty::Request, std_srvs::Empty::Response>(
        wanted ? "start" : "stop",
        [this, wanted](std_srvs::Empty::Request&, std_srvs::Empty::Response&) { return listen(wanted); }));
  }
  timer_ = pi_node::VehicleTimer(service_node_, options_.diagnostic_period, [this] { publishDiagnostics(); });
  service_thread_.post([this] { updateSubscription(); });

  worker_.start();
  input_thread_.start();
  loader_.start();
  service_thread_.start();
}

RecognizerRos::~RecognizerRos()
{
  worker_.stop();
  if (dictation_)
  {
    dictation_->stop();
  }
  input_thread_.stop();
  service_thread_.stop();
  loader_.stop();
  audio_.shutdown();
  info_.shutdown();
  services_.clear();
}

void RecognizerRos::take(const AudioDataConstPtr& audio, const std_msgs::Header& header)
{
  if (worker_.add(audio, header) && options_.stamped && header.stamp.isZero())
  {
    warnings_.warn(topic_ + ": stamp is 0, so the arrival counts; the driver must stamp its messages");
  }
}

void RecognizerRos::publish(const VoiceCommand& message, const Recognition& recognition, double latency_s)
{
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
    if (recognition.doubtful)
    {
      doubtful_.publish(message);
      ROS_INFO_STREAM_NAMED("recognizer", "perhaps heard \"" << recognition.text << "\": " << recognition.reason);
    }
    rejected_.publish(message);
    ROS_DEBUG_STREAM_NAMED("recognizer", "rejected \"" << recognition.text << "\": " << recognition.reason
                                                       << format(", confidence %.2f", recognition.confidence)
                                                       << format(", %.0f dB over the noise", recognition.snr_db));
  }
  diagnostics_.addRecognition(recognition, latency_s);
}

bool RecognizerRos::listen(bool wanted)
{
  listening_ = wanted;
  updateSubscription();
  ROS_INFO_STREAM_NAMED("recognizer", (wanted ? "listens" : "stopped"));
  return true;
}

void RecognizerRos::updateSubscription()
{
  const bool heard = options_.always_on || command_.getNumSubscribers() > 0 || output_.getNumSubscribers() > 0 ||
                     doubtful_.getNumSubscribers() > 0 || rejected_.getNumSubscribers() > 0 ||
                     (options_.dictation && written_.getNumSubscribers() > 0);
  const bool wanted = listening_ && heard;
  if (wanted == subscribed_)
  {
    return;
  }
  subscribed_ = wanted;
  worker_.take(wanted);
  if (!wanted)
  {
    audio_.shutdown();
    info_.shutdown();
    return;
  }
  const ros::TransportHints hints = ros::TransportHints().tcpNoDelay();
  info_ = input_node_.subscribe<AudioInfo>(
      "audio_info", 1,
      [this](const AudioInfoConstPtr& info) { worker_.addInfo(*info, input_node_.resolveName("audio_info")); },
      ros::VoidConstPtr(), hints);
  if (options_.stamped)
  {
    audio_ = input_node_.subscribe<AudioDataStamped>(
        "audio_stamped", INPUT_QUEUE,
        [this](const AudioDataStampedConstPtr& message)
        { take(AudioDataConstPtr(message, &message->audio), message->header); },  // keeps the whole
        ros::VoidConstPtr(), hints);
    return;
  }
  audio_ = input_node_.subscribe<AudioData>(
      "audio", INPUT_QUEUE, [this](const AudioDataConstPtr& message) { take(message, std_msgs::Header()); },
      ros::VoidConstPtr(), hints);
}

void RecognizerRos::publishDiagnostics()
{
  updateSubscription();  // also when somebody left without saying so
  RecognizerFigures figures;
  worker_.report(subscribed_, &figures);
  figures.topic = topic_;
  figures.mode = toString(options_.recognizer.mode);
  figures.listening = listening_;
  figures.subscribed = subscribed_;
  if (dictation_)
  {
    figures.dictation = dictation_->figures();
  }
  diagnostics_.update(figures);
}

}  // namespace pi_speech
