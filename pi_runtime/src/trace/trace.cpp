#include <pi_node/durations.h>
#include <pi_runtime/trace.h>

#include <unistd.h>

#include <algorithm>
#include <cinttypes>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <ostream>
#include <stdexcept>

namespace pi_runtime
{
namespace
{

constexpr const char* OUTCOMES[] = {"ok", "failed", "cancelled"};
constexpr std::string_view OTHER = "(other)";

/// A JSON string. Bytes that are no UTF-8 become U+FFFD.
std::string jsonString(std::string_view text)
{
  using Json = nlohmann::json;
  return Json(text).dump(-1, ' ', false, Json::error_handler_t::replace);
}

/// Nanoseconds as the microseconds of the format, without loss.
std::string microseconds(int64_t time_ns)
{
  char text[32];
  const char* const sign = time_ns < 0 ? "-" : "";
  const uint64_t magnitude = time_ns < 0 ? 0 - static_cast<uint64_t>(time_ns) : static_cast<uint64_t>(time_ns);
  std::snprintf(text, sizeof text, "%s%" PRIu64 ".%03" PRIu64, sign, magnitude / 1000, magnitude % 1000);
  return text;
}

/// A finite double as JSON, exactly; others, which JSON does not know, as 0.
std::string number(double value)
{
  char text[32];
  std::snprintf(text, sizeof text, "%.17g", std::isfinite(value) ? value : 0.0);
  return text;
}

/// Collects the events and writes the commas between them.
class EventWriter
{
public:
  explicit EventWriter(std::ostream& stream) : stream_(stream) {}

  /// @param phase  the "ph" of the format. @param rest  further members, each with a comma in front.
  void write(const char* phase, std::string_view name, const std::string& rest)
  {
    stream_ << (first_ ? "\n" : ",\n") << R"({"ph":")" << phase << R"(","pid":)" << pid_ << R"(,"name":)"
            << jsonString(name) << rest << "}";
    first_ = false;
  }

private:
  std::ostream& stream_;
  const int pid_ = getpid();
  bool first_ = true;
};

std::string thread(uint32_t unit)
{
  return ",\"tid\":" + std::to_string(uint64_t{unit} + 1);
}

std::string at(int64_t time_ns)
{
  return ",\"ts\":" + microseconds(time_ns);
}

std::string lasting(int64_t duration_ns)
{
  return ",\"dur\":" + microseconds(std::max<int64_t>(duration_ns, 0));
}

std::string arguments(const TaskTrace& record)
{
  const char* const deadline = record.deadline_ns == 0 ? "none" : record.missedDeadline() ? "missed" : "met";
  std::string text = ",\"args\":{\"task\":" + std::to_string(record.task);
  text += ",\"codelet\":" + jsonString(record.codelet) + ",\"implementation\":" + jsonString(record.implementation);
  text += ",\"unit\":" + std::to_string(record.unit);
  text += ",\"slice\":" + std::to_string(record.slice) + ",\"slices\":" + std::to_string(record.slices);
  text += ",\"submitted_ns\":" + std::to_string(record.submitted_ns);
  text += ",\"queued_ns\":" + std::to_string(record.queued_ns);
  text += ",\"started_ns\":" + std::to_string(record.started_ns);
  text += ",\"transfer_ns\":" + std::to_string(record.transfer_ns);
  text += ",\"finished_ns\":" + std::to_string(record.finished_ns);
  text += ",\"deadline_ns\":" + std::to_string(record.deadline_ns);
  text += std::string(",\"deadline\":\"") + deadline + "\",\"outcome\":\"";
  text += OUTCOMES[static_cast<size_t>(record.outcome)];
  text += std::string("\",\"stolen\":") + (record.stolen ? "true" : "false");
  text += ",\"predicted_s\":" + number(record.predicted_s);
  text += ",\"real_s\":" + number(record.ran() ? pi_node::seconds(record.finished_ns - record.started_ns) : 0);
  return text + "}";
}

void writeRecord(EventWriter& writer, const TaskTrace& record)
{
  if (!record.ran())
  {
    writer.write("i", record.codelet,
                 R"(,"cat":"run","s":"t")" + thread(record.unit) + at(record.finished_ns) + arguments(record));
    return;
  }
  const int64_t taken_ns = record.started_ns - record.transfer_ns;
  const std::string wait = ",\"cat\":\"queue\",\"id\":\"" + std::to_string(record.task) + "." +
                           std::to_string(record.slice) + "\"" + thread(record.unit);
  writer.write("b", record.codelet, wait + at(std::min(record.queued_ns, taken_ns)));
  writer.write("e", record.codelet, wait + at(taken_ns));
  if (record.transfer_ns > 0)
  {
    writer.write("X", "transfer for " + std::string(record.codelet),
                 R"(,"cat":"transfer")" + thread(record.unit) + at(taken_ns) + lasting(record.transfer_ns));
  }
  writer.write("X", record.codelet,
               R"(,"cat":"run")" + thread(record.unit) + at(record.started_ns) +
                   lasting(record.finished_ns - record.started_ns) + arguments(record));
}

}  // namespace

TraceRecorder::TraceRecorder(size_t capacity) : capacity_(capacity)
{
  if (capacity == 0)
  {
    throw std::invalid_argument("the capacity of a trace recorder is 0, must be at least 1");
  }
  ring_.reserve(capacity);
}

void TraceRecorder::keep(const TaskTrace& record)
{
  const std::lock_guard<std::mutex> lock(mutex_);
  TaskTrace kept = record;
  kept.codelet = intern(record.codelet);
  kept.implementation = intern(record.implementation);
  if (ring_.size() < capacity_)
  {
    ring_.push_back(kept);
  }
  else
  {
    ring_[next_] = kept;
    next_ = (next_ + 1) % capacity_;
    ++dropped_;
  }
}

std::string_view TraceRecorder::intern(std::string_view name)
{
  const auto found = names_.find(name);
  if (found != names_.end())
  {
    return *found;
  }
  return names_.size() < MAX_NAMES ? std::string_view(*names_.emplace(name).first) : OTHER;
}

std::vector<TaskTrace> TraceRecorder::snapshot() const
{
  const std::lock_guard<std::mutex> lock(mutex_);
  std::vector<TaskTrace> records = ring_;
  std::rotate(records.begin(), records.begin() + static_cast<std::ptrdiff_t>(next_), records.end());
  return records;
}

uint64_t TraceRecorder::dropped() const
{
  const std::lock_guard<std::mutex> lock(mutex_);
  return dropped_;
}

void TraceRecorder::keepAtLeast(size_t capacity)
{
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (capacity > capacity_)
    {
      std::rotate(ring_.begin(), ring_.begin() + static_cast<std::ptrdiff_t>(next_), ring_.end());
      next_ = 0;
      ring_.reserve(capacity);
      capacity_ = capacity;
    }
  }
  setEnabled(true);
}

void writeChromeTrace(std::ostream& stream, const std::vector<TaskTrace>& records,
                      const std::vector<std::string>& units, const std::string& process)
{
  stream << R"({"displayTimeUnit":"ms","traceEvents":[)";
  EventWriter writer(stream);
  writer.write("M", "process_name", ",\"args\":{\"name\":" + jsonString(process) + "}");
  size_t count = units.size();
  for (const TaskTrace& record : records)
  {
    count = std::max<size_t>(count, size_t{record.unit} + 1);
  }
  for (uint32_t unit = 0; unit < count; ++unit)
  {
    const std::string name = unit < units.size() ? units[unit] : "unit " + std::to_string(unit);
    writer.write("M", "thread_name", thread(unit) + ",\"args\":{\"name\":" + jsonString(name) + "}");
    writer.write("M", "thread_sort_index", thread(unit) + ",\"args\":{\"sort_index\":" + std::to_string(unit) + "}");
  }
  for (const TaskTrace& record : records)
  {
    writeRecord(writer, record);
  }
  stream << "\n]}\n";
}

}  // namespace pi_runtime
