#pragma once

#include "chassis/chassis_controller.h"
#include "chassis/chassis_model.h"

#include <pi_vehicle/chassis/chassis_host.h>

#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

namespace pi_vehicle::chassis
{

using pi_simulation::ChassisController;
using pi_simulation::ChassisModel;
using pi_simulation::ModelOptions;
using pi_simulation::Setpoint;

constexpr int64_t TICK_NS = 5'000'000;
constexpr int64_t COMMAND_TICKS = 4;

inline int64_t ns(double seconds)
{
  return static_cast<int64_t>(1e9 * seconds);
}

/// Host, controller and model on a line without time of its own: tests move the clock.
class ChassisLine
{
public:
  explicit ChassisLine(const HostOptions& options = HostOptions(), const Hello& hello = Hello(),
                       const ModelOptions& model = ModelOptions())
    : host(options), controller(std::make_unique<ChassisController>(hello, 0)), model(model), hello_(hello)
  {
    host.onLineOpen(now_ns);
  }

  /// @param each  called before every tick; may be empty.
  void run(double seconds, const std::function<void()>& each = {})
  {
    const int64_t end_ns = now_ns + ns(seconds);
    while (now_ns < end_ns)
    {
      if (each)
      {
        each();
      }
      if (tick_ % COMMAND_TICKS == 0)
      {
        const std::vector<uint8_t> commands = host.poll(now_ns);
        if (to_chassis)
        {
          controller->onBytes(commands.data(), commands.size(), now_ns);
        }
      }
      setpoint = controller->update(this->model.measurement(), now_ns);
      this->model.step(setpoint, 1e-9 * TICK_NS);
      const std::vector<uint8_t> statuses = controller->takeOutput();
      now_ns += TICK_NS;  // on their way
      if (to_host)
      {
        host.onBytes(statuses.data(), statuses.size(), now_ns);
      }
      ++tick_;
    }
  }

  void drive(double seconds, double speed, double curvature = 0.0, double deceleration = 0.0)
  {
    run(seconds,
        [=]
        {
          Motion motion;
          motion.speed = speed;
          motion.curvature = curvature;
          motion.deceleration = deceleration;
          host.setMotion(motion, now_ns);
        });
  }

  HostState state() const { return host.state(now_ns); }
  double speed() const { return model.measurement().speed; }
  void restartChassis() { controller = std::make_unique<ChassisController>(hello_, now_ns); }

  int64_t now_ns = ns(1.0);
  bool to_chassis = true;  ///< else the wire to it is cut
  bool to_host = true;
  ChassisHost host;
  std::unique_ptr<ChassisController> controller;
  ChassisModel model;
  Setpoint setpoint;

private:
  const Hello hello_;
  int64_t tick_ = 0;
};

}  // namespace pi_vehicle::chassis
