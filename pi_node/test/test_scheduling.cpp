#include <gtest/gtest.h>
#include <pi_node/scheduling.h>
#include <pi_node/vehicle_clock.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <thread>

namespace pi_node
{
namespace
{

/// In a thread of its own: no other test gets its nice value.
std::string preferred()
{
  std::string text;
  std::thread([&text] { text = preferThread(); }).join();
  return text;
}

TEST(PreferThread, SaysTheNiceValueOfTheThread)
{
  const bool granted = std::stoi(preferred().substr(5)) == -10;
  std::string again;
  std::thread(
      [&again]
      {
        const auto thread = static_cast<id_t>(syscall(SYS_gettid));
        again = setpriority(PRIO_PROCESS, thread, -10) == 0 ? "granted" : "refused";
      })
      .join();
  EXPECT_EQ(granted ? "granted" : "refused", again);
}

TEST(PreferThread, ChangesNothingInSimulatedTime)
{
  simulateTime([] { return int64_t{1}; });
  const std::string text = preferred();
  simulateTime(nullptr);
  EXPECT_EQ("nice " + std::to_string(getpriority(PRIO_PROCESS, 0)), text);
}

}  // namespace
}  // namespace pi_node
