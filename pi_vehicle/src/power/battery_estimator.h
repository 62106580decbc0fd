#pragma once

#include <cstdint>
#include <limits>

namespace pi_vehicle::power
{

struct BatteryOptions
{
  double capacity_ah = 2.2;        ///< [Ah], in [0.01, 10000]
  double nominal_voltage = 11.1;   ///< [V], in [0.1, 1000]
  double smoothing_s = 60.0;       ///< the draw is a mean over about so long [s], in [0.1, 3600]
  double low_charge = 0.2;         ///< from here on there is a warning; in [0, 1]
  double empty_charge = 0.05;      ///< from here on an error; in [0, low_charge]
  double low_remaining_s = 600.0;  ///< likewise a warning [s], in [0, 1e6]

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
};

/// What is known of a battery; NaN: not known.
struct BatteryReading
{
  double voltage = std::numeric_limits<double>::quiet_NaN();  ///< [V]
  double current = std::numeric_limits<double>::quiet_NaN();  ///< [A], negative while it gives
  double charge = std::numeric_limits<double>::quiet_NaN();   ///< 0 to 1
};

struct BatteryEstimate
{
  double draw_w = std::numeric_limits<double>::quiet_NaN();       ///< smoothed [W], negative while it is charged
  double remaining_s = std::numeric_limits<double>::quiet_NaN();  ///< until it is empty [s]; NaN: unknown, or charged
};

/// How long a battery lasts: energy left / smoothed draw. The draw is that of the battery where it says its current,
/// else that of the computer alone. Not thread safe.
class BatteryEstimator
{
public:
  /// @throws std::invalid_argument as BatteryOptions::validate().
  explicit BatteryEstimator(const BatteryOptions& options);

  /// @param now_ns      of a clock that never goes back.
  /// @param computer_w  what the computer draws [W].
  BatteryEstimate update(int64_t now_ns, const BatteryReading& reading, double computer_w);

private:
  const BatteryOptions options_;
  double draw_w_ = std::numeric_limits<double>::quiet_NaN();
  bool of_battery_ = false;  ///< whose draw it is
  int64_t updated_ns_ = 0;
};

}  // namespace pi_vehicle::power
