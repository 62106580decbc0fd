// Filters a million samples 30 times a second, as a stream whose deadlines the runtime has accepted.

#include <chrono>
#include <cstdint>
#include <cstdio>
#include <thread>

#include "mean_filter.h"

using namespace pi_runtime;

int main()
{
  constexpr uint64_t COUNT = 1 << 20;
  constexpr std::chrono::milliseconds PERIOD(33);
  constexpr int JOBS = 90;
  const BufferPtr samples = Buffer::allocate(COUNT * sizeof(float));
  const BufferPtr means = Buffer::allocate(COUNT * sizeof(float));
  TaskRequest task = meanFilterTask(samples, means, COUNT);
  task.deadline = PERIOD;

  const std::shared_ptr<Runtime> runtime = Runtime::shared();
  runtime->calibrate(task);  // the run times, by which the stream is admitted

  StreamRequest request;
  request.name = "mean_filter";
  request.codelet = task.codelet;
  request.period = PERIOD;
  const Admission admission = runtime->admit(request);
  if (!admission.admitted())
  {
    std::printf("not admitted: %s; it would fit with a period of %.1f ms\n", admission.reason.c_str(),
                static_cast<double>(admission.shortest_period.count()) * 1e-6);
    return 1;
  }
  std::printf("admitted on %s\n", admission.unit.c_str());

  task.stream = admission.id;
  int done = 0;
  int late = 0;
  auto next = std::chrono::steady_clock::now();
  for (int job = 0; job < JOBS; ++job)
  {
    const TaskHandle handle = runtime->submit(task);
    done += handle.wait().ok() ? 1 : 0;
    late += handle.wait().missedDeadline() ? 1 : 0;
    std::this_thread::sleep_until(next += PERIOD);
  }
  std::printf("%d of %d jobs done, %d late\n", done, JOBS, late);
  return done == JOBS ? 0 : 1;
}
