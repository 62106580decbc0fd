#pragma once

#include <pi_runtime/AdmitStream.h>
#include <pi_runtime/CodeletInfo.h>
#include <pi_runtime/EtcEntry.h>
#include <pi_runtime/GraphEdge.h>
#include <pi_runtime/SchedulerPolicy.h>
#include <pi_runtime/Statistics.h>
#include <pi_runtime/Stream.h>
#include <pi_runtime/TaskReport.h>
#include <pi_runtime/Unit.h>
#include <pi_runtime/runtime.h>
#include <ros/duration.h>
#include "core/codelet_registry.h"

#include <chrono>

namespace pi_runtime
{

/// @throws std::invalid_argument "<name> = <value> s, must be at least 0".
std::chrono::nanoseconds toNanoseconds(const ros::Duration& duration, const std::string& name);

Unit toMsg(const UnitStatus& status);
CodeletInfo toMsg(const RegisteredCodelet& entry);
Stream toMsg(const StreamStatus& status);

EtcEntry toMsg(const EtcTable::Entry& entry);
EtcTable::Entry fromMsg(const EtcEntry& message);

GraphRequest::Edge fromMsg(const GraphEdge& message);

/// Both layers of the scheduler.
struct SchedulerOptions
{
  InterCoreOptions inter_core;
  InnerCoreOptions inner_core;
};
SchedulerPolicy toMsg(const SchedulerOptions& options);
/// @throws std::invalid_argument naming the field that is impossible, or listing the valid names.
SchedulerOptions fromMsg(const SchedulerPolicy& message);

/// Client_key, id and outputs are left empty.
TaskReport toMsg(const TaskResult& result);

/// The figures of the node are left 0.
Statistics toMsg(const RuntimeStatistics& statistics);

/// @param codelet  the one that it names.
/// @throws std::invalid_argument naming the duration that is negative.
StreamRequest fromMsg(const AdmitStream::Request& message, CodeletPtr codelet);

}  // namespace pi_runtime
