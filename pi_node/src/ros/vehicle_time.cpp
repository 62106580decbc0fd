#include <pi_node/ros/vehicle_time.h>

#include <pi_node/durations.h>
#include <pi_node/ros/time.h>
#include <pi_node/vehicle_clock.h>
#include <ros/this_node.h>
#include <ros/time.h>
#include <std_msgs/Header.h>

#include <algorithm>
#include <atomic>
#include <memory>

namespace pi_node
{
namespace
{

constexpr uint32_t ANSWERS_QUEUE = 100;
constexpr double USUAL_PERIOD_S = 0.05;  // longer ones are to be waited for by so much longer

/// Time of ROS since it began to be known here; 0 until then. When it becomes known a second has passed: a simulator
/// that stands and waits for a node gets what was due while the node did not know, and nothing seems to have waited
/// since 1970.
int64_t sinceBegin()
{
  constexpr int64_t UNKNOWN_NS = 1000000000;
  static std::atomic<int64_t> begin_ns{0};
  const int64_t now_ns = fromMsg(ros::Time::now());
  if (now_ns == 0)
  {
    return 0;
  }
  int64_t none_ns = 0;
  begin_ns.compare_exchange_strong(none_ns, now_ns);
  return now_ns - begin_ns + UNKNOWN_NS;
}

}  // namespace

void followRosTime()
{
  if (ros::Time::isSimTime())
  {
    simulateTime(sinceBegin);
  }
}

SimulationAnswers::SimulationAnswers(const std::string& kind, const std::string& service, const std::string& topic)
  : name_(kind + " " + service + " " + ros::this_node::getName() + (topic.empty() ? "" : " " + topic))
{
  if (isTimeSimulated())
  {
    publisher_ = ros::NodeHandle().advertise<std_msgs::Header>("/simulation/answers", ANSWERS_QUEUE);
  }
}

void SimulationAnswers::workedOff(int64_t stamp_ns) const
{
  const std::lock_guard<std::mutex> lock(mutex_);
  if (takes_)
  {
    publish(stamp_ns);
  }
}

void SimulationAnswers::waits(double seconds) const
{
  workedOff(fromMsg(ros::Time::now()) + nanoseconds(seconds));
}

void SimulationAnswers::take(bool takes)
{
  const std::lock_guard<std::mutex> lock(mutex_);
  takes_ = takes;
  if (!takes)
  {
    publish(0);
  }
}

void SimulationAnswers::publish(int64_t stamp_ns) const
{
  if (publisher_)
  {
    std_msgs::Header answer;
    answer.stamp = toTime(stamp_ns);
    answer.frame_id = name_;
    publisher_.publish(answer);
  }
}

VehicleTimer::VehicleTimer(const ros::NodeHandle& node, double period_s, const std::function<void()>& function,
                           const std::string& service)
{
  if (isTimeSimulated())
  {
    const auto answers = service.empty() ? nullptr : std::make_shared<const SimulationAnswers>("tick", service);
    const double later_s = std::max(0.0, period_s - USUAL_PERIOD_S);
    simulated_ = node.createTimer(ros::Duration(period_s),
                                  [function, answers, later_s](const ros::TimerEvent&)
                                  {
                                    function();
                                    if (answers)
                                    {
                                      answers->waits(later_s);
                                    }
                                  });
  }
  else
  {
    steady_ =
        node.createSteadyTimer(ros::WallDuration(period_s), [function](const ros::SteadyTimerEvent&) { function(); });
  }
}

void VehicleTimer::stop()
{
  steady_.stop();
  simulated_.stop();
}

}  // namespace pi_node
