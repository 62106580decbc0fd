#pragma once

#include <cstdint>
#include <limits>
#include <memory>
#include <string>
#include <vector>

namespace pi_node
{

/// Readings of a computer's sensors at one time, without sensors that cannot be read now. Do not add up powers: a
/// package contains its cores, and a supply rail contains its consumers.
struct PowerReading
{
  struct Power
  {
    std::string name;
    double watts;   ///< now; of an energy counter: the mean since the previous read()
    double joules;  ///< since construction: counted, or powers integrated by trapezoids
  };
  struct Battery
  {
    std::string name;
    double watts;   ///< output, negative while charging; NaN if unknown
    double charge;  ///< in [0, 1]; NaN if unknown
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
/// The constructor finds the sensors. Nothing throws: a sensor that vanishes or gives nonsense is left out until it
/// recovers. RAPL counters wrap around after 2^32 uJ or more: read at least once a minute.
/// Not thread safe.
class PowerMonitor
{
public:
  /// A sensor that exists but may not be read.
  struct Unreadable
  {
    std::string path;
    std::string reason;  ///< the system's text, such as "Permission denied"
  };

  /// @param root  where sysfs is mounted.
  explicit PowerMonitor(const std::string& root = "/sys");
  /// The same with a given time, for recordings and tests. @param now_ns  of a monotonic clock.
  PowerMonitor(const std::string& root, int64_t now_ns);
  ~PowerMonitor();
  PowerMonitor(PowerMonitor&&) noexcept;
  PowerMonitor& operator=(PowerMonitor&&) noexcept;

  PowerReading read();
  /// @param now_ns  of the same clock as at construction; not before the previous call.
  PowerReading read(int64_t now_ns);

  /// True if at least one sensor can be read.
  bool available() const;
  /// Sensors that the constructor found but could not read.
  const std::vector<Unreadable>& unreadable() const { return unreadable_; }

private:
  struct Sensors;

  std::unique_ptr<Sensors> sensors_;
  std::vector<Unreadable> unreadable_;
};

}  // namespace pi_node
