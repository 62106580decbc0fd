#pragma once

#include "power/service_meter.h"

#include <pi_node/power_monitor.h>

#include <string>
#include <vector>

namespace pi_vehicle::power
{

/// A model of power for computers without sensors. Equation 4 of the π-Edge paper, e_L = (a + beta f^3) w / f, gives a
/// task of w cycles the energy of the time w / f at a power of a + beta f^3. Here a is paid once, busy or not; beta f^3
/// for each core as long as it is busy. The defaults are calibrated on the paper's TX1: idle 1 W, and 4.2 W of the CPU
/// at 60 % of four cores (figures 14 and 15): beta = (4.2 - 1.0) / (2.4 * 1.9^3). The GPU is not modelled.
struct ModelOptions
{
  double idle_w = 1.0;              ///< a: the CPU at rest [W], in [0, 1000]
  double board_w = 3.3;             ///< memory, radio and the rest of the board, constant [W], in [0, 1000]
  double beta_w_per_ghz3 = 0.1944;  ///< of one core [W/GHz^3], in [0, 1000]
  double frequency_ghz = 1.9;       ///< of the cores [GHz], in [0, 100]; 0: as the system says

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
};

/// Power of a core that is always busy, less its power at rest [W].
double busyCoreWatts(const ModelOptions& model, double frequency_ghz);

/// Power of each consumer [W].
struct PowerAccount
{
  double total = 0.0;            ///< idle and dynamic
  double idle = 0.0;             ///< that no service causes
  double dynamic = 0.0;          ///< shared out by CPU time
  std::vector<double> services;  ///< dynamic part of each, in the order of MachineUse
  double shared = 0.0;
  double other = 0.0;
  bool measured = false;
  std::string source;  ///< names of sensors, or "model"
};

/// The sensors whose sum is the power of the computer: the requested ones, else the input rail of an INA3221 (VDD_IN,
/// POM_5V_IN), else RAPL's platform (psys), else RAPL's packages. Empty: there is none, or a requested one is missing.
std::vector<std::string> computerSensors(const pi_node::PowerReading& reading,
                                         const std::vector<std::string>& asked_for);

/// Shares the power of the computer out to its services.
/// @param sensors  as for computerSensors(). Of the measured power, model.idle_w + model.board_w is idle power (all of
/// it
///                 if it is less), the rest is dynamic.
PowerAccount accountPower(const MachineUse& use, const pi_node::PowerReading& reading, const ModelOptions& model,
                          const std::vector<std::string>& sensors);

}  // namespace pi_vehicle::power
