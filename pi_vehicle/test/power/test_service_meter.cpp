// CPU time and memory by service: own processes, shared ones by the names of threads, restarts.

#include "power/service_meter.h"

#include <gtest/gtest.h>
#include <pi_node/test_support/temporary_folder.h>

#include <cmath>
#include <filesystem>
#include <map>
#include <stdexcept>
#include <string>
#include <vector>

#include "test_values.h"

namespace pi_vehicle::power
{
namespace
{

using pi_node::test_support::TemporaryFolder;

/// A computer of two cores whose clock has 100 ticks per second.
class Services : public testing::Test
{
protected:
  void folder(const std::string& name) { std::filesystem::create_directories(root_.path() + "/" + name); }
  void process(int pid, int ticks, int start = 1, int memory_kb = 100)
  {
    const std::string name = std::to_string(pid);
    folder(name + "/task");
    root_.file(name + "/stat", name + " (x) S 1 2 3 4 5 6 7 8 9 10 " + std::to_string(ticks) + " 0 13 14 15 16 17 18 " +
                                   std::to_string(start) + " 20\n");
    root_.file(name + "/smaps_rollup", "Pss: " + std::to_string(memory_kb) + " kB\n");
  }
  void thread(int pid, int tid, const std::string& name, int ticks)
  {
    const std::string path = std::to_string(pid) + "/task/" + std::to_string(tid);
    folder(path);
    root_.file(path + "/stat", std::to_string(tid) + " (" + name + ") S 1 2 3 4 5 6 7 8 9 10 " + std::to_string(ticks) +
                                   " 0 13 14 15 16 17 18 1 20\n");
  }
  void machine(int busy_ticks)
  {
    root_.file("stat",
               "cpu " + std::to_string(busy_ticks) + " 0 0 9 9 0 0 0\ncpu0 1 0 0 9 9 0 0 0\ncpu1 1 0 0 9 9 0 0 0\n");
  }
  ServiceMeter meter(double memory_period_s = 1.0) const
  {
    return ServiceMeter(
        {{"slam", {"/vio", "/manager"}, {"vio_*"}, false}, {"detection", {"/ssd", "/manager"}, {"ssd_worke?"}, false}},
        ProcessFiles(root_.path(), 100.0), memory_period_s);
  }

  const TemporaryFolder root_;
};

TEST_F(Services, ProcessesOfTheirOwn)
{
  ServiceMeter meter = this->meter();
  const std::map<std::string, int32_t> pids{{"/vio", 10}, {"/ssd", 20}};
  machine(1000);
  process(10, 500);
  process(20, 100);
  EXPECT_EQ(0.0, meter.update(SECOND, pids).period_s);
  machine(1300);
  process(10, 600);
  process(20, 150, 1, 300);
  const MachineUse use = meter.update(3 * SECOND, pids);
  EXPECT_DOUBLE_EQ(2.0, use.period_s);
  EXPECT_DOUBLE_EQ(0.5, use.services[0].cores);
  EXPECT_DOUBLE_EQ(0.25, use.services[1].cores);
  EXPECT_DOUBLE_EQ(1.5, use.busy_cores);
  EXPECT_DOUBLE_EQ(0.75, use.other.cores);
  EXPECT_EQ(2U, use.cores);
  EXPECT_DOUBLE_EQ(307200.0, use.services[1].memory);
  EXPECT_EQ(std::vector<std::string>{"/ssd"}, use.services[1].nodes);
  EXPECT_FALSE(use.shared.running);
}

TEST_F(Services, ThreadsOfASharedProcessGoToTheirService)
{
  ServiceMeter meter = this->meter();
  const std::map<std::string, int32_t> pids{{"/manager", 10}};
  machine(0);
  process(10, 1000);
  thread(10, 10, "nodelet", 100);
  thread(10, 11, "vio_worker", 500);
  thread(10, 12, "ssd_worker", 400);
  meter.update(SECOND, pids);
  machine(100);
  process(10, 1090);
  thread(10, 10, "nodelet", 110);
  thread(10, 11, "vio_worker", 530);
  thread(10, 12, "ssd_worker", 420);
  thread(10, 13, "vio_imu", 5);  // has begun since
  const MachineUse use = meter.update(2 * SECOND, pids);
  EXPECT_TRUE(use.services[0].running);
  EXPECT_NEAR(0.35, use.services[0].cores, 1e-9);
  EXPECT_NEAR(0.20, use.services[1].cores, 1e-9);
  EXPECT_NEAR(0.35, use.shared.cores, 1e-9);  // its main thread, and threads that have ended
  EXPECT_NEAR(0.10, use.other.cores, 1e-9);
  EXPECT_DOUBLE_EQ(0.0, use.services[0].memory);
  EXPECT_DOUBLE_EQ(102400.0, use.shared.memory);
}

TEST_F(Services, AServiceThatIsNotLoadedInAManagerDoesNotRun)
{
  ServiceMeter meter = this->meter();
  process(10, 0);
  thread(10, 10, "nodelet", 0);
  thread(10, 11, "vio_worker", 0);
  const MachineUse use = meter.update(SECOND, {{"/manager", 10}});
  EXPECT_TRUE(use.services[0].running);
  EXPECT_EQ(std::vector<std::string>{"/manager"}, use.services[0].nodes);
  EXPECT_FALSE(use.services[1].running);
  EXPECT_TRUE(use.services[1].nodes.empty());
  EXPECT_TRUE(use.shared.running);
}

TEST_F(Services, TwoNodesOfOneServiceInAProcessCountOnce)
{
  ServiceMeter meter({{"slam", {"/a", "/b"}, {}, false}}, ProcessFiles(root_.path(), 100.0), 1.0);
  const std::map<std::string, int32_t> pids{{"/a", 10}, {"/b", 10}};
  process(10, 0);
  meter.update(SECOND, pids);
  process(10, 50);
  const MachineUse use = meter.update(2 * SECOND, pids);
  EXPECT_DOUBLE_EQ(0.5, use.services[0].cores);
  EXPECT_FALSE(use.shared.running);
  EXPECT_EQ(2U, use.services[0].nodes.size());
}

TEST_F(Services, ARestartedProcessBeginsAtZero)
{
  ServiceMeter meter = this->meter();
  process(10, 5000, 1);
  meter.update(SECOND, {{"/vio", 10}});
  process(10, 6000, 99);  // another one with its number
  EXPECT_DOUBLE_EQ(0.0, meter.update(2 * SECOND, {{"/vio", 10}}).services[0].cores);
  process(10, 6030, 99);
  EXPECT_NEAR(0.3, meter.update(3 * SECOND, {{"/vio", 10}}).services[0].cores, 1e-9);
}

TEST_F(Services, WhatHasEndedDoesNotRun)
{
  ServiceMeter meter = this->meter();
  process(10, 500);
  EXPECT_TRUE(meter.update(SECOND, {{"/vio", 10}}).services[0].running);
  std::filesystem::remove_all(root_.path() + "/10");
  const MachineUse use = meter.update(2 * SECOND, {{"/vio", 10}});
  EXPECT_FALSE(use.services[0].running);
  EXPECT_TRUE(use.services[0].nodes.empty());
  EXPECT_DOUBLE_EQ(0.0, use.services[0].cores);
}

TEST_F(Services, MemoryIsReadOncePerPeriod)
{
  ServiceMeter meter = this->meter(10.0);
  process(10, 0, 1, 100);
  EXPECT_DOUBLE_EQ(102400.0, meter.update(SECOND, {{"/vio", 10}}).services[0].memory);
  process(10, 0, 1, 200);
  EXPECT_DOUBLE_EQ(102400.0, meter.update(2 * SECOND, {{"/vio", 10}}).services[0].memory);
  EXPECT_DOUBLE_EQ(204800.0, meter.update(12 * SECOND, {{"/vio", 10}}).services[0].memory);
  std::filesystem::remove(root_.path() + "/10/smaps_rollup");
  EXPECT_TRUE(std::isnan(meter.update(23 * SECOND, {{"/vio", 10}}).services[0].memory));
}

TEST_F(Services, WrongTablesAreNamed)
{
  const auto refusal = [](const std::vector<ServiceDescription>& services) -> std::string
  {
    try
    {
      validateServices(services);
    }
    catch (const std::invalid_argument& error)
    {
      return error.what();
    }
    return "";
  };
  EXPECT_EQ("", refusal(defaultServices()));
  EXPECT_EQ("", refusal({}));
  EXPECT_EQ("a service has no name; give it one", refusal({{"", {"/a"}, {}, false}}));
  EXPECT_EQ("service slam has no nodes, must have at least one", refusal({{"slam", {}, {}, false}}));
  EXPECT_EQ("two services are named slam; put their nodes into one",
            refusal({{"slam", {"/a"}, {}, false}, {"slam", {"/b"}, {}, false}}));
  EXPECT_NE("", refusal({{"slam", {""}, {}, false}}));
  EXPECT_NE("", refusal({{"slam", {"/a"}, {""}, false}}));
}

}  // namespace
}  // namespace pi_vehicle::power
