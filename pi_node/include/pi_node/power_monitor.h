#pragma once

#include <cstdint>
#include <limits>
#include <memory>
#include <string>
#include <vector>

namespace pi_node
{

/// What the sensors of a computer say at one time. A sensor that cannot be read just now is left out. Powers are not
/// to be added up: a package contains its cores, and a supply rail what hangs on it.
struct PowerReading
{
  struct Power
  {
    std::string name;
    double watts;   ///< now; for counters of energy the mean since the previous read()
    double joules;  ///< since the monitor was made: counted, or powers integrated by trapezoids between the readings
  };
  struct Battery
  {
    std::string name;
    double watts;   ///< what it gives, negative while it is charged; NaN if it does not say
    double charge;  ///< in [0, 1]; NaN if it does not say
  };
  struct Temperature
  {
    std::string name;
    double celsius;
  };
  struct Frequency
  {
    uint32_t core;
    double hertz;
  };

  std::vector<Power> powers;
  std::vector<Battery> batteries;
  std::vector<Temperature> temperatures;
  std::vector<Frequency> frequencies;
};

/// Reads the sensors that the kernel offers in /sys:
/// - RAPL zones (powercap/intel-rapl:*, AMD's as well): energy counters, named "package-0", "package-0/core";
/// - INA3221 and other monitors of supply rails: of NVIDIA's kernel 4.9 (ina3221x), and by hwmon (voltage and current
///   of the ina3221's channels; power inputs of any chip);
/// - batteries (power_supply), temperatures (thermal zones, hwmon), frequencies of the CPU cores (cpufreq).
///
/// The sensors are looked for once, at construction. Nothing is an error: a sensor that vanishes or says nonsense is
/// left out until it is well again. RAPL counters wrap around after about 2^32 uJ or more: read at least each minute.
/// Not thread safe.
class PowerMonitor
{
public:
  /// A sensor that is there but may not be read.
  struct Unreadable
  {
    std::string path;
    std::string reason;  ///< the system's text, such as "Permission denied"
  };

  /// @param root  where sysfs is mounted.
  explicit PowerMonitor(const std::string& root = "/sys");
  /// The same at a given time, for recordings and tests. @param now_ns  a clock that never goes back.
  PowerMonitor(const std::string& root, int64_t now_ns);
  ~PowerMonitor();
  PowerMonitor(PowerMonitor&&) noexcept;
  PowerMonitor& operator=(PowerMonitor&&) noexcept;

  PowerReading read();
  /// @param now_ns  of the same clock as at construction; not before the previous call.
  PowerReading read(int64_t now_ns);

  /// True if any sensor was found that can be read.
  bool available() const;
  /// What was found at construction and could not be read, once each.
  const std::vector<Unreadable>& unreadable() const { return unreadable_; }

private:
  struct Sensors;

  std::unique_ptr<Sensors> sensors_;
  std::vector<Unreadable> unreadable_;
};

}  // namespace pi_node
