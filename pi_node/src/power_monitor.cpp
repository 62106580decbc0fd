#include <pi_node/durations.h>
#include <pi_node/power_monitor.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <functional>
#include <optional>
#include <set>
#include <system_error>

namespace pi_node
{
namespace
{

namespace fs = std::filesystem;

/// First line of a file of sysfs, without blanks at the end. @param error  set to the errno of a failure.
std::optional<std::string> readLine(const fs::path& path, int* error = nullptr)
{
  errno = 0;
  std::FILE* file = std::fopen(path.c_str(), "re");
  char text[256] = {};
  const bool read = file != nullptr && std::fgets(text, sizeof text, file) != nullptr;
  if (error != nullptr)
  {
    *error = read ? 0 : errno;
  }
  if (file != nullptr)
  {
    std::fclose(file);
  }
  if (!read)
  {
    return std::nullopt;
  }
  std::string line = text;
  line.erase(line.find_last_not_of(" \t\r\n") + 1);
  return line;
}

/// The whole number in a file; nothing if there is none, or anything beside it.
std::optional<int64_t> readInteger(const fs::path& path, int* error = nullptr)
{
  const std::optional<std::string> line = readLine(path, error);
  int64_t value = 0;
  if (!line)
  {
    return std::nullopt;
  }
  const char* const end = line->data() + line->size();
  const auto [stop, failure] = std::from_chars(line->data(), end, value);
  return failure == std::errc() && stop == end ? std::optional<int64_t>(value) : std::nullopt;
}

/// Entries of a folder whose names start with `prefix`, package-2 before package-10.
std::vector<fs::path> entries(const fs::path& folder, const std::string& prefix)
{
  std::vector<fs::path> found;
  std::error_code ignored;
  for (fs::directory_iterator entry(folder, ignored), end; !ignored && entry != end; entry.increment(ignored))
  {
    if (entry->path().filename().string().compare(0, prefix.size(), prefix) == 0)
    {
      found.push_back(entry->path());
    }
  }
  std::sort(found.begin(), found.end(),
            [](const fs::path& a, const fs::path& b) { return strverscmp(a.c_str(), b.c_str()) < 0; });
  return found;
}

std::string lineOr(const fs::path& path, const std::string& otherwise)
{
  const std::string line = readLine(path).value_or("");
  return line.empty() ? otherwise : line;
}

/// A counter of energy that wraps around.
struct EnergyCounter
{
  std::string name;
  fs::path path;
  std::optional<int64_t> range_uj;  ///< the counter goes from here to 0
  std::optional<int64_t> last_uj;
  int64_t last_ns = 0;
  double watts = 0;
  double joules = 0;

  std::optional<PowerReading::Power> read(int64_t now_ns)
  {
    const std::optional<int64_t> count_uj = readInteger(path);
    if (!count_uj || *count_uj < 0)
    {
      return std::nullopt;
    }
    if (!last_uj)  // could not be read when the monitor was made
    {
      last_uj = count_uj;
      last_ns = now_ns;
      return std::nullopt;
    }
    // Two reads at one time would make a power out of nothing.
    if (now_ns > last_ns)
    {
      int64_t used_uj = *count_uj - *last_uj;
      if (used_uj < 0)
      {
        used_uj = range_uj && *range_uj >= *last_uj ? used_uj + *range_uj : 0;  // without a range: it was reset
      }
      watts = static_cast<double>(used_uj) * 1e3 / static_cast<double>(now_ns - last_ns);
      joules += static_cast<double>(used_uj) * 1e-6;
      last_uj = count_uj;
      last_ns = now_ns;
    }
    return PowerReading::Power{name, watts, joules};
  }
};

/// A sensor of power.
struct Rail
{
  std::string name;
  std::function<std::optional<double>()> watts;
  std::optional<double> last_watts;
  int64_t last_ns = 0;
  double joules = 0;

  std::optional<PowerReading::Power> read(int64_t now_ns)
  {
    const std::optional<double> now_watts = watts();
    if (now_watts && last_watts)
    {
      joules += (*last_watts + *now_watts) / 2 * secondsBetween(last_ns, now_ns);
    }
    last_watts = now_watts;  // nothing is made up for a time in which it could not be read
    last_ns = now_ns;
    return now_watts ? std::optional(PowerReading::Power{name, *now_watts, joules}) : std::nullopt;
  }
};

std::optional<double> scaled(const fs::path& path, double scale)
{
  const std::optional<int64_t> value = readInteger(path);
  return value ? std::optional<double>(static_cast<double>(*value) * scale) : std::nullopt;
}

std::optional<double> product(const fs::path& first, const fs::path& second, double scale)
{
  const std::optional<double> a = scaled(first, 1);
  const std::optional<double> b = scaled(second, scale);
  return a && b ? std::optional<double>(*a * *b) : std::nullopt;
}

/// [W], positive; drivers do not agree on the sign of the current.
std::optional<double> batteryWatts(const fs::path& battery)
{
  std::optional<double> watts = scaled(battery / "power_now", 1e-6);
  if (!watts)
  {
    watts = product(battery / "voltage_now", battery / "current_now", 1e-12);
  }
  return watts ? std::optional<double>(std::abs(*watts)) : std::nullopt;
}

struct Thermometer
{
  std::string name;
  fs::path path;
};

}  // namespace

struct PowerMonitor::Sensors
{
  std::vector<EnergyCounter> counters;
  std::vector<Rail> rails;
  std::vector<fs::path> batteries;
  std::vector<Thermometer> thermometers;
  std::vector<std::pair<uint32_t, fs::path>> frequencies;
  std::vector<Unreadable> unreadable;
  std::set<std::string> power_names;

  /// The name, with a number if another sensor has it already.
  std::string unique(const std::string& name)
  {
    std::string candidate = name;
    for (int number = 2; !power_names.insert(candidate).second; ++number)
    {
      candidate = name + " (" + std::to_string(number) + ")";
    }
    return candidate;
  }

  /// @return false, and takes note, if the file is there but may not be read.
  bool isReadable(const fs::path& path)
  {
    int error = 0;
    readLine(path, &error);
    if (error == 0 || error == ENOENT)
    {
      return error == 0;
    }
    unreadable.push_back({path.string(), std::strerror(error)});
    // Only a lack of rights is taken as lasting; other errors, such as of a rail that is switched off, may pass.
    return error != EACCES && error != EPERM;
  }

  void addRail(const std::string& name, std::function<std::optional<double>()> watts)
  {
    rails.push_back({unique(name), std::move(watts), std::nullopt, 0, 0});
  }

  void findCounters(const fs::path& root);
  void findInaOfNvidia(const fs::path& root);
  void findHwmon(const fs::path& root);
  void findInaChannels(const fs::path& chip);
  void findOthers(const fs::path& root);
};

void PowerMonitor::Sensors::findCounters(const fs::path& root)
{
  for (const fs::path& zone : entries(root / "class/powercap", "intel-rapl:"))
  {
    const fs::path path = zone / "energy_uj";
    if (!isReadable(path))
    {
      continue;
    }
    std::string name = lineOr(zone / "name", zone.filename());
    const std::string id = zone.filename();
    const size_t sub_zone = id.find(':', id.find(':') + 1);
    if (sub_zone != std::string::npos)
    {
      const std::string parent = id.substr(0, sub_zone);
      name = lineOr(zone.parent_path() / parent / "name", parent) + "/" + name;
    }
    EnergyCounter counter;
    counter.name = unique(name);
    counter.path = path;
    counter.range_uj = readInteger(zone / "max_energy_range_uj");
    counters.push_back(counter);
  }
}

/// Kernel 4.9 of Jetson Linux: in_power<channel>_input in mW.
void PowerMonitor::Sensors::findInaOfNvidia(const fs::path& root)
{
  for (const fs::path& chip : entries(root / "bus/i2c/drivers/ina3221x", ""))
  {
    for (const fs::path& device : entries(chip, "iio:device"))
    {
      for (const std::string channel : {"0", "1", "2"})
      {
        const fs::path path = device / ("in_power" + channel + "_input");
        if (isReadable(path))
        {
          addRail(lineOr(device / ("rail_name_" + channel), "ina3221x " + chip.filename().string() + " " + channel),
                  [path] { return scaled(path, 1e-3); });
        }
      }
    }
  }
}

/// Mainline: in<channel>_input in mV and curr<channel>_input in mA of channels 1 to 3. Higher numbers are not pairs:
/// in4 is the shunt voltage of channel 1, but curr4 the sum of all.
void PowerMonitor::Sensors::findInaChannels(const fs::path& chip)
{
  for (const std::string channel : {"1", "2", "3"})
  {
    const fs::path voltage = chip / ("in" + channel + "_input");
    const fs::path current = chip / ("curr" + channel + "_input");
    if (isReadable(voltage) && isReadable(current))
    {
      addRail(lineOr(chip / ("in" + channel + "_label"), "ina3221 " + chip.filename().string() + " " + channel),
              [voltage, current] { return product(voltage, current, 1e-6); });
    }
  }
}

void PowerMonitor::Sensors::findHwmon(const fs::path& root)
{
  for (const fs::path& chip : entries(root / "class/hwmon", "hwmon"))
  {
    const std::string name = lineOr(chip / "name", chip.filename());
    if (name == "ina3221")
    {
      findInaChannels(chip);
    }
    for (const fs::path& path : entries(chip, ""))
    {
      const std::string file = path.filename();
      const std::string stem = file.substr(0, file.find('_'));
      const std::string label = lineOr(chip / (stem + "_label"), stem);
      const bool is_power = file == stem + "_input" && stem.compare(0, 5, "power") == 0;
      const bool is_mean = file == stem + "_average" && stem.compare(0, 5, "power") == 0;
      if ((is_power || (is_mean && !readLine(chip / (stem + "_input")))) && isReadable(path))
      {
        addRail(name + " " + label, [path] { return scaled(path, 1e-6); });
      }
      else if (file == stem + "_input" && stem.compare(0, 4, "temp") == 0 && isReadable(path))
      {
        thermometers.push_back({name + " " + label, path});
      }
    }
  }
}

void PowerMonitor::Sensors::findOthers(const fs::path& root)
{
  for (const fs::path& zone : entries(root / "class/thermal", "thermal_zone"))
  {
    if (isReadable(zone / "temp"))
    {
      thermometers.push_back({lineOr(zone / "type", zone.filename()), zone / "temp"});
    }
  }
  for (const fs::path& supply : entries(root / "class/power_supply", ""))
  {
    if (readLine(supply / "type") == "Battery")
    {
      batteries.push_back(supply);
    }
  }
  for (const fs::path& core : entries(root / "devices/system/cpu", "cpu"))
  {
    const std::string digits = core.filename().string().substr(3);
    uint32_t number = 0;
    const auto [stop, failure] = std::from_chars(digits.data(), digits.data() + digits.size(), number);
    const fs::path path = core / "cpufreq/scaling_cur_freq";
    if (failure == std::errc() && stop == digits.data() + digits.size() && isReadable(path))
    {
      frequencies.emplace_back(number, path);
    }
  }
}

PowerMonitor::PowerMonitor(const std::string& root) : PowerMonitor(root, monotonicNs()) {}

PowerMonitor::PowerMonitor(const std::string& root, int64_t now_ns) : sensors_(std::make_unique<Sensors>())
{
  sensors_->findCounters(root);
  sensors_->findInaOfNvidia(root);
  sensors_->findHwmon(root);
  sensors_->findOthers(root);
  unreadable_ = std::move(sensors_->unreadable);
  read(now_ns);
}

PowerMonitor::~PowerMonitor() = default;
PowerMonitor::PowerMonitor(PowerMonitor&&) noexcept = default;
PowerMonitor& PowerMonitor::operator=(PowerMonitor&&) noexcept = default;

PowerReading PowerMonitor::read()
{
  return read(monotonicNs());
}

PowerReading PowerMonitor::read(int64_t now_ns)
{
  PowerReading reading;
  const auto addPower = [&reading, now_ns](auto& sensor)
  {
    if (const std::optional<PowerReading::Power> power = sensor.read(now_ns))
    {
      reading.powers.push_back(*power);
    }
  };
  std::for_each(sensors_->counters.begin(), sensors_->counters.end(), addPower);
  std::for_each(sensors_->rails.begin(), sensors_->rails.end(), addPower);
  for (const fs::path& battery : sensors_->batteries)
  {
    constexpr double UNKNOWN = std::numeric_limits<double>::quiet_NaN();
    const std::optional<double> watts = batteryWatts(battery);
    const std::optional<double> charge = scaled(battery / "capacity", 1e-2);
    if (watts || charge)
    {
      const double sign = readLine(battery / "status") == "Charging" ? -1 : 1;
      reading.batteries.push_back({battery.filename(), sign * watts.value_or(UNKNOWN), charge.value_or(UNKNOWN)});
    }
  }
  for (const Thermometer& thermometer : sensors_->thermometers)
  {
    if (const std::optional<double> celsius = scaled(thermometer.path, 1e-3))
    {
      reading.temperatures.push_back({thermometer.name, *celsius});
    }
  }
  for (const auto& [core, path] : sensors_->frequencies)
  {
    if (const std::optional<double> hertz = scaled(path, 1e3))
    {
      reading.frequencies.push_back({core, *hertz});
    }
  }
  return reading;
}

bool PowerMonitor::available() const
{
  return !sensors_->counters.empty() || !sensors_->rails.empty() || !sensors_->batteries.empty() ||
         !sensors_->thermometers.empty() || !sensors_->frequencies.empty();
}

}  // namespace pi_node
