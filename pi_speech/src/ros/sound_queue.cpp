#include "ros/sound_queue.h"

#include <pi_node/formatting.h>
#include <pi_speech/ros/audio_conversions.h>

#include <stdexcept>
#include <utility>

namespace pi_speech
{
namespace
{

constexpr double LEAST_WARNED_S = 1.0;  ///< of sound without audio_info, which may come second

}  // namespace

SoundQueue::SoundQueue(std::string topic, const AudioFormat& format, double most_s)
  : topic_(std::move(topic)), most_s_(most_s)
{
  figures_.format = format;
}

std::string SoundQueue::add(const AudioDataConstPtr& audio, const std_msgs::Header& header, bool ready)
{
  ++figures_.chunks;
  if (!figures_.problem.empty())
  {
    ++figures_.unusable;
    return "";
  }
  SoundChunk chunk;
  chunk.audio = audio;
  chunk.format = figures_.format;
  chunk.frame_id = header.frame_id;
  chunk.came_at = std::chrono::steady_clock::now();
  chunk.duration_s =
      static_cast<double>(audio->data.size()) / (2.0 * chunk.format.channels * chunk.format.sample_rate_hz);
  chunk.stamp_ns = static_cast<int64_t>(header.stamp.toNSec());
  if (header.stamp.isZero())
  {
    chunk.stamp_ns = static_cast<int64_t>(ros::Time::now().toNSec()) - ros::Duration(chunk.duration_s).toNSec();
  }
  std::string warning = noteMissingInfo(chunk.duration_s);
  figures_.waiting_s += chunk.duration_s;
  chunks_.push_back(std::move(chunk));
  const std::string loss = dropOldest(ready);
  return loss.empty() ? warning : loss;
}

std::string SoundQueue::noteMissingInfo(double duration_s)
{
  if (figures_.format_known || without_info_s_ >= LEAST_WARNED_S)
  {
    return "";
  }
  without_info_s_ += duration_s;
  return without_info_s_ < LEAST_WARNED_S
             ? ""
             : topic_ + ": no audio_info yet, the sound is taken as " + std::to_string(figures_.format.sample_rate_hz) +
                   " Hz, channels = " + std::to_string(figures_.format.channels) +
                   "; set sample_rate and channels if it is something else";
}

std::string SoundQueue::dropOldest(bool ready)
{
  uint64_t dropped = 0;
  for (; figures_.waiting_s > most_s_ && chunks_.size() > 1; ++dropped)
  {
    figures_.waiting_s -= chunks_.front().duration_s;
    chunks_.pop_front();
    chunks_.front().after_loss = true;
  }
  if (dropped == 0 || !ready)
  {
    return "";
  }
  figures_.dropped += dropped;
  return topic_ + pi_node::format(": more than %.1f s of sound wait, the oldest is dropped", most_s_) +
         "; the computer is too busy for the recogniser";
}

SoundChunk SoundQueue::take()
{
  SoundChunk chunk = std::move(chunks_.front());
  chunks_.pop_front();
  figures_.waiting_s = chunks_.empty() ? 0.0 : figures_.waiting_s - chunk.duration_s;
  return chunk;
}

void SoundQueue::clear()
{
  chunks_.clear();
  figures_.waiting_s = 0.0;
}

std::string SoundQueue::setInfo(const AudioInfo& info, const std::string& topic)
{
  std::string problem;
  try
  {
    figures_.format = fromMsg(info);
    figures_.format_known = true;
  }
  catch (const std::invalid_argument& error)
  {
    problem = topic + ": " + error.what();
  }
  return std::exchange(figures_.problem, problem) != problem ? problem : "";
}

}  // namespace pi_speech
