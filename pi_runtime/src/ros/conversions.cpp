#include "ros/conversions.h"

#include <stdexcept>
#include <utility>

namespace pi_runtime
{

// The outcomes of the message are those of the core.
static_assert(TaskReport::OK == static_cast<uint8_t>(Outcome::OK));
static_assert(TaskReport::CANCELLED == static_cast<uint8_t>(Outcome::CANCELLED));
static_assert(TaskReport::REFUSED == static_cast<uint8_t>(Outcome::REFUSED));
static_assert(TaskReport::BUILD_FAILED == static_cast<uint8_t>(Outcome::BUILD_FAILED));
static_assert(TaskReport::EXECUTION_FAILED == static_cast<uint8_t>(Outcome::EXECUTION_FAILED));
static_assert(TaskReport::UNIT_FAILED == static_cast<uint8_t>(Outcome::UNIT_FAILED));
static_assert(TaskReport::SHUT_DOWN == static_cast<uint8_t>(Outcome::SHUT_DOWN));

std::chrono::nanoseconds toNanoseconds(const ros::Duration& duration, const std::string& name)
{
  if (duration < ros::Duration(0))
  {
    throw std::invalid_argument(name + " = " + std::to_string(duration.toSec()) + " s, must be at least 0");
  }
  return std::chrono::nanoseconds(duration.toNSec());
}

Unit toMsg(const UnitStatus& status)
{
  Unit message;
  message.name = status.name;
  message.type = toString(status.type);
  message.executors = status.executors;
  message.device = status.device;
  message.memory = status.memory;
  message.preemptive = status.preemptive;
  message.scheduling = status.scheduling;
  message.cores.assign(status.cores.begin(), status.cores.end());
  message.compute_units = status.compute_units;
  message.fp16 = status.fp16;
  message.fp64 = status.fp64;
  message.bandwidth_bps = status.bandwidth_bps;
  message.active_power_w = status.active_power_w;
  message.idle_power_w = status.idle_power_w;
  message.failed = status.failed;
  message.failure = status.failure;
  message.queued = static_cast<uint32_t>(status.queued);
  message.running = static_cast<uint32_t>(status.running);
  message.load_s = status.load_s;
  message.blocking_budget_s = status.blocking_budget_s;
  message.tasks = status.tasks;
  message.failures = status.failures;
  message.stolen = status.stolen;
  message.deadline_tasks = status.deadline_tasks;
  message.missed_deadlines = status.missed_deadlines;
  message.busy_s = status.busy_s;
  message.utilisation = status.utilisation;
  return message;
}

CodeletInfo toMsg(const RegisteredCodelet& entry)
{
  CodeletInfo message;
  message.name = entry.codelet->name;
  message.description = entry.description;
  message.arguments = entry.arguments;
  message.native = !entry.codelet->native.empty();
  message.opencl = !entry.codelet->opencl.empty();
  message.sliceable = entry.codelet->sliceable;
  message.slice_granularity = entry.codelet->slice_granularity;
  return message;
}

Stream toMsg(const StreamStatus& status)
{
  Stream message;
  message.id = status.id;
  message.pid = status.pid;
  message.name = status.name;
  message.unit = status.unit;
  message.priority = static_cast<uint8_t>(status.priority);
  message.period_s = status.period_s;
  message.deadline_s = status.deadline_s;
  message.wcet_s = status.wcet_s;
  message.jobs = status.jobs;
  message.missed = status.missed;
  message.p50_s = status.p50_s;
  message.p99_s = status.p99_s;
  message.max_s = status.max_s;
  return message;
}

EtcEntry toMsg(const EtcTable::Entry& entry)
{
  EtcEntry message;
  message.codelet = entry.codelet;
  message.bucket = entry.bucket;
  message.column = entry.column;
  message.count = entry.cell.count;
  message.mean_s = entry.cell.mean_s;
  message.variance_s2 = entry.cell.variance_s2;
  return message;
}

EtcTable::Entry fromMsg(const EtcEntry& message)
{
  return {message.codelet, message.bucket, message.column, {message.count, message.mean_s, message.variance_s2}};
}

GraphRequest::Edge fromMsg(const GraphEdge& message)
{
  return {message.predecessor, message.successor, message.bytes};
}

SchedulerPolicy toMsg(const SchedulerOptions& options)
{
  SchedulerPolicy message;
  message.inter_core_policy = toString(options.inter_core.policy);
  message.diff_min_order = toString(options.inter_core.diff_min_order);
  message.seed = options.inter_core.seed;
  message.budget_us = options.inter_core.budget.count();
  message.kicks = options.inter_core.kicks;
  message.alpha = options.inter_core.alpha;
  message.gamma = options.inter_core.gamma;
  message.inner_core_policy = toString(options.inner_core.policy);
  message.insertion = options.inner_core.insertion;
  message.level_mapping = toString(options.inner_core.level_mapping);
  message.level_barrier = options.inner_core.level_barrier;
  return message;
}

SchedulerOptions fromMsg(const SchedulerPolicy& message)
{
  SchedulerOptions options;
  options.inter_core.policy = parseInterCorePolicy(message.inter_core_policy);
  options.inter_core.diff_min_order = parseDiffMinOrder(message.diff_min_order);
  options.inter_core.seed = message.seed;
  options.inter_core.budget = std::chrono::microseconds(message.budget_us);
  options.inter_core.kicks = message.kicks;
  options.inter_core.alpha = message.alpha;
  options.inter_core.gamma = message.gamma;
  options.inter_core.validate();
  options.inner_core.policy = parseInnerCorePolicy(message.inner_core_policy);
  options.inner_core.insertion = message.insertion;
  options.inner_core.level_mapping = parseLevelMapping(message.level_mapping);
  options.inner_core.level_barrier = message.level_barrier;
  return options;
}

TaskReport toMsg(const TaskResult& result)
{
  TaskReport message;
  message.outcome = static_cast<uint8_t>(result.outcome);
  message.message = result.message;
  message.opencl_code = result.opencl_code;
  message.unit = result.unit;
  message.executor = result.executor;
  message.submitted_ns = result.submitted_ns;
  message.started_ns = result.started_ns;
  message.finished_ns = result.finished_ns;
  message.deadline_ns = result.deadline_ns;
  message.transfer_ns = result.transfer_ns;
  message.predicted_s = result.predicted_s;
  message.slices = result.slices;
  message.stolen = result.stolen;
  message.deadline_missed = result.missedDeadline();
  return message;
}

Statistics toMsg(const RuntimeStatistics& statistics)
{
  Statistics message;
  message.submitted = statistics.submitted;
  message.ended_ok = statistics.ended_ok;
  message.cancelled = statistics.cancelled;
  message.refused = statistics.refused;
  message.failed = statistics.failed;
  message.missed_deadlines = statistics.missed_deadlines;
  message.predictions = statistics.prediction_error.count;
  message.prediction_error_p50 = statistics.prediction_error.p50;
  message.prediction_error_p95 = statistics.prediction_error.p95;
  return message;
}

StreamRequest fromMsg(const AdmitStream::Request& message, CodeletPtr codelet)
{
  StreamRequest request;
  request.name = message.name;
  request.codelet = std::move(codelet);
  request.size = message.size != 0.0 ? message.size : 1.0;
  request.period = toNanoseconds(message.period, "period");
  request.deadline = toNanoseconds(message.deadline, "deadline");
  request.wcet = toNanoseconds(message.wcet, "wcet");
  return request;
}

}  // namespace pi_runtime
