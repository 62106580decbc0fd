#pragma once

#include "policies/admission.h"
#include "engine/node.h"
#include "wire/sp_socket.h"
#include "wire/wire_message.h"

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>

namespace pi_offload
{

/// Does one task. Called from one thread, one task after the other. Fills status, text and the result of the reply; the
/// rest is the server's, the model too where the executor leaves it empty. What it throws becomes a reply FAILED with
/// that text.
/// @param service_s  in: negative; out: the time it took, where that is another one than that of the call [s].
using Executor = std::function<OffloadReply(const OffloadRequest& request, double* service_s)>;
/// Makes an executor; called once for each worker, in the constructor of the server. May throw.
using ExecutorFactory = std::function<Executor()>;

struct EdgeServerOptions
{
  SpReplier::Options replier;  ///< address and limits of the connections
  AdmissionOptions admission;  ///< `workers` and the queue; `served` follows from the executors
  std::string model;           ///< network that DETECTION is done with, told in every reply; empty: not told
  bool has_position = false;   ///< the position is told to the vehicles
  Point position;              ///< in the map [m]
  double range_m = 0.0;        ///< of the node's network [m]; infinite: everywhere
  size_t max_payload_bytes = 256U << 20U;  ///< of all tasks queued and running; further ones are refused
  double max_task_s = 30.0;  ///< a worker that takes longer for a task hangs: the server is not live any more

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
};

/// An edge-cloud node without ROS: takes requests of vehicles, lets Admission decide, does tasks on worker threads, and
/// tells with each reply how busy it is. It keeps nothing of a vehicle but its leases: one may be replaced by another
/// at any time.
///
/// - PROBE is answered at once. TASK is answered when it is done, or at once if it is refused. A TASK that came already
///   on its connection (a repeated one) is done once, and answered to the later.
/// - CANCEL is answered at once (OK; the text says what was done); the task that it names is not answered.
/// - What a request took longer on its way than the fastest one of its connection lately counts as passed of its time.
/// - A connection that ends takes its vehicles' tasks and leases with it, unless they have another one.
/// - Who sends what is no request is disconnected.
///
/// Thread safe.
class EdgeServer
{
public:
  struct Callbacks
  {
    /// Something for the log: bad requests, failed tasks. From any thread, may be null, must not throw.
    std::function<void(const std::string& text)> event;
  };
  /// Makes the executors, then listens.
  /// @param executors  by kind; null: not served. At least one.
  /// @throws std::invalid_argument for options, std::runtime_error naming the address, or what an executor's factory
  ///   threw with kind and worker.
  EdgeServer(const EdgeServerOptions& options, const std::array<ExecutorFactory, TASK_KINDS>& executors,
             Callbacks callbacks = {});
  ~EdgeServer();  ///< Waits for the tasks that run; queued ones are not answered. See drain().
  EdgeServer(const EdgeServer&) = delete;
  EdgeServer& operator=(const EdgeServer&) = delete;

  uint16_t port() const;

  /// Takes no more tasks: they are refused, and advertisements say so. What was taken is done and answered.
  /// @return true when that is so; false: not in time, call it again or end.
  bool drain(double timeout_s);

  struct Health
  {
    bool live = false;   ///< no worker hangs
    bool ready = false;  ///< live, and takes tasks
  };
  Health health() const;

  struct Statistics
  {
    struct OfKind
    {
      bool served = false;
      uint64_t done = 0;
      uint64_t failed = 0;
      double service_s = 0.0;  ///< mean of late
    };
    std::array<OfKind, TASK_KINDS> of_kind;
    uint64_t probes = 0;
    uint64_t cancelled = 0;   ///< tasks
    uint64_t repeated = 0;    ///< tasks that came twice
    uint64_t malformed = 0;   ///< messages that were no request
    uint64_t unanswered = 0;  ///< replies for connections that had ended
    Admission::Totals admission;
    size_t connections = 0;
    size_t vehicles = 0;
    size_t queued = 0;
    size_t running = 0;
    int workers = 0;
    bool draining = false;
  };
  Statistics statistics() const;

private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// As Prometheus reads it, text format 0.0.4.
std::string prometheusText(const EdgeServer::Statistics& statistics, const EdgeServer::Health& health);

}  // namespace pi_offload
