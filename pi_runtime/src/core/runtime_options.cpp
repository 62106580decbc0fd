#include <pi_runtime/runtime_options.h>

#include <cmath>
#include <cstdlib>
#include <stdexcept>

namespace pi_runtime
{

const char* toString(QueueOrder order)
{
  return order == QueueOrder::EDF ? "edf" : "fifo";
}

QueueOrder parseQueueOrder(const std::string& name)
{
  for (const QueueOrder order : {QueueOrder::EDF, QueueOrder::FIFO})
  {
    if (name == toString(order))
    {
      return order;
    }
  }
  throw std::invalid_argument("queue order \"" + name + "\" is unknown, must be edf or fifo");
}

RuntimeOptions RuntimeOptions::forService(bool opencl)
{
  RuntimeOptions options;
  options.opencl_cpu = opencl;
  options.opencl_gpu = opencl;
  return options;
}

std::string RuntimeOptions::defaultCacheFolder()
{
  const char* const cache = std::getenv("XDG_CACHE_HOME");
  if (cache != nullptr && cache[0] == '/')
  {
    return std::string(cache) + "/pi_runtime";
  }
  const char* const home = std::getenv("HOME");
  return home != nullptr && home[0] == '/' ? std::string(home) + "/.cache/pi_runtime" : std::string();
}

void RuntimeOptions::validate() const
{
  for (const unsigned cores : cpu_units)
  {
    if (cores == 0)
    {
      throw std::invalid_argument("cpu_units: a unit of 0 cores, must be at least 1");
    }
  }
  for (const UnitTuning& unit : tuning)
  {
    if (!(unit.slowdown >= 1.0 && unit.slowdown <= 1000.0))
    {
      throw std::invalid_argument("tuning of " + unit.unit + ": slowdown = " + std::to_string(unit.slowdown) +
                                  ", must be in [1, 1000]");
    }
    if (!std::isfinite(unit.active_power_w + unit.idle_power_w) || unit.active_power_w < 0.0 || unit.idle_power_w < 0.0)
    {
      throw std::invalid_argument("tuning of " + unit.unit + ": powers must be at least 0 and finite");
    }
  }
  if (slice.count() <= 0)
  {
    throw std::invalid_argument("slice = " + std::to_string(slice.count()) + " us, must be above 0");
  }
  if (pipeline.count() < 0)
  {
    throw std::invalid_argument("pipeline = " + std::to_string(pipeline.count()) + " us, must be at least 0");
  }
  if (hang_timeout.count() <= 0 || hang_timeout > std::chrono::hours(24))
  {
    throw std::invalid_argument("hang_timeout = " + std::to_string(hang_timeout.count()) +
                                " ms, must be in [1, 86400000]");
  }
  inter_core.validate();
}

}  // namespace pi_runtime
