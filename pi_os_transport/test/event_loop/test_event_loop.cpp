#include "event_loop/event_loop.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <array>
#include <memory>
#include <string>
#include <thread>
#include <vector>

namespace pi_os_transport
{
namespace
{

using std::chrono::milliseconds;

constexpr milliseconds LONG{20000};
constexpr milliseconds NOT_AT_ALL{0};

struct Pipe
{
  Pipe()
  {
    std::array<int, 2> ends;
    EXPECT_EQ(0, pipe(ends.data()));
    out = FileDescriptor(ends[0]);
    in = FileDescriptor(ends[1]);
  }
  void fill() const { EXPECT_EQ(1, write(in.get(), "x", 1)); }
  void drain() const
  {
    char byte;
    EXPECT_EQ(1, read(out.get(), &byte, 1));
  }

  FileDescriptor out;
  FileDescriptor in;
};

TEST(EventLoop, CallsADescriptorWhileItIsReady)
{
  EventLoop loop;
  const Pipe pipe;
  std::vector<uint32_t> events;
  loop.add(pipe.out.get(), EPOLLIN, [&](uint32_t event) { events.push_back(event); });
  loop.runOnce(NOT_AT_ALL);
  EXPECT_TRUE(events.empty());
  pipe.fill();
  loop.runOnce(LONG);
  loop.runOnce(LONG);
  EXPECT_EQ((std::vector<uint32_t>{EPOLLIN, EPOLLIN}), events);
  pipe.drain();
  loop.runOnce(NOT_AT_ALL);
  EXPECT_EQ(2U, events.size());
  loop.remove(pipe.out.get());
}

TEST(EventLoop, AlwaysTellsThatTheOtherEndHasGone)
{
  EventLoop loop;
  Pipe pipe;
  uint32_t events = 0;
  loop.add(pipe.out.get(), 0, [&](uint32_t event) { events = event; });
  pipe.in.reset();
  loop.runOnce(LONG);
  EXPECT_EQ(static_cast<uint32_t>(EPOLLHUP), events);
  loop.remove(pipe.out.get());
}

TEST(EventLoop, ChangesWhatItWaitsFor)
{
  EventLoop loop;
  const Pipe pipe;
  int calls = 0;
  loop.add(pipe.out.get(), 0, [&](uint32_t) { ++calls; });
  pipe.fill();
  loop.runOnce(NOT_AT_ALL);
  EXPECT_EQ(0, calls);
  loop.change(pipe.out.get(), EPOLLIN);
  loop.runOnce(LONG);
  EXPECT_EQ(1, calls);
  loop.change(pipe.out.get(), 0);
  loop.runOnce(NOT_AT_ALL);
  EXPECT_EQ(1, calls);
  loop.remove(pipe.out.get());
  loop.change(pipe.out.get(), EPOLLIN);
  loop.runOnce(NOT_AT_ALL);
  EXPECT_EQ(1, calls);
}

TEST(EventLoop, ADescriptorMayRemoveItselfFromItsCallback)
{
  EventLoop loop;
  const Pipe pipe;
  pipe.fill();
  std::string said;
  // Long enough to lie on the heap: the callback must not be freed while it runs.
  const std::string word = "a text that is longer than what a string keeps within itself";
  loop.add(pipe.out.get(), EPOLLIN,
           [&loop, &said, fd = pipe.out.get(), word](uint32_t)
           {
             loop.remove(fd);
             said += word;
           });
  loop.runOnce(LONG);
  loop.runOnce(NOT_AT_ALL);
  EXPECT_EQ(word, said);
}

TEST(EventLoop, ADescriptorRemovedInARoundIsNotCalledInIt)
{
  EventLoop loop;
  const std::array<Pipe, 2> pipes;
  int calls = 0;
  for (size_t index : {0, 1})
  {
    pipes[index].fill();
    loop.add(pipes[index].out.get(), EPOLLIN,
             [&, index](uint32_t)
             {
               ++calls;
               loop.remove(pipes[1 - index].out.get());
             });
  }
  loop.runOnce(LONG);
  EXPECT_EQ(1, calls);
  loop.remove(pipes[0].out.get());
  loop.remove(pipes[1].out.get());
}

TEST(EventLoop, AnEventIsNotTakenForOneOfASuccessorWithTheSameNumber)
{
  EventLoop loop;
  const std::array<Pipe, 2> pipes;
  const Pipe successor;
  int calls = 0;
  int successor_calls = 0;
  for (size_t index : {0, 1})
  {
    pipes[index].fill();
    loop.add(pipes[index].out.get(), EPOLLIN,
             [&, index](uint32_t)
             {
               ++calls;
               const int number = pipes[1 - index].out.get();
               loop.remove(pipes[index].out.get());
               loop.remove(number);
               ASSERT_EQ(number, dup2(successor.out.get(), number));
               loop.add(number, EPOLLIN,
                        [&, number](uint32_t)
                        {
                          ++successor_calls;
                          loop.remove(number);
                        });
             });
  }
  loop.runOnce(LONG);
  EXPECT_EQ(1, calls);
  EXPECT_EQ(0, successor_calls);
  successor.fill();
  loop.runOnce(LONG);
  EXPECT_EQ(1, calls);
  EXPECT_EQ(1, successor_calls);
}

TEST(EventLoop, CallsTimersInOrderAndNotTooEarly)
{
  EventLoop loop;
  const SteadyTime start = SteadyClock::now();
  std::vector<int> order;
  for (const int delay_ms : {60, 20, 40})
  {
    loop.at(start + milliseconds(delay_ms), [&, delay_ms] { order.push_back(delay_ms); });
  }
  while (order.size() < 3 && SteadyClock::now() < start + LONG)
  {
    loop.runOnce(LONG);
    ASSERT_FALSE(order.empty());
    EXPECT_GE(SteadyClock::now(), start + milliseconds(order.back()));
  }
  EXPECT_EQ((std::vector<int>{20, 40, 60}), order);
}

TEST(EventLoop, CallsTimersOfTheSameTimeInTheOrderTheyWereSet)
{
  EventLoop loop;
  const SteadyTime time = SteadyClock::now();
  std::vector<int> order;
  for (int number = 0; number < 5; ++number)
  {
    loop.at(time, [&, number] { order.push_back(number); });
  }
  loop.runOnce(LONG);
  EXPECT_EQ((std::vector<int>{0, 1, 2, 3, 4}), order);
}

TEST(EventLoop, CallsATimerOnce)
{
  EventLoop loop;
  int calls = 0;
  loop.at(SteadyClock::now(), [&] { ++calls; });
  loop.runOnce(LONG);
  loop.runOnce(NOT_AT_ALL);
  EXPECT_EQ(1, calls);
}

TEST(EventLoop, DoesNotCallWhatWasCancelled)
{
  EventLoop loop;
  std::string called;
  const SteadyTime now = SteadyClock::now();
  const EventLoop::TimerId first = loop.at(now, [&] { called += '1'; });
  EventLoop::TimerId third = 0;
  const EventLoop::TimerId second = loop.at(now,
                                            [&]
                                            {
                                              called += '2';
                                              loop.cancel(third);
                                            });
  third = loop.at(now, [&] { called += '3'; });
  EXPECT_NE(0U, first);
  loop.cancel(first);
  loop.runOnce(LONG);
  loop.runOnce(NOT_AT_ALL);
  EXPECT_EQ("2", called);
  loop.cancel(second);  // gone already
  loop.cancel(0);
}

TEST(EventLoop, ATimerMaySetAnother)
{
  EventLoop loop;
  Timer timer;
  int calls = 0;
  std::function<void()> again = [&]
  {
    EXPECT_FALSE(timer.running());
    if (++calls < 3)
    {
      timer.start(&loop, milliseconds(1), again);
    }
  };
  timer.start(&loop, milliseconds(1), again);
  EXPECT_TRUE(timer.running());
  const SteadyTime deadline = SteadyClock::now() + LONG;
  while (calls < 3 && SteadyClock::now() < deadline)
  {
    loop.runOnce(LONG);
  }
  EXPECT_EQ(3, calls);
}

TEST(EventLoop, ATimerIsCancelledByItsNextStartAndByItsEnd)
{
  EventLoop loop;
  std::string called;
  Timer timer;
  timer.start(&loop, NOT_AT_ALL, [&] { called += '1'; });
  timer.start(&loop, NOT_AT_ALL, [&] { called += '2'; });
  Timer stopped;
  stopped.start(&loop, NOT_AT_ALL, [&] { called += '3'; });
  stopped.stop();
  stopped.stop();
  auto gone = std::make_unique<Timer>();
  gone->start(&loop, NOT_AT_ALL, [&] { called += '4'; });
  gone.reset();
  auto ends_itself = std::make_unique<Timer>();
  ends_itself->start(&loop, NOT_AT_ALL,
                     [&]
                     {
                       called += '5';
                       ends_itself.reset();
                     });
  loop.runOnce(LONG);
  EXPECT_EQ("25", called);
  EXPECT_FALSE(timer.running() || stopped.running());
}

TEST(EventLoop, DefersUntilTheCallbacksOfTheRoundAreDone)
{
  EventLoop loop;
  const std::array<Pipe, 2> pipes;
  std::string order;
  for (const Pipe& pipe : pipes)
  {
    pipe.fill();
    loop.add(pipe.out.get(), EPOLLIN,
             [&](uint32_t)
             {
               order += 'r';
               loop.defer([&] { order += 'd'; });
             });
  }
  loop.at(SteadyClock::now(), [&] { order += 't'; });
  loop.runOnce(LONG);
  EXPECT_EQ("rrtdd", order);
  loop.remove(pipes[0].out.get());
  loop.remove(pipes[1].out.get());
}

TEST(EventLoop, DoesNotWaitWhileSomethingIsDeferred)
{
  EventLoop loop;
  std::string order;
  loop.defer(
      [&]
      {
        order += '1';
        loop.defer([&] { order += '2'; });
      });
  const SteadyTime start = SteadyClock::now();
  loop.runOnce(LONG);
  EXPECT_EQ("1", order);
  loop.runOnce(LONG);
  EXPECT_EQ("12", order);
  EXPECT_LT(SteadyClock::now(), start + LONG / 2);
}

TEST(EventLoop, StopsFromAnotherThread)
{
  EventLoop loop;
  bool running = false;
  std::thread stopper;
  loop.defer(
      [&]
      {
        running = true;
        stopper = std::thread([&] { loop.stop(); });
      });
  const SteadyTime start = SteadyClock::now();
  loop.run();
  EXPECT_TRUE(running);
  EXPECT_LT(SteadyClock::now(), start + LONG);
  stopper.join();
}

TEST(EventLoop, StoppedBeforeItRunsReturnsAtOnce)
{
  EventLoop loop;
  loop.stop();
  loop.stop();
  const SteadyTime start = SteadyClock::now();
  loop.run();
  EXPECT_LT(SteadyClock::now(), start + LONG);
}

}  // namespace
}  // namespace pi_os_transport
