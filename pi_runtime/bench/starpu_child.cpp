// The rival: what a child process of bench_runtime does with StarPU. It runs in processes of its own, as its workers
// spin from starpu_init() on and its global state cannot be set up twice.
#include "runtime_bench.h"

#ifdef PI_RUNTIME_HAVE_STARPU

#include <starpu.h>

#include <cstdio>
#include <memory>
#include <stdexcept>
#include <thread>

#include "drive_streams.h"
#include "drive_work.h"

namespace pi_runtime_bench
{
namespace
{

constexpr int CALIBRATION_RUNS = 40;  ///< StarPU trusts its models after 10 runs

void require(int code, const char* what)
{
  if (code != 0)
  {
    throw std::runtime_error(std::string("StarPU: ") + what + " failed with " + std::to_string(code));
  }
}

/// A codelet without data handles: pointers are all it needs on CPUs, and handles would only cost time.
struct CpuCodelet
{
  CpuCodelet(const char* name, void (*function)(void**, void*))
  {
    model.type = STARPU_HISTORY_BASED;
    model.symbol = name;
    codelet.cpu_funcs[0] = function;
    codelet.nbuffers = 0;
    codelet.model = &model;
    codelet.name = name;
  }

  starpu_perfmodel model{};
  starpu_codelet codelet{};
};

starpu_task* makeTask(CpuCodelet* codelet, void* argument)
{
  starpu_task* const task = starpu_task_create();
  task->cl = &codelet->codelet;
  task->cl_arg = argument;
  task->cl_arg_size = 0;
  return task;
}

void runAndWait(CpuCodelet* codelet, void* argument)
{
  starpu_task* const task = makeTask(codelet, argument);
  task->detach = 0;
  require(starpu_task_submit(task), "starpu_task_submit");
  require(starpu_task_wait(task), "starpu_task_wait");
}

CpuCodelet& emptyCodelet()
{
  static CpuCodelet codelet("empty", [](void**, void*) {});
  return codelet;
}

void latency(size_t tasks)
{
  for (int run = 0; run < CALIBRATION_RUNS; ++run)
  {
    runAndWait(&emptyCodelet(), nullptr);
  }
  for (size_t i = 0; i < tasks; ++i)
  {
    const auto start = Clock::now();
    runAndWait(&emptyCodelet(), nullptr);
    std::printf("wait_us %.3f\n", secondsSince(start) * 1e6);
  }
  auto start = Clock::now();
  for (size_t i = 0; i < tasks; ++i)
  {
    require(starpu_task_submit(makeTask(&emptyCodelet(), nullptr)), "starpu_task_submit");
  }
  std::printf("submit_us %.4f\n", secondsSince(start) * 1e6 / static_cast<double>(tasks));
  require(starpu_task_wait_for_all(), "starpu_task_wait_for_all");
  std::printf("loop_us %.4f\n", secondsSince(start) * 1e6 / static_cast<double>(tasks));

  start = Clock::now();
  std::vector<starpu_task*> chain;
  for (size_t i = 0; i < tasks; ++i)
  {
    chain.push_back(makeTask(&emptyCodelet(), nullptr));
    chain.back()->detach = 0;
    chain.back()->destroy = 0;
    if (i > 0)
    {
      starpu_task* before[] = {chain[i - 1]};
      starpu_task_declare_deps_array(chain[i], 1, before);
    }
  }
  for (starpu_task* const task : chain)
  {
    require(starpu_task_submit(task), "starpu_task_submit");
  }
  require(starpu_task_wait_for_all(), "starpu_task_wait_for_all");
  std::printf("chain_us %.4f\n", secondsSince(start) * 1e6 / static_cast<double>(tasks));
}

void idle(double seconds)
{
  runAndWait(&emptyCodelet(), nullptr);
  const double cpu_before_s = processCpu();
  const auto start = Clock::now();
  std::this_thread::sleep_for(std::chrono::duration<double>(seconds));
  std::printf("cpu %.4f\n", 100.0 * (processCpu() - cpu_before_s) / secondsSince(start));
}

/// What a task of the drive works on.
struct DriveTask
{
  std::unique_ptr<FrontEndMemory> frame;
  std::unique_ptr<DetectionMemory> network;
  std::vector<float> covariance;
  int32_t points = 0;
  uint64_t rows = 0;
  DriveStream* stream = nullptr;
  DriveStream::Job job{};
};

void frontEnd(void**, void* argument)
{
  auto* const task = static_cast<DriveTask*>(argument);
  runFrontEnd(task->frame->frame(), task->points);
}

void detection(void**, void* argument)
{
  auto* const task = static_cast<DriveTask*>(argument);
  runNetwork(static_cast<float*>(task->network->maps->address()),
             static_cast<const float*>(task->network->weights->address()), 0, task->rows);
}

void inertial(void**, void* argument)
{
  runInertial(static_cast<DriveTask*>(argument)->covariance.data());
}

void ended(void* argument)
{
  auto* const task = static_cast<DriveTask*>(argument);
  task->stream->finished(task->job, nowNs(), true);
}

/// A stream whose jobs are StarPU tasks. Its codelet must outlive it.
class StarpuStream
{
public:
  StarpuStream(CpuCodelet* codelet, int priority, std::vector<DriveTask> tasks, const Rhythm& rhythm)
    : codelet_(codelet)
    , priority_(priority)
    , tasks_(std::move(tasks))
    , stream_(codelet->codelet.name, rhythm.period_s, rhythm.deadline_s,
              [this](const DriveStream::Job& job) { submit(job); })
  {
    for (DriveTask& task : tasks_)
    {
      task.stream = &stream_;
    }
    for (int run = 0; run < CALIBRATION_RUNS; ++run)
    {
      runAndWait(codelet_, &tasks_.front());
    }
  }

  DriveStream* stream() { return &stream_; }

private:
  void submit(const DriveStream::Job& job)
  {
    DriveTask& argument = tasks_[job.slot];
    argument.job = job;
    starpu_task* const task = makeTask(codelet_, &argument);
    task->priority = priority_;
    task->callback_func = ended;
    task->callback_arg = &argument;
    require(starpu_task_submit(task), "starpu_task_submit");
  }

  CpuCodelet* const codelet_;
  const int priority_;
  std::vector<DriveTask> tasks_;
  DriveStream stream_;
};

void drive(const std::vector<std::string>& words)
{
  const double seconds = std::stod(words.at(2));
  const auto points = static_cast<int32_t>(std::stol(words.at(3)));
  const uint64_t layers = std::stoul(words.at(4));
  const bool priorities = words.at(6) == "priorities";
  std::vector<DriveTask> frames(DriveStream::SLOTS);
  std::vector<DriveTask> maps(DriveStream::SLOTS);
  std::vector<DriveTask> covariances(DriveStream::SLOTS);
  for (size_t slot = 0; slot < DriveStream::SLOTS; ++slot)
  {
    frames[slot].frame = std::make_unique<FrontEndMemory>();
    frames[slot].points = points;
    maps[slot].network = std::make_unique<DetectionMemory>();
    maps[slot].rows = Network::HEIGHT * layers;
    covariances[slot].covariance.resize(INERTIAL_FLOATS);
  }
  CpuCodelet front_end_codelet("front_end", frontEnd);
  CpuCodelet detection_codelet("detection", detection);
  CpuCodelet inertial_codelet("inertial", inertial);
  const int high = priorities ? starpu_sched_get_max_priority() : STARPU_DEFAULT_PRIO;
  StarpuStream front_end(&front_end_codelet, high, std::move(frames), DRIVE_FRONT_END);
  StarpuStream detections(&detection_codelet, STARPU_DEFAULT_PRIO, std::move(maps), DRIVE_DETECTION);
  std::vector<DriveStream*> streams{front_end.stream(), detections.stream()};
  std::unique_ptr<StarpuStream> inertials;
  if (words.at(5) == "inertial")
  {
    inertials = std::make_unique<StarpuStream>(&inertial_codelet, high, std::move(covariances), DRIVE_INERTIAL);
    streams.push_back(inertials->stream());
  }
  driveAndPrint(streams, seconds);
}

}  // namespace

bool starpuAvailable()
{
  return true;
}

void childStarpu(const std::vector<std::string>& words)
{
  const Memory before = processMemory();
  const auto start = Clock::now();
  require(starpu_init(nullptr), "starpu_init");
  std::printf("init_ms %.3f\n", secondsSince(start) * 1e3);
  if (words.at(1) == "latency")
  {
    latency(std::stoul(words.at(2)));
  }
  else if (words.at(1) == "idle")
  {
    idle(std::stod(words.at(2)));
  }
  else
  {
    drive(words);
  }
  std::printf("private_kb %.0f\n", processMemory().private_kb - before.private_kb);
  std::fflush(stdout);
  _exit(0);  // starpu_shutdown() would wait for more than there is to wait for
}

}  // namespace pi_runtime_bench

#else

#include <stdexcept>

namespace pi_runtime_bench
{

bool starpuAvailable()
{
  return false;
}

void childStarpu(const std::vector<std::string>&)
{
  throw std::runtime_error("bench_runtime was built without StarPU");
}

}  // namespace pi_runtime_bench

#endif
