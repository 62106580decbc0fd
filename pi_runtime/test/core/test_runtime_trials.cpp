// Executors that compile are tried in the background, never on a user's task.

#include <gtest/gtest.h>
#include "core/fake_executor.h"

#include <algorithm>
#include <future>
#include <string>
#include <thread>
#include <vector>

namespace pi_runtime
{
namespace
{

/// What the trial of "work" was given, and when it ends. Trials of other codelets end at once.
struct Trials
{
  Event begun;
  Event others_begun;
  std::promise<double> seconds;  ///< what the trial returns, or throws
  std::vector<uint8_t> content;  ///< of the first argument
  uint8_t value = 0;             ///< the second one
  std::thread::id thread;
  std::atomic<int> count{0};
};

class CompilingExecutor : public FakeExecutor
{
public:
  CompilingExecutor(std::shared_ptr<FakeDevice> device, std::shared_ptr<Trials> trials)
    : FakeExecutor(std::move(device), nullptr, "compiled"), trials_(std::move(trials))
  {
  }
  bool compiles() const override { return true; }
  double tryOut(const Execution& execution) override
  {
    ++trials_->count;
    if (execution.codelet->name != "work")
    {
      trials_->others_begun.set();
      return 1.0;
    }
    trials_->thread = std::this_thread::get_id();
    const BufferPtr& buffer = execution.arguments[0].buffer();
    const auto* data = static_cast<const uint8_t*>(buffer->address());
    trials_->content.assign(data, data + buffer->bytes());
    trials_->value = *static_cast<const uint8_t*>(execution.arguments[1].valueData());
    trials_->begun.set();
    return trials_->seconds.get_future().get();
  }

private:
  const std::shared_ptr<Trials> trials_;
};

class RuntimeTrials : public testing::Test
{
protected:
  RuntimeTrials() { start(""); }
  ~RuntimeTrials() override { runtime_.reset(); }

  void start(const std::string& etc_file)
  {
    runtime_.reset();
    RuntimeOptions options = FakeRuntime::fakeOptions();
    options.etc_file = etc_file;
    options.log = [this](LogLevel, const std::string& text)
    {
      warning_ = text;
      warned_.set();
    };
    std::vector<CustomUnit> units(1);
    units[0].name = "unit";
    units[0].executors.push_back(std::make_unique<FakeExecutor>(plain_, nullptr, "plain"));
    units[0].executors.push_back(std::make_unique<CompilingExecutor>(compiled_, trials_));
    runtime_.emplace(options, std::move(units));
    const auto good = [](const FakeDevice::Start&) { return ExecutionReport(); };
    plain_->serveAll(good);
    compiled_->serveAll(good);
  }
  std::string executorOfNext(bool deadline = false)
  {
    TaskRequest request = requestOf(codelet_);
    request.arguments = {Argument::in(Buffer::wrap(user_data_.data(), user_data_.size())), Argument::value(uint8_t{7})};
    if (deadline)
    {
      request.deadline = std::chrono::hours(1);
    }
    const TaskHandle task = runtime_->submit(request);
    EXPECT_TRUE(task.wait().ok()) << task.wait().message;
    return task.wait().executor;
  }
  void setTime(const std::string& column, double seconds)
  {
    runtime_->setEtcEntries({{"work", EtcTable::sizeBucket(1.0), column, {10, seconds, 0.0}}});
  }
  /// Trials are done one after the other, so the first one has ended when a second one begins.
  void awaitEndOfTrial()
  {
    EXPECT_TRUE(runtime_->submit(requestOf(fakeCodelet("next"))).wait().ok());
    EXPECT_TRUE(trials_->others_begun.wait());
  }

  const CodeletPtr codelet_ = fakeCodelet("work");
  std::vector<uint8_t> user_data_{1, 2, 3};
  std::shared_ptr<FakeDevice> plain_ = std::make_shared<FakeDevice>();
  std::shared_ptr<FakeDevice> compiled_ = std::make_shared<FakeDevice>();
  std::shared_ptr<Trials> trials_ = std::make_shared<Trials>();
  std::string warning_;
  Event warned_;
  std::optional<Runtime> runtime_;
};

TEST_F(RuntimeTrials, NoTaskWaitsForACompilationThatAnotherExecutorDoesNotNeed)
{
  EXPECT_EQ("plain", executorOfNext());
  ASSERT_TRUE(trials_->begun.wait());
  // The trial lasts: whatever comes meanwhile runs without it, with a deadline and without.
  for (int task = 0; task < 20; ++task)
  {
    EXPECT_EQ("plain", executorOfNext(task % 2 == 0));
  }
  EXPECT_EQ(0u, compiled_->started());
  EXPECT_EQ(1, trials_->count);
  setTime("unit/plain", 1.0);
  trials_->seconds.set_value(1e-3);
  awaitEndOfTrial();
  EXPECT_EQ("compiled", executorOfNext()) << "it is known to be faster now";
  EXPECT_EQ("compiled", executorOfNext(true));
}

TEST_F(RuntimeTrials, TrialsUseMemoryOfTheirOwnAndTheValuesOfTheTask)
{
  executorOfNext();
  user_data_ = {};  // the caller's memory is gone
  ASSERT_TRUE(trials_->begun.wait());
  EXPECT_EQ((std::vector<uint8_t>{0, 0, 0}), trials_->content);
  EXPECT_EQ(7, trials_->value);
  EXPECT_NE(std::this_thread::get_id(), trials_->thread);
  trials_->seconds.set_value(0.25);
  awaitEndOfTrial();
  const std::vector<EtcTable::Entry> entries = runtime_->etcEntries();
  EXPECT_EQ(1, std::count_if(entries.begin(), entries.end(),
                             [](const EtcTable::Entry& entry) {
                               return entry.codelet == "work" && entry.column == "unit/compiled" &&
                                      entry.cell.mean_s == 0.25;
                             }));
}

TEST_F(RuntimeTrials, WhatAKeptTableKnowsToBeSlowerIsNotTried)
{
  setTime("unit/plain", 1e-3);
  setTime("unit/compiled", 2e-3);
  EXPECT_EQ("plain", executorOfNext());
  awaitEndOfTrial();
  EXPECT_EQ(1, trials_->count) << "that of the codelet that nothing is known of";
}

TEST_F(RuntimeTrials, WhatAKeptTableKnowsToBeFasterIsCompiledInTheBackgroundFirst)
{
  setTime("unit/plain", 2e-3);
  setTime("unit/compiled", 1e-3);
  EXPECT_EQ("plain", executorOfNext());
  ASSERT_TRUE(trials_->begun.wait());
  EXPECT_EQ("plain", executorOfNext(true));
  trials_->seconds.set_value(5.0);  // counts for nothing beside real runs
  awaitEndOfTrial();
  EXPECT_EQ("compiled", executorOfNext());
}

TEST_F(RuntimeTrials, AnExecutorWhoseTrialFailsIsNotUsed)
{
  executorOfNext();
  ASSERT_TRUE(trials_->begun.wait());
  trials_->seconds.set_exception(std::make_exception_ptr(std::runtime_error("no such kernel")));
  ASSERT_TRUE(warned_.wait());
  EXPECT_EQ("codelet work does not build on unit unit and is not run by compiled there: no such kernel", warning_);
  awaitEndOfTrial();
  EXPECT_EQ("plain", executorOfNext());
  EXPECT_EQ(2, trials_->count) << "not tried again";
}

TEST_F(RuntimeTrials, WhatOnlyACompilerCanRunIsRunAtOnce)
{
  runtime_.reset();
  std::vector<CustomUnit> units(1);
  units[0].name = "unit";
  units[0].executors.push_back(std::make_unique<CompilingExecutor>(compiled_, trials_));
  runtime_.emplace(FakeRuntime::fakeOptions(), std::move(units));
  EXPECT_EQ("compiled", executorOfNext());
  EXPECT_EQ(0, trials_->count);
}

TEST_F(RuntimeTrials, TheRuntimeEndsAfterATrialThatIsUnderWay)
{
  executorOfNext();
  ASSERT_TRUE(trials_->begun.wait());
  auto ending = std::async(std::launch::async, [this] { runtime_.reset(); });
  trials_->seconds.set_value(1.0);
  EXPECT_EQ(std::future_status::ready, ending.wait_for(LONG_WAIT));
}

}  // namespace
}  // namespace pi_runtime
