#include <gtest/gtest.h>
#include "ros/conversions.h"

#include <cmath>
#include <limits>
#include <stdexcept>

namespace pi_runtime
{
namespace
{

template <typename Action>
std::string refusal(const Action& action)
{
  try
  {
    action();
  }
  catch (const std::invalid_argument& error)
  {
    return error.what();
  }
  return "";
}

TEST(Conversions, OfDurationsAreExactAndRefuseNegativeOnes)
{
  EXPECT_EQ(1500000001, toNanoseconds(ros::Duration(1, 500000001), "deadline").count());
  EXPECT_EQ(0, toNanoseconds(ros::Duration(0), "deadline").count());
  EXPECT_EQ("deadline = -0.500000 s, must be at least 0",
            refusal([] { toNanoseconds(ros::Duration(-0.5), "deadline"); }));
}

TEST(Conversions, OfUnitsKeepEveryField)
{
  UnitStatus status{};
  status.name = "gpu0";
  status.type = UnitType::GPU;
  status.executors = {"native", "opencl"};
  status.device = "a GPU";
  status.memory = "separate";
  status.cores = {1, 3};
  status.compute_units = 20;
  status.fp16 = true;
  status.fp64 = false;
  status.bandwidth_bps = std::numeric_limits<double>::infinity();
  status.active_power_w = 30.0;
  status.idle_power_w = 5.0;
  status.failed = true;
  status.failure = "gone";
  status.queued = 2;
  status.running = 1;
  status.load_s = 0.5;
  status.blocking_budget_s = 0.25;
  status.tasks = 11;
  status.failures = 12;
  status.stolen = 13;
  status.deadline_tasks = 14;
  status.missed_deadlines = 15;
  status.busy_s = 16.5;
  status.utilisation = 0.75;
  const Unit message = toMsg(status);
  EXPECT_EQ("gpu0", message.name);
  EXPECT_EQ("gpu", message.type);
  EXPECT_EQ((std::vector<std::string>{"native", "opencl"}), message.executors);
  EXPECT_EQ("a GPU", message.device);
  EXPECT_EQ("separate", message.memory);
  EXPECT_EQ((std::vector<int32_t>{1, 3}), message.cores);
  EXPECT_EQ(20u, message.compute_units);
  EXPECT_TRUE(message.fp16);
  EXPECT_FALSE(message.fp64);
  EXPECT_TRUE(std::isinf(message.bandwidth_bps));
  EXPECT_EQ(30.0, message.active_power_w);
  EXPECT_EQ(5.0, message.idle_power_w);
  EXPECT_TRUE(message.failed);
  EXPECT_EQ("gone", message.failure);
  EXPECT_EQ(2u, message.queued);
  EXPECT_EQ(1u, message.running);
  EXPECT_EQ(0.5, message.load_s);
  EXPECT_EQ(0.25, message.blocking_budget_s);
  EXPECT_EQ(11u, message.tasks);
  EXPECT_EQ(12u, message.failures);
  EXPECT_EQ(13u, message.stolen);
  EXPECT_EQ(14u, message.deadline_tasks);
  EXPECT_EQ(15u, message.missed_deadlines);
  EXPECT_EQ(16.5, message.busy_s);
  EXPECT_EQ(0.75, message.utilisation);
}

TEST(Conversions, OfCodeletsSayWhatTheyCanDo)
{
  Codelet codelet;
  codelet.name = "copy";
  codelet.native = {NativeImplementation{[](const NativeCall&) {}}};
  codelet.sliceable = true;
  codelet.slice_granularity = 8;
  const CodeletInfo message = toMsg(RegisteredCodelet{makeCodelet(codelet), "copies", "0 in, 1 out"});
  EXPECT_EQ("copy", message.name);
  EXPECT_EQ("copies", message.description);
  EXPECT_EQ("0 in, 1 out", message.arguments);
  EXPECT_TRUE(message.native);
  EXPECT_FALSE(message.opencl);
  EXPECT_TRUE(message.sliceable);
  EXPECT_EQ(8u, message.slice_granularity);
}

TEST(Conversions, OfEtcEntriesGoBothWays)
{
  const EtcTable::Entry entry{"blur", -7, "cpu1/opencl", {12, 0.25, 0.5}};
  const EtcTable::Entry back = fromMsg(toMsg(entry));
  EXPECT_EQ(entry.codelet, back.codelet);
  EXPECT_EQ(entry.bucket, back.bucket);
  EXPECT_EQ(entry.column, back.column);
  EXPECT_EQ(entry.cell.count, back.cell.count);
  EXPECT_EQ(entry.cell.mean_s, back.cell.mean_s);
  EXPECT_EQ(entry.cell.variance_s2, back.cell.variance_s2);
}

TEST(Conversions, OfEdgesKeepEveryField)
{
  GraphEdge message;
  message.predecessor = 3;
  message.successor = 5;
  message.bytes = 1e6;
  const GraphRequest::Edge edge = fromMsg(message);
  EXPECT_EQ(3u, edge.from);
  EXPECT_EQ(5u, edge.to);
  EXPECT_EQ(1e6, edge.bytes);
}

TEST(Conversions, OfPoliciesGoBothWays)
{
  SchedulerOptions options;
  options.inter_core.policy = InterCorePolicy::SUFFERAGE;
  options.inter_core.diff_min_order = DiffMinOrder::MIN_DIV;
  options.inter_core.seed = 99;
  options.inter_core.budget = std::chrono::microseconds(77);
  options.inter_core.kicks = 3;
  options.inter_core.alpha = 0.5;
  options.inter_core.gamma = 0.125;
  options.inner_core.policy = InnerCorePolicy::LEVELS;
  options.inner_core.insertion = false;
  options.inner_core.level_mapping = LevelMapping::DIFF_MIN;
  options.inner_core.level_barrier = false;
  const SchedulerOptions back = fromMsg(toMsg(options));
  EXPECT_EQ(options.inter_core.policy, back.inter_core.policy);
  EXPECT_EQ(options.inter_core.diff_min_order, back.inter_core.diff_min_order);
  EXPECT_EQ(options.inter_core.seed, back.inter_core.seed);
  EXPECT_EQ(options.inter_core.budget, back.inter_core.budget);
  EXPECT_EQ(options.inter_core.kicks, back.inter_core.kicks);
  EXPECT_EQ(options.inter_core.alpha, back.inter_core.alpha);
  EXPECT_EQ(options.inter_core.gamma, back.inter_core.gamma);
  EXPECT_EQ(options.inner_core.policy, back.inner_core.policy);
  EXPECT_EQ(options.inner_core.insertion, back.inner_core.insertion);
  EXPECT_EQ(options.inner_core.level_mapping, back.inner_core.level_mapping);
  EXPECT_EQ(options.inner_core.level_barrier, back.inner_core.level_barrier);
}

TEST(Conversions, OfPoliciesRefuseWhatIsImpossible)
{
  SchedulerPolicy message = toMsg(SchedulerOptions{});
  message.inter_core_policy = "fastest";
  EXPECT_NE(std::string::npos, refusal([&] { fromMsg(message); }).find("fastest"));
  message = toMsg(SchedulerOptions{});
  message.alpha = std::nan("");
  EXPECT_NE(std::string::npos, refusal([&] { fromMsg(message); }).find("alpha = nan"));
  message = toMsg(SchedulerOptions{});
  message.level_mapping = "";
  EXPECT_NE(std::string::npos, refusal([&] { fromMsg(message); }).find("level mapping"));
}

TEST(Conversions, OfResultsKeepEveryField)
{
  TaskResult result;
  result.outcome = Outcome::UNIT_FAILED;
  result.message = "broke";
  result.opencl_code = -5;
  result.unit = "cpu1";
  result.executor = "native";
  result.submitted_ns = 100;
  result.started_ns = 200;
  result.finished_ns = 5000000000;
  result.deadline_ns = 4000000000;
  result.transfer_ns = 50;
  result.predicted_s = 0.125;
  result.slices = 4;
  result.stolen = true;
  const TaskReport message = toMsg(result);
  EXPECT_TRUE(message.deadline_missed);
  EXPECT_EQ(TaskReport::UNIT_FAILED, message.outcome);
  EXPECT_EQ(result.message, message.message);
  EXPECT_EQ(result.opencl_code, message.opencl_code);
  EXPECT_EQ(result.unit, message.unit);
  EXPECT_EQ(result.executor, message.executor);
  EXPECT_EQ(result.submitted_ns, message.submitted_ns);
  EXPECT_EQ(result.started_ns, message.started_ns);
  EXPECT_EQ(result.finished_ns, message.finished_ns);
  EXPECT_EQ(result.deadline_ns, message.deadline_ns);
  EXPECT_EQ(result.transfer_ns, message.transfer_ns);
  EXPECT_EQ(result.predicted_s, message.predicted_s);
  EXPECT_EQ(result.slices, message.slices);
  EXPECT_EQ(result.stolen, message.stolen);
}

TEST(Conversions, OfStreamsKeepEveryField)
{
  const Stream message =
      toMsg(StreamStatus{4, 4711, "camera", "cpu0", 12, 0.033, 0.02, 0.01, 100, 3, 0.011, 0.019, 0.025});
  EXPECT_EQ(4u, message.id);
  EXPECT_EQ(4711, message.pid);
  EXPECT_EQ(12, message.priority);
  EXPECT_EQ("camera", message.name);
  EXPECT_EQ("cpu0", message.unit);
  EXPECT_EQ(0.033, message.period_s);
  EXPECT_EQ(0.02, message.deadline_s);
  EXPECT_EQ(0.01, message.wcet_s);
  EXPECT_EQ(100u, message.jobs);
  EXPECT_EQ(3u, message.missed);
  EXPECT_EQ(0.011, message.p50_s);
  EXPECT_EQ(0.019, message.p99_s);
  EXPECT_EQ(0.025, message.max_s);
}

TEST(Conversions, OfStreamRequestsNameTheNegativeDuration)
{
  AdmitStream::Request message;
  message.name = "camera";
  message.size = 480.0;
  message.period = ros::Duration(0.033);
  message.wcet = ros::Duration(0.002);
  const StreamRequest request = fromMsg(message, nullptr);
  EXPECT_EQ("camera", request.name);
  EXPECT_EQ(480.0, request.size);
  EXPECT_EQ(33000000, request.period.count());
  EXPECT_EQ(0, request.deadline.count());
  EXPECT_EQ(2000000, request.wcet.count());
  message.size = 0.0;
  EXPECT_EQ(1.0, fromMsg(message, nullptr).size);
  message.wcet = ros::Duration(-1);
  EXPECT_NE(std::string::npos, refusal([&] { fromMsg(message, nullptr); }).find("wcet = -1"));
}

TEST(Conversions, OfStatisticsKeepEveryField)
{
  const Statistics message = toMsg(RuntimeStatistics{1, 2, 3, 4, 5, 6, {7, 0.25, 0.5}});
  EXPECT_EQ(1u, message.submitted);
  EXPECT_EQ(2u, message.ended_ok);
  EXPECT_EQ(3u, message.cancelled);
  EXPECT_EQ(4u, message.refused);
  EXPECT_EQ(5u, message.failed);
  EXPECT_EQ(6u, message.missed_deadlines);
  EXPECT_EQ(7u, message.predictions);
  EXPECT_EQ(0.25, message.prediction_error_p50);
  EXPECT_EQ(0.5, message.prediction_error_p95);
}

}  // namespace
}  // namespace pi_runtime
