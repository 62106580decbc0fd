// config/runtime.yaml and the defaults in the code must be the same, and impossible values must be named.

#include <gtest/gtest.h>
#include <pi_node/test_support/options_reader.h>
#include "ros/runtime_ros_options.h"

#include <map>
#include <string>
#include <vector>

namespace pi_runtime
{
namespace
{

using namespace pi_node::test_support;
using XmlRpc::XmlRpcValue;

/// The parameters of a tree by their names, as text.
std::map<std::string, std::string> texts(XmlRpcValue tree, const std::string& path = "")
{
  std::map<std::string, std::string> result;
  for (auto& [name, value] : tree)
  {
    if (value.getType() == XmlRpcValue::TypeStruct)
    {
      result.merge(texts(value, path + name + "/"));
    }
    else
    {
      result[path + name] = value.toXml();
    }
  }
  return result;
}

const OptionsReader<RuntimeRosOptions> reader("/runtime/");

TEST(RuntimeRosOptions, AreThoseOfTheConfiguration)
{
  const XmlRpcValue file = fromYaml(YAML::LoadFile(RUNTIME_YAML));
  EXPECT_EQ(texts(RuntimeRosOptions().toParameters()), texts(file));
  Names unknown;
  const RuntimeRosOptions loaded = RuntimeRosOptions::fromParameters(file, "/runtime/", &unknown);
  EXPECT_EQ(texts(RuntimeRosOptions().toParameters()), texts(loaded.toParameters()));
  EXPECT_EQ(RuntimeOptions::defaultCacheFolder(), loaded.runtime.cache_folder);
  EXPECT_TRUE(unknown.empty());
}

TEST(RuntimeRosOptions, AreTheDefaultsWithoutParameters)
{
  Names unknown;
  const RuntimeRosOptions loaded = RuntimeRosOptions::fromParameters(XmlRpcValue(), "/runtime/", &unknown);
  EXPECT_EQ(texts(RuntimeRosOptions().toParameters()), texts(loaded.toParameters()));
}

TEST(RuntimeRosOptions, TakeEveryKindOfParameter)
{
  const RuntimeRosOptions options = reader.load(R"(
cpu_units: [1, 3]
native: false
cpu_memory: separate
inter_core: {policy: diff_min, diff_min_order: min, gamma: 2}
inner_core: {policy: levels, level_mapping: rank, level_barrier: false}
queue_order: fifo
slice: 250
hang_timeout: 3
etc_file: /tmp/etc.csv
cache_folder: ""
trace_capacity: 1000
report_keep_s: 0.5
tuning: [{unit: cpu0, slowdown: 2, active_power_w: 3.5}, {unit: cpu1, idle_power_w: 1.5}]
)");
  EXPECT_EQ((std::vector<unsigned>{1, 3}), options.runtime.cpu_units);
  EXPECT_FALSE(options.runtime.native);
  EXPECT_EQ(MemoryModel::SEPARATE, options.runtime.cpu_memory);
  EXPECT_EQ(InterCorePolicy::DIFF_MIN, options.runtime.inter_core.policy);
  EXPECT_EQ(DiffMinOrder::MIN_DIV, options.runtime.inter_core.diff_min_order);
  EXPECT_EQ(2.0, options.runtime.inter_core.gamma);
  EXPECT_EQ(InnerCorePolicy::LEVELS, options.runtime.inner_core.policy);
  EXPECT_EQ(LevelMapping::RANK, options.runtime.inner_core.level_mapping);
  EXPECT_FALSE(options.runtime.inner_core.level_barrier);
  EXPECT_EQ(QueueOrder::FIFO, options.runtime.queue_order);
  EXPECT_EQ(std::chrono::microseconds(250), options.runtime.slice);
  EXPECT_EQ(std::chrono::milliseconds(3), options.runtime.hang_timeout);
  EXPECT_EQ("/tmp/etc.csv", options.runtime.etc_file);
  EXPECT_EQ("", options.runtime.cache_folder);
  EXPECT_EQ(1000u, options.runtime.trace_capacity);
  EXPECT_EQ(0.5, options.report_keep_s);
  ASSERT_EQ(2u, options.runtime.tuning.size());
  EXPECT_EQ("cpu0", options.runtime.tuning[0].unit);
  EXPECT_EQ(2.0, options.runtime.tuning[0].slowdown);
  EXPECT_EQ(3.5, options.runtime.tuning[0].active_power_w);
  EXPECT_EQ(1.5, options.runtime.tuning[1].idle_power_w);
}

TEST(RuntimeRosOptions, NameParametersThatMeanNothing)
{
  Names unknown;
  reader.load("{slise: 5, inter_core: {polizy: mct}, stealing: false}", &unknown);
  EXPECT_EQ((Names{"/runtime/inter_core/polizy", "/runtime/slise"}), unknown);
}

TEST(RuntimeRosOptions, NameParameterValueAndBoundOfWhatIsImpossible)
{
  EXPECT_EQ("parameter /runtime/max_tasks = 0, must be at least 1", reader.refusal("max_tasks: 0"));
  EXPECT_EQ("parameter /runtime/max_task_memory_mb = -1, must be at least 1", reader.refusal("max_task_memory_mb: -1"));
  EXPECT_EQ("parameter /runtime/max_kept_buffer_mb = -1, must be at least 0", reader.refusal("max_kept_buffer_mb: -1"));
  EXPECT_EQ("parameter /runtime/max_kept_reports = 0, must be at least 1", reader.refusal("max_kept_reports: 0"));
  EXPECT_EQ("parameter /runtime/report_keep_s = 0, must be in (0, 1e6]", reader.refusal("report_keep_s: 0.0"));
  EXPECT_EQ("parameter /runtime/max_waiting_calls = 257, must be in [0, 256]",
            reader.refusal("max_waiting_calls: 257"));
  EXPECT_EQ("parameter /runtime/diagnostic_period = 0, must be in (0, 1e6]", reader.refusal("diagnostic_period: 0"));
  EXPECT_EQ("parameter /runtime/slice = 0 us, must be above 0", reader.refusal("slice: 0"));
  EXPECT_EQ("parameter /runtime/trace_capacity = -1, must be at least 0", reader.refusal("trace_capacity: -1"));
  EXPECT_EQ("parameter /runtime/inter_core/alpha = 0, must be finite and > 0",
            reader.refusal("inter_core: {alpha: 0.0}"));
  EXPECT_EQ("parameter /runtime/cpu_units: a unit of 0 cores, must be at least 1", reader.refusal("cpu_units: [1, 0]"));
}

TEST(RuntimeRosOptions, NameParametersOfTheWrongType)
{
  EXPECT_EQ("parameter /runtime/native = 1, must be true or false", reader.refusal("native: 1"));
  EXPECT_EQ("parameter /runtime/slice = fast, must be a whole number", reader.refusal("slice: fast"));
  EXPECT_EQ("parameter /runtime/report_keep_s = long, must be a number", reader.refusal("report_keep_s: long"));
  EXPECT_EQ("parameter /runtime/etc_file = 5, must be a text", reader.refusal("etc_file: 5"));
  EXPECT_EQ("parameter /runtime/cpu_units = 2, must be a list", reader.refusal("cpu_units: 2"));
}

TEST(RuntimeRosOptions, ListTheNamesThatAreKnown)
{
  EXPECT_EQ("parameter /runtime/cpu_memory = \"fast\", must be direct, mapped or separate",
            reader.refusal("cpu_memory: fast"));
  EXPECT_NE(std::string::npos, reader.refusal("inter_core: {policy: best}").find("/runtime/inter_core/policy: "));
  EXPECT_NE(std::string::npos, reader.refusal("inter_core: {policy: best}").find("diff_min"));
}

TEST(RuntimeRosOptions, RefuseTuningOfNoUnitOrOfAnUnknownKind)
{
  EXPECT_NE(std::string::npos,
            reader.refusal("tuning: [{slowdown: 2.0}]").find("/runtime/tuning has an entry without a unit"));
  EXPECT_NE(std::string::npos, reader.refusal("tuning: [{unit: cpu0, speed: 2.0}]").find("\"speed\""));
  EXPECT_NE(std::string::npos, reader.refusal("tuning: [{unit: cpu0, slowdown: 0.5}]").find("slowdown = 0.5"));
}

}  // namespace
}  // namespace pi_runtime
