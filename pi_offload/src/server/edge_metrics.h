#pragma once

#include <prometheus/histogram.h>

#include <array>
#include <string>

#include "server/edge_server.h"

namespace pi_offload
{

/// Durations of tasks of one kind, in buckets. Thread safe.
struct TaskDurations
{
  TaskDurations();
  prometheus::Histogram waiting;  ///< from the arrival of a task until a worker takes it [s]
  prometheus::Histogram service;  ///< on the worker [s]
};

/// Text format 0.0.4 of Prometheus.
std::string prometheusText(const EdgeServer::Statistics& statistics, const EdgeServer::Health& health,
                           const std::array<TaskDurations, TASK_KINDS>& durations);

}  // namespace pi_offload
