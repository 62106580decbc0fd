#include <pi_node/vehicle_clock.h>

#include <pi_node/durations.h>

#include <atomic>

namespace pi_node
{
namespace
{

std::atomic<int64_t (*)()> simulated_clock{nullptr};

}  // namespace

int64_t vehicleNs()
{
  int64_t (*const clock)() = simulated_clock;
  return clock != nullptr ? clock() : monotonicNs();
}

bool isTimeSimulated()
{
  return simulated_clock != nullptr;
}

void simulateTime(int64_t (*clock)())
{
  simulated_clock = clock;
}

}  // namespace pi_node
