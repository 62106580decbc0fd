#include <pi_node/ros/parameter_values.h>
#include "ros/runtime_ros_options.h"

#include <map>
#include <set>
#include <stdexcept>
#include <type_traits>

namespace pi_runtime
{
namespace
{

using pi_node::parameters::flatten;
using pi_node::parameters::read;
using pi_node::parameters::require;
using pi_node::parameters::requireType;
using pi_node::parameters::text;
using pi_node::parameters::write;
using XmlRpc::XmlRpcValue;

/// What stands for RuntimeOptions::defaultCacheFolder(), which depends on the user.
constexpr char DEFAULT_FOLDER[] = "default";
constexpr double MAX_DURATION_S = 1e6;

/// Every parameter, by the path of its name, with its field.
template <typename Options, typename Visitor>
void visitFields(Options& options, Visitor&& visit)
{
  auto& runtime = options.runtime;
  visit("cpu_units", runtime.cpu_units);
  visit("native", runtime.native);
  visit("opencl_cpu", runtime.opencl_cpu);
  visit("opencl_gpu", runtime.opencl_gpu);
  visit("cpu_memory", runtime.cpu_memory);
  visit("pin_threads", runtime.pin_threads);
  visit("thread_priority", runtime.thread_priority);
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

template <typename Period>
void read(const XmlRpcValue& value, std::chrono::duration<int64_t, Period>* field)
{
  int number = 0;
  read(value, &number);
  *field = std::chrono::duration<int64_t, Period>(number);
}

template <typename Enum>
void readName(const XmlRpcValue& value, Enum* field, Enum (*parse)(const std::string&))
{
  std::string name;
  read(value, &name);
  try
  {
    *field = parse(name);
  }
  catch (const std::invalid_argument& error)
  {
    throw std::invalid_argument(std::string(": ") + error.what());
  }
}

MemoryModel parseMemoryModel(const std::string& name)
{
  for (const MemoryModel model : {MemoryModel::DIRECT, MemoryModel::MAPPED, MemoryModel::SEPARATE})
  {
    if (name == toString(model))
    {
      return model;
    }
  }
  throw std::invalid_argument("memory \"" + name + "\" is unknown, must be direct, mapped or separate");
}

void read(const XmlRpcValue& value, MemoryModel* field)
{
  readName(value, field, parseMemoryModel);
}
void read(const XmlRpcValue& value, InterCorePolicy* field)
{
  readName(value, field, parseInterCorePolicy);
}
void read(const XmlRpcValue& value, DiffMinOrder* field)
{
  readName(value, field, parseDiffMinOrder);
}
void read(const XmlRpcValue& value, InnerCorePolicy* field)
{
  readName(value, field, parseInnerCorePolicy);
}
void read(const XmlRpcValue& value, LevelMapping* field)
{
  readName(value, field, parseLevelMapping);
}
void read(const XmlRpcValue& value, QueueOrder* field)
{
  readName(value, field, parseQueueOrder);
}

/// @return the members of a struct with these names, and no others.
std::map<std::string, XmlRpcValue> members(XmlRpcValue value, const std::set<std::string>& names)
{
  requireType(value, XmlRpcValue::TypeStruct, "a list of {unit, active_power_w, idle_power_w, slowdown}");
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

void read(const XmlRpcValue& value, UnitTuning* field)
{
  for (const auto& [name, member] : members(value, {"unit", "active_power_w", "idle_power_w", "slowdown"}))
  {
    if (name == "unit")
    {
      read(member, &field->unit);
    }
    else
    {
      read(member, name == "active_power_w" ? &field->active_power_w
                   : name == "idle_power_w" ? &field->idle_power_w
                                            : &field->slowdown);
    }
  }
  if (field->unit.empty())
  {
    throw std::invalid_argument("has an entry without a unit");
  }
}

template <typename Element>
void read(XmlRpcValue value, std::vector<Element>* field)
{
  requireType(value, XmlRpcValue::TypeArray, "a list");
  field->assign(static_cast<size_t>(value.size()), Element());
  for (int i = 0; i < value.size(); ++i)
  {
    read(value[i], &(*field)[static_cast<size_t>(i)]);
  }
}

template <typename Period>
XmlRpcValue write(const std::chrono::duration<int64_t, Period>& field)
{
  return XmlRpcValue(static_cast<int>(field.count()));
}
template <typename Enum, std::enable_if_t<std::is_enum<Enum>::value, int> = 0>
XmlRpcValue write(const Enum& field)
{
  return XmlRpcValue(toString(field));
}
XmlRpcValue write(const UnitTuning& field)
{
  XmlRpcValue value;
  value["unit"] = field.unit;
  value["active_power_w"] = field.active_power_w;
  value["idle_power_w"] = field.idle_power_w;
  value["slowdown"] = field.slowdown;
  return value;
}
template <typename Element>
XmlRpcValue write(const std::vector<Element>& field)
{
  XmlRpcValue value;
  value.setSize(static_cast<int>(field.size()));
  for (size_t i = 0; i < field.size(); ++i)
  {
    value[static_cast<int>(i)] = write(field[i]);
  }
  return value;
}

}  // namespace

void RuntimeRosOptions::validate() const
{
  try
  {
    runtime.inter_core.validate();
  }
  catch (const std::invalid_argument& error)
  {
    throw std::invalid_argument(std::string("inter_core/") + error.what());
  }
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

RuntimeRosOptions RuntimeRosOptions::load(const ros::NodeHandle& private_node, std::vector<std::string>* unknown)
{
  XmlRpcValue tree;
  const std::string& path = private_node.getNamespace();
  private_node.getParam(path, tree);
  return fromParameters(tree, path + "/", unknown);
}

RuntimeRosOptions RuntimeRosOptions::fromParameters(const XmlRpcValue& tree, const std::string& path,
                                                    std::vector<std::string>* unknown)
{
  RuntimeRosOptions options;
  std::map<std::string, XmlRpcValue> leaves;
  if (tree.getType() == XmlRpcValue::TypeStruct)
  {
    flatten(tree, "", &leaves);
  }
  const auto load = [&leaves, &path](const char* name, auto& field)
  {
    const auto leaf = leaves.find(name);
    if (leaf == leaves.end())
    {
      return;
    }
    try
    {
      read(leaf->second, &field);
    }
    catch (const std::invalid_argument& error)
    {
      const std::string problem = error.what();
      throw std::invalid_argument("parameter " + path + name + (problem[0] == ':' ? "" : " ") + problem);
    }
    leaves.erase(leaf);
  };
  visitFields(options, load);
  if (options.runtime.cache_folder == DEFAULT_FOLDER)
  {
    options.runtime.cache_folder = RuntimeOptions::defaultCacheFolder();
  }
  try
  {
    options.validate();
  }
  catch (const std::invalid_argument& error)
  {
    throw std::invalid_argument("parameter " + path + error.what());
  }
  for (const auto& [name, value] : leaves)
  {
    unknown->push_back(path + name);
  }
  return options;
}

XmlRpcValue RuntimeRosOptions::toParameters() const
{
  XmlRpcValue tree;
  visitFields(*this,
              [&tree](const std::string& name, const auto& field)
              {
                const size_t slash = name.find('/');
                XmlRpcValue& parameter =
                    slash == std::string::npos ? tree[name] : tree[name.substr(0, slash)][name.substr(slash + 1)];
                parameter = write(field);
              });
  if (runtime.cache_folder == RuntimeOptions::defaultCacheFolder())
  {
    tree["cache_folder"] = DEFAULT_FOLDER;
  }
  return tree;
}

std::string RuntimeRosOptions::toText() const
{
  return text(toParameters());
}

}  // namespace pi_runtime
