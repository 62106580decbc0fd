#include <gtest/gtest.h>
#include "wire/event_thread.h"

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <future>
#include <memory>
#include <mutex>
#include <stdexcept>
#include <string>
#include <vector>

namespace pi_offload
{
namespace
{

EventThread::Callbacks withoutTimer()
{
  EventThread::Callbacks callbacks;
  callbacks.next_time = [] { return INT64_MAX; };
  callbacks.on_time = [](int64_t) {};
  callbacks.failed = [](const std::string&) {};
  return callbacks;
}

TEST(EventThread, RunsFunctionsInTheirOrder)
{
  EventThread thread("test", withoutTimer());
  std::vector<int> order;
  for (int i = 0; i < 100; ++i)
  {
    thread.post([&order, i](int64_t) { order.push_back(i); });
  }
  thread.start();
  EXPECT_EQ(100u, thread.call([&order](int64_t) { return order.size(); }));
  for (int i = 0; i < 100; ++i)
  {
    EXPECT_EQ(i, order[static_cast<size_t>(i)]);
  }
}

TEST(EventThread, CallGivesResultsAndExceptions)
{
  EventThread thread("test", withoutTimer());
  thread.start();
  EXPECT_EQ(7, thread.call([](int64_t) { return 7; }));
  EXPECT_THROW(thread.call([](int64_t) { throw std::invalid_argument("wrong"); }), std::invalid_argument);
  const int64_t before = monotonicNs();
  const int64_t at = thread.call([](int64_t now_ns) { return now_ns; });
  EXPECT_LE(before, at);
  EXPECT_GE(monotonicNs(), at);
}

TEST(EventThread, CallsTheTimerOnceItIsTime)
{
  std::promise<int64_t> came;
  std::atomic<int64_t> next_ns{INT64_MAX};
  EventThread::Callbacks callbacks = withoutTimer();
  callbacks.next_time = [&next_ns] { return next_ns.load(); };
  callbacks.on_time = [&](int64_t now_ns)
  {
    next_ns = INT64_MAX;
    came.set_value(now_ns);
  };
  EventThread thread("test", callbacks);
  thread.start();
  const int64_t due_ns = monotonicNs() + 20000000;
  thread.post([&](int64_t) { next_ns = due_ns; });  // asked for after each function
  EXPECT_GE(came.get_future().get(), due_ns);
}

TEST(EventThread, GoesOnAfterAFunctionThatThrows)
{
  std::promise<std::string> said;
  EventThread::Callbacks callbacks = withoutTimer();
  callbacks.failed = [&said](const std::string& text) { said.set_value(text); };
  EventThread thread("test", callbacks);
  thread.start();
  thread.post([](int64_t) { throw std::runtime_error("broken"); });
  EXPECT_EQ("broken", said.get_future().get());
  EXPECT_EQ(1, thread.call([](int64_t) { return 1; }));
}

TEST(EventThread, NobodyWaitsForEverWhenItStops)
{
  EventThread thread("test", withoutTimer());
  thread.start();
  std::promise<void> entered;
  std::promise<void> leave;
  thread.post(
      [&](int64_t)
      {
        entered.set_value();
        leave.get_future().wait();
      });
  entered.get_future().wait();
  std::promise<void> dropped;
  thread.post([gone = std::shared_ptr<void>(nullptr, [&](void*) { dropped.set_value(); })](int64_t) {});
  std::future<void> waiting =
      std::async(std::launch::async, [&] { EXPECT_THROW(thread.call([](int64_t) { return 1; }), std::future_error); });
  std::future<void> stopping = std::async(std::launch::async, [&] { thread.stop(); });
  // While another is at work, what waits is dropped, and who calls is told.
  constexpr std::chrono::seconds PATIENCE(30);
  EXPECT_EQ(std::future_status::ready, dropped.get_future().wait_for(PATIENCE));
  EXPECT_EQ(std::future_status::ready, waiting.wait_for(PATIENCE));
  leave.set_value();
  stopping.wait();
  EXPECT_THROW(thread.call([](int64_t) { return 1; }), std::future_error);
}

}  // namespace
}  // namespace pi_offload
