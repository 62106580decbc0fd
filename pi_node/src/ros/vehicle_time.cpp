#include <pi_node/ros/vehicle_time.h>

#include <pi_node/durations.h>
#include <pi_node/ros/time.h>
#include <pi_node/vehicle_clock.h>
#include <ros/this_node.h>
#include <ros/time.h>
#include <std_msgs/Header.h>

#include <atomic>
#include <memory>
#include <optional>

namespace pi_node
{
namespace
{

constexpr uint32_t ANSWERS_QUEUE = 100;

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

ros::Time rosTime(int64_t vehicle_ns)
{
  const ros::Time now = ros::Time::now();
  const ros::Duration age = ros::Duration().fromNSec(vehicleNs() - vehicle_ns);
  return now.toSec() > age.toSec() ? now - age : now;
}

SimulationAnswers::SimulationAnswers(const std::string& kind, const std::string& service, const std::string& topic)
  : name_(kind + " " + service + " " + ros::this_node::getName() + (topic.empty() ? "" : " " + topic))
{
  if (isTimeSimulated())
  {
    publisher_ = ros::NodeHandle().advertise<std_msgs::Header>("/simulation/answers", ANSWERS_QUEUE);
  }
}

void SimulationAnswers::taken(int64_t stamp_ns)
{
  const std::lock_guard<std::mutex> lock(mutex_);
  inputs_.taken(stamp_ns);
}

void SimulationAnswers::leftOut(int64_t stamp_ns)
{
  const std::lock_guard<std::mutex> lock(mutex_);
  if (const std::optional<int64_t> answer_ns = inputs_.leftOut(stamp_ns))
  {
    publish(*answer_ns);
  }
}

void SimulationAnswers::workedOff(int64_t stamp_ns)
{
  const std::lock_guard<std::mutex> lock(mutex_);
  publish(inputs_.workedOff(stamp_ns));
}

int64_t SimulationAnswers::waits(double seconds)
{
  const int64_t until_ns = vehicleNs() + nanoseconds(seconds);  // read first: the simulator is to come that far
  const std::lock_guard<std::mutex> lock(mutex_);
  publish(fromMsg(ros::Time::now()) + nanoseconds(seconds));
  return until_ns;
}

void SimulationAnswers::take(bool takes)
{
  const std::lock_guard<std::mutex> lock(mutex_);
  if (!takes)
  {
    publish(0);
    inputs_ = WorkedOff();
  }
  takes_ = takes;
}

void SimulationAnswers::publish(int64_t stamp_ns) const
{
  if (publisher_ && takes_)
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
    const auto answers = service.empty() ? nullptr : std::make_shared<SimulationAnswers>("tick", service);
    simulated_ = node.createTimer(ros::Duration(period_s),
                                  [function, answers, period_s](const ros::TimerEvent&)
                                  {
                                    function();
                                    if (answers)
                                    {
                                      answers->waits(period_s);
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
