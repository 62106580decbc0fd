#pragma once

#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include <pi_runtime/executor.h>
#include <pi_runtime/opencl.h>
#include <pi_runtime/opencl_command.h>

namespace pi_runtime
{

/// Runs OpenCL implementations on one device or sub-device of a context.
class OpenClExecutor : public Executor
{
public:
  /// @param device  index in the context.
  /// @param cache_folder  see OpenClProgram.
  /// @throws OpenClError
  OpenClExecutor(std::shared_ptr<OpenClContext> context, size_t device, std::string cache_folder);
  ~OpenClExecutor() override;

  const char* name() const override { return "opencl"; }
  bool supports(const Codelet& codelet) const override { return !codelet.opencl.empty(); }
  bool asynchronous() const override { return true; }
  bool ready(const Execution& execution) const override;
  void prepare(const CodeletPtr& codelet) override;
  bool compiles() const override { return true; }
  double tryOut(const Execution& execution) override;
  void start(const Execution& execution, Completion completion) override;
  const MemorySpace* memory() const override { return space_.get(); }
  double measureBandwidth() override;

private:
  struct Prepared
  {
    CodeletPtr codelet;  ///< held, so that no other can take its address
    std::unique_ptr<OpenClProgram> program;
  };
  OpenClProgram* find(const CodeletPtr& codelet) const;
  cl_mem memoryOf(Buffer& buffer, Access access, ExecutionReport* report);
  void enqueue(const Execution& execution, ExecutionReport* report, ClEvent* finished);

  const std::shared_ptr<OpenClContext> context_;
  const size_t device_;
  const std::string cache_folder_;
  const ClQueue queue_;
  const std::shared_ptr<MemorySpace> space_;  ///< null where memory is the host's
  std::vector<cl_mem> memory_;                ///< of the execution that is being started
  mutable std::mutex mutex_;                  ///< guards prepared_
  std::map<std::string, Prepared> prepared_;
};

}  // namespace pi_runtime
