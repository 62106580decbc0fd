// Watts by sensor or model, and how they are shared out.

#include "power/power_account.h"

#include <gtest/gtest.h>

#include <limits>
#include <stdexcept>
#include <string>
#include <vector>

namespace pi_vehicle::power
{
namespace
{

using pi_node::PowerReading;

PowerReading reading(const std::vector<PowerReading::Power>& powers)
{
  PowerReading reading;
  reading.powers = powers;
  return reading;
}

MachineUse busy(double slam, double shared, double other)
{
  MachineUse use;
  use.cores = 4;
  use.services = {{"slam", true, {}, slam, 0.0}, {"speech", false, {}, 0.0, 0.0}};
  use.shared.cores = shared;
  use.other.cores = other;
  use.busy_cores = slam + shared + other;
  return use;
}

double sum(const PowerAccount& account)
{
  double watts = account.idle + account.shared + account.other;
  for (const double service : account.services)
  {
    watts += service;
  }
  return watts;
}

TEST(PowerAccount, ModelHasThePapersTx1)
{
  // Figures 14 and 15: at 60 % of four cores the CPU takes 4.2 W.
  const ModelOptions model;
  const PowerAccount account = accountPower(busy(2.4, 0.0, 0.0), {}, model, {});
  EXPECT_NEAR(4.2, account.total - model.board_w, 0.01);
  EXPECT_EQ("model", account.source);
  EXPECT_FALSE(account.measured);
}

TEST(PowerAccount, ModelGrowsWithTheCubeOfTheFrequency)
{
  ModelOptions model;
  EXPECT_NEAR(8.0, busyCoreWatts(model, 1.8) / busyCoreWatts(model, 0.9), 1e-9);
  model.frequency_ghz = 0.0;  // as the system says
  PowerReading cores;
  cores.frequencies = {{0, 0.8e9}, {1, 1.2e9}};
  EXPECT_NEAR(busyCoreWatts(model, 1.0), accountPower(busy(1.0, 0.0, 0.0), cores, model, {}).dynamic, 1e-9);
}

TEST(PowerAccount, PartsAddUpToTheTotal)
{
  const PowerAccount modelled = accountPower(busy(0.5, 0.2, 0.8), {}, ModelOptions(), {});
  EXPECT_NEAR(modelled.total, sum(modelled), 1e-9);
  const PowerAccount measured = accountPower(busy(0.5, 0.2, 0.8), reading({{"VDD_IN", 7.3, 0.0}}), ModelOptions(), {});
  EXPECT_TRUE(measured.measured);
  EXPECT_NEAR(7.3, sum(measured), 1e-9);
  EXPECT_NEAR(4.3, measured.idle, 1e-9);
  EXPECT_NEAR(3.0 * 0.5 / 1.5, measured.services[0], 1e-9);
  EXPECT_EQ(0.0, measured.services[1]);
}

TEST(PowerAccount, ARestingComputerIsIdleAlone)
{
  const PowerAccount modelled = accountPower(busy(0.0, 0.0, 0.0), {}, ModelOptions(), {});
  EXPECT_DOUBLE_EQ(4.3, modelled.total);
  EXPECT_DOUBLE_EQ(0.0, modelled.services[0]);
  const PowerAccount measured = accountPower(busy(0.0, 0.0, 0.0), reading({{"psys", 2.0, 0.0}}), ModelOptions(), {});
  EXPECT_DOUBLE_EQ(2.0, measured.idle);
  EXPECT_DOUBLE_EQ(0.0, measured.dynamic);
}

TEST(PowerAccount, SensorsThatAddUpToTheComputer)
{
  const PowerReading jetson = reading({{"POM_5V_GPU", 1.0, 0.0}, {"POM_5V_IN", 6.0, 0.0}, {"POM_5V_CPU", 2.0, 0.0}});
  EXPECT_EQ(std::vector<std::string>{"POM_5V_IN"}, computerSensors(jetson, {}));
  const PowerReading rapl = reading(
      {{"package-0", 9.0, 0.0}, {"package-0/core", 5.0, 0.0}, {"package-1", 8.0, 0.0}, {"package-0/dram", 1.0, 0.0}});
  EXPECT_EQ((std::vector<std::string>{"package-0", "package-1"}), computerSensors(rapl, {}));
  EXPECT_EQ("package-0 + package-1", accountPower(busy(1.0, 0.0, 0.0), rapl, ModelOptions(), {}).source);
  EXPECT_DOUBLE_EQ(17.0, accountPower(busy(1.0, 0.0, 0.0), rapl, ModelOptions(), {}).total);
  EXPECT_EQ(std::vector<std::string>{"psys"},
            computerSensors(reading({{"package-0", 9.0, 0.0}, {"psys", 15.0, 0.0}}), {}));
  EXPECT_TRUE(computerSensors(reading({{"nvme Composite", 1.0, 0.0}}), {}).empty());
  EXPECT_EQ(std::vector<std::string>{"POM_5V_CPU"}, computerSensors(jetson, {"POM_5V_CPU"}));
  EXPECT_TRUE(computerSensors(jetson, {"POM_5V_CPU", "absent"}).empty());
}

TEST(PowerAccount, ASensorWithoutANumberGivesWayToTheModel)
{
  const PowerReading broken = reading({{"VDD_IN", std::numeric_limits<double>::quiet_NaN(), 0.0}});
  const PowerAccount account = accountPower(busy(1.0, 0.0, 0.0), broken, ModelOptions(), {});
  EXPECT_FALSE(account.measured);
  EXPECT_EQ("model", account.source);
  EXPECT_GT(account.services[0], 0.0);
}

TEST(PowerAccount, WrongModelsAreNamed)
{
  ModelOptions model;
  model.board_w = -1.0;
  try
  {
    model.validate();
    FAIL() << "accepted";
  }
  catch (const std::invalid_argument& error)
  {
    EXPECT_STREQ("model/board_w = -1, must be in [0, 1000]", error.what());
  }
}

}  // namespace
}  // namespace pi_vehicle::power
