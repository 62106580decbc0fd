#include <pi_node/power_monitor.h>

#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

namespace pi_node
{
namespace
{

constexpr int64_t SECOND = 1'000'000'000;
constexpr double ROUNDING = 1e-9;  // relative error of a few operations on doubles, with a margin

/// A folder that looks like /sys.
class PowerMonitorTest : public testing::Test
{
protected:
  PowerMonitorTest()
  {
    char name[] = "/tmp/test_power_monitor.XXXXXX";
    root_ = mkdtemp(name);
    chmod(root_.c_str(), 0755);
  }
  ~PowerMonitorTest() override { std::filesystem::remove_all(root_); }

  void write(const std::string& path, const std::string& content)
  {
    std::filesystem::create_directories((std::filesystem::path(root_) / path).parent_path());
    std::ofstream(root_ + "/" + path) << content << "\n";
  }
  void remove(const std::string& path) { std::filesystem::remove(root_ + "/" + path); }

  void writeRapl(const std::string& zone, const std::string& name, const std::string& energy_uj)
  {
    write("class/powercap/" + zone + "/name", name);
    write("class/powercap/" + zone + "/energy_uj", energy_uj);
    write("class/powercap/" + zone + "/max_energy_range_uj", "262143328850");
  }

  std::string root_;
};

TEST_F(PowerMonitorTest, NothingIsAvailableInAnEmptyTree)
{
  PowerMonitor monitor(root_);
  EXPECT_FALSE(monitor.available());
  EXPECT_TRUE(monitor.unreadable().empty());
  const PowerReading reading = monitor.read();
  EXPECT_TRUE(reading.powers.empty());
  EXPECT_TRUE(reading.batteries.empty());
  EXPECT_TRUE(reading.temperatures.empty());
  EXPECT_TRUE(reading.frequencies.empty());
  EXPECT_FALSE(PowerMonitor(root_ + "/missing").available());
}

TEST_F(PowerMonitorTest, CountsTheEnergyOfRaplZones)
{
  writeRapl("intel-rapl:0", "package-0", "1000000");
  writeRapl("intel-rapl:0:1", "core", "500000");
  writeRapl("intel-rapl:10", "package-1", "0");
  writeRapl("intel-rapl:2", "psys", "0");
  write("class/powercap/intel-rapl/enabled", "1");
  writeRapl("intel-rapl-mmio:0", "package-0", "7");  // the same zone by another way
  PowerMonitor monitor(root_, 10 * SECOND);
  writeRapl("intel-rapl:0", "package-0", "31000000");
  writeRapl("intel-rapl:0:1", "core", "10500000");
  PowerReading reading = monitor.read(12 * SECOND);
  ASSERT_EQ(4U, reading.powers.size());
  EXPECT_EQ("package-0", reading.powers[0].name);
  EXPECT_NEAR(15, reading.powers[0].watts, ROUNDING);
  EXPECT_NEAR(30, reading.powers[0].joules, ROUNDING);
  EXPECT_EQ("package-0/core", reading.powers[1].name);
  EXPECT_NEAR(5, reading.powers[1].watts, ROUNDING);
  EXPECT_EQ("psys", reading.powers[2].name);
  EXPECT_EQ("package-1", reading.powers[3].name);
  EXPECT_EQ(0, reading.powers[3].watts);

  writeRapl("intel-rapl:0", "package-0", "32000000");
  reading = monitor.read(13 * SECOND);
  EXPECT_NEAR(1, reading.powers[0].watts, ROUNDING) << "the mean since the previous read";
  EXPECT_NEAR(31, reading.powers[0].joules, ROUNDING);
  reading = monitor.read(13 * SECOND);
  EXPECT_NEAR(1, reading.powers[0].watts, ROUNDING) << "no time has passed";
}

TEST_F(PowerMonitorTest, ACounterMayWrapAround)
{
  writeRapl("intel-rapl:0", "package-0", "262143328000");
  PowerMonitor monitor(root_, 0);
  writeRapl("intel-rapl:0", "package-0", "9150");
  EXPECT_NEAR(0.01, monitor.read(SECOND).powers.at(0).joules, ROUNDING);
}

TEST_F(PowerMonitorTest, ACounterWithoutRangeThatFallsWasReset)
{
  writeRapl("intel-rapl:0", "package-0", "5000000");
  remove("class/powercap/intel-rapl:0/max_energy_range_uj");
  PowerMonitor monitor(root_, 0);
  writeRapl("intel-rapl:0", "package-0", "1000000");
  EXPECT_EQ(0, monitor.read(SECOND).powers.at(0).watts);
  writeRapl("intel-rapl:0", "package-0", "3000000");
  EXPECT_NEAR(2, monitor.read(2 * SECOND).powers.at(0).joules, ROUNDING);
}

TEST_F(PowerMonitorTest, WhatMayNotBeReadIsListedWithTheReason)
{
  writeRapl("intel-rapl:0", "package-0", "1");
  const std::string path = root_ + "/class/powercap/intel-rapl:0/energy_uj";
  chmod(path.c_str(), 0);
  constexpr uid_t NOBODY = 65534;
  const uid_t user = geteuid();
  if (user == 0)  // who may read anything
  {
    ASSERT_EQ(0, seteuid(NOBODY));
  }
  PowerMonitor monitor(root_);
  const PowerReading reading = monitor.read();
  if (user == 0)
  {
    ASSERT_EQ(0, seteuid(user));
  }
  EXPECT_FALSE(monitor.available());
  EXPECT_TRUE(reading.powers.empty());
  ASSERT_EQ(1U, monitor.unreadable().size());
  EXPECT_EQ(path, monitor.unreadable()[0].path);
  EXPECT_EQ("Permission denied", monitor.unreadable()[0].reason);
}

TEST_F(PowerMonitorTest, ReadsTheRailsOfNvidiasKernel)
{
  const std::string device = "bus/i2c/drivers/ina3221x/1-0040/iio:device0/";
  write(device + "rail_name_0", "POM_5V_IN");
  write(device + "in_power0_input", "2000");
  write(device + "rail_name_1", "POM_5V_GPU");
  write(device + "in_power1_input", "40");
  write(device + "in_power2_input", "100");
  PowerMonitor monitor(root_, 0);
  write(device + "in_power0_input", "4000");
  const PowerReading reading = monitor.read(2 * SECOND);
  ASSERT_EQ(3U, reading.powers.size());
  EXPECT_EQ("POM_5V_IN", reading.powers[0].name);
  EXPECT_NEAR(4, reading.powers[0].watts, ROUNDING);
  EXPECT_NEAR(6, reading.powers[0].joules, ROUNDING) << "trapezoid of 2 W and 4 W over 2 s";
  EXPECT_EQ("POM_5V_GPU", reading.powers[1].name);
  EXPECT_NEAR(0.04, reading.powers[1].watts, ROUNDING);
  EXPECT_EQ("ina3221x 1-0040 2", reading.powers[2].name);
}

TEST_F(PowerMonitorTest, ReadsTheChannelsOfTheMainlineIna3221)
{
  const std::string chip = "class/hwmon/hwmon3/";
  write(chip + "name", "ina3221");
  write(chip + "in1_label", "VDD_IN");
  for (const std::string channel : {"1", "2", "3", "4"})
  {
    write(chip + "in" + channel + "_input", "5000");
    write(chip + "curr" + channel + "_input", "400");
  }
  remove(chip + "curr2_input");
  const PowerReading reading = PowerMonitor(root_).read();
  ASSERT_EQ(2U, reading.powers.size()) << "in4 and curr4 are no channel";
  EXPECT_EQ("VDD_IN", reading.powers[0].name);
  EXPECT_NEAR(2, reading.powers[0].watts, ROUNDING);
  EXPECT_EQ("ina3221 hwmon3 3", reading.powers[1].name);
}

TEST_F(PowerMonitorTest, ReadsPowersAndTemperaturesOfOtherChips)
{
  const std::string chip = "class/hwmon/hwmon0/";
  write(chip + "name", "amdgpu");
  write(chip + "power1_average", "12000000");
  write(chip + "power1_label", "PPT");
  write(chip + "power1_cap", "99000000");
  write(chip + "power2_input", "3000000");
  write(chip + "power2_average", "1");
  write(chip + "temp1_input", "45500");
  write(chip + "temp1_label", "edge");
  write(chip + "temp2_input", "-2000");
  write(chip + "temp2_crit", "100000");
  const PowerReading reading = PowerMonitor(root_).read();
  ASSERT_EQ(2U, reading.powers.size());
  EXPECT_EQ("amdgpu PPT", reading.powers[0].name);
  EXPECT_NEAR(12, reading.powers[0].watts, ROUNDING);
  EXPECT_EQ("amdgpu power2", reading.powers[1].name);
  EXPECT_NEAR(3, reading.powers[1].watts, ROUNDING);
  ASSERT_EQ(2U, reading.temperatures.size());
  EXPECT_EQ("amdgpu edge", reading.temperatures[0].name);
  EXPECT_NEAR(45.5, reading.temperatures[0].celsius, ROUNDING);
  EXPECT_EQ("amdgpu temp2", reading.temperatures[1].name);
  EXPECT_NEAR(-2, reading.temperatures[1].celsius, ROUNDING);
}

TEST_F(PowerMonitorTest, SensorsOfOneNameAreNumbered)
{
  for (const std::string chip : {"hwmon1", "hwmon10", "hwmon2"})
  {
    write("class/hwmon/" + chip + "/name", "ina226");
    write("class/hwmon/" + chip + "/power1_input", chip.substr(5) + "000000");
  }
  const PowerReading reading = PowerMonitor(root_).read();
  ASSERT_EQ(3U, reading.powers.size());
  EXPECT_EQ("ina226 power1", reading.powers[0].name);
  EXPECT_EQ("ina226 power1 (2)", reading.powers[1].name);
  EXPECT_NEAR(2, reading.powers[1].watts, ROUNDING);
  EXPECT_EQ("ina226 power1 (3)", reading.powers[2].name);
  EXPECT_NEAR(10, reading.powers[2].watts, ROUNDING);
}

TEST_F(PowerMonitorTest, ReadsBatteries)
{
  write("class/power_supply/AC/type", "Mains");
  write("class/power_supply/AC/power_now", "1");
  write("class/power_supply/BAT0/type", "Battery");
  write("class/power_supply/BAT0/status", "Discharging");
  write("class/power_supply/BAT0/voltage_now", "12000000");
  write("class/power_supply/BAT0/current_now", "-1500000");
  write("class/power_supply/BAT0/capacity", "73");
  write("class/power_supply/BAT1/type", "Battery");
  write("class/power_supply/BAT1/status", "Charging");
  write("class/power_supply/BAT1/power_now", "20000000");
  write("class/power_supply/BAT2/type", "Battery");
  const PowerReading reading = PowerMonitor(root_).read();
  ASSERT_EQ(2U, reading.batteries.size());
  EXPECT_EQ("BAT0", reading.batteries[0].name);
  EXPECT_NEAR(18, reading.batteries[0].watts, ROUNDING);
  EXPECT_NEAR(0.73, reading.batteries[0].charge, ROUNDING);
  EXPECT_EQ("BAT1", reading.batteries[1].name);
  EXPECT_NEAR(-20, reading.batteries[1].watts, ROUNDING);
  EXPECT_TRUE(std::isnan(reading.batteries[1].charge));
}

TEST_F(PowerMonitorTest, ReadsThermalZonesAndFrequencies)
{
  write("class/thermal/thermal_zone0/type", "CPU-therm");
  write("class/thermal/thermal_zone0/temp", "51250");
  write("class/thermal/thermal_zone1/temp", "20000");
  write("class/thermal/cooling_device0/type", "fan");
  write("devices/system/cpu/cpu0/cpufreq/scaling_cur_freq", "1420000");
  write("devices/system/cpu/cpu10/cpufreq/scaling_cur_freq", "800000");
  write("devices/system/cpu/cpu2/online", "0");
  write("devices/system/cpu/cpufreq/scaling_cur_freq", "1");
  const PowerReading reading = PowerMonitor(root_).read();
  ASSERT_EQ(2U, reading.temperatures.size());
  EXPECT_EQ("CPU-therm", reading.temperatures[0].name);
  EXPECT_NEAR(51.25, reading.temperatures[0].celsius, ROUNDING);
  EXPECT_EQ("thermal_zone1", reading.temperatures[1].name);
  ASSERT_EQ(2U, reading.frequencies.size());
  EXPECT_EQ(0U, reading.frequencies[0].core);
  EXPECT_NEAR(1.42e9, reading.frequencies[0].hertz, 1);
  EXPECT_EQ(10U, reading.frequencies[1].core);
}

TEST_F(PowerMonitorTest, SensorsThatVanishAreLeftOutUntilTheyReturn)
{
  const std::string power = "class/hwmon/hwmon0/power1_input";
  const std::string counter = "class/powercap/intel-rapl:0/energy_uj";
  write("class/hwmon/hwmon0/name", "ina226");
  write(power, "1000000");
  writeRapl("intel-rapl:0", "package-0", "0");
  PowerMonitor monitor(root_, 0);
  ASSERT_EQ(2U, monitor.read(SECOND).powers.size());
  remove(power);
  remove(counter);
  EXPECT_TRUE(monitor.read(2 * SECOND).powers.empty());
  write(power, "3000000");
  write(counter, "4000000");
  const PowerReading reading = monitor.read(4 * SECOND);
  ASSERT_EQ(2U, reading.powers.size());
  EXPECT_NEAR(4, reading.powers[0].joules, ROUNDING) << "the counter went on meanwhile";
  EXPECT_NEAR(1, reading.powers[1].joules, ROUNDING) << "nobody knows the power meanwhile";
  EXPECT_NEAR(4, monitor.read(5 * SECOND).powers[1].joules, ROUNDING);
}

TEST_F(PowerMonitorTest, NonsenseIsNoReading)
{
  const std::string power = "class/hwmon/hwmon0/power1_input";
  write("class/hwmon/hwmon0/name", "ina226");
  for (const std::string garbage : {"", "abc", "12abc", "1.5", "99999999999999999999999", "0x10", "1 2"})
  {
    write(power, garbage);
    PowerMonitor monitor(root_, 0);
    EXPECT_TRUE(monitor.read(SECOND).powers.empty()) << garbage;
    write(power, "2000000 ");
    EXPECT_EQ(1U, monitor.read(2 * SECOND).powers.size()) << "well again after " << garbage;
  }
  writeRapl("intel-rapl:0", "package-0", "-5");
  EXPECT_EQ(1U, PowerMonitor(root_).read().powers.size());
  std::ofstream(root_ + "/" + power) << "";
  EXPECT_TRUE(PowerMonitor(root_).read().powers.empty()) << "a file without a line";
}

TEST_F(PowerMonitorTest, AMovedMonitorGoesOn)
{
  writeRapl("intel-rapl:0", "package-0", "0");
  PowerMonitor first(root_, 0);
  PowerMonitor second(std::move(first));
  writeRapl("intel-rapl:0", "package-0", "1000000");
  EXPECT_NEAR(1, second.read(SECOND).powers.at(0).joules, ROUNDING);
}

}  // namespace
}  // namespace pi_node
