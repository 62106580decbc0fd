#pragma once

#include "chassis/chassis_controller.h"
#include "chassis/chassis_model.h"
#include "chassis/pseudo_terminal.h"
#include "chassis/stock_base.h"

#include <cstdint>
#include <memory>
#include <optional>
#include <random>
#include <sstream>
#include <string>
#include <vector>

namespace pi_simulation
{

enum class Base
{
  SERIAL,  ///< its controller is on a pseudo-terminal
  TWIST,   ///< it takes velocities and tells odometry: StockBase
};
const char* toString(Base base);  ///< "serial", "twist"

struct SimulationOptions
{
  Base base = Base::SERIAL;
  StockBaseOptions stock;
  ModelOptions model;
  chassis::Limits limits;         ///< curvature and kind of the model are put into the HELLO
  double watchdog_s = 0.25;       ///< [s], in [0.05, 10]
  double status_period_s = 0.02;  ///< [s], in [0.005, 1]
  pi_vehicle::Pose2 start;
  std::string name = "simulated";
  std::string link;   ///< symbolic link to the pseudo-terminal; empty: none
  uint64_t seed = 1;  ///< of the garbage

  /// Kind, wheels, steering and limits.
  void setVehicle(const pi_node::VehicleDescription& vehicle);
  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
};

/// A chassis: controller, on a pseudo-terminal or that of a stock base, model and faults. The caller passes the time,
/// at any rate. Not thread safe.
class SimulatedChassis
{
public:
  /// @throws std::invalid_argument for wrong options, std::runtime_error without a pseudo-terminal.
  SimulatedChassis(const SimulationOptions& options, int64_t now_ns);

  /// Reads, advances to now, writes. Call at 100 Hz or faster.
  void step(int64_t now_ns);

  /// To a stock base. @return false if a number is not finite.
  bool onTwist(double linear, double angular, int64_t now_ns);

  /// One line of text: unplug, plug, restart, silent on|off, garbage BYTES, garbage on|off, stuck on|off,
  /// battery CHARGE, button on|off, slip SHARE, pose X Y YAW.
  /// @return the problem with its remedy; empty: done.
  std::string command(const std::string& line, int64_t now_ns);

  /// Of the pseudo-terminal; empty: unplugged, or there is none.
  std::string path() const { return terminal_ ? terminal_->path() : ""; }
  bool isPlugged() const { return stock_ ? plugged_ : terminal_.has_value(); }
  const ChassisModel& model() const { return model_; }
  const ChassisController& controller() const { return *controller_; }  ///< only of Base::SERIAL
  chassis::Mode mode() const { return stock_ ? stock_->mode() : controller_->mode(); }
  uint64_t received() const;  ///< commands, whatever became of them
  /// What a stock base tells now; null: it tells nothing.
  const StockBase* teller() const { return stock_ && plugged_ && !silent_ ? &*stock_ : nullptr; }
  /// True state as one line of JSON: t [s] simulated, x, y [m], yaw [rad], speed [m/s], curvature [1/m], mode.
  std::string truth() const;

private:
  void restart(int64_t now_ns);
  void write(const std::vector<uint8_t>& bytes);
  void writeGarbage(size_t count);
  /// The commands "NAME on|off". @return false: there is no such command.
  bool setFault(const std::string& name, bool on);
  /// The commands with numbers. @return false: there is no such command.
  bool setNumbers(const std::string& name, std::istringstream numbers);

  const SimulationOptions options_;
  const chassis::Hello hello_;
  ChassisModel model_;
  std::unique_ptr<ChassisController> controller_;  ///< or stock_
  std::optional<PseudoTerminal> terminal_;
  std::optional<StockBase> stock_;
  bool plugged_ = true;  ///< the stock base
  std::mt19937_64 random_;
  int64_t now_ns_;
  bool silent_ = false;
  bool garbage_ = false;
};

}  // namespace pi_simulation
