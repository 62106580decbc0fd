#pragma once

#include <pi_node/worked_off.h>
#include <ros/node_handle.h>
#include <ros/steady_timer.h>
#include <ros/time.h>
#include <ros/timer.h>

#include <cstdint>
#include <functional>
#include <mutex>
#include <string>

namespace pi_node
{

/// Makes vehicleNs() the time of ROS if that is simulated (/use_sim_time). Call once roscpp has started; runNode() and
/// AdapterNodelet do.
void followRosTime();

/// A time of vehicleNs() by the clock of ROS, as far as that goes back. Any thread.
ros::Time rosTime(int64_t vehicle_ns);

/// Tells a simulator how far the inputs of a service are worked off, whatever came of them, so that it does not run
/// away from a busy computer: on the topic /simulation/answers (std_msgs/Header: `frame_id` is "KIND SERVICE NODE";
/// stamp 0: the service takes no inputs now). Does nothing unless time is simulated. Any thread.
class SimulationAnswers
{
public:
  /// @param kind  of the inputs: imu, pictures, detection (of pictures, slower), sound, tick.
  /// @param topic  of the inputs, if they may come from elsewhere than the simulator: then nobody waits for the
  /// service.
  SimulationAnswers(const std::string& kind, const std::string& service, const std::string& topic = "");
  // As those of WorkedOff; services that leave no inputs out need only the last.
  void taken(int64_t stamp_ns);
  void leftOut(int64_t stamp_ns);
  void workedOff(int64_t stamp_ns);
  /// The service waits for something that only time can bring, at most so long.
  /// @return when the wait is to end, of vehicleNs(): the simulator may not go farther than that.
  int64_t waits(double seconds);
  /// Whether the service takes inputs. While it takes none, nobody waits for it. At first it does.
  void take(bool takes);

private:
  void publish(int64_t stamp_ns) const;

  const std::string name_;
  std::mutex mutex_;  ///< of all below; so that no answer comes behind the end of taking
  bool takes_ = true;
  WorkedOff inputs_;
  ros::Publisher publisher_;  ///< none unless time is simulated
};

/// Calls a function again and again, in the vehicle's time. Not thread safe; copies are the same timer.
class VehicleTimer
{
public:
  VehicleTimer() = default;
  /// @param node      its callback queue calls the function.
  /// @param period_s  [s]
  /// @param service   if not empty, answers the simulator after each call.
  VehicleTimer(const ros::NodeHandle& node, double period_s, const std::function<void()>& function,
               const std::string& service = "");

  /// No call begins afterwards.
  void stop();

private:
  ros::SteadyTimer steady_;
  ros::Timer simulated_;
};

}  // namespace pi_node
