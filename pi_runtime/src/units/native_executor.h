#pragma once

#include <pi_runtime/executor.h>

namespace pi_runtime
{

/// Calls native functions on the thread that starts them, which is the unit's.
class NativeExecutor : public Executor
{
public:
  /// @param type  of the unit: functions for other types are not run.
  explicit NativeExecutor(UnitType type) : type_(type) {}

  const char* name() const override { return "native"; }
  bool supports(const Codelet& codelet) const override;
  bool asynchronous() const override { return false; }
  bool ready(const Execution&) const override { return true; }
  void prepare(const CodeletPtr&) override {}
  void start(const Execution& execution, Completion completion) override;
  double measureBandwidth() override;

private:
  const UnitType type_;
};

}  // namespace pi_runtime
