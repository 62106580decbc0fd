#pragma once

#include <pi_runtime/Task.h>
#include <pi_runtime/TaskReport.h>
#include "core/codelet_registry.h"
#include "core/kept_buffers.h"
#include <pi_runtime/task.h>

#include <functional>
#include <memory>
#include <string>
#include <vector>

namespace pi_runtime
{

/// A message made ready to run, with the memory for what it makes.
struct TaskIntake
{
  TaskRequest request;
  /// Has the client's key and the outputs. Tasks write into the arrays of the outputs, which therefore stay in place
  /// and alive as long as the buffers of the request.
  TaskReportPtr report;
  std::vector<BufferPtr> outputs;             ///< per output of report; null if it is a kept buffer
  std::shared_ptr<const void> input_memory;   ///< shares of the budget: of what the message holds,
  std::shared_ptr<const void> output_memory;  ///< and of the outputs
};

/// Counts memory, see MemoryBudget::take(). @throws std::runtime_error if there is no room.
using TakeMemory = std::function<std::shared_ptr<const void>(size_t bytes)>;

/// Turns a message into a request. Bytes of IN arguments are used in place, and keep the message alive.
/// @param buffers  where kept buffers are found and made; the caller commits it once the task is submitted.
/// @throws std::invalid_argument naming codelet, argument, value and way out, or what takeMemory throws.
TaskIntake takeIn(const TaskConstPtr& task, const CodeletRegistry& codelets, KeptBuffers::Draft* buffers,
                  const TakeMemory& take_memory);

}  // namespace pi_runtime
