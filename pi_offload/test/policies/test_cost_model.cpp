#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <stdexcept>
#include <string>

#include "policies/cost_model.h"

namespace
{

using namespace pi_offload;

constexpr double TOLERANCE = 1e-4;
constexpr double ETA = 0.5;
constexpr double NODE_GHZ = 10.0;

/// 0.19 Gcycle on a picture of 0.48 Mbit.
TaskNeeds detection()
{
  TaskNeeds needs;
  needs.work_gcycles = 0.19;
  needs.input_mbit = 0.48;
  needs.output_mbit = 0.008;
  needs.deadline_s = 0.2;
  return needs;
}

RemoteService nodeAt(double mbps)
{
  RemoteService service;
  service.frequency_ghz = NODE_GHZ;
  service.uplink_mbps = mbps;
  service.downlink_mbps = mbps;
  return service;
}

/// What an exception says; empty if there is none.
std::string errorOf(const std::function<void()>& call)
{
  try
  {
    call();
  }
  catch (const std::invalid_argument& error)
  {
    return error.what();
  }
  return "";
}

TEST(CostModel, OffloadsOverAFastLink)  // vector A
{
  const Cost local = localCost(detection(), LocalComputer());
  const Cost remote = remoteCost(detection(), Radio(), nodeAt(20.0));
  EXPECT_NEAR(local.time_s, 0.1, TOLERANCE);
  EXPECT_NEAR(local.energy_j, 0.42, TOLERANCE);
  EXPECT_NEAR(printedCost(local, ETA), 0.26, TOLERANCE);
  EXPECT_NEAR(remote.time_s, 0.0434, TOLERANCE);
  EXPECT_NEAR(remote.energy_j, 0.02916, TOLERANCE);
  EXPECT_NEAR(printedCost(remote, ETA), 0.03628, TOLERANCE);
}

TEST(CostModel, StaysOnTheVehicleOverASlowLink)  // vector B
{
  const Cost remote = remoteCost(detection(), Radio(), nodeAt(2.0));
  EXPECT_NEAR(remote.time_s, 0.263, TOLERANCE);
  EXPECT_NEAR(remote.energy_j, 0.2916, TOLERANCE);
  EXPECT_NEAR(printedCost(remote, ETA), 0.2773, TOLERANCE);
  EXPECT_GT(printedCost(remote, ETA), printedCost(localCost(detection(), LocalComputer()), ETA));
}

TEST(CostModel, WaitingForTheAnswerCostsMoreThanSending)  // vector C
{
  Radio radio;
  radio.wait_w = 1.0;
  RemoteService service = nodeAt(20.0);
  service.round_trip_s = 0.010;
  service.queue_s = 0.020;
  const Cost remote = remoteCost(detection(), radio, service);
  EXPECT_NEAR(remote.time_s, 0.0734, TOLERANCE);
  EXPECT_NEAR(remote.energy_j, 0.07816, TOLERANCE);
  EXPECT_NEAR(printedCost(remote, ETA), 0.07578, TOLERANCE);
  EXPECT_GT(remote.energy_j, 2.0 * remoteCost(detection(), Radio(), service).energy_j);
}

TEST(CostModel, TailIsPaidOnce)
{
  Radio radio;
  radio.tail_w = 0.5;
  radio.tail_s = 0.2;
  const Cost remote = remoteCost(detection(), radio, nodeAt(20.0));
  EXPECT_NEAR(remote.energy_j, 0.02916 + 0.1, TOLERANCE);
  EXPECT_NEAR(remote.time_s, 0.0434, TOLERANCE) << "the answer is there before the tail";
}

TEST(CostModel, NodeAndVehicleAreEqualAtTheBreakEvenRates)  // vector D
{
  const TaskNeeds needs = detection();
  const Radio radio;
  const Cost local = localCost(needs, LocalComputer());
  const double node_s = needs.work_gcycles / NODE_GHZ;
  const double data_mbit = needs.input_mbit + needs.output_mbit;
  const double watt_mbit = radio.transmit_w * needs.input_mbit + radio.receive_w * needs.output_mbit;
  const double energy_mbps = watt_mbit / local.energy_j;
  const double time_mbps = data_mbit / (local.time_s - node_s);
  const auto printed_mbps = [&](double eta)
  { return (eta * data_mbit + (1.0 - eta) * watt_mbit) / (printedCost(local, eta) - eta * node_s); };
  EXPECT_NEAR(energy_mbps, 1.3886, TOLERANCE);
  EXPECT_NEAR(time_mbps, 6.0247, TOLERANCE);
  EXPECT_NEAR(printed_mbps(ETA), 2.1381, TOLERANCE);
  EXPECT_NEAR(remoteCost(needs, radio, nodeAt(energy_mbps)).energy_j, local.energy_j, 1e-12);
  EXPECT_NEAR(remoteCost(needs, radio, nodeAt(time_mbps)).time_s, local.time_s, 1e-12);
  EXPECT_NEAR(printedCost(remoteCost(needs, radio, nodeAt(printed_mbps(0.3))), 0.3), printedCost(local, 0.3), 1e-12);
}

TEST(CostModel, NoRateMakesASlowerNodeFaster)
{
  const Cost local = localCost(detection(), LocalComputer());
  RemoteService slower = nodeAt(1e12);
  slower.frequency_ghz = 1.9;
  EXPECT_GE(remoteCost(detection(), Radio(), slower).time_s, local.time_s);
  EXPECT_LT(remoteCost(detection(), Radio(), slower).energy_j, local.energy_j);
  RemoteService dead = nodeAt(1e12);
  dead.frequency_ghz = 0.0;
  EXPECT_TRUE(std::isinf(remoteCost(detection(), Radio(), dead).time_s));
  EXPECT_TRUE(std::isinf(printedCost(remoteCost(detection(), Radio(), dead), ETA)));
}

TEST(CostModel, PrintedCostChangesItsVerdictWithTheUnit)  // vector E
{
  const Cost local{0.1, 0.42};
  const Cost remote{0.2, 0.01199};
  EXPECT_NEAR(printedCost(local, ETA), 0.260, TOLERANCE);
  EXPECT_NEAR(printedCost(remote, ETA), 0.105995, TOLERANCE);
  EXPECT_LT(printedCost(remote, ETA), printedCost(local, ETA));

  const Cost local_ms{100.0, 0.42};
  const Cost remote_ms{200.0, 0.01199};
  EXPECT_NEAR(printedCost(local_ms, ETA), 50.21, TOLERANCE);
  EXPECT_NEAR(printedCost(remote_ms, ETA), 100.005995, TOLERANCE);
  EXPECT_GT(printedCost(remote_ms, ETA), printedCost(local_ms, ETA));
}

TEST(CostModel, NormalisedCostKeepsItsVerdictInEveryUnit)
{
  const double seconds = normalisedCost({0.2, 0.01199}, 0.5, 0.42, ETA) - normalisedCost({0.1, 0.42}, 0.5, 0.42, ETA);
  const double milliseconds =
      normalisedCost({200.0, 11.99}, 500.0, 420.0, ETA) - normalisedCost({100.0, 420.0}, 500.0, 420.0, ETA);
  EXPECT_NEAR(seconds, milliseconds, 1e-12);
  EXPECT_LT(seconds, 0.0);
  EXPECT_NEAR(normalisedCost({0.5, 0.42}, 0.5, 0.42, 0.3), 1.0, 1e-12) << "all of the deadline, all of the energy";
}

TEST(CostModel, VehicleNeedsLeastEnergyAtItsMostEfficientFrequency)  // vector F
{
  const LocalComputer computer;
  const double best = mostEfficientFrequency(computer);
  EXPECT_NEAR(best, 1.0234, TOLERANCE);
  TaskNeeds one = detection();
  one.work_gcycles = 1.0;
  EXPECT_NEAR(localCost(one, computer, best).energy_j, 1.4658, TOLERANCE);
  EXPECT_NEAR(localCost(one, computer).energy_j, 2.2105, TOLERANCE);
  EXPECT_LT(localCost(one, computer, best).energy_j, localCost(one, computer, best * 0.99).energy_j);
  EXPECT_LT(localCost(one, computer, best).energy_j, localCost(one, computer, best * 1.01).energy_j);
}

TEST(CostModel, LocalFrequencyMeetsTheDeadlineWithinWhatTheComputerCanDo)
{
  TaskNeeds needs = detection();
  const LocalComputer computer;
  needs.deadline_s = 1.0;
  EXPECT_NEAR(bestLocalFrequency(needs, computer), 1.0234, TOLERANCE) << "time to spare";
  needs.deadline_s = 0.19 / 1.5;
  EXPECT_NEAR(bestLocalFrequency(needs, computer), 1.5, 1e-12) << "done just in time";
  needs.deadline_s = 0.01;
  EXPECT_EQ(bestLocalFrequency(needs, computer), 1.9) << "too late anyway";
  needs.deadline_s = 0.0;
  EXPECT_EQ(bestLocalFrequency(needs, computer), 1.9);
  needs.deadline_s = 10.0;
  LocalComputer idle_free;
  idle_free.static_w = 0.0;
  EXPECT_EQ(bestLocalFrequency(needs, idle_free), 0.4) << "slowest is best";
  LocalComputer all_static;
  all_static.beta_w_per_ghz3 = 0.0;
  EXPECT_EQ(bestLocalFrequency(needs, all_static), 1.9) << "race to the end";
}

TEST(CostModel, ARateOfZeroNeedsForever)
{
  const Cost remote = remoteCost(detection(), Radio(), nodeAt(0.0));
  EXPECT_TRUE(std::isinf(remote.time_s));
  EXPECT_TRUE(std::isinf(remote.energy_j));
  Radio free_radio;
  free_radio.transmit_w = 0.0;
  free_radio.receive_w = 0.0;
  EXPECT_TRUE(std::isinf(remoteCost(detection(), free_radio, nodeAt(0.0)).energy_j)) << "not 0 * infinity";
}

TEST(CostModel, NothingToCarryNeedsNoRate)
{
  TaskNeeds needs = detection();
  needs.input_mbit = 0.0;
  needs.output_mbit = 0.0;
  const Cost remote = remoteCost(needs, Radio(), nodeAt(0.0));
  EXPECT_NEAR(remote.time_s, 0.019, 1e-12);
  EXPECT_EQ(remote.energy_j, 0.0);
}

TEST(CostModel, UplinkAndDownlinkHaveTheirOwnRates)
{
  RemoteService service = nodeAt(20.0);
  service.downlink_mbps = 0.1;
  const Cost remote = remoteCost(detection(), Radio(), service);
  EXPECT_NEAR(remote.time_s, 0.019 + 0.024 + 0.08, 1e-12);
  EXPECT_NEAR(remote.energy_j, 1.2 * 0.024 + 0.9 * 0.08, 1e-12);
}

TEST(CostModel, RefusesAFrequencyThatIsNone)
{
  for (const double frequency : {0.0, -1.0, std::nan(""), std::numeric_limits<double>::infinity()})
  {
    EXPECT_THROW(localCost(detection(), LocalComputer(), frequency), std::invalid_argument) << frequency;
  }
}

TEST(CostModel, OptionsNameFieldValueAndBound)
{
  LocalComputer computer;
  EXPECT_NO_THROW(computer.validate());
  computer.least_frequency_ghz = 2.5;
  EXPECT_EQ(errorOf([&] { computer.validate(); }), "computer/least_frequency_ghz = 2.5, must be in [0, 1.9]");
  computer = LocalComputer();
  computer.static_w = std::nan("");
  EXPECT_NE(errorOf([&] { computer.validate(); }).find("computer/static_w = nan"), std::string::npos);
  computer = LocalComputer();
  computer.frequency_ghz = 0.0;
  EXPECT_NE(errorOf([&] { computer.validate(); }).find("computer/frequency_ghz = 0, must be positive"),
            std::string::npos);
  computer = LocalComputer();
  computer.beta_w_per_ghz3 = -0.1;
  EXPECT_NE(errorOf([&] { computer.validate(); }).find("computer/beta_w_per_ghz3 = -0.1"), std::string::npos);

  for (double Radio::*field : {&Radio::transmit_w, &Radio::receive_w, &Radio::wait_w, &Radio::tail_w, &Radio::tail_s})
  {
    Radio radio;
    EXPECT_NO_THROW(radio.validate());
    radio.*field = -1.0;
    EXPECT_NE(errorOf([&] { radio.validate(); }).find(" = -1, must be in [0, "), std::string::npos);
  }
}

}  // namespace
