#include "ros/runtime_ros_options.h"

#include <pi_node/ros/parameter_tree.h>

#include <map>
#include <set>
#include <stdexcept>

namespace pi_runtime
{

using pi_node::parameters::require;
using XmlRpc::XmlRpcValue;

namespace
{

/// Stands for RuntimeOptions::defaultCacheFolder(), which depends on the user.
constexpr char DEFAULT_FOLDER[] = "default";
constexpr double MAX_DURATION_S = 1e6;

template <typename Enum>
void readName(const XmlRpcValue& value, Enum* field, Enum (*parse)(const std::string&))
{
  std::string name;
  pi_node::parameters::read(value, &name);
  try
  {
    *field = parse(name);
  }
  catch (const std::invalid_argument& error)
  {
    throw std::invalid_argument(std::string(": ") + error.what());
  }
}

/// @return the members of a struct with these names, and no others.
std::map<std::string, XmlRpcValue> members(XmlRpcValue value, const std::set<std::string>& names)
{
  pi_node::parameters::requireType(value, XmlRpcValue::TypeStruct,
                                   "a list of {unit, active_power_w, idle_power_w, slowdown}");
  std::map<std::string, XmlRpcValue> result;
  for (auto& [name, member] : value)
  {
    if (names.count(name) == 0)
    {
      throw std::invalid_argument("has an entry with \"" + name +
                                  "\"; known are unit, active_power_w, idle_power_w, slowdown");
    }
    result[name] = member;
  }
  return result;
}

}  // namespace

template <typename Visitor>
static void visitFields(RuntimeRosOptions& options, Visitor&& visit)
{
  auto& runtime = options.runtime;
  visit("cpu_units", runtime.cpu_units);
  visit("native", runtime.native);
  visit("opencl_cpu", runtime.opencl_cpu);
  visit("opencl_gpu", runtime.opencl_gpu);
  visit("cpu_memory", runtime.cpu_memory);
  visit("pin_threads", runtime.pin_threads);
  visit("preemption", runtime.preemption);
  visit("tuning", runtime.tuning);
  visit("inter_core/policy", runtime.inter_core.policy);
  visit("inter_core/diff_min_order", runtime.inter_core.diff_min_order);
  visit("inter_core/seed", runtime.inter_core.seed);
  visit("inter_core/budget", runtime.inter_core.budget);
  visit("inter_core/kicks", runtime.inter_core.kicks);
  visit("inter_core/alpha", runtime.inter_core.alpha);
  visit("inter_core/gamma", runtime.inter_core.gamma);
  visit("inner_core/policy", runtime.inner_core.policy);
  visit("inner_core/insertion", runtime.inner_core.insertion);
  visit("inner_core/level_mapping", runtime.inner_core.level_mapping);
  visit("inner_core/level_barrier", runtime.inner_core.level_barrier);
  visit("queue_order", runtime.queue_order);
  visit("stealing", runtime.stealing);
  visit("slice", runtime.slice);
  visit("pipeline", runtime.pipeline);
  visit("hang_timeout", runtime.hang_timeout);
  visit("arbitration", runtime.arbitration);
  visit("arbitration_folder", runtime.arbitration_folder);
  visit("etc_file", runtime.etc_file);
  visit("cache_folder", runtime.cache_folder);
  visit("trace_capacity", runtime.trace_capacity);
  visit("max_tasks", options.max_tasks);
  visit("max_task_memory_mb", options.max_task_memory_mb);
  visit("max_kept_buffer_mb", options.max_kept_buffer_mb);
  visit("max_kept_reports", options.max_kept_reports);
  visit("report_keep_s", options.report_keep_s);
  visit("max_waiting_calls", options.max_waiting_calls);
  visit("diagnostic_period", options.diagnostic_period);
}

static void read(const XmlRpcValue& value, MemoryModel* field)
{
  pi_node::parameters::readChoice(value, {MemoryModel::DIRECT, MemoryModel::MAPPED, MemoryModel::SEPARATE}, field);
}
static void read(const XmlRpcValue& value, InterCorePolicy* field)
{
  readName(value, field, parseInterCorePolicy);
}
static void read(const XmlRpcValue& value, DiffMinOrder* field)
{
  readName(value, field, parseDiffMinOrder);
}
static void read(const XmlRpcValue& value, InnerCorePolicy* field)
{
  readName(value, field, parseInnerCorePolicy);
}
static void read(const XmlRpcValue& value, LevelMapping* field)
{
  readName(value, field, parseLevelMapping);
}
static void read(const XmlRpcValue& value, QueueOrder* field)
{
  readName(value, field, parseQueueOrder);
}

static void read(const XmlRpcValue& value, UnitTuning* field)
{
  for (const auto& [name, member] : members(value, {"unit", "active_power_w", "idle_power_w", "slowdown"}))
  {
    if (name == "unit")
    {
      pi_node::parameters::read(member, &field->unit);
    }
    else
    {
      pi_node::parameters::read(member, name == "active_power_w" ? &field->active_power_w
                                        : name == "idle_power_w" ? &field->idle_power_w
                                                                 : &field->slowdown);
    }
  }
  if (field->unit.empty())
  {
    throw std::invalid_argument("has an entry without a unit");
  }
}

static XmlRpcValue write(const UnitTuning& field)
{
  XmlRpcValue value;
  value["unit"] = field.unit;
  value["active_power_w"] = field.active_power_w;
  value["idle_power_w"] = field.idle_power_w;
  value["slowdown"] = field.slowdown;
  return value;
}

void RuntimeRosOptions::validate() const
{
  pi_node::parameter_tree::validateGroup("inter_core", runtime.inter_core);
  runtime.validate();
  require(max_tasks >= 1, "max_tasks", max_tasks, "at least 1");
  require(max_task_memory_mb >= 1, "max_task_memory_mb", max_task_memory_mb, "at least 1");
  require(max_kept_buffer_mb >= 0, "max_kept_buffer_mb", max_kept_buffer_mb, "at least 0");
  require(max_kept_reports >= 1, "max_kept_reports", max_kept_reports, "at least 1");
  require(report_keep_s > 0.0 && report_keep_s <= MAX_DURATION_S, "report_keep_s", report_keep_s, "in (0, 1e6]");
  require(max_waiting_calls >= 0 && max_waiting_calls <= 256, "max_waiting_calls", max_waiting_calls, "in [0, 256]");
  require(diagnostic_period > 0.0 && diagnostic_period <= MAX_DURATION_S, "diagnostic_period", diagnostic_period,
          "in (0, 1e6]");
}

RuntimeRosOptions RuntimeRosOptions::fromParameters(const XmlRpcValue& tree, const std::string& path,
                                                    std::vector<std::string>* unknown)
{
  auto options = pi_node::parameter_tree::load<RuntimeRosOptions>(tree, path, unknown);
  if (options.runtime.cache_folder == DEFAULT_FOLDER)
  {
    options.runtime.cache_folder = RuntimeOptions::defaultCacheFolder();
  }
  return options;
}

XmlRpcValue RuntimeRosOptions::toParameters() const
{
  XmlRpcValue tree = pi_node::parameter_tree::save(*this);
  if (runtime.cache_folder == RuntimeOptions::defaultCacheFolder())
  {
    tree["cache_folder"] = DEFAULT_FOLDER;
  }
  return tree;
}

}  // namespace pi_runtime

template struct pi_node::NodeParameters<pi_runtime::RuntimeRosOptions>;
