// Judge of power.test.

#include <gtest/gtest.h>
#include <pi_node/test_support/on_graph.h>
#include <pi_vehicle/PowerState.h>
#include <pi_vehicle/VehicleState.h>
#include <ros/ros.h>
#include <sensor_msgs/BatteryState.h>
#include <sys/wait.h>
#include <unistd.h>

#include <atomic>
#include <cmath>
#include <csignal>
#include <limits>
#include <string>
#include <thread>
#include <vector>

namespace pi_vehicle
{

using namespace pi_node::test_support;
namespace
{

constexpr int OK = diagnostic_msgs::DiagnosticStatus::OK;
constexpr int WARN = diagnostic_msgs::DiagnosticStatus::WARN;
constexpr int ERROR = diagnostic_msgs::DiagnosticStatus::ERROR;

/// A node named /victim; ends with the object.
class Victim
{
public:
  Victim()
  {
    child_ = ::fork();
    if (child_ == 0)
    {
      ::execl(POWER_NODE, POWER_NODE, "__name:=victim", "power:=victim/power", "battery:=victim/battery",
              static_cast<char*>(nullptr));
      ::_exit(127);
    }
  }
  ~Victim() { kill(); }
  Victim(const Victim&) = delete;
  Victim& operator=(const Victim&) = delete;

  void signal(int number) const { ::kill(child_, number); }
  void kill()
  {
    if (child_ > 0)
    {
      ::kill(child_, SIGKILL);
      ::waitpid(child_, nullptr, 0);
      child_ = -1;
    }
  }

private:
  pid_t child_ = -1;
};

class Power : public testing::Test
{
protected:
  void SetUp() override
  {
    ros::param::set("/power/period_s", 0.2);
    ros::param::set("/power/lookup_period_s", 0.2);
    ros::param::set("/power/lookup_timeout_s", 2.0);
    ros::param::set("/power/diagnostic_period", 0.2);
    ros::param::set("/power/publish_battery", true);
    ros::param::set("/power/battery/smoothing_s", 0.1);
    XmlRpc::XmlRpcValue services;
    const char* const names[3][3] = {
        {"judge", "/power_test", "burner*"}, {"twin", "/power_test", "other*"}, {"victim", "/victim", "*"}};
    for (int i = 0; i < 3; ++i)
    {
      services[i]["name"] = names[i][0];
      services[i]["nodes"][0] = names[i][1];
      services[i]["threads"][0] = names[i][2];
      services[i]["optional"] = i < 2;
    }
    ros::param::set("/power/services", services);
    vehicle_ = ros::NodeHandle().advertise<VehicleState>("vehicle_state", 1);
    ASSERT_TRUE(loadNodelet("/power", "pi_vehicle/power"));
    ASSERT_TRUE(states_.waitForPublisher());
    ASSERT_TRUE(until(TIMEOUT_S, [this] { return vehicle_.getNumSubscribers() > 0; }));
  }
  void TearDown() override { EXPECT_TRUE(unloadNodelet("/power")); }

  bool waitForVictim(bool running)
  {
    states_.clear();
    return states_.waitFor([running](const PowerState& state) { return state.services[2].running == running; });
  }
  void say(double charge, double voltage, double current)
  {
    VehicleState state;
    state.header.stamp = ros::Time::now();
    state.mode = VehicleState::READY;
    state.battery_charge = charge;
    state.battery_voltage = voltage;
    state.battery_current = current;
    vehicle_.publish(state);
  }

  ros::Publisher vehicle_;
  Collector<PowerState> states_{"power"};
  Collector<sensor_msgs::BatteryState> battery_{"battery"};
  DiagnosticCollector diagnostics_;
};

TEST_F(Power, CpuTimeGoesToTheThreadsOfAService)
{
  std::atomic<bool> end{false};
  std::thread burner(
      [&end]
      {
        pthread_setname_np(pthread_self(), "burner");
        volatile double sum = 0.0;
        while (!end)
        {
          sum = sum + 1.0;
        }
      });
  const bool seen = states_.waitFor(
      [](const PowerState& state)
      {
        return state.services[0].cpu > 0.05 && state.services[0].nodes == std::vector<std::string>{"/power_test"} &&
               state.services[0].memory == 0.0 && state.shared.memory > 1e6 &&  // two services share this process
               !state.services[1].running && state.services[1].cpu == 0.0;
      });
  end = true;
  burner.join();
  ASSERT_TRUE(seen);
  for (const auto& state : states_.messages())
  {
    double watts = state->idle_watts + state->shared.watts + state->other.watts;
    for (const ServicePower& service : state->services)
    {
      watts += service.watts;
    }
    EXPECT_NEAR(state->total_watts, watts, 1e-6);
    EXPECT_GE(state->cores, 1U);
    EXPECT_FALSE(state->source.empty());
  }
}

TEST_F(Power, ANodeThatRestartsIsFoundAgain)
{
  EXPECT_TRUE(diagnostics_.waitForSummary("power: services", WARN, "no node is here of victim")) << diagnostics_.text();
  EXPECT_TRUE(diagnostics_.waitForValue("power: services", "/victim", "is not registered")) << diagnostics_.text();
  {
    Victim victim;
    ASSERT_TRUE(waitForVictim(true)) << diagnostics_.text();
    EXPECT_TRUE(states_.waitFor([](const PowerState& state) { return state.services[2].memory > 1e6; }));
    EXPECT_TRUE(diagnostics_.waitForSummary("power: services", OK, "cores are busy")) << diagnostics_.text();
    victim.kill();  // stays registered at the master, and answers no longer
    ASSERT_TRUE(waitForVictim(false)) << diagnostics_.text();
    diagnostics_.clear();
    EXPECT_TRUE(diagnostics_.waitForValue("power: services", "/victim", "does not answer")) << diagnostics_.text();
  }
  const Victim again;
  EXPECT_TRUE(waitForVictim(true)) << diagnostics_.text();
}

TEST_F(Power, APeerThatHangsHoldsUpNobody)
{
  Victim victim;
  ASSERT_TRUE(waitForVictim(true)) << diagnostics_.text();
  victim.signal(SIGSTOP);
  EXPECT_TRUE(unloadNodelet("/power"));
  ASSERT_TRUE(loadNodelet("/power", "pi_vehicle/power"));  // looks for all of them anew
  states_.clear();
  EXPECT_TRUE(diagnostics_.waitForValue("power: services", "/victim", "does not answer")) << diagnostics_.text();
  EXPECT_TRUE(states_.waitFor([](const PowerState& state) { return state.shared.running; }));
  EXPECT_TRUE(until(TIMEOUT_S, [this] { return states_.messages().size() >= 10; }));
  victim.signal(SIGCONT);
  EXPECT_TRUE(waitForVictim(true)) << diagnostics_.text();
}

TEST_F(Power, TheVehiclesBatteryAndHowLongItLasts)
{
  ASSERT_TRUE(until(TIMEOUT_S,
                    [this]
                    {
                      say(0.5, 10.0, -2.442);
                      return states_.last() && std::abs(states_.last()->battery_watts - 24.42) < 0.01;
                    }));
  // Half of 24.42 Wh at 24.42 W.
  EXPECT_NEAR(1800.0, states_.last()->remaining_time, 10.0);
  EXPECT_NEAR(0.5, states_.last()->battery_charge, 1e-6);
  // Of another topic: it may come later.
  ASSERT_TRUE(battery_.waitFor([](const sensor_msgs::BatteryState& battery) { return battery.present; }));
  const auto battery = battery_.last();
  EXPECT_NEAR(0.5, battery->percentage, 1e-6);
  EXPECT_NEAR(10.0, battery->voltage, 1e-6);
  EXPECT_NEAR(-2.442, battery->current, 1e-6);
  EXPECT_NEAR(1.1, battery->charge, 1e-6);
  EXPECT_TRUE(battery->present);
  EXPECT_EQ(sensor_msgs::BatteryState::POWER_SUPPLY_STATUS_DISCHARGING, battery->power_supply_status);
}

TEST_F(Power, ALowBatteryIsSaid)
{
  const auto says = [this](double charge, int level, const std::string& part)
  {
    return until(TIMEOUT_S,
                 [&]
                 {
                   say(charge, 10.0, -1.0);
                   const auto last = diagnostics_.last();
                   for (const auto& status : last ? last->status : diagnostic_msgs::DiagnosticArray().status)
                   {
                     if (status.name == "power: battery" && status.level == level &&
                         status.message.find(part) != std::string::npos)
                     {
                       return true;
                     }
                   }
                   return false;
                 });
  };
  EXPECT_TRUE(says(0.9, OK, "90 %, 2.2 h left")) << diagnostics_.text();
  EXPECT_TRUE(says(0.15, WARN, "charge it")) << diagnostics_.text();
  EXPECT_TRUE(says(0.01, ERROR, "charge it")) << diagnostics_.text();
}

}  // namespace
}  // namespace pi_vehicle

int main(int argc, char** argv)
{
  return pi_node::test_support::runOnGraph(argc, argv, "power_test");
}
