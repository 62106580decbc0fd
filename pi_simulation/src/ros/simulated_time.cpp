#include "ros/simulated_time.h"

#include <pi_node/durations.h>
#include <pi_node/formatting.h>
#include <pi_node/ros/time.h>
#include <pi_node/vehicle_clock.h>
#include <rosgraph_msgs/Clock.h>

#include <algorithm>
#include <sstream>
#include <stdexcept>
#include <utility>

namespace pi_simulation
{
namespace
{

constexpr uint32_t ANSWERS_QUEUE = 1000;
constexpr uint32_t SOUND_QUEUE = 100;
constexpr int STEPS_PER_CLOCK = 2;            ///< 200 Hz of simulated time
constexpr std::chrono::milliseconds LOOK(1);  ///< between two looks while the vehicle is waited for
constexpr std::chrono::milliseconds CLOCK_AGAIN(100);
constexpr double WARN_S = 5.0;
constexpr std::chrono::milliseconds CATCH_UP(100);  ///< most that is made up for after a wait

}  // namespace

SimulatedTime::SimulatedTime(ros::NodeHandle node, const SimulatedTimeOptions& options)
  : options_(options)
  , picture_topic_(node.resolveName("left/image_raw"))
  , clock_(node.advertise<rosgraph_msgs::Clock>("/clock", 10))
  , pace_(options.pace)
{
  if (!pi_node::isTimeSimulated())
  {
    throw std::runtime_error(
        "/use_sim_time = false: the simulator is the clock; set it to true before any node starts, "
        "as simulation.launch does");
  }
  const auto hints = ros::TransportHints().tcpNoDelay();
  answers_ = node.subscribe("/simulation/answers", ANSWERS_QUEUE, &SimulatedTime::onAnswer, this, hints);
  sound_ = node.subscribe<pi_speech::AudioDataStamped>(
      "audio_stamped", SOUND_QUEUE,
      [this](const pi_speech::AudioDataStampedConstPtr& message)
      { given("sound", pi_node::fromMsg(message->header.stamp)); },
      ros::VoidConstPtr(), hints);
}

int64_t SimulatedTime::nowNs() const
{
  const std::lock_guard<std::mutex> lock(mutex_);
  return now_ns_;
}

void SimulatedTime::given(const std::string& kind, int64_t stamp_ns)
{
  const std::lock_guard<std::mutex> lock(mutex_);
  pace_.given(kind, stamp_ns);
}

void SimulatedTime::answered(const std::string& kind, const std::string& who, int64_t stamp_ns)
{
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    pace_.answered(kind, who, stamp_ns);
  }
  changed_.notify_all();
}

void SimulatedTime::forget(const std::string& kind, const std::string& who)
{
  const std::lock_guard<std::mutex> lock(mutex_);
  pace_.forget(kind, who);
}

void SimulatedTime::onAnswer(const std_msgs::Header& message)
{
  std::istringstream words(message.frame_id);
  std::string kind;
  std::string service;
  std::string node;
  std::string topic;
  if (!(words >> kind >> service >> node) || (words >> topic && topic != picture_topic_))
  {
    return;  // a service whose pictures somebody else chooses
  }
  const std::string who = service + " " + node;
  if (message.stamp.isZero())
  {
    forget(kind, who);
  }
  else
  {
    answered(kind, who, pi_node::fromMsg(message.stamp));
  }
}

bool SimulatedTime::advance(const std::function<void()>& look)
{
  std::unique_lock<std::mutex> lock(mutex_);
  if (!awaitVehicle(&lock, look) || !awaitWall(&lock))
  {
    return false;
  }
  now_ns_ += STEP_NS;
  lock.unlock();
  if (now_ns_ / STEP_NS % STEPS_PER_CLOCK == 0)
  {
    publishClock();
  }
  return true;
}

/// Of the thread of advance(), which alone changes the time.
void SimulatedTime::publishClock()
{
  rosgraph_msgs::Clock message;
  message.clock = pi_node::toTime(now_ns_);
  clock_.publish(message);
}

void SimulatedTime::forgetTheDead()
{
  const uint32_t answering = answers_.getNumPublishers();
  if (answering < answering_)
  {
    pace_.forget();
  }
  answering_ = answering;
}

bool SimulatedTime::awaitVehicle(std::unique_lock<std::mutex>* lock, const std::function<void()>& look)
{
  const Clock::time_point begin = Clock::now();
  Clock::time_point clock_again = begin + CLOCK_AGAIN;
  bool warned = false;
  forgetTheDead();
  std::optional<VehiclePace::Awaited> awaited = pace_.awaited(now_ns_ + STEP_NS);
  if (!awaited && !stopping_)
  {
    return true;
  }
  while (awaited && !stopping_)
  {
    waited_for_ = awaited->kind + " " + awaited->who;
    const double waited_s = pi_node::secondsSince(begin);
    if (waited_s > WARN_S && !std::exchange(warned, true))
    {
      ROS_WARN_STREAM_NAMED("vehicle_simulator", "waits for " << waited_for_);
    }
    if (waited_s > options_.patience_s)
    {
      problem_ = awaited->who + " has not worked off " + awaited->kind + " later than " +
                 pi_node::format("%.2f", pi_node::secondsBetween(START_NS, awaited->answered_ns)) + " s of " +
                 pi_node::format("%.2f", pi_node::secondsBetween(START_NS, now_ns_)) +
                 " s simulated, and does not answer for " + pi_node::format("%.0f", waited_s) +
                 " s: look at its log, or give patience_s";
      return false;
    }
    changed_.wait_for(*lock, LOOK);
    lock->unlock();
    if (Clock::now() >= clock_again)
    {
      publishClock();  // for those who have subscribed since: without it they may wait for the time, and we for them
      clock_again = Clock::now() + CLOCK_AGAIN;
    }
    look();
    lock->lock();
    forgetTheDead();
    awaited = pace_.awaited(now_ns_ + STEP_NS);
  }
  waited_s_ += pi_node::secondsSince(begin);
  return !stopping_;
}

bool SimulatedTime::awaitWall(std::unique_lock<std::mutex>* lock)
{
  if (options_.realtime_factor <= 0.0)
  {
    return !stopping_;
  }
  const std::chrono::duration<double> step(pi_node::seconds(STEP_NS) / options_.realtime_factor);
  due_ = std::max(due_ + std::chrono::duration_cast<Clock::duration>(step), Clock::now() - CATCH_UP);
  return !changed_.wait_until(*lock, due_, [this] { return stopping_; });
}

std::string SimulatedTime::problem() const
{
  const std::lock_guard<std::mutex> lock(mutex_);
  return problem_;
}

void SimulatedTime::stop()
{
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    stopping_ = true;
  }
  changed_.notify_all();
}

SimulatedTime::Figures SimulatedTime::figures()
{
  const std::lock_guard<std::mutex> lock(mutex_);
  Figures figures;
  figures.factor = pi_node::secondsBetween(told_ns_, now_ns_) / std::max(1e-3, pi_node::secondsSince(told_at_));
  figures.waited_s = waited_s_;
  figures.waited_for = waited_for_;
  told_ns_ = now_ns_;
  told_at_ = Clock::now();
  return figures;
}

}  // namespace pi_simulation
