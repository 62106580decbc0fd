#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

namespace pi_runtime_bench
{

/// Jobs that are released in a fixed rhythm, whether or not earlier ones have ended, and what became of them.
///
/// Each job has one of a few slots of memory. One that is released while its slot is still in use is not submitted and
/// counts as lost: a sensor would overwrite the picture.
class DriveStream
{
public:
  static constexpr size_t SLOTS = 8;

  struct Job
  {
    size_t number;
    size_t slot;
    int64_t release_ns;  ///< nominal: when it should have been submitted
    int64_t deadline_ns;
  };

  /// @param submit  called by run() for each job; finished() answers it.
  DriveStream(std::string name, double period_s, double deadline_s, std::function<void(const Job&)> submit);

  const std::string& name() const { return name_; }
  int64_t periodNs() const { return period_ns_; }
  int64_t deadlineNs() const { return deadline_ns_; }

  /// Releases jobs on this thread from start_ns on for this time, by absolute times.
  void run(int64_t start_ns, double seconds);
  /// A job that was submitted has ended. Any thread.
  void finished(const Job& job, int64_t end_ns, bool ok);
  /// Waits until all jobs have ended. @return false if that takes longer.
  bool drain(double limit_s) const;

  /// After drain(). Response times from the nominal release [s], in order of release; negative: lost or failed.
  const std::vector<double>& responses() const { return responses_; }

private:
  const std::string name_;
  const int64_t period_ns_;
  const int64_t deadline_ns_;
  const std::function<void(const Job&)> submit_;
  std::vector<double> responses_;
  std::array<std::atomic<bool>, SLOTS> used_{};
};

/// Runs streams side by side, a thread each, and prints per job "job <stream> <response [s]>", then per stream
/// "stream <name> <deadline [s]>", and "cpu <percent of a core>" of this process.
/// @throws std::runtime_error if jobs do not end.
void driveAndPrint(const std::vector<DriveStream*>& streams, double seconds);

}  // namespace pi_runtime_bench
