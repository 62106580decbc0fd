#pragma once

#include <chrono>
#include <future>
#include <memory>
#include <thread>
#include <utility>

#include <pi_runtime/executor.h>

namespace pi_runtime
{

/// Makes an executor look slower than it is: each execution keeps the unit (factor - 1) times as long again.
class SlowExecutor : public Executor
{
public:
  SlowExecutor(std::unique_ptr<Executor> inner, double factor) : inner_(std::move(inner)), factor_(factor) {}

  const char* name() const override { return inner_->name(); }
  bool supports(const Codelet& codelet) const override { return inner_->supports(codelet); }
  bool asynchronous() const override { return false; }
  bool ready(const Execution& execution) const override { return inner_->ready(execution); }
  void prepare(const CodeletPtr& codelet) override { inner_->prepare(codelet); }
  bool compiles() const override { return inner_->compiles(); }
  double tryOut(const Execution& execution) override { return factor_ * inner_->tryOut(execution); }
  const MemorySpace* memory() const override { return inner_->memory(); }
  double measureBandwidth() override { return inner_->measureBandwidth(); }

  void start(const Execution& execution, Completion completion) override
  {
    const auto begin = std::chrono::steady_clock::now();
    std::promise<ExecutionReport> promise;
    inner_->start(execution, [&promise](const ExecutionReport& report) { promise.set_value(report); });
    const ExecutionReport report = promise.get_future().get();
    std::this_thread::sleep_for((std::chrono::steady_clock::now() - begin) * (factor_ - 1.0));
    completion(report);
  }

private:
  const std::unique_ptr<Executor> inner_;
  const double factor_;
};

}  // namespace pi_runtime
