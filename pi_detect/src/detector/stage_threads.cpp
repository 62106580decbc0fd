#include "detector/stage_threads.h"

#include <pi_runtime/stage.h>

#include <algorithm>
#include <memory>
#include <mutex>
#include <opencv2/core/parallel/parallel_backend.hpp>
#include <opencv2/core/utility.hpp>
#include <vector>

namespace pi_detect
{
namespace
{

/// OpenCV's layers ask for the number of threads, and cut their work into so many pieces.
constexpr int PIECES = 8;

class StageThread : public cv::parallel::ParallelForAPI
{
public:
  void parallel_for(int tasks, FN_parallel_for_body_cb_t body, void* data) override
  {
    for (int task = 0; task < tasks; ++task)
    {
      body(task, task + 1, data);
      pi_runtime::Stage::yield();
    }
  }
  int getThreadNum() const override { return 0; }
  int getNumThreads() const override { return PIECES; }
  int setNumThreads(int) override { return PIECES; }
  const char* getName() const override { return "pi_runtime"; }
};

}  // namespace

void cutStages(const pi_runtime::Runtime& runtime, int threads)
{
  const std::vector<pi_runtime::UnitStatus> units = runtime.units();
  const bool interrupted =
      std::any_of(units.begin(), units.end(), [](const pi_runtime::UnitStatus& unit) { return unit.preemptive; });
  static std::once_flag once;
  if (interrupted)
  {
    // Its threads begin here: those that a thread with real-time priority starts would keep to the cores of its unit.
    std::call_once(once,
                   []
                   {
                     cv::parallel_for_(
                         cv::Range(0, PIECES), [](const cv::Range&) {}, PIECES);
                   });
  }
  else if (threads == 0)
  {
    std::call_once(once, [] { cv::parallel::setParallelForBackend(std::make_shared<StageThread>(), false); });
  }
}

}  // namespace pi_detect
