#pragma once

#include "vehicle/vehicle_pace.h"

#include <pi_speech/AudioDataStamped.h>
#include <ros/ros.h>
#include <std_msgs/Header.h>

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <mutex>
#include <string>

namespace pi_simulation
{

struct SimulatedTimeOptions
{
  double realtime_factor = 1.0;  ///< most simulated seconds per second; 0: no limit
  PaceOptions pace;
  double patience_s = 20.0;  ///< for an answer of the vehicle, by the clock on the wall
};

/// The clock of simulated time: publishes `/clock` and goes on step by step, as far as the vehicle has kept up. Takes
/// the vehicle's `/simulation/answers` (pi_node::SimulationAnswers). All methods but advance() from any thread.
class SimulatedTime
{
public:
  /// The same for each run, so that noise which comes from stamps is the same: 2001-09-09.
  static constexpr int64_t START_NS = 1000000000000000000;
  static constexpr int64_t STEP_NS = 2500000;

  /// @param node  its callback queue takes the answers. @throws std::runtime_error without /use_sim_time.
  SimulatedTime(ros::NodeHandle node, const SimulatedTimeOptions& options);

  int64_t nowNs() const;
  /// The vehicle got something of a kind in PaceOptions.
  void given(const std::string& kind, int64_t stamp_ns);
  void answered(const std::string& kind, const std::string& who, int64_t stamp_ns);
  void forget(const std::string& kind, const std::string& who);

  /// Goes on by a step, once vehicle and wall clock let it.
  /// @param look  called again and again while the vehicle is waited for, to take what it answers elsewhere.
  /// @return false: stop() was called, or the vehicle does not answer.
  bool advance(const std::function<void()>& look);
  /// What the vehicle does not answer, after advance() returned false; empty: stopped.
  std::string problem() const;
  void stop();

  struct Figures
  {
    double factor = 0.0;     ///< simulated seconds per second since the last call
    double waited_s = 0.0;   ///< for the vehicle, since the start
    std::string waited_for;  ///< "KIND SERVICE NODE", the last
  };
  Figures figures();

private:
  using Clock = std::chrono::steady_clock;

  void publishClock();
  void onAnswer(const std_msgs::Header& message);
  /// When a node has died, nobody is waited for until it answers again. mutex_ is held.
  void forgetTheDead();
  bool awaitVehicle(std::unique_lock<std::mutex>* lock, const std::function<void()>& look);
  bool awaitWall(std::unique_lock<std::mutex>* lock);

  const SimulatedTimeOptions options_;
  const std::string picture_topic_;  ///< of what a detector works on
  ros::Publisher clock_;
  ros::Subscriber answers_;
  ros::Subscriber sound_;

  mutable std::mutex mutex_;  ///< of all below
  std::condition_variable changed_;
  VehiclePace pace_;
  int64_t now_ns_ = START_NS;
  Clock::time_point due_ = Clock::now();
  uint32_t answering_ = 0;  ///< nodes, of the thread of advance()
  double waited_s_ = 0.0;
  std::string waited_for_;
  std::string problem_;
  bool stopping_ = false;
  Clock::time_point told_at_ = Clock::now();
  int64_t told_ns_ = START_NS;
};

}  // namespace pi_simulation
