#pragma once

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <limits>
#include <memory>
#include <mutex>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include <pi_runtime/runtime.h>

namespace pi_runtime
{

/// Never reached in a test that passes.
constexpr std::chrono::seconds LONG_WAIT{30};

/// What the test holds of a unit whose executions end when and how the test says. Thread safe.
class FakeDevice
{
public:
  struct Start
  {
    std::string codelet;
    uint64_t begin;
    uint64_t end;
  };

  /// The next execution that the runtime has started; waits for it.
  Start awaitStart()
  {
    std::unique_lock<std::mutex> lock(mutex_);
    if (!changed_.wait_for(lock, LONG_WAIT, [this] { return looked_at_ < starts_.size(); }))
    {
      throw std::runtime_error("the runtime starts nothing on this unit");
    }
    return starts_[looked_at_++];
  }
  /// Ends the oldest execution that runs; waits for one.
  void finish(const ExecutionReport& report = ExecutionReport())
  {
    std::unique_lock<std::mutex> lock(mutex_);
    if (!changed_.wait_for(lock, LONG_WAIT, [this] { return !open_.empty(); }))
    {
      throw std::runtime_error("nothing runs on this unit that could be finished");
    }
    const Executor::Completion completion = std::move(open_.front().completion);
    open_.pop_front();
    lock.unlock();
    completion(report);
  }
  void fail(Outcome outcome, const std::string& message)
  {
    ExecutionReport report;
    report.outcome = outcome;
    report.message = message;
    finish(report);
  }
  /// Waits for an execution, ends it well and tells which it was.
  Start serve()
  {
    const Start start = awaitStart();
    finish();
    return start;
  }
  /// From now on executions end by themselves inside of start(), with what `answer` returns.
  void serveAll(std::function<ExecutionReport(const Start&)> answer)
  {
    std::lock_guard<std::mutex> lock(mutex_);
    answer_ = std::move(answer);
  }
  /// True if the oldest execution that runs has been told that nobody wants it any more.
  bool cancelled() const
  {
    std::lock_guard<std::mutex> lock(mutex_);
    return !open_.empty() && open_.front().cancelled->load();
  }
  size_t started() const
  {
    std::lock_guard<std::mutex> lock(mutex_);
    return starts_.size();
  }
  size_t running() const
  {
    std::lock_guard<std::mutex> lock(mutex_);
    return open_.size();
  }

private:
  friend class FakeExecutor;
  struct Open
  {
    Executor::Completion completion;
    const std::atomic<bool>* cancelled;
  };

  void start(const Execution& execution, Executor::Completion completion)
  {
    std::unique_lock<std::mutex> lock(mutex_);
    const Start start{execution.codelet->name, execution.begin, execution.end};
    starts_.push_back(start);
    if (answer_)
    {
      const auto answer = answer_;
      lock.unlock();
      completion(answer(start));
      return;
    }
    open_.push_back(Open{std::move(completion), execution.cancelled});
    changed_.notify_all();
  }

  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::vector<Start> starts_;
  size_t looked_at_ = 0;
  std::deque<Open> open_;
  std::function<ExecutionReport(const Start&)> answer_;
};

/// Runs nothing: hands each execution to a FakeDevice. By default the submitting thread starts it.
class FakeExecutor : public Executor
{
public:
  using Filter = std::function<bool(const Codelet&)>;
  explicit FakeExecutor(std::shared_ptr<FakeDevice> device, Filter supported = nullptr, std::string name = "fake")
    : device_(std::move(device)), supported_(std::move(supported)), name_(std::move(name))
  {
  }

  const char* name() const override { return name_.c_str(); }
  bool supports(const Codelet& codelet) const override { return !supported_ || supported_(codelet); }
  bool asynchronous() const override { return true; }
  bool ready(const Execution&) const override { return true; }
  void prepare(const CodeletPtr&) override {}
  void start(const Execution& execution, Completion completion) override
  {
    device_->start(execution, std::move(completion));
  }
  double measureBandwidth() override { return std::numeric_limits<double>::infinity(); }

private:
  const std::shared_ptr<FakeDevice> device_;
  const Filter supported_;
  const std::string name_;
};

/// A runtime whose units "fake0", "fake1"... are fakes, and what it says.
class FakeRuntime
{
public:
  explicit FakeRuntime(size_t units, const std::function<void(RuntimeOptions&)>& change = nullptr,
                       const std::vector<FakeExecutor::Filter>& supported = {})
  {
    RuntimeOptions options = fakeOptions();
    options.log = [this](LogLevel, const std::string& text)
    {
      std::lock_guard<std::mutex> lock(log_mutex_);
      log_.push_back(text);
      logged_.notify_all();
    };
    if (change)
    {
      change(options);
    }
    std::vector<CustomUnit> custom;
    for (size_t i = 0; i < units; ++i)
    {
      devices_.push_back(std::make_shared<FakeDevice>());
      CustomUnit unit;
      unit.name = "fake" + std::to_string(i);
      unit.executors.push_back(
          std::make_unique<FakeExecutor>(devices_.back(), i < supported.size() ? supported[i] : nullptr));
      custom.push_back(std::move(unit));
    }
    runtime_.emplace(options, std::move(custom));
  }

  /// No unit but those that the test brings, alone in the world.
  static RuntimeOptions fakeOptions()
  {
    RuntimeOptions options;
    options.native = false;
    options.opencl_cpu = false;
    options.opencl_gpu = false;
    options.arbitration = false;
    options.preemption = false;
    options.cache_folder.clear();
    return options;
  }

  Runtime* operator->() { return &*runtime_; }
  FakeDevice& device(size_t unit) { return *devices_[unit]; }
  std::shared_ptr<FakeDevice> sharedDevice(size_t unit) { return devices_[unit]; }
  /// Ends the runtime.
  void stop() { runtime_.reset(); }

  /// Makes the ETC table say that the codelet, with a range of 1, takes so long on the units.
  void setTimes(const CodeletPtr& codelet, const std::vector<double>& seconds, double size = 1.0)
  {
    std::vector<EtcTable::Entry> entries;
    for (size_t unit = 0; unit < seconds.size(); ++unit)
    {
      EtcTable::Cell cell;
      cell.count = 10;
      cell.mean_s = seconds[unit];
      entries.push_back({codelet->name, EtcTable::sizeBucket(size), "fake" + std::to_string(unit) + "/fake", cell});
    }
    runtime_->setEtcEntries(entries);
  }

  std::vector<std::string> log() const
  {
    std::lock_guard<std::mutex> lock(log_mutex_);
    return log_;
  }
  /// How many lines have the text in them.
  size_t logged(const std::string& text) const
  {
    std::lock_guard<std::mutex> lock(log_mutex_);
    return count(text);
  }
  /// Waits for such a line.
  bool awaitLog(const std::string& text) const
  {
    std::unique_lock<std::mutex> lock(log_mutex_);
    return logged_.wait_for(lock, LONG_WAIT, [&] { return count(text) != 0; });
  }

private:
  size_t count(const std::string& text) const
  {
    size_t lines = 0;
    for (const std::string& line : log_)
    {
      lines += line.find(text) != std::string::npos ? 1 : 0;
    }
    return lines;
  }

  mutable std::mutex log_mutex_;
  mutable std::condition_variable logged_;
  std::vector<std::string> log_;
  std::vector<std::shared_ptr<FakeDevice>> devices_;
  std::optional<Runtime> runtime_;
};

/// A codelet for fakes; its native function is never called by them.
inline CodeletPtr fakeCodelet(const std::string& name, bool sliceable = false)
{
  Codelet codelet;
  codelet.name = name;
  codelet.native = {{[](const NativeCall&) {}, ANY_UNIT_TYPE}};
  codelet.sliceable = sliceable;
  return makeCodelet(std::move(codelet));
}

inline TaskRequest requestOf(const CodeletPtr& codelet, const std::string& unit = "")
{
  TaskRequest request;
  request.codelet = codelet;
  request.unit = unit;
  return request;
}

/// One bit for the threads of a test to wait on.
class Event
{
public:
  void set()
  {
    std::lock_guard<std::mutex> lock(mutex_);
    set_ = true;
    changed_.notify_all();
  }
  /// @return false if it did not come.
  bool wait()
  {
    std::unique_lock<std::mutex> lock(mutex_);
    return changed_.wait_for(lock, LONG_WAIT, [this] { return set_; });
  }

private:
  std::mutex mutex_;
  std::condition_variable changed_;
  bool set_ = false;
};

}  // namespace pi_runtime
