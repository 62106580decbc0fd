// Decisions run on the runtime's units, are told by them in their table, and never wait long for other work.

#include <gtest/gtest.h>
#include "ros/recognizer_tasks.h"

#include <algorithm>
#include <future>
#include <memory>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

namespace pi_speech
{
namespace
{

/// Never reached in a test that passes.
constexpr std::chrono::seconds LONG_WAIT{30};

/// One unit, so that what occupies it is in the way of everything.
pi_runtime::RuntimeOptions oneUnit()
{
  pi_runtime::RuntimeOptions options;
  options.cpu_units = {1};
  options.opencl_cpu = false;
  options.opencl_gpu = false;
  options.arbitration = false;
  options.cache_folder = "";
  options.trace_capacity = 100;
  return options;
}

class RecognizerTasksTest : public testing::Test
{
protected:
  const std::shared_ptr<pi_runtime::Runtime> runtime_ = std::make_shared<pi_runtime::Runtime>(oneUnit());
  std::vector<std::string> errors_;
  RecognizerTasks tasks_{runtime_, [this](const std::string& text) { errors_.push_back(text); }, LONG_WAIT};
};

/// A task that holds a unit until it is told to end, as the network of a picture.
class OtherWork
{
public:
  explicit OtherWork(pi_runtime::Runtime* runtime)
  {
    pi_runtime::Codelet codelet;
    codelet.name = "other_work";
    pi_runtime::NativeImplementation native;
    native.function = [this](const pi_runtime::NativeCall&)
    {
      begun_.set_value();
      end_.get_future().wait();
    };
    codelet.native = {std::move(native)};
    pi_runtime::TaskRequest task;
    task.codelet = pi_runtime::makeCodelet(std::move(codelet));
    handle_ = runtime->submit(std::move(task));
    begun_.get_future().wait();
  }
  ~OtherWork()
  {
    end_.set_value();
    handle_.wait();
  }
  OtherWork(const OtherWork&) = delete;
  OtherWork& operator=(const OtherWork&) = delete;
  bool runs() const { return !handle_.ready(); }

private:
  std::promise<void> begun_;
  std::promise<void> end_;
  pi_runtime::TaskHandle handle_;
};

TEST_F(RecognizerTasksTest, WorkRunsOnAUnitWithItsOwnEntryAndADeadline)
{
  std::thread::id ran_on;
  int runs = 0;
  const auto work = [&]
  {
    ran_on = std::this_thread::get_id();
    ++runs;
  };
  tasks_.run(0.5, work);
  EXPECT_EQ(1, runs);
  EXPECT_NE(std::this_thread::get_id(), ran_on);
  tasks_.run(0.5, work);
  tasks_.run(0.5, work);
  tasks_.run(2.0, work);
  EXPECT_EQ(4, runs);
  EXPECT_EQ(4u, tasks_.figures().tasks);
  EXPECT_EQ(0u, tasks_.figures().taken_back + tasks_.figures().failed);
  EXPECT_GT(tasks_.figures().cpu_s, 0.0);
  EXPECT_EQ(runtime_->units().front().name, tasks_.figures().unit);

  std::vector<uint64_t> counts;
  for (const pi_runtime::EtcTable::Entry& entry : runtime_->etcEntries())
  {
    if (entry.codelet == RecognizerTasks::CODELET)
    {
      counts.push_back(entry.cell.count);
      EXPECT_EQ(pi_runtime::EtcTable::sizeBucket(counts.size() == 1 ? 500.0 : 2000.0), entry.bucket);
    }
  }
  EXPECT_EQ((std::vector<uint64_t>{2, 1}), counts);  // the first run of all is not learned from
  const std::vector<pi_runtime::TaskTrace> trace = runtime_->trace().snapshot();
  ASSERT_EQ(4u, trace.size());
  for (const pi_runtime::TaskTrace& record : trace)
  {
    EXPECT_EQ(RecognizerTasks::CODELET, record.codelet);
    EXPECT_EQ(record.submitted_ns + std::chrono::nanoseconds(RecognizerTasks::DEADLINE).count(), record.deadline_ns);
  }
}

TEST_F(RecognizerTasksTest, WorkDoesNotWaitBehindOtherWork)
{
  RecognizerTasks tasks{runtime_, [](const std::string&) {}};
  int runs = 0;
  std::thread::id ran_on;
  {
    const OtherWork network(runtime_.get());
    tasks.run(0.5,
              [&]
              {
                ran_on = std::this_thread::get_id();
                ++runs;
              });
    EXPECT_TRUE(network.runs());
  }
  EXPECT_EQ(1, runs);
  EXPECT_EQ(std::this_thread::get_id(), ran_on);
  EXPECT_EQ(1u, tasks.figures().taken_back);
  EXPECT_EQ(0u, tasks.figures().failed);
  // Nothing is left of it.
  tasks_.run(0.5, [&] { ++runs; });
  EXPECT_EQ(2, runs);
  EXPECT_EQ(1u, tasks_.figures().tasks);
  EXPECT_EQ(1u, runtime_->statistics().cancelled);
}

TEST_F(RecognizerTasksTest, WorkThatTakesLongerThanThePatienceIsDoneOnce)
{
  using Clock = std::chrono::steady_clock;
  constexpr std::chrono::milliseconds PATIENCE{50};
  RecognizerTasks tasks{runtime_, [](const std::string&) {}, PATIENCE};
  int runs = 0;
  tasks.run(0.5,
            [&]
            {
              const Clock::time_point end = Clock::now() + 3 * PATIENCE;
              while (Clock::now() < end)
              {
              }
              ++runs;
            });
  EXPECT_EQ(1, runs);
  // A busy computer may begin too late.
  EXPECT_EQ(1u, tasks.figures().tasks + tasks.figures().taken_back);
}

TEST_F(RecognizerTasksTest, TaskThatFailsIsToldAndTheWorkDoneAllTheSame)
{
  int runs = 0;
  tasks_.run(0.5,
             [&]
             {
               if (++runs == 1)
               {
                 throw std::runtime_error("out of memory");
               }
             });
  EXPECT_EQ(2, runs);
  EXPECT_EQ(1u, tasks_.figures().failed);
  ASSERT_EQ(1u, errors_.size());
  EXPECT_NE(std::string::npos, errors_[0].find("speech_decode: ")) << errors_[0];
  EXPECT_NE(std::string::npos, errors_[0].find("out of memory; decided without the runtime")) << errors_[0];

  // No unit is left.
  runtime_->setUnitAvailable(runtime_->units().front().name, false);
  tasks_.run(0.5, [&] { ++runs; });
  EXPECT_EQ(3, runs);
  ASSERT_EQ(2u, errors_.size());
  EXPECT_NE(std::string::npos, errors_[1].find("speech_decode: unit failed: no unit is left")) << errors_[1];
  EXPECT_THROW(tasks_.run(0.5, [] { throw std::logic_error("always"); }), std::logic_error);
}

}  // namespace
}  // namespace pi_speech
