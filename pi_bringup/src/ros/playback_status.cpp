#include <diagnostic_msgs/DiagnosticStatus.h>
#include <pi_bringup/ros/playback_status.h>

#include <sstream>

namespace pi_bringup
{

namespace
{

diagnostic_msgs::KeyValue keyValue(const std::string& key, const std::string& value)
{
  diagnostic_msgs::KeyValue pair;
  pair.key = key;
  pair.value = value;
  return pair;
}

}  // namespace

PlaybackStatus::PlaybackStatus(ros::NodeHandle& private_node, const std::string& player) : player_(player)
{
  publisher_ = private_node.advertise<diagnostic_msgs::DiagnosticStatus>("status", 10, true);
}

void PlaybackStatus::count(const ros::Publisher& publisher, int64_t lateness_ns)
{
  ++published_[publisher.getTopic()];
  lateness_.record(lateness_ns);
}

void PlaybackStatus::skip(const std::string& reason)
{
  if (skipped_++ == 0)
  {
    ROS_WARN_STREAM_NAMED("playback", "picture skipped: " << reason << " (further ones are only counted)");
  }
}

void PlaybackStatus::finished()
{
  std::ostringstream figures;
  for (const auto& [topic, count] : published_)
  {
    figures << "\n  " << count << " x " << topic;
  }
  ROS_INFO_STREAM_NAMED("playback", "published:" << figures.str() << "\n  skipped pictures: " << skipped_
                                                 << "; behind schedule: mean " << lateness_.meanNs() * 1e-6
                                                 << " ms, max " << static_cast<double>(lateness_.maxNs()) * 1e-6
                                                 << " ms, over 10 ms " << lateness_.overTenMilliseconds() << " of "
                                                 << lateness_.count());
  publish("finished");
}

void PlaybackStatus::publish(const std::string& state)
{
  diagnostic_msgs::DiagnosticStatus status;
  status.level = skipped_ == 0 ? diagnostic_msgs::DiagnosticStatus::OK : diagnostic_msgs::DiagnosticStatus::WARN;
  status.name = player_;
  status.message = state;
  for (const auto& [topic, count] : published_)
  {
    status.values.push_back(keyValue("published " + topic, std::to_string(count)));
  }
  status.values.push_back(keyValue("skipped pictures", std::to_string(skipped_)));
  status.values.push_back(keyValue("lateness mean [ms]", std::to_string(lateness_.meanNs() * 1e-6)));
  status.values.push_back(keyValue("lateness max [ms]", std::to_string(static_cast<double>(lateness_.maxNs()) * 1e-6)));
  status.values.push_back(keyValue("late by more than 1 ms", std::to_string(lateness_.overOneMillisecond())));
  status.values.push_back(keyValue("late by more than 10 ms", std::to_string(lateness_.overTenMilliseconds())));
  publisher_.publish(status);
}

}  // namespace pi_bringup
