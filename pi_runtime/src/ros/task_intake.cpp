#include "ros/conversions.h"
#include "ros/task_intake.h"

#include <boost/make_shared.hpp>
#include <cstring>
#include <stdexcept>

namespace pi_runtime
{
namespace
{

/// The memory of one message's arguments.
class ArgumentIntake
{
public:
  ArgumentIntake(const TaskConstPtr& task, KeptBuffers::Draft* buffers, TaskIntake* intake)
    : owner_(task.get(), [task](const void*) {}), buffers_(buffers), intake_(intake)
  {
  }

  Argument take(const TaskArgument& argument)
  {
    switch (argument.kind)
    {
      case TaskArgument::IN:
        return Argument::in(argument.buffer.empty() ? wrap(argument) : keptContent(argument));
      case TaskArgument::OUT:
        return Argument::out(argument.buffer.empty() ? output(argument, argument.bytes) : keptRoom(argument));
      case TaskArgument::IN_OUT:
        return Argument::inOut(argument.buffer.empty() ? copy(argument) : kept(argument));
      case TaskArgument::VALUE:
        return value(argument);
      default:
        throw std::invalid_argument("kind = " + std::to_string(argument.kind) +
                                    ", must be IN (0), OUT (1), IN_OUT (2) or VALUE (3)");
    }
  }

private:
  static void requireData(const TaskArgument& argument)
  {
    if (argument.data.empty())
    {
      throw std::invalid_argument("has no data; give data, or the name of a kept buffer");
    }
  }

  BufferPtr wrap(const TaskArgument& argument)
  {
    requireData(argument);
    return Buffer::wrap(static_cast<const void*>(argument.data.data()), argument.data.size(), owner_);
  }

  /// Memory in the report, which the task then writes without anybody copying.
  BufferPtr output(const TaskArgument& argument, size_t bytes)
  {
    if (bytes == 0 || (argument.kind == TaskArgument::OUT && !argument.data.empty()))
    {
      throw std::invalid_argument("must have bytes, how many it is to get, and no data");
    }
    TaskArgument& output = addOutput(argument);
    output.data.resize(bytes);
    const TaskReportPtr report = intake_->report;
    intake_->outputs.back() = Buffer::wrap(static_cast<void*>(output.data.data()), bytes,
                                           std::shared_ptr<const void>(report.get(), [report](const void*) {}));
    return intake_->outputs.back();
  }

  BufferPtr copy(const TaskArgument& argument)
  {
    requireData(argument);
    const BufferPtr buffer = output(argument, argument.data.size());
    std::memcpy(buffer->address(), argument.data.data(), argument.data.size());
    return buffer;
  }

  BufferPtr kept(const TaskArgument& argument)
  {
    addOutput(argument);
    return keptContent(argument);
  }

  BufferPtr keptContent(const TaskArgument& argument)
  {
    BufferPtr buffer;
    if (argument.data.empty())
    {
      buffer = buffers_->find(argument.buffer);
      if (!buffer)
      {
        throw std::invalid_argument("there is no kept buffer \"" + argument.buffer +
                                    "\"; give data, or submit the task that makes it first");
      }
    }
    else
    {
      buffer = buffers_->make(argument.buffer, argument.data.size());
      std::memcpy(buffer->address(), argument.data.data(), argument.data.size());
    }
    return buffer;
  }

  BufferPtr keptRoom(const TaskArgument& argument)
  {
    addOutput(argument);
    const BufferPtr buffer = buffers_->find(argument.buffer);
    if (buffer && (argument.bytes == 0 || argument.bytes == buffer->bytes()))
    {
      return buffer;
    }
    return buffers_->make(argument.buffer, argument.bytes);
  }

  static Argument value(const TaskArgument& argument)
  {
    if (!argument.buffer.empty())
    {
      throw std::invalid_argument("is a value and cannot be kept as buffer \"" + argument.buffer + "\"");
    }
    return Argument::bytes(argument.data.data(), argument.data.size());
  }

  TaskArgument& addOutput(const TaskArgument& argument)
  {
    TaskArgument& output = intake_->report->outputs.emplace_back();
    output.kind = argument.kind;
    output.buffer = argument.buffer;
    intake_->outputs.push_back(nullptr);
    return output;
  }

  const std::shared_ptr<const void> owner_;
  KeptBuffers::Draft* const buffers_;
  TaskIntake* const intake_;
};

void takeShares(const Task& task, const TakeMemory& take_memory, TaskIntake* intake)
{
  size_t inputs = 0;
  size_t outputs = 0;
  for (const TaskArgument& argument : task.arguments)
  {
    inputs += argument.data.size();
    if (argument.buffer.empty())
    {
      outputs += argument.kind == TaskArgument::OUT      ? argument.bytes
                 : argument.kind == TaskArgument::IN_OUT ? argument.data.size()
                                                         : 0;
    }
  }
  intake->input_memory = take_memory(inputs);
  intake->output_memory = take_memory(outputs);
}

CodeletPtr findCodelet(const std::string& name, const CodeletRegistry& codelets)
{
  CodeletPtr codelet = codelets.find(name);
  if (codelet)
  {
    return codelet;
  }
  std::string known;
  for (const RegisteredCodelet& entry : codelets.list())
  {
    known += (known.empty() ? "" : ", ") + entry.codelet->name;
  }
  throw std::invalid_argument("there is no codelet \"" + name + "\", there are " + known);
}

}  // namespace

TaskIntake takeIn(const TaskConstPtr& task, const CodeletRegistry& codelets, KeptBuffers::Draft* buffers,
                  const TakeMemory& take_memory)
{
  TaskIntake intake;
  intake.request.codelet = findCodelet(task->codelet, codelets);
  intake.request.range = task->range != 0 ? task->range : 1;
  intake.request.size = task->size;
  intake.request.priority = task->priority;
  intake.request.stream = task->stream;
  intake.request.unit = task->unit;
  if (!task->deadline.isZero())
  {
    intake.request.deadline = toNanoseconds(task->deadline, "deadline");
  }
  takeShares(*task, take_memory, &intake);
  intake.report = boost::make_shared<TaskReport>();
  intake.report->client_key = task->client_key;
  ArgumentIntake arguments(task, buffers, &intake);
  for (size_t i = 0; i < task->arguments.size(); ++i)
  {
    try
    {
      intake.request.arguments.push_back(arguments.take(task->arguments[i]));
    }
    catch (const std::invalid_argument& error)
    {
      throw std::invalid_argument(task->codelet + ": argument " + std::to_string(i) + " " + error.what());
    }
  }
  return intake;
}

}  // namespace pi_runtime
