#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "trace/gantt.h"

namespace pi_runtime
{

/// What a picture of a trace shows: the records that ran in its span of time.
struct GanttScene
{
  std::vector<TaskTrace> tasks;
  std::vector<std::string_view>
      codelets;          ///< of the whole trace, so that colours do not depend on the span; busiest first
  size_t never_ran = 0;  ///< records of the whole trace that never ran
  size_t units = 0;
  int64_t origin_ns = 0;  ///< start of the first task of the whole trace, its transfer included
  int64_t from_ns = 0;
  int64_t to_ns = 0;

  double durationS() const { return static_cast<double>(to_ns - from_ns) * 1e-9; }
};

/// @throws std::invalid_argument if `options` are invalid or leave no duration.
GanttScene arrangeGantt(const std::vector<TaskTrace>& records, size_t named_units, const GanttOptions& options);

/// Start of the transfer of a record, or of its run if there is none.
inline int64_t takenNs(const TaskTrace& record)
{
  return record.started_ns - (record.transfer_ns > 0 ? record.transfer_ns : 0);
}

/// The smallest of 1, 2 and 5 times a power of ten that is not below `least` (> 0).
double roundStep(double least);

struct TimeUnit
{
  const char* name;
  double seconds;
};
/// The largest of s, ms, us and ns that is not above a duration (> 0).
TimeUnit timeUnitFor(double duration_s);

/// A number as printf() writes it.
std::string formatted(const char* format, double value);

}  // namespace pi_runtime
