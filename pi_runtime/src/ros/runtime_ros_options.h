#pragma once

#include <pi_node/ros/node_parameters.h>
#include <pi_runtime/runtime_options.h>
#include <ros/node_handle.h>

#include <string>
#include <vector>

namespace pi_runtime
{

/// The parameters of the runtime node; config/runtime.yaml shows each with its unit.
struct RuntimeRosOptions : pi_node::NodeParameters<RuntimeRosOptions>
{
  RuntimeOptions runtime;

  /// Without OpenCL on the CPU: PoCL takes 70 MB, and no codelet of this package is faster by it.
  RuntimeRosOptions() { runtime.opencl_cpu = false; }

  int max_tasks = 256;             ///< that came as messages or by service and have not ended
  int max_task_memory_mb = 512;    ///< arguments of open tasks and outputs in kept reports [MiB]
  int max_kept_buffer_mb = 512;    ///< buffers kept under names [MiB]
  int max_kept_reports = 256;      ///< of tasks submitted by service without waiting; the oldest go first
  double report_keep_s = 60.0;     ///< how long these can be asked for [s]
  int max_waiting_calls = 8;       ///< of SubmitTask and SubmitGraph at once; each has a thread
  double diagnostic_period = 1.0;  ///< [s]; the name is that of diagnostic_updater

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;

  /// As in the base; a default cache_folder means the one of this user.
  static RuntimeRosOptions fromParameters(const XmlRpc::XmlRpcValue& tree, const std::string& path,
                                          std::vector<std::string>* unknown);
  XmlRpc::XmlRpcValue toParameters() const;
};

}  // namespace pi_runtime

extern template struct pi_node::NodeParameters<pi_runtime::RuntimeRosOptions>;
