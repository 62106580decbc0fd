#include "trace/gantt_scene.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <map>
#include <stdexcept>
#include <utility>

namespace pi_runtime
{
namespace
{

int64_t shifted(int64_t origin_ns, double offset_s)
{
  constexpr double FARTHEST_S = 4e9;  // beyond any trace, and far from overflow
  return origin_ns + static_cast<int64_t>(std::clamp(offset_s, -FARTHEST_S, FARTHEST_S) * 1e9);
}

std::vector<std::string_view> busiestFirst(const std::vector<TaskTrace>& tasks)
{
  std::map<std::string_view, int64_t> busy_ns;
  for (const TaskTrace& task : tasks)
  {
    busy_ns[task.codelet] += task.finished_ns - task.started_ns;
  }
  std::vector<std::string_view> order;
  for (const auto& entry : busy_ns)
  {
    order.push_back(entry.first);
  }
  std::stable_sort(order.begin(), order.end(),
                   [&busy_ns](std::string_view a, std::string_view b) { return busy_ns[a] > busy_ns[b]; });
  return order;
}

}  // namespace

void GanttOptions::validate() const
{
  if (!(from_s >= 0) || std::isinf(from_s))
  {
    throw std::invalid_argument("from_s = " + formatted("%g", from_s) + ", must be at least 0 and finite");
  }
  if (!(to_s > from_s))
  {
    throw std::invalid_argument("to_s = " + formatted("%g", to_s) +
                                ", must be greater than from_s = " + formatted("%g", from_s));
  }
  if (width < 600 || width > 20000)
  {
    throw std::invalid_argument("width = " + std::to_string(width) + ", must be in [600, 20000]");
  }
}

GanttScene arrangeGantt(const std::vector<TaskTrace>& records, size_t named_units, const GanttOptions& options)
{
  options.validate();
  GanttScene scene;
  scene.units = named_units;
  int64_t first_ns = std::numeric_limits<int64_t>::max();
  int64_t last_ns = std::numeric_limits<int64_t>::min();
  for (const TaskTrace& record : records)
  {
    scene.units = std::max<size_t>(scene.units, size_t{record.unit} + 1);
    if (!record.ran())
    {
      ++scene.never_ran;
      continue;
    }
    first_ns = std::min(first_ns, takenNs(record));
    last_ns = std::max(last_ns, record.finished_ns);
    scene.tasks.push_back(record);
  }
  if (scene.tasks.empty())
  {
    first_ns = last_ns = 0;
  }
  scene.origin_ns = first_ns;
  scene.from_ns = shifted(first_ns, options.from_s);
  scene.to_ns = std::isinf(options.to_s) ? std::max(last_ns, first_ns + 1000) : shifted(first_ns, options.to_s);
  if (scene.from_ns >= scene.to_ns)
  {
    throw std::invalid_argument("from_s = " + formatted("%g", options.from_s) +
                                " is not before the end of the picture, " +
                                formatted("%g", static_cast<double>(scene.to_ns - first_ns) * 1e-9) + "; choose less");
  }
  scene.codelets = busiestFirst(scene.tasks);
  const auto outside = [&scene](const TaskTrace& task)
  { return task.finished_ns < scene.from_ns || takenNs(task) >= scene.to_ns; };
  scene.tasks.erase(std::remove_if(scene.tasks.begin(), scene.tasks.end(), outside), scene.tasks.end());
  return scene;
}

std::vector<double> unitUtilisation(const std::vector<TaskTrace>& records, size_t units, int64_t from_ns, int64_t to_ns)
{
  using Span = std::pair<int64_t, int64_t>;
  std::vector<std::vector<Span>> spans(units);
  for (const TaskTrace& record : records)
  {
    spans.resize(std::max<size_t>(spans.size(), size_t{record.unit} + 1));
    const Span span(std::max(takenNs(record), from_ns), std::min(record.finished_ns, to_ns));
    if (record.ran() && span.first < span.second)
    {
      spans[record.unit].push_back(span);
    }
  }
  std::vector<double> busy;
  for (std::vector<Span>& unit : spans)
  {
    // Tasks may overlap on a unit that runs several at a time: what counts is their union.
    std::sort(unit.begin(), unit.end());
    int64_t covered_ns = 0;
    int64_t covered_to_ns = from_ns;
    for (const auto& [start_ns, end_ns] : unit)
    {
      covered_ns += std::max<int64_t>(end_ns - std::max(start_ns, covered_to_ns), 0);
      covered_to_ns = std::max(covered_to_ns, end_ns);
    }
    busy.push_back(to_ns > from_ns ? static_cast<double>(covered_ns) / static_cast<double>(to_ns - from_ns) : 0);
  }
  return busy;
}

double roundStep(double least)
{
  const double power = std::pow(10.0, std::floor(std::log10(least)));
  for (const double round : {1.0, 2.0, 5.0})
  {
    if (round * power >= least * (1 - 1e-9))
    {
      return round * power;
    }
  }
  return 10 * power;
}

TimeUnit timeUnitFor(double duration_s)
{
  for (const TimeUnit unit : {TimeUnit{"s", 1}, TimeUnit{"ms", 1e-3}, TimeUnit{"us", 1e-6}})
  {
    if (duration_s >= unit.seconds * (1 - 1e-9))
    {
      return unit;
    }
  }
  return {"ns", 1e-9};
}

std::string formatted(const char* format, double value)
{
  char text[64];
  std::snprintf(text, sizeof text, format, value);
  return text;
}

}  // namespace pi_runtime
