#include <sched.h>

#include <algorithm>
#include <cctype>
#include <cstdlib>
#include <filesystem>
#include <map>
#include <numeric>
#include <stdexcept>

#include "opencl/opencl_executor.h"
#include "units/native_executor.h"
#include "units/slow_executor.h"
#include "units/unit.h"

namespace pi_runtime
{
namespace
{

constexpr size_t MOST_DEFAULT_CPU_UNITS = 4;

std::vector<int> allowedCores()
{
  cpu_set_t set;
  CPU_ZERO(&set);
  std::vector<int> cores;
  if (sched_getaffinity(0, sizeof set, &set) == 0)
  {
    for (int core = 0; core < CPU_SETSIZE; ++core)
    {
      if (CPU_ISSET(core, &set))
      {
        cores.push_back(core);
      }
    }
  }
  return cores.empty() ? std::vector<int>{0} : cores;
}

std::vector<unsigned> evenShares(size_t cores)
{
  const size_t units = std::min(cores, MOST_DEFAULT_CPU_UNITS);
  std::vector<unsigned> shares(units, static_cast<unsigned>(cores / units));
  for (size_t unit = 0; unit < cores % units; ++unit)
  {
    ++shares[units - 1 - unit];
  }
  return shares;
}

/// PoCL's threads keep to the cores of their compute units if told so before it starts. That is only right if its
/// numbers of cores are ours.
void tellPoclToPin(const std::vector<int>& cores)
{
  std::vector<int> all(cores.size());
  std::iota(all.begin(), all.end(), 0);
  if (cores == all)
  {
    setenv("POCL_AFFINITY", "1", 0);
  }
}

/// True if the OpenCL loader has no driver but PoCL's, so that no GPU can be behind it. Asking the loader instead would
/// load PoCL, which takes 70 MB.
bool onlyPoclIsInstalled()
{
  if (std::getenv("OCL_ICD_VENDORS") != nullptr || std::getenv("OCL_ICD_FILENAMES") != nullptr)
  {
    return false;  // other drivers than those below
  }
  std::error_code ignored;
  for (const auto& file : std::filesystem::directory_iterator("/etc/OpenCL/vendors", ignored))
  {
    if (file.path().extension() == ".icd" && file.path().stem() != "pocl")
    {
      return false;
    }
  }
  return true;
}

/// "cpu:0-1" of a user's device: the same in every process.
std::string arbiterKey(const Unit& unit)
{
  if (unit.cores.empty())
  {
    return unit.name + ":" + unit.device;
  }
  std::string key = "cpu";
  for (const int core : unit.cores)
  {
    key += ":" + std::to_string(core);
  }
  return key;
}

class Discovery
{
public:
  Discovery(const RuntimeOptions& options, std::vector<std::string>* problems) : options_(options), problems_(problems)
  {
  }

  std::vector<std::unique_ptr<Unit>> run(std::vector<CustomUnit> custom)
  {
    if (options_.opencl_cpu || (options_.opencl_gpu && !onlyPoclIsInstalled()))
    {
      tellPoclToPin(options_.pin_threads ? allowedCores() : std::vector<int>{});
      devices_ = findOpenClDevices(problems_);
    }
    if (options_.native || options_.opencl_cpu)
    {
      addCpuUnits();
    }
    if (options_.opencl_gpu)
    {
      addOtherDevices();
    }
    for (CustomUnit& unit : custom)
    {
      addCustom(std::move(unit));
    }
    for (const std::unique_ptr<Unit>& unit : units_)
    {
      finish(*unit);
    }
    return std::move(units_);
  }

private:
  std::unique_ptr<Unit>& add(const std::string& name, UnitType type)
  {
    units_.push_back(std::make_unique<Unit>(options_.queue_order == QueueOrder::FIFO));
    Unit& unit = *units_.back();
    unit.name = name;
    unit.index = units_.size() - 1;
    unit.type = type;
    return units_.back();
  }

  void addCpuUnits()
  {
    const std::vector<int> cores = allowedCores();
    const std::vector<unsigned> shares = options_.cpu_units.empty() ? evenShares(cores.size()) : options_.cpu_units;
    const unsigned wanted = std::accumulate(shares.begin(), shares.end(), 0u);
    if (wanted > cores.size())
    {
      throw std::invalid_argument("cpu_units ask for " + std::to_string(wanted) + " cores, this process may use " +
                                  std::to_string(cores.size()));
    }
    const std::shared_ptr<OpenClContext> context = options_.opencl_cpu ? cpuContext(shares, wanted) : nullptr;
    size_t first_core = 0;
    for (size_t index = 0; index < shares.size(); ++index)
    {
      std::vector<std::unique_ptr<Executor>> executors;
      if (options_.native)
      {
        executors.push_back(std::make_unique<NativeExecutor>(UnitType::CPU));
      }
      if (context)
      {
        executors.push_back(std::make_unique<OpenClExecutor>(context, index, options_.cache_folder));
      }
      if (executors.empty())
      {
        continue;
      }
      Unit& unit = *add("cpu" + std::to_string(index), UnitType::CPU);
      unit.cores.assign(cores.begin() + static_cast<long>(first_core),
                        cores.begin() + static_cast<long>(first_core + shares[index]));
      first_core += shares[index];
      unit.compute_units = shares[index];
      unit.memory = options_.cpu_memory;
      unit.device = context ? context->info().name : "";
      unit.fp16 = context && context->info().fp16;
      setExecutors(unit, std::move(executors));
    }
  }

  std::shared_ptr<OpenClContext> cpuContext(const std::vector<unsigned>& shares, unsigned wanted)
  {
    const auto cpu = std::find_if(devices_.begin(), devices_.end(),
                                  [](const OpenClDeviceInfo& info) { return info.type == UnitType::CPU; });
    if (cpu == devices_.end())
    {
      problems_->push_back(
          "no OpenCL device for the CPU (Debian: pocl-opencl-icd): its units run native functions only");
      return nullptr;
    }
    if (cpu->compute_units < wanted)
    {
      problems_->push_back("OpenCL device " + cpu->name + " has " + std::to_string(cpu->compute_units) +
                           " compute units for " + std::to_string(wanted) +
                           " cores: CPU units run native functions only (POCL_MAX_PTHREAD_COUNT set?)");
      return nullptr;
    }
    try
    {
      const bool whole = shares.size() == 1 && shares.front() == cpu->compute_units;
      return std::make_shared<OpenClContext>(*cpu, whole ? std::vector<unsigned>{} : shares, options_.cpu_memory);
    }
    catch (const OpenClError& error)
    {
      problems_->push_back(std::string(error.what()) + ": CPU units run native functions only");
      return nullptr;
    }
  }

  void addOtherDevices()
  {
    std::map<UnitType, int> number;
    for (const OpenClDeviceInfo& info : devices_)
    {
      if (info.type == UnitType::CPU)
      {
        continue;
      }
      try
      {
        const auto context = std::make_shared<OpenClContext>(
            info, std::vector<unsigned>{}, info.unified_memory ? MemoryModel::MAPPED : MemoryModel::SEPARATE);
        std::vector<std::unique_ptr<Executor>> executors;
        executors.push_back(std::make_unique<OpenClExecutor>(context, 0, options_.cache_folder));
        executors.push_back(std::make_unique<NativeExecutor>(info.type));
        Unit& unit = *add(toString(info.type) + std::to_string(number[info.type]++), info.type);
        unit.device = info.name;
        unit.compute_units = info.compute_units;
        unit.memory = context->memoryModel();
        unit.fp16 = info.fp16;
        unit.fp64 = info.fp64;
        setExecutors(unit, std::move(executors));
      }
      catch (const OpenClError& error)
      {
        problems_->push_back("OpenCL device " + info.name + " is left out: " + error.what());
      }
    }
  }

  void addCustom(CustomUnit custom)
  {
    const bool taken = std::any_of(units_.begin(), units_.end(),
                                   [&](const std::unique_ptr<Unit>& unit) { return unit->name == custom.name; });
    const bool word = !custom.name.empty() &&
                      std::all_of(custom.name.begin(), custom.name.end(),
                                  [](unsigned char letter) { return std::isgraph(letter) != 0 && letter != ','; });
    const bool usable = !custom.executors.empty() &&
                        std::all_of(custom.executors.begin(), custom.executors.end(),
                                    [](const std::unique_ptr<Executor>& executor) { return executor != nullptr; });
    if (taken || !word || !usable)
    {
      throw std::invalid_argument("CustomUnit \"" + custom.name +
                                  "\": needs a name of its own, one word without commas, and an executor");
    }
    Unit& unit = *add(custom.name, custom.type);
    setExecutors(unit, std::move(custom.executors));
  }

  void setExecutors(Unit& unit, std::vector<std::unique_ptr<Executor>> executors)
  {
    for (const UnitTuning& tuning : options_.tuning)
    {
      if (tuning.unit == unit.name)
      {
        unit.tuning = tuning;
      }
    }
    for (std::unique_ptr<Executor>& executor : executors)
    {
      UnitExecutor entry;
      entry.bandwidth_bps = executor->measureBandwidth();
      entry.executor = unit.tuning.slowdown > 1.0
                           ? std::make_unique<SlowExecutor>(std::move(executor), unit.tuning.slowdown)
                           : std::move(executor);
      unit.executors.push_back(std::move(entry));
    }
  }

  void finish(Unit& unit)
  {
    if (!options_.arbitration)
    {
      return;
    }
    try
    {
      unit.arbiter = std::make_unique<UnitArbiter>(arbiterKey(unit), options_.arbitration_folder);
    }
    catch (const std::exception& error)
    {
      problems_->push_back("unit " + unit.name + " is not shared fairly with other processes: " + error.what());
    }
  }

  const RuntimeOptions& options_;
  std::vector<std::string>* const problems_;
  std::vector<OpenClDeviceInfo> devices_;
  std::vector<std::unique_ptr<Unit>> units_;
};

}  // namespace

std::unique_ptr<Unit> makeLane(Unit* base, int priority)
{
  auto lane = std::make_unique<Unit>(false);
  lane->name = base->name;
  lane->index = base->index;
  lane->type = base->type;
  lane->cores = base->cores;
  lane->base = base;
  lane->priority = priority;
  UnitExecutor entry;
  entry.executor = std::make_unique<NativeExecutor>(base->type);
  entry.column = base->executors.front().column;
  lane->executors.push_back(std::move(entry));
  lane->worker_left = true;  // until it has a stream
  return lane;
}

std::vector<std::unique_ptr<Unit>> makeUnits(const RuntimeOptions& options, std::vector<CustomUnit> custom,
                                             std::vector<std::string>* problems)
{
  std::vector<std::unique_ptr<Unit>> units = Discovery(options, problems).run(std::move(custom));
  if (units.empty())
  {
    std::string message = "no computing unit: neither native nor OpenCL units are there";
    for (const std::string& problem : *problems)
    {
      message += "; " + problem;
    }
    throw std::runtime_error(message);
  }
  for (const UnitTuning& tuning : options.tuning)
  {
    if (std::none_of(units.begin(), units.end(),
                     [&](const std::unique_ptr<Unit>& unit) { return unit->name == tuning.unit; }))
    {
      throw std::invalid_argument("tuning names the unit \"" + tuning.unit + "\", which does not exist");
    }
  }
  return units;
}

}  // namespace pi_runtime
