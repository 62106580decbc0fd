// Part `mixture` of bench_runtime: does a batch on unequal units take as long as the policy has planned? Twice: with
// emulated units that are busy for as long as a random ETC table says (the setting of the paper's figure 9, in ms), and
// with real work on native units that are slowed down by different factors.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <random>
#include <set>
#include <stdexcept>
#include <thread>

#include "drive_work.h"
#include <pi_runtime/inter_core_scheduler.h>
#include "units/native_executor.h"
#include <pi_runtime/runtime.h>
#include "runtime_bench.h"

namespace pi_runtime_bench
{
namespace
{

using pi_runtime::Codelet;
using pi_runtime::EtcMatrix;
using pi_runtime::EtcTable;
using pi_runtime::Execution;
using pi_runtime::InterCoreOptions;
using pi_runtime::InterCorePolicy;
using pi_runtime::Runtime;
using pi_runtime::RuntimeOptions;
using pi_runtime::TaskHandle;
using pi_runtime::TaskRequest;
using pi_runtime::TaskResult;

constexpr size_t UNITS = 4;
constexpr size_t TASKS = 30;
constexpr int LEARNING_RUNS = 3;
constexpr double ETC_ERROR = 0.5;                          ///< sigma of the log-normal factor of a wrong table
constexpr double SLOWDOWNS[UNITS] = {2.0, 3.0, 4.0, 6.0};  ///< together no more than the work of 1.25 cores

constexpr InterCorePolicy POLICIES[] = {InterCorePolicy::DIFF_MIN,  InterCorePolicy::MIN_MIN, InterCorePolicy::SEARCH,
                                        InterCorePolicy::SUFFERAGE, InterCorePolicy::MCT,     InterCorePolicy::OLB};

std::string unitName(size_t unit)
{
  return "unit" + std::to_string(unit);
}

/// A unit that is busy for the time of its column of the table, without using the CPU for it.
class EmulatedExecutor : public pi_runtime::Executor
{
public:
  explicit EmulatedExecutor(std::map<std::string, double> seconds) : seconds_(std::move(seconds)) {}
  const char* name() const override { return "native"; }
  bool supports(const Codelet& codelet) const override { return seconds_.count(codelet.name) != 0; }
  bool asynchronous() const override { return false; }
  bool ready(const Execution&) const override { return true; }
  void prepare(const pi_runtime::CodeletPtr&) override {}
  double measureBandwidth() override { return std::numeric_limits<double>::infinity(); }
  void start(const Execution& execution, Completion completion) override
  {
    std::this_thread::sleep_for(std::chrono::duration<double>(seconds_.at(execution.codelet->name)));
    completion({});
  }

private:
  const std::map<std::string, double> seconds_;
};

RuntimeOptions mixtureOptions(InterCorePolicy policy, bool stealing)
{
  RuntimeOptions options = benchOptions();
  options.native = false;
  options.opencl_cpu = false;
  options.inter_core.policy = policy;
  options.stealing = stealing;
  return options;
}

/// Runs the batch. @return its makespan [s].
double runBatch(Runtime* runtime, const std::vector<TaskRequest>& batch)
{
  const int64_t start_ns = nowNs();
  int64_t end_ns = start_ns;
  for (const TaskHandle& handle : runtime->submitBatch(batch))
  {
    const TaskResult& result = handle.wait();
    if (!result.ok())
    {
      throw std::runtime_error("a task of the mixture fails: " + result.message);
    }
    end_ns = std::max(end_ns, result.finished_ns);
  }
  return static_cast<double>(end_ns - start_ns) * 1e-9;
}

/// What the policy promises for a table [s].
double plannedMakespan(const EtcMatrix& etc, InterCorePolicy policy)
{
  InterCoreOptions options;
  options.policy = policy;
  return pi_runtime::schedule(etc, {}, options).makespan;
}

/// Makespans by policy and column of the table, all rounds.
using Figures = std::map<InterCorePolicy, std::map<std::string, std::vector<double>>>;

std::vector<TaskRequest> emulatedBatch()
{
  std::vector<TaskRequest> batch(TASKS);
  for (size_t task = 0; task < TASKS; ++task)
  {
    Codelet codelet;
    codelet.name = "task" + std::to_string(task);
    codelet.native = {{[](const pi_runtime::NativeCall&) {}}};
    batch[task].codelet = makeCodelet(std::move(codelet));
  }
  return batch;
}

/// @param told  what the runtime believes. @param real  how long tasks take.
double runEmulated(const EtcMatrix& told, const EtcMatrix& real, const std::vector<TaskRequest>& batch,
                   const RuntimeOptions& options)
{
  std::vector<pi_runtime::CustomUnit> units(UNITS);
  std::vector<EtcTable::Entry> entries;
  for (size_t unit = 0; unit < UNITS; ++unit)
  {
    std::map<std::string, double> seconds;
    for (size_t task = 0; task < TASKS; ++task)
    {
      const std::string& name = batch[task].codelet->name;
      seconds[name] = real.at(task, unit);
      entries.push_back({name, EtcTable::sizeBucket(1.0), unitName(unit) + "/native", {100, told.at(task, unit), 0.0}});
    }
    units[unit].name = unitName(unit);
    units[unit].executors.push_back(std::make_unique<EmulatedExecutor>(std::move(seconds)));
  }
  Runtime runtime(options, std::move(units));
  runtime.setEtcEntries(entries);
  return runBatch(&runtime, batch);
}

void emulatedRound(int round, Figures* figures)
{
  std::mt19937_64 random(static_cast<uint64_t>(round) + 1);
  std::uniform_int_distribution<int> milliseconds(1, 30);
  std::normal_distribution<double> error(0.0, ETC_ERROR);
  EtcMatrix real(TASKS, UNITS);
  EtcMatrix wrong(TASKS, UNITS);
  for (size_t task = 0; task < TASKS; ++task)
  {
    for (size_t unit = 0; unit < UNITS; ++unit)
    {
      real.at(task, unit) = milliseconds(random) * 1e-3;
      wrong.at(task, unit) = real.at(task, unit) * std::exp(error(random));
    }
  }
  const std::vector<TaskRequest> batch = emulatedBatch();
  for (const InterCorePolicy policy : POLICIES)
  {
    std::map<std::string, std::vector<double>>& own = (*figures)[policy];
    own["planned"].push_back(plannedMakespan(real, policy));
    for (const bool stealing : {false, true})
    {
      const RuntimeOptions options = mixtureOptions(policy, stealing);
      const std::string suffix = stealing ? " + steal" : "";
      own["exact" + suffix].push_back(runEmulated(real, real, batch, options));
      own["wrong" + suffix].push_back(runEmulated(wrong, real, batch, options));
    }
  }
}

/// Front ends and networks of different depth, each with memory of its own.
struct RealBatch
{
  std::vector<TaskRequest> requests;

  explicit RealBatch(const WorkSize& size)
  {
    constexpr size_t FRONT_ENDS = 8;
    for (size_t task = 0; task < TASKS; ++task)
    {
      TaskRequest request;
      if (task < FRONT_ENDS)
      {
        request.codelet = frontEnd();
        request.arguments = FrontEndMemory().arguments(size.points);
      }
      else
      {
        request.codelet = network();
        request.arguments = DetectionMemory().arguments();
        request.range = static_cast<uint64_t>(Network::HEIGHT) * (1 + task % 4);
      }
      requests.push_back(std::move(request));
    }
  }

private:
  static pi_runtime::CodeletPtr anywhere(const pi_runtime::CodeletPtr& codelet)
  {
    Codelet copy = *codelet;
    copy.native.front().unit_types = pi_runtime::ANY_UNIT_TYPE;
    return makeCodelet(std::move(copy));
  }
  static pi_runtime::CodeletPtr frontEnd()
  {
    static const pi_runtime::CodeletPtr codelet = anywhere(frontEndCodelet());
    return codelet;
  }
  static pi_runtime::CodeletPtr network()
  {
    static const pi_runtime::CodeletPtr codelet = anywhere(detectionCodelet(false));
    return codelet;
  }
};

std::unique_ptr<Runtime> slowedRuntime(InterCorePolicy policy, bool stealing)
{
  RuntimeOptions options = mixtureOptions(policy, stealing);
  std::vector<pi_runtime::CustomUnit> units(UNITS);
  for (size_t unit = 0; unit < UNITS; ++unit)
  {
    units[unit].name = unitName(unit);
    units[unit].executors.push_back(std::make_unique<pi_runtime::NativeExecutor>(units[unit].type));
    options.tuning.push_back({unitName(unit), 0.0, 0.0, SLOWDOWNS[unit]});
  }
  return std::make_unique<Runtime>(options, std::move(units));
}

/// The table after a few runs of each kind of task on each unit; and the same as the matrix of the batch.
std::vector<EtcTable::Entry> learn(const RealBatch& batch, EtcMatrix* etc)
{
  const std::unique_ptr<Runtime> runtime = slowedRuntime(InterCorePolicy::MCT, false);
  std::set<std::pair<std::string, uint64_t>> known;
  for (const TaskRequest& request : batch.requests)
  {
    if (known.emplace(request.codelet->name, request.range).second)
    {
      runtime->calibrate(request, LEARNING_RUNS);
    }
  }
  for (size_t task = 0; task < TASKS; ++task)
  {
    const TaskRequest& request = batch.requests[task];
    for (size_t unit = 0; unit < UNITS; ++unit)
    {
      etc->at(task, unit) = runtime->predict(request.codelet, static_cast<double>(request.range), unitName(unit));
    }
  }
  return runtime->etcEntries();
}

void realRound(const RealBatch& batch, Figures* figures)
{
  EtcMatrix etc(TASKS, UNITS);
  const std::vector<EtcTable::Entry> entries = learn(batch, &etc);
  for (const InterCorePolicy policy : POLICIES)
  {
    std::map<std::string, std::vector<double>>& own = (*figures)[policy];
    own["planned"].push_back(plannedMakespan(etc, policy));
    for (const bool stealing : {false, true})
    {
      const std::unique_ptr<Runtime> runtime = slowedRuntime(policy, stealing);
      runtime->setEtcEntries(entries);
      own[stealing ? "learned + steal" : "learned"].push_back(runBatch(runtime.get(), batch.requests));
    }
  }
}

/// The last column compares the column `stolen_from` with stealing and without, round by round.
void print(const Figures& figures, const std::vector<std::string>& columns, const std::string& stolen_from)
{
  std::printf("%-13s", "makespan [ms]");
  for (const std::string& column : columns)
  {
    std::printf(" %22s", column.c_str());
  }
  std::printf(" %22s\n", ("steal / none, " + stolen_from).c_str());
  for (const InterCorePolicy policy : POLICIES)
  {
    const std::map<std::string, std::vector<double>>& own = figures.at(policy);
    std::printf("%-13s", toString(policy));
    for (const std::string& column : columns)
    {
      std::vector<double> milliseconds = own.at(column);
      std::transform(milliseconds.begin(), milliseconds.end(), milliseconds.begin(),
                     [](double seconds) { return seconds * 1e3; });
      std::printf(" %22s", spread(milliseconds, "%.1f").c_str());
    }
    const std::vector<double>& without = own.at(stolen_from);
    std::vector<double> ratios = own.at(stolen_from + " + steal");
    std::transform(ratios.begin(), ratios.end(), without.begin(), ratios.begin(), std::divides<double>());
    std::printf(" %22s\n", spread(ratios).c_str());
  }
}

}  // namespace

void benchMixture(Settings* settings)
{
  Figures emulated;
  Figures real;
  const RealBatch batch(WorkSize::forThisMachine());
  for (int round = 0; round < settings->rounds; ++round)
  {
    emulatedRound(round, &emulated);
    realRound(batch, &real);
  }
  std::printf("\nMixture: %zu tasks on %zu unequal units, %d rounds\n", TASKS, UNITS, settings->rounds);
  std::printf(
      "Emulated units, ETC uniform in {1..30} ms, another table each round; wrong: the runtime is told the ETC\n"
      "times log-normal(%.1f); planned: by the exact table\n",
      ETC_ERROR);
  print(emulated, {"planned", "exact", "exact + steal", "wrong", "wrong + steal"}, "wrong");
  std::printf("Real work on native units slowed down 2, 3, 4 and 6 times; ETC learned by %d runs of each kind\n",
              LEARNING_RUNS);
  print(real, {"planned", "learned", "learned + steal"}, "learned");
}

}  // namespace pi_runtime_bench
