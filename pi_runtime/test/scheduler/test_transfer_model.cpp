#include <pi_runtime/transfer_model.h>

#include <gtest/gtest.h>

#include <limits>
#include <stdexcept>

#include "scheduler/inter_core_problem.h"

namespace pi_runtime
{
namespace
{

TEST(TransferModel, TakesNoTimeInOneMemory)
{
  const TransferModel transfers(3);
  EXPECT_EQ(0.0, transfers.time(0, 2, 1e9));
  EXPECT_EQ(0.0, transfers.mean().time(1e9));
}

TEST(TransferModel, AddsLatencyAndBytesOverBandwidth)
{
  const TransferModel transfers(2, {0.5, 100.0});
  EXPECT_DOUBLE_EQ(0.5 + 2.0, transfers.time(0, 1, 200.0));
  EXPECT_DOUBLE_EQ(0.5, transfers.time(1, 0, 0.0));
}

TEST(TransferModel, TakesNoTimeInsideAUnit)
{
  const TransferModel transfers(2, {0.5, 100.0});
  EXPECT_EQ(0.0, transfers.time(0, 0, 200.0));
  EXPECT_EQ(0.0, transfers.time(1, 1, 200.0));
}

TEST(TransferModel, KeepsTheWayBackApart)
{
  TransferModel transfers(3);
  transfers.setLink(0, 2, {1.0, 10.0});
  EXPECT_DOUBLE_EQ(1.0 + 3.0, transfers.time(0, 2, 30.0));
  EXPECT_EQ(0.0, transfers.time(2, 0, 30.0));
  EXPECT_EQ(0.0, transfers.time(0, 1, 30.0));
}

TEST(TransferModel, AveragesOverPairsOfDifferentUnits)
{
  TransferModel transfers(3);  // six pairs
  transfers.setLink(0, 2, {1.0, 10.0});
  transfers.setLink(2, 1, {0.2, INF});
  EXPECT_DOUBLE_EQ((1.0 + 3.0 + 0.2) / 6.0, transfers.mean().time(30.0));
}

TEST(TransferModel, HasNoMeanTransferWithOneUnit)
{
  EXPECT_EQ(0.0, TransferModel(1, {1.0, 10.0}).mean().time(30.0));
  EXPECT_EQ(0.0, TransferModel(0).mean().time(30.0));
}

TEST(TransferModel, RefusesImpossibleLinks)
{
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (const double latency : {-1e-9, INF, nan})
  {
    EXPECT_THROW(TransferModel(2, {latency, 1.0}), std::invalid_argument) << latency;
  }
  for (const double bandwidth : {0.0, -1.0, nan})
  {
    EXPECT_THROW(TransferModel(2, {0.0, bandwidth}), std::invalid_argument) << bandwidth;
  }
}

TEST(TransferModel, RefusesLinksItDoesNotHave)
{
  TransferModel transfers(2);
  EXPECT_THROW(transfers.setLink(0, 0, {}), std::invalid_argument);
  EXPECT_THROW(transfers.setLink(0, 2, {}), std::invalid_argument);
  EXPECT_THROW(transfers.setLink(2, 0, {}), std::invalid_argument);
  EXPECT_THROW(transfers.setLink(0, 1, {0.0, 0.0}), std::invalid_argument);
  EXPECT_EQ(0.0, transfers.time(0, 1, 5.0)) << "a refused link must not be set";
}

}  // namespace
}  // namespace pi_runtime
