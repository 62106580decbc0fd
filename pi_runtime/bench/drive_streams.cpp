#include "drive_streams.h"

#include <cerrno>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <stdexcept>
#include <thread>

#include "runtime_bench.h"

namespace pi_runtime_bench
{
namespace
{

constexpr double LOST = -1.0;
constexpr double DRAIN_LIMIT_S = 10.0;

void sleepUntil(int64_t time_ns)
{
  timespec time{};
  time.tv_sec = time_ns / 1000000000;
  time.tv_nsec = time_ns % 1000000000;
  while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &time, nullptr) == EINTR)
  {
  }
}

int64_t nanoseconds(double seconds)
{
  return std::llround(seconds * 1e9);
}

}  // namespace

DriveStream::DriveStream(std::string name, double period_s, double deadline_s, std::function<void(const Job&)> submit)
  : name_(std::move(name))
  , period_ns_(nanoseconds(period_s))
  , deadline_ns_(nanoseconds(deadline_s))
  , submit_(std::move(submit))
{
}

void DriveStream::run(int64_t start_ns, double seconds)
{
  const auto jobs = static_cast<size_t>(nanoseconds(seconds) / period_ns_);
  responses_.assign(jobs, LOST);
  for (size_t number = 0; number < jobs; ++number)
  {
    Job job{number, number % SLOTS, start_ns + static_cast<int64_t>(number) * period_ns_, 0};
    job.deadline_ns = job.release_ns + deadline_ns_;
    sleepUntil(job.release_ns);
    if (!used_[job.slot].load(std::memory_order_acquire))
    {
      used_[job.slot].store(true, std::memory_order_relaxed);
      submit_(job);
    }
  }
}

void DriveStream::finished(const Job& job, int64_t end_ns, bool ok)
{
  responses_[job.number] = ok ? static_cast<double>(end_ns - job.release_ns) * 1e-9 : LOST;
  used_[job.slot].store(false, std::memory_order_release);
}

bool DriveStream::drain(double limit_s) const
{
  const int64_t end_ns = nowNs() + nanoseconds(limit_s);
  for (const std::atomic<bool>& used : used_)
  {
    while (used.load(std::memory_order_acquire))
    {
      if (nowNs() > end_ns)
      {
        return false;
      }
      sleepUntil(nowNs() + 1000000);
    }
  }
  return true;
}

void driveAndPrint(const std::vector<DriveStream*>& streams, double seconds)
{
  const double cpu_before_s = processCpu();
  const auto start = Clock::now();
  // All streams begin together: the first jobs meet.
  const int64_t start_ns = nowNs() + 20000000;
  std::vector<std::thread> threads;
  for (DriveStream* const stream : streams)
  {
    threads.emplace_back([stream, start_ns, seconds] { stream->run(start_ns, seconds); });
  }
  for (std::thread& thread : threads)
  {
    thread.join();
  }
  for (const DriveStream* const stream : streams)
  {
    if (!stream->drain(DRAIN_LIMIT_S))
    {
      throw std::runtime_error("jobs of the stream " + stream->name() + " have not ended " +
                               std::to_string(DRAIN_LIMIT_S) + " s after the last release");
    }
  }
  const double cpu_percent = 100.0 * (processCpu() - cpu_before_s) / secondsSince(start);
  for (const DriveStream* const stream : streams)
  {
    std::printf("stream %s %.9f\n", stream->name().c_str(), static_cast<double>(stream->deadlineNs()) * 1e-9);
    for (const double response_s : stream->responses())
    {
      std::printf("job %s %.9f\n", stream->name().c_str(), response_s);
    }
  }
  std::printf("cpu %.3f\n", cpu_percent);
}

}  // namespace pi_runtime_bench
